"""Strong sources of a light probe, extracted as discs: a window, a lamp, the sun cast shadows, a sky does not.

Galileo's Tomb has a third of its light in a thousandth of the sphere. Light in spherical harmonics casts no such
shadows, so `extract_sources` cuts these regions out as discs of the same direction and irradiance, and fills the holes
with the level around them. Sources and remainder together are the light of the probe: the difference between a disc and
the shape of its region stays in the spherical harmonics of the remainder.
This module DOES NOT cast shadows, rotate or scale, or approximate large areas by many lamps.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label, sum_labels
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from milkglass.core.arrays import Array
from milkglass.core.light.harmonics import basis, zonal_coefficients
from milkglass.core.light.maps import Radiance, latlong_to_direction, texel_solid_angles
from milkglass.core.light.probe import SH_ORDER, Probe

MAX_SOURCES = 8  # each costs a shadow map and, with transport `diffusion`, an entering light
BRIGHT_RATIO = (
    16.0  # times the mean luminance: the sky of Uffizi reaches 15.6, the windows of Galileo's Tomb begin there
)
MIN_SHARE = 0.02  # of the light of the probe: weaker sources are not worth a shadow
MAX_ANGLE_DEG = 25.0  # diameter; larger ones cast no shadow that a smooth environment could not
MIN_COVERAGE = 0.4  # of a disc, by neighbours such as panes of one window, to become one source
LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
_MAX_CANDIDATES = 64  # regions considered, the strongest
_RING = 1.5, 3.0  # the surround of a source reaches 1.5 times its radius, and 3 degrees more

Bool = npt.NDArray[np.bool_]
Texels = npt.NDArray[np.intp]  # indices into a map, row by row


@dataclass(frozen=True)
class ProbeSource:
    """A distant disc of constant radiance.

    Attributes
    ----------
    direction : 3 floats
        Unit, towards its centre, in the probe's frame.
    irradiance : 3 floats
        R, G, B on a surface that faces it; unit of radiance x sr.
    angle_deg : float
        Angular diameter, > 0.
    """

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]
    angle_deg: float


def extract_sources(probe: Probe) -> tuple[tuple[ProbeSource, ...], Probe]:
    """Return the small strong sources of a probe, and the probe without them.

    Returns
    -------
    sources : tuple of ProbeSource
        The strongest first, at most MAX_SOURCES.
    remainder : Probe
        The probe without them, or the probe itself if there are none. In `latlong` the holes are filled with the level
        around them; `sh` is that of the probe less that of the discs.
    """
    luminance = probe.latlong @ LUMINANCE_WEIGHTS.astype(np.float32)
    rows = texel_solid_angles(probe.latlong)
    total = float(rows @ luminance.sum(axis=1, dtype=np.float64))
    bright = luminance * (4.0 * np.pi) > BRIGHT_RATIO * total
    if not bright.any():
        return (), probe
    remainder = probe.latlong.copy().reshape(-1, 3)
    found = []
    for texels in _clusters(bright, luminance, rows):
        towards, d_omega = _directions(texels, bright.shape, rows)
        surround = _surround(towards, ~bright, probe.latlong)
        excess = np.maximum(remainder[texels] - surround, 0.0) * d_omega[:, None]  # flux of each texel, RGB
        source, share = _disc(towards, excess, total)
        if share >= MIN_SHARE and source.angle_deg <= MAX_ANGLE_DEG:
            found.append((share, source, texels, surround))
    found = sorted(found, key=lambda entry: -entry[0])[:MAX_SOURCES]
    if not found:
        return (), probe
    for _, _, texels, surround in found:
        remainder[texels] = np.minimum(remainder[texels], surround)
    sources = tuple(entry[1] for entry in found)
    sh = probe.sh - np.sum([disc_sh(source, SH_ORDER) for source in sources], axis=0)
    return sources, Probe(remainder.reshape(probe.latlong.shape), sh)


def disc_sh(source: ProbeSource, order: int) -> Array:
    """Return spherical-harmonic coefficients of a source, ((order + 1)^2, 3) float64: radiance x sr, as `Probe.sh`."""
    cosine_at_rim = np.cos(0.5 * np.radians(source.angle_deg))
    nodes, weights = np.polynomial.legendre.leggauss(32)
    mu = 1.0 - 0.5 * (1.0 - cosine_at_rim) * (1.0 - nodes)
    # The radiance of a cap of irradiance 1 is 1 / (pi sin^2 a).
    radiance = 1.0 / (np.pi * (1.0 - cosine_at_rim**2))
    zonal = zonal_coefficients(mu, 0.5 * (1.0 - cosine_at_rim) * weights * radiance, order)
    band = np.repeat(np.arange(order + 1), 2 * np.arange(order + 1) + 1)
    return np.outer(zonal[band] * basis(np.array([source.direction]), order)[0], source.irradiance)


def _clusters(bright: Bool, luminance: Radiance, rows: Array) -> list[Texels]:
    """Return the texels of each candidate: connected regions, with neighbours merged."""
    regions = _regions(bright)
    flux = luminance * rows[:, None]
    share = sum_labels(flux, regions, np.arange(1, int(regions.max()) + 1)) / flux.sum()
    strongest = np.argsort(-share)[:_MAX_CANDIDATES]
    strongest = strongest[share[strongest] >= 0.05 * MIN_SHARE]
    clusters = [np.flatnonzero(regions == region + 1) for region in strongest]
    # Vector, flux and solid angle of each, which are additive.
    sums = []
    for texels in clusters:
        towards, d_omega = _directions(texels, bright.shape, rows)
        cluster_flux = flux.ravel()[texels].astype(np.float64)
        sums.append(np.array([*(cluster_flux @ towards), cluster_flux.sum(), d_omega.sum()]))
    i = 0
    while i < len(clusters):  # the strongest first, merged with all that fill a disc with it
        for j in range(i + 1, len(clusters)):
            if _is_disc(sums[i] + sums[j]):
                clusters[i] = np.concatenate([clusters[i], clusters.pop(j)])
                sums[i] = sums[i] + sums.pop(j)
                break
        else:
            i += 1
    return clusters


def _is_disc(total: Array) -> bool:
    """Return whether regions with this sum of vectors (3), flux and solid angle make one source."""
    angle = _diameter_deg(total[:3], float(total[3]))
    disc_angle = 2.0 * np.pi * (1.0 - np.cos(0.5 * np.radians(angle)))
    return bool(angle <= MAX_ANGLE_DEG and total[4] >= MIN_COVERAGE * disc_angle)


def _regions(bright: Bool) -> npt.NDArray[np.intp]:
    """Return labels of connected texels from 1 on, across the seam and over the poles; 0 where not bright."""
    labels, count = label(bright, np.ones((3, 3)))
    left, right = labels[:, 0], labels[:, -1]
    pairs = [np.stack([left, np.roll(right, shift)]) for shift in (-1, 0, 1)]
    # A roll moves the top row to the bottom, from pole to pole, which would join two sources, one at each.
    pairs[0][:, -1], pairs[2][:, 0] = 0, 0
    for row in (labels[0], labels[-1]):
        touching = np.unique(row[row > 0])
        pairs.append(np.stack([touching[:-1], touching[1:]]))
    edges = np.concatenate(pairs, axis=1)
    edges = edges[:, (edges > 0).all(axis=0)]
    graph = coo_array((np.ones(edges.shape[1]), (edges[0], edges[1])), shape=(count + 1, count + 1))
    merged = connected_components(graph, directed=False)[1]
    return np.asarray(merged[labels], np.intp)  # label 0 comes first and has no edge, so it stays 0


def _directions(texels: Texels, shape: tuple[int, int], rows: Array) -> tuple[Array, Array]:
    """Return directions (n, 3) and solid angles (n,) of texels."""
    row, column = np.divmod(texels, shape[1])
    uv = np.stack([(column + 0.5) / shape[1], (row + 0.5) / shape[0]], axis=-1)
    return latlong_to_direction(uv), rows[row]


def _surround(towards: Array, dark: Bool, latlong: Radiance) -> Radiance:
    """Return the median radiance (3,) around texels in directions (n, 3)."""
    centre = towards.mean(axis=0)
    centre /= max(float(np.linalg.norm(centre)), 1e-12)
    radius = float(np.arccos(np.clip((towards @ centre).min(), -1.0, 1.0)))
    reach = min(_RING[0] * radius + np.radians(_RING[1]), np.pi)
    height, width = dark.shape
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    cosine = np.outer(np.sin(theta), centre[0] * np.sin(phi) - centre[2] * np.cos(phi))
    cosine += (centre[1] * np.cos(theta))[:, None]
    near = (cosine > np.cos(reach)) & dark
    return np.asarray(np.median(latlong[near], axis=0) if near.any() else np.zeros(3), np.float32)


def _disc(directions: Array, flux: Array, total: float) -> tuple[ProbeSource, float]:
    """Return the disc of the flux (n, 3), mean direction and spread of texels, and its share of the total light."""
    luminance = flux @ LUMINANCE_WEIGHTS
    vector, total_luminance = luminance @ directions, float(luminance.sum())
    length = float(np.linalg.norm(vector))
    towards = vector / max(length, 1e-300)
    x, y, z = towards.tolist()
    red, green, blue = np.maximum(flux.T @ (directions @ towards), 0.0).tolist()
    return ProbeSource((x, y, z), (red, green, blue), _diameter_deg(vector, total_luminance)), total_luminance / total


def _diameter_deg(vector: Array, flux: float) -> float:
    """Return the angular diameter of the disc whose mean direction is as short as `vector` (3,) over `flux`.

    Over a spherical cap of half angle a, directions average to a vector of length (1 + cos a) / 2.
    """
    length = min(float(np.linalg.norm(vector)) / max(flux, 1e-300), 1.0)
    # At least a hundredth of a degree, well below the size of a texel in the largest map.
    return max(2.0 * float(np.degrees(np.arccos(max(2.0 * length - 1.0, -1.0)))), 0.01)
