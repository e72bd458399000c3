"""Light that leaves beside a concave edge: its last flight, from where it scattered last, is followed.

Over a flat surface fluence grows evenly with depth, and what arrives from there is M = phi / (2 A). Where a wall meets
a floor it does not. A place on either sees the half of the object that is behind its own face: light that comes up
through a floor leaves by it, and passes along the wall. Diffusion has nearly the same phi, and so M, on both sides of
the edge, 20 % too much on the wall and 15 % too little on the floor. There M is

    <F_t(mu) int ds exp(-s) a' phi(x + s w)> / 4 + M_1,

the mean over directions w inwards with a density mu / pi, s in mean free paths, phi inside as pixels have it, and M_1,
the light that has scattered but once, that of a half space. It is scaled so that in all no more leaves than before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.normals import across
from milkglass.core.material import fresnel
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.edges.ramps import rising
from milkglass.core.transport.diffusion.entry import Entry, first_sources
from milkglass.core.transport.diffusion.green import local_green, local_slope

Ints = npt.NDArray[np.intp]

LIMITS = CONSTANTS.last_flight
AZIMUTHS = 6  # of the directions that are followed back from a patch
TABLE_WIDTHS, TABLE_SIZE = 8.0, 512  # of local parts of G: widths of the window that it reaches, and its entries


@dataclass(frozen=True, eq=False)
class LastFlight:
    """Where light that leaves at k patches scattered last, at m places each.

    Attributes
    ----------
    patches : (k,) int
    share : (k,) float64
        How far each is beside an edge, in [0, 1].
    areas : (k,) float64
        mm^2.
    places : (3, k * m) float64
        Grid coordinates z, y, x.
    shares : (k, m) float64
        Of O there, in M.
    own : (k,) float64
        Of the patch's 2 A M, in M: what the nodes are too coarse for.
    given : (k,) float64
        The same of light that enters there, with M_1.
    """

    patches: Ints
    share: Array
    areas: Array
    places: Array
    shares: Array
    own: Array
    given: Array

    def exitance(self, fluence: Array, volume: Float32) -> Array:
        """M, (k,), not scaled yet, for 2 A M of all patches and O at the nodes."""
        # Quadratic B-splines, with which patches gather too.
        seen = map_coordinates(volume, self.places, np.float64, order=2, mode="nearest", prefilter=False)
        flown = np.einsum("ij,ij->i", self.shares, seen.reshape(self.shares.shape))
        return np.asarray(np.maximum(flown + self.own * fluence[self.patches] + self.given, 0.0))

    def turned(self, fluence: Array, volume: Float32, extrapolation_factor: float) -> Array:
        """What is to be added to 2 A M of all patches, (n,): in all, none."""
        before, flown = fluence[self.patches], 2.0 * extrapolation_factor * self.exitance(fluence, volume)
        counts = self.share * self.areas
        total, leaving = float(counts @ flown), max(float(counts @ before), 0.0)
        added = np.zeros(len(fluence))
        if total > 0.0:
            added[self.patches] = self.share * (flown * (leaving / total) - before)
        return added


def last_flight(
    boundary: Boundary, depths: Depths, medium: Medium, s: float, entries: Sequence[Entry], channel: int, kept: Array
) -> LastFlight | None:
    """Follow one channel of all lights back from beside concave edges; None where there are none.

    `s` is the window's width, mm, and `kept` the share of each patch's light that diffuses, (n,).
    """
    share = _beside(boundary, medium.mean_free_path)
    share *= rising(share.mean(), LIMITS.least_share, LIMITS.full_share)
    chosen = np.flatnonzero(share > 0.0)
    if not len(chosen):
        return None
    places, shares, below = _places(boundary, depths, medium, chosen)
    e = TABLE_WIDTHS * s * np.linspace(0.0, 1.0, TABLE_SIZE)
    green, slope = local_green(medium, s, e), local_slope(medium, s, e)
    coarse = np.interp(below, e, green, right=0.0) / (2.0 * medium.extrapolation_factor)
    coarse += boundary.bending(medium)[chosen, None] * np.interp(below, e, slope, right=0.0)
    areas, given = boundary.patches.areas[chosen], np.zeros(len(chosen))
    for entry in entries:
        _, lit, of = np.intersect1d(chosen, entry.patches, assume_unique=True, return_indices=True)
        depth, strength = (each[of] for each in first_sources(entry, medium, channel, kept))
        strength /= areas[lit, None]
        for node in range(2):
            apart = np.abs(below[lit] - (depth[:, node] * entry.cosines[of])[:, None])
            given[lit] += strength[:, node] * np.sum(shares[lit] * np.interp(apart, e, green, right=0.0), axis=1)
        given[lit] += strength.sum(axis=1) * once(medium.eta, entry.cosines[of])
    return LastFlight(chosen, share[chosen], areas, places, shares, -np.sum(shares * coarse, axis=1), given)


def once(eta: float, cosines: Array) -> Array:
    """M_1 over a' E in a half space, for rays inside of cosines c, (n,): int F_t(mu) mu / (mu + c) dmu / 2."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    outside = 0.5 * (nodes + 1.0)  # mu out there: below the critical angle nothing leaves
    mu = np.sqrt(1.0 - (1.0 - np.square(outside)) / eta**2)
    leaves = 0.25 * weights * outside / eta**2 * fresnel.transmittance(eta, outside)
    return np.asarray(np.sum(leaves / (mu + np.maximum(cosines, 0.0)[:, None]), axis=1))


