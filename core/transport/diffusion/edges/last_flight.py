"""Exitance beside a concave edge, from the light's last flight: from its last scattering to the surface.

Over a flat surface fluence grows evenly with depth, and what arrives from there is M = phi / (2 A). Where a wall meets
a floor it does not. A point of either sees the half of the object that is behind its face: light that comes up through
a floor leaves by it, and passes along the wall. Diffusion has nearly the same phi, and so M, on both sides of the edge,
20 % too much on the wall and 15 % too little on the floor. There M is

    <F_t(mu) int ds exp(-s) a' phi(x + s w)> / 4 + M_1,

the mean over directions w inwards with a density mu / pi, s in mean free paths, phi inside as pixels have it, and M_1,
the light that has scattered once only, that of a half space. It is scaled so that in all as much leaves as before.
Which patches are beside an edge is decided by thresholds chosen by hand (`core.transport.diffusion.constants`).
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
from milkglass.core.transport.diffusion.green import LocalParts

Ints = npt.NDArray[np.intp]

LIMITS = CONSTANTS.last_flight
AZIMUTHS = 6  # of the directions that are followed back from a patch


@dataclass(frozen=True, eq=False)
class LastFlight:
    """Points of last scattering, m for each of k patches beside concave edges, and weights that turn O there to M.

    Attributes
    ----------
    patches : (k,) int
        Indices of the patches.
    share : (k,) float64
        Share to which each is beside an edge, in [0, 1].
    areas : (k,) float64
        mm^2.
    points : (3, k * m) float64
        Points of last scattering, grid coordinates z, y, x.
    weights : (k, m) float64
        Of O at these points, in M.
    local : (k,) float64
        Weight of the patch's 2 A M in M, for what the nodes are too coarse for.
    entering : (k,) float64
        M of light that enters there: local part and M_1.
    """

    patches: Ints
    share: Array
    areas: Array
    points: Array
    weights: Array
    local: Array
    entering: Array

    def exitance(self, two_A_M: Array, volume: Float32) -> Array:
        """Return M of the k patches, not scaled yet, from 2 A M of all patches, (n,), and O at the nodes."""
        # Quadratic B-splines, with which patches gather too.
        values = map_coordinates(volume, self.points, np.float64, order=2, mode="nearest", prefilter=False)
        flown = np.einsum("ij,ij->i", self.weights, values.reshape(self.weights.shape))
        return np.asarray(np.maximum(flown + self.local * two_A_M[self.patches] + self.entering, 0.0))

    def correction(self, two_A_M: Array, volume: Float32, extrapolation_factor: float) -> Array:
        """Return what is added to 2 A M of all patches, (n,); its integral over the surface is 0."""
        before, flown = two_A_M[self.patches], 2.0 * extrapolation_factor * self.exitance(two_A_M, volume)
        counts = self.share * self.areas
        total, leaving = float(counts @ flown), max(float(counts @ before), 0.0)
        added = np.zeros(len(two_A_M))
        if total > 0.0:
            added[self.patches] = self.share * (flown * (leaving / total) - before)
        return added


def last_flight(
    boundary: Boundary,
    depths: Depths,
    medium: Medium,
    s: float,
    entries: Sequence[Entry],
    channel: int,
    retained: Array,
) -> LastFlight | None:
    """Return the last flight of one channel; None where no patch is beside a concave edge.

    `s` is the window's width, mm, and `retained` the share of each patch's light that diffuses, (n,).
    """
    share = _edge_shares(boundary, medium.mean_free_path)
    share *= rising(share.mean(), LIMITS.least_share, LIMITS.full_share)
    chosen = np.flatnonzero(share > 0.0)
    if not len(chosen):
        return None
    points, weights, below = _scattering_points(boundary, depths, medium, chosen)
    parts = LocalParts.of(medium, s)
    coarse = parts.green(below) / (2.0 * medium.extrapolation_factor)
    coarse += boundary.bending(medium)[chosen, None] * parts.slope(below)
    areas, entering = boundary.patches.areas[chosen], np.zeros(len(chosen))
    for entry in entries:
        _, lit, of = np.intersect1d(chosen, entry.patches, assume_unique=True, return_indices=True)
        depth, strength = (values[of] for values in first_sources(entry, medium, channel, retained))
        strength /= areas[lit, None]
        for node in range(2):
            distance = np.abs(below[lit] - (depth[:, node] * entry.cosines[of])[:, None])
            entering[lit] += strength[:, node] * np.sum(weights[lit] * parts.green(distance), axis=1)
        entering[lit] += strength.sum(axis=1) * scattered_once(medium.eta, entry.cosines[of])
    return LastFlight(chosen, share[chosen], areas, points, weights, -np.sum(weights * coarse, axis=1), entering)


def scattered_once(eta: float, cosines: Array) -> Array:
    """Return M_1 / (a' E) of a half space, int F_t(mu) mu / (mu + c) dmu / 2, for rays of cosines c inside, (n,)."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    outside = 0.5 * (nodes + 1.0)  # mu outside: below the critical angle nothing leaves
    mu = np.sqrt(1.0 - (1.0 - np.square(outside)) / eta**2)
    leaves = 0.25 * weights * outside / eta**2 * fresnel.transmittance(eta, outside)
    return np.asarray(np.sum(leaves / (mu + np.maximum(cosines, 0.0)[:, None]), axis=1))


def _edge_shares(boundary: Boundary, mfp: float) -> Array:
    """Return the share to which each patch is beside a concave edge of faces, (n,), for a mean free path in mm."""
    width = min(LIMITS.width * mfp, float(boundary.curvature.widths[-1]))
    concave = np.sqrt(2.0 * np.pi) * width * boundary.curvature.at(width)[2]
    share = rising(concave, LIMITS.flat_turn, LIMITS.sharp_turn)
    _, convex, _ = boundary.curvature.at(CONSTANTS.curvature.width * mfp)
    share *= np.clip(1.0 - mfp / LIMITS.convex_limit * convex, 0.0, 1.0)
    share *= rising(boundary.curvature.evenness, LIMITS.rough_evenness, LIMITS.even_evenness)
    nowhere = boundary.is_sheet | (boundary.patches.areas == 0.0)
    return np.asarray(boundary.edges.resolved(mfp) * np.where(nowhere, 0.0, share))


def _scattering_points(boundary: Boundary, depths: Depths, medium: Medium, chosen: Ints) -> tuple[Array, Array, Array]:
    """Return points of last scattering, grid coordinates (3, k * m), weights of O there and depths under the face, mm.

    All directions leave under 45 degrees outside, where half of the light is on either side; more change nothing.
    """
    patches, cell, mfp = boundary.patches, boundary.grid.texel, medium.mean_free_path
    normals, starts = patches.face_normals[chosen], patches.on_surface[chosen]
    first, second = across(normals)
    mu = np.sqrt(1.0 - 0.5 / medium.eta**2)
    leaves = float(fresnel.transmittance(medium.eta, np.sqrt(0.5))) / medium.eta**2
    points, weights, below = [], [], []
    for turn in 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS:
        side = np.cos(turn) * first + np.sin(turn) * second
        directions = np.sqrt(1.0 - mu * mu) * side - mu * normals
        depth, share = first_scattering(depths.ends(patches, chosen, directions, cell)[0] / mfp)
        for node in range(2):
            points.append(starts + mfp * depth[:, node, None] * directions)
            weights.append(0.25 * medium.albedo * leaves / AZIMUTHS * share[:, node])
            below.append(mfp * mu * depth[:, node])
    at = boundary.grid.coordinates(np.stack(points, axis=1).reshape(-1, 3))
    return np.ascontiguousarray(at[:, ::-1].T), np.stack(weights, axis=1), np.stack(below, axis=1)
