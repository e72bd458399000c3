"""Tables of light that scatters once in a wedge: it enters by one face and leaves by the other. Exact, no fit.

Lengths in mean free paths. The lit face lies at height 0 and ends at the edge, the origin; the direction (1, 0) leads
over it. Light of irradiance 1 that entered at distance d first scatters at y = (-d + z v, -z sqrt(1 - v^2)), along its
ray, with a density exp(-z); a point at distance p from the edge on the other face, whose normal is (sin a, cos a), sees
that through r^2 = |x - y|^2 + l^2, l along the edge, under a cosine mu = h / r to its normal:

    K(d, p) = int dz exp(-z) int dl exp(-r) F_t(mu) mu / (4 pi r^2).

Its integral over d is the exitance at p, its integral over p the share of the light that leaves by the other face.
"""

import functools
import threading
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.transport.diffusion.constants import CONSTANTS

LARGEST_DISTANCE = 4.0  # from the edge, mean free paths; beyond, exp(-4) of the light is left
ETA_STEP = 0.1  # between indices of refraction that have tables
DISTANCES = 20  # of the tables, even in sqrt(distance)
ANGLES, NODES = 20, 16  # Gauss nodes in angle, and in length
# Between the faces' normals: of all that are an edge.
COSINES = np.linspace(CONSTANTS.edges.opposite_cosine, CONSTANTS.curvature.same_face_cosine, 9)
SLOPES = np.linspace(-0.9, 0.9, 13)  # v: of the ray over the edge, inside
RADII, HEIGHTS = 48, 65  # rows and columns of the table of the integral along the edge
_TABULATING = threading.Lock()


@dataclass(frozen=True, eq=False)
class Wedge:
    """Tables over cosine, slope and sqrt(distance) of an index of refraction.

    Attributes
    ----------
    exitance : (9, 13, DISTANCES) float64
        Of the other face, for an irradiance that has entered, and an albedo, of 1.
    lost : (9, 13, DISTANCES) float64
        Share of the light that enters which leaves by the other face.
    """

    exitance: Array
    lost: Array


def look_up(table: Array, cosine: Array, slope: Array, distance: Array) -> Array:
    """Return a table of a `Wedge` at cosines between normals, slopes v and distances in mean free paths, (n,) each."""
    at = np.stack(
        [
            (cosine - COSINES[0]) / (COSINES[1] - COSINES[0]),
            (slope - SLOPES[0]) / (SLOPES[1] - SLOPES[0]),
            np.sqrt(np.maximum(distance, 0.0) / LARGEST_DISTANCE) * (DISTANCES - 1),
        ]
    )
    return np.asarray(map_coordinates(table, at, order=1, mode="nearest"))


def wedge(eta: float) -> Wedge:
    """Return the tables for an index of refraction >= 1, interpolated between multiples of `ETA_STEP`."""
    at = (eta - 1.0) / ETA_STEP
    low = int(at + 1e-6)
    share = at - low
    with _TABULATING:  # channels ask at once
        first = _tabulated(low)
        if share < 1e-6:
            return first
        second = _tabulated(low + 1)
    mixed = (a + share * (b - a) for a, b in ((first.exitance, second.exitance), (first.lost, second.lost)))
    return Wedge(*mixed)


@functools.lru_cache(maxsize=32)
def _tabulated(step: int) -> Wedge:
    distance = LARGEST_DISTANCE * np.linspace(0.0, 1.0, DISTANCES) ** 2
    table = _along_edge(1.0 + ETA_STEP * step)
    angle, angle_weights = _gauss(-0.5 * np.pi, 0.5 * np.pi, ANGLES)
    u, u_weights = _gauss(0.0, 1.0, NODES)
    rho = LARGEST_DISTANCE * u**2  # close where the integrand is steep
    weights = angle_weights[:, None] * 2.0 * LARGEST_DISTANCE * u * u_weights
    density = weights * _looked_up(table, rho, np.cos(angle)[:, None])
    faces = [[(cosine, slope) for slope in SLOPES] for cosine in COSINES]
    exitance = [[_exitance(distance, *face, angle[:, None], rho, density) for face in row] for row in faces]
    lost = [[_lost(distance, *face, angle[:, None], rho, weights, table) for face in row] for row in faces]
    return Wedge(np.array(exitance), np.array(lost))


def _exitance(distance: Array, cosine: float, slope: float, angle: Array, rho: Array, density: Array) -> Array:
    """Return the exitance, (DISTANCES,): the integral in polar coordinates around x, where nothing is singular."""
    place, sine, down = distance[:, None, None], np.sqrt(1.0 - cosine**2), np.sqrt(1.0 - slope**2)
    # From x against the normal, turned by the angle.
    across, up = -sine * np.cos(angle) - cosine * np.sin(angle), -cosine * np.cos(angle) + sine * np.sin(angle)
    z = (sine * place - rho * up) / down
    d = z * slope - rho * across - cosine * place
    inside = (z > 0.0) & (d > 0.0)
    return np.asarray(np.sum(density * np.where(inside, np.exp(-np.maximum(z, 0.0)), 0.0), axis=(1, 2)) / down)


def _lost(distance: Array, cosine: float, slope: float, angle: Array, z: Array, weights: Array, table: Array) -> Array:
    """Return the lost share, (DISTANCES,): the integral over the ray and the angles to the other face from it."""
    place, sine, down = distance[:, None, None], np.sqrt(1.0 - cosine**2), np.sqrt(1.0 - slope**2)
    height = sine * (place - z * slope) + cosine * z * down  # of the other face over y
    p = cosine * (z * slope - place) + sine * z * down + np.tan(angle) * height
    density = np.exp(-z) * _looked_up(table, height / np.cos(angle), np.cos(angle)) / np.cos(angle)
    return np.asarray(np.sum(weights * np.where((height > 0.0) & (p > 0.0), density, 0.0), axis=(1, 2)))


def _along_edge(eta: float) -> Array:
    """Return rho int dl exp(-r) F_t(mu) mu / (4 pi r^2), r^2 = rho^2 + l^2, over sqrt(rho) and h / rho."""
    rho = LARGEST_DISTANCE * np.linspace(0.0, 1.0, RADII)[:, None, None] ** 2
    height = np.linspace(0.0, 1.0, HEIGHTS)[:, None]
    angle, weights = _gauss(0.0, 0.5 * np.pi, NODES)  # l = rho tan(angle), both ways
    mu = height * np.cos(angle)
    leaves = mu * fresnel.transmittance(1.0 / eta, mu)
    return np.asarray(np.sum(2.0 * weights * np.exp(-rho / np.cos(angle)) * leaves, axis=-1) / (4.0 * np.pi))


def _looked_up(table: Array, rho: Array, cosine: Array) -> Array:
    rows = np.sqrt(np.clip(rho / LARGEST_DISTANCE, 0.0, 1.0)) * (RADII - 1)
    at = np.stack(np.broadcast_arrays(rows, cosine * (HEIGHTS - 1)))
    return np.asarray(map_coordinates(table, at, order=1))


def _gauss(low: float, high: float, n: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return low + 0.5 * (high - low) * (nodes + 1.0), 0.5 * (high - low) * weights