def _beside(boundary: Boundary, far: float) -> Array:
    """How far each patch is beside a concave edge of faces, (n,), for a mean free path `far`."""
    width = min(LIMITS.width * far, float(boundary.curvature.widths[-1]))
    concave = np.sqrt(2.0 * np.pi) * width * boundary.curvature.at(width)[2]
    share = rising(concave, LIMITS.flat_turn, LIMITS.sharp_turn)
    _, convex, _ = boundary.curvature.at(CONSTANTS.curvature.width * far)
    share *= np.clip(1.0 - far / LIMITS.convex_limit * convex, 0.0, 1.0)
    share *= rising(boundary.curvature.evenness, LIMITS.rough_evenness, LIMITS.even_evenness)
    nowhere = boundary.is_sheet | (boundary.patches.areas == 0.0)
    return np.asarray(boundary.edges.shown(far) * np.where(nowhere, 0.0, share))


def _places(boundary: Boundary, depths: Depths, medium: Medium, chosen: Ints) -> tuple[Array, Array, Array]:
    """Grid coordinates of places of last scattering, (3, k * m), shares of O there and depths under the face, mm.

    Ways leave under 45 degrees outside, where half of the light is on either side; more angles change nothing.
    """
    patches, cell, far = boundary.patches, boundary.grid.texel, medium.mean_free_path
    normals, starts = patches.face_normals[chosen], patches.on_surface[chosen]
    first, second = across(normals)
    mu = np.sqrt(1.0 - 0.5 / medium.eta**2)
    leaves = float(fresnel.transmittance(medium.eta, np.sqrt(0.5))) / medium.eta**2
    points, shares, below = [], [], []
    for turn in 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS:
        side = np.cos(turn) * first + np.sin(turn) * second
        way = np.sqrt(1.0 - mu * mu) * side - mu * normals
        depth, share = first_scattering(depths.ends(patches, chosen, way, cell)[0] / far)
        for node in range(2):
            points.append(starts + far * depth[:, node, None] * way)
            shares.append(0.25 * medium.albedo * leaves / AZIMUTHS * share[:, node])
            below.append(far * mu * depth[:, node])
    at = boundary.grid.coordinates(np.stack(points, axis=1).reshape(-1, 3))
    return np.ascontiguousarray(at[:, ::-1].T), np.stack(shares, axis=1), np.stack(below, axis=1)
