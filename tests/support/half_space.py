"""A half space under a pencil of light, for `reference.photons`: what leaves, in rings, is the profile itself.

The exitance that the walk tallies in a ring around the pencil, of a flux of 1, over the flux that entered is the mean
of R_d over the ring: what every profile is judged by, and what none of them is fitted to.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.reference.photon_shapes import Arrivals, Hits

_NOBODY = np.empty(0, np.int64)


class HalfSpace:
    """z > 0, lit along its normal at the origin; the last bin is all that lies beyond the rings.

    Parameters
    ----------
    edges : (n + 1,) array
        Radii of the rings, rising from 0, in the unit of 1 / sigma_t'.
    """

    def __init__(self, edges: npt.ArrayLike) -> None:
        self._edges = np.asarray(edges, np.float64)
        rises = self._edges.ndim == 1 and len(self._edges) > 1 and bool((np.diff(self._edges) > 0.0).all())
        if not rises or self._edges[0] != 0.0:
            raise InputError("the rings of a half space need radii that rise from 0.")
        self.areas: Array = np.append(np.pi * np.diff(np.square(self._edges)), np.inf)
        self.mean_chord, self.offset = np.inf, 0.0

    def arrivals(self, rng: np.random.Generator, n: int, towards: Array | None) -> Arrivals:
        """See `core.reference.photon_shapes.Shape.arrivals`; `towards` must be (0, 0, -1)."""
        if towards is None or towards[2] != -1.0:
            raise InputError("a half space is lit along its normal: the direction towards the light must be 0, 0, -1.")
        normals = np.zeros((3, n))
        normals[2] = -1.0
        bins, all_visible = np.zeros(n, np.int64), np.ones(n, np.bool_)
        return Arrivals(np.zeros((3, n)), normals, normals.copy(), bins, all_visible, np.ones(n), 1.0)

    def hits(self, position: Array, direction: Array, reach: Array) -> Hits:
        """See `core.reference.photon_shapes.Shape.hits`."""
        index = np.flatnonzero(position[2] + reach * direction[2] <= 0.0)
        start, onwards = position[:, index], direction[:, index]
        # A photon that has been reflected starts at z = 0 and leaves upwards at once only by rounding.
        points = start - onwards * (start[2] / np.minimum(onwards[2], -np.finfo(np.float64).tiny))
        points[2] = 0.0
        normals = np.zeros_like(points)
        normals[2] = -1.0
        bins = np.searchsorted(self._edges, np.hypot(points[0], points[1]), side="right") - 1
        return Hits(index, points, normals, bins, _NOBODY)
