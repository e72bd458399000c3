"""Mean curvature of a surface in patches, smoothed along the surface to the scale of a mean free path.

2 H is the least-squares slope of the normal n over neighbours x_j, 2 sum w dx . dn / sum w |dx|^2; weights are areas
times the likeness of normals, so that the two sides of a thin slab are surfaces apart. An edge has the curvature of the
angle that turns over it within a patch or two. Repeated averages over the neighbours smooth it, as diffusion would.
"""

import functools
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.edges.ramps import rising
from milkglass.core.transport.diffusion.patches import Patches

LIMITS = CONSTANTS.curvature
NEIGHBOURS = 10  # of a patch, itself included
DOUBLINGS = 6  # of the smoothing's variance: its width grows to 8 patches


@dataclass(frozen=True, eq=False)
class Curvature:
    """Curvature of n patches, smoothed to m widths.

    Attributes
    ----------
    widths : (m,) float64
        Standard deviations along the surface, mm, ascending.
    values : (m, n, 3) float64
        Sum of the two principal curvatures, 2 H, 1/mm, above 0 where the surface is convex; then the parts of it that
        convex and that concave edges make, both >= 0.
    evenness : (n,) float64
        Mean cosine between a patch's normal and those around it on the same face: 0.93 on a scan's bumps, 1 if flat.
    """

    widths: Array
    values: Array
    evenness: Array

    def at(self, width: float) -> tuple[Array, Array, Array]:
        """Return 2 H, its convex and its concave edges, 1/mm, (n,) each, at `width`, mm, clamped to `widths`."""
        i = int(np.clip(np.searchsorted(self.widths, width), 1, len(self.widths) - 1))
        low, high = self.widths[i - 1], self.widths[i]
        share = float(np.clip((width - low) / (high - low), 0.0, 1.0)) if high > low else 0.0
        total, convex, concave = ((1.0 - share) * self.values[i - 1] + share * self.values[i]).T
        return total, convex, concave


def curvature(patches: Patches) -> Curvature:
    """Return the curvature of patches, measured between neighbours and smoothed to widths of up to eight patches."""
    n = len(patches)
    spacing = float(np.sqrt(patches.areas.mean()))
    count = min(NEIGHBOURS, n)
    places = np.hstack([patches.points, LIMITS.normal_separation / np.sqrt(2.0) * spacing * patches.normals])
    neighbours = cKDTree(places).query(places, count)[1].reshape(n, count)
    step = patches.points[neighbours] - patches.points[:, None]
    turn = patches.normals[neighbours] - patches.normals[:, None]
    along, turned = np.einsum("ijk,ijk->ij", step, step), np.einsum("ijk,ijk->ij", turn, turn)
    alike = np.maximum(1.0 - 0.25 * turned, 0.0)
    face = turned < 2.0 - 2.0 * LIMITS.same_face_cosine
    evenness = 1.0 - 0.5 * np.sum(turned * face, axis=1) / np.sum(face, axis=1)
    weights = alike * patches.areas[neighbours]
    bent = np.sum(weights * np.einsum("ijk,ijk->ij", step, turn), axis=1)
    value = 2.0 * bent / np.maximum(np.sum(weights * along, axis=1), np.finfo(np.float64).tiny)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny)
    rows = np.arange(0, n * count + 1, count)
    smoother = csr_array((weights.ravel(), neighbours.ravel(), rows), shape=(n, n))
    variance = 0.5 * float(np.average(np.sum(weights * along, axis=1), weights=patches.areas))
    edge = value * rising(np.abs(value) * spacing, LIMITS.smooth_turn, LIMITS.edge_turn)
    values = [smoother @ np.stack([value, np.maximum(edge, 0.0), np.maximum(-edge, 0.0)], axis=-1)]
    for i in range(DOUBLINGS):
        values.append(functools.reduce(lambda v, _: smoother @ v, range(2**i), values[-1]))
    return Curvature(np.sqrt(variance * 2.0 ** np.arange(DOUBLINGS + 1)), np.stack(values), evenness)
