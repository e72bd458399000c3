"""Edges of a surface, as pairs of a patch and a face that meets the patch's face: distance, angle and curvature.

Patches are gathered to pieces a mean free path wide. The plane of a piece stands for its face, so that the distance of
a patch from an edge follows from any piece of the other face, however the cells cut that.
"""

import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.special import erfc

from milkglass.core.arrays import Array
from milkglass.core.geometry.normals import unit
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.edges.ramps import falling, rising
from milkglass.core.transport.diffusion.patches import Patches, cells, octants

Ints = npt.NDArray[np.intp]

LIMITS = CONSTANTS.edges
SAME_FACE = CONSTANTS.curvature.same_face_cosine


@dataclass(frozen=True, eq=False)
class Pairs:
    """K pairs of a patch and a face beyond an edge; faces are sums over m pieces of n patches.

    Attributes
    ----------
    patch : (k,) int
        Index of the patch.
    pieces : (m, n) sparse float64
        Sums over the patches of each piece.
    areas : (m,) float64
        Of the pieces, mm^2.
    means : (k, m) sparse float64
        Means over the pieces of the other face, by area and nearness; rows sum to 1.
    normals : (k, 3) float64
        Unit, of the other face.
    distance : (k,) float64
        From the patch to the edge, mm.
    cosine : (k,) float64
        Between the two normals.
    share : (k,) float64
        Weight of the pair, >= 0; 1 for a straight edge between half planes.
    turn : (k,) float64
        Angle between the two normals, radians, divided among the pairs of one edge.
    """

    patch: Ints
    pieces: csr_array
    areas: Array
    means: csr_array
    normals: Array
    distance: Array
    cosine: Array
    share: Array
    turn: Array


class Edges:
    """The edges of a surface for any mean free path, found on demand and kept; safe to use in several threads.

    Parameters
    ----------
    patches : Patches, n of them
    thickness : (n,) float64
        See `core.transport.diffusion.boundary.Boundary`.
    plain : (n,) bool
        Patches that may be of a face with edges; only they are searched.
    """

    def __init__(self, patches: Patches, thickness: Array, plain: npt.NDArray[np.bool_]) -> None:
        self.patches, self._thickness, self._plain = patches, thickness, np.flatnonzero(plain)
        self.spacing = float(np.sqrt(patches.areas.mean()))
        self._found: dict[int, Pairs] = {}
        self._finding = threading.Lock()

    def pairs(self, mean_free_path: float) -> list[tuple[float, Pairs]]:
        """Return weights, which sum to 1 or less, and pairs for a mean free path, mm; empty where there are no edges.

        Pairs are found for powers of two, so that a slider meets kept ones, and mixed, so that pictures change evenly.
        """
        level = float(np.log2(mean_free_path))
        low = int(np.floor(level))
        mixed = [(1.0 - (level - low), low), (level - low, low + 1)]
        found = [(weight, self._at(power)) for weight, power in mixed if weight > 0.0 and len(self._plain)]
        return [
            (weight, pairs) for weight, pairs in found if pairs.share.sum() > LIMITS.least_pairs * len(self.patches)
        ]

    def resolved(self, mean_free_path: float) -> float:
        """Return the share, in [0, 1], to which patches resolve light beside edges, for a mean free path in mm."""
        return float(falling(self.spacing / mean_free_path, LIMITS.resolved_spacing, LIMITS.unresolved_spacing))

    def curvature(self, mean_free_path: float) -> Array:
        """Return the part of 2 H that convex edges make, of each patch, 1/mm, (n,) float64.

        The angle of an edge as a Gaussian of the distance from it.
        """
        found = np.zeros(len(self.patches))
        # Patches that are large against the strip do not resolve it.
        counts = float(np.clip(LIMITS.hidden_strip * mean_free_path / self.spacing - 1.0, 0.0, 1.0))
        if counts > 0.0:
            width = max(LIMITS.curvature_width * mean_free_path, 0.5 * self.spacing)
            for part, pairs in self.pairs(mean_free_path):
                bell = np.exp(-0.5 * np.square(pairs.distance / width)) / (np.sqrt(2.0 * np.pi) * width)
                found += counts * part * np.bincount(pairs.patch, pairs.turn * bell, len(found))
        return found

    def _at(self, level: int) -> Pairs:
        with self._finding:
            if level not in self._found:
                pieces = _gather(self.patches, self._plain, 2.0**level)
                self._found[level] = _pair(self.patches, self._thickness, self._plain, pieces, 2.0**level)
            return self._found[level]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """M pieces of the chosen patches.

    Attributes
    ----------
    of_patch : (chosen,) int
        Piece of each chosen patch.
    sums : (m, n) sparse float64
    areas, points, normals : (m,), (m, 3), (m, 3) float64
        mm^2, centres in mm, unit mean normals.
    counts : (m,) float64
        Share to which a piece is of a flat face that ends in an edge.
    """

    of_patch: Ints
    sums: csr_array
    areas: Array
    points: Array
    normals: Array
    counts: Array


def _gather(patches: Patches, chosen: Ints, mfp: float) -> _Pieces:
    """Return pieces: the chosen patches of a cell whose normals lie in one octant."""
    points, normals, areas = patches.on_surface[chosen], patches.face_normals[chosen], patches.areas[chosen]
    piece = np.unique(cells(points, normals, LIMITS.piece_size * mfp), return_inverse=True)[1]
    sums = csr_array((np.ones(len(chosen)), (piece, chosen)), shape=(int(piece.max()) + 1, len(patches)))
    of = sums[:, chosen]
    total = np.maximum(of @ areas, np.finfo(np.float64).tiny)
    centres, means = (of @ (areas[:, None] * points)) / total[:, None], unit(of @ (areas[:, None] * normals))
    evenness, sharpest = _faces(centres, means, mfp)
    turning = (LIMITS.round_turn * mfp - sharpest) / ((LIMITS.round_turn - LIMITS.sharp_turn) * mfp)
    edged = evenness * np.clip(turning, 0.0, 1.0)
    return _Pieces(piece, sums, total, centres, means, edged)


def _pair(patches: Patches, thickness: Array, chosen: Ints, pieces: _Pieces, mfp: float) -> Pairs:
    """Return pairs of patches with the pieces of other faces from which light may come."""
    near = np.flatnonzero(pieces.counts)
    edged = np.flatnonzero(pieces.counts[pieces.of_patch])
    points, normals = patches.on_surface[chosen[edged]], patches.face_normals[chosen[edged]]
    trees = cKDTree(points), cKDTree(pieces.points[near])
    found = trees[0].sparse_distance_matrix(trees[1], LIMITS.reach * mfp, output_type="ndarray")
    a, b, offset = found["i"], near[found["j"]], found["v"]
    cosine = np.einsum("ij,ij->i", normals[a], pieces.normals[b])
    meeting = np.flatnonzero((cosine < SAME_FACE) & (cosine > LIMITS.opposite_cosine))
    a, b, cosine, offset = a[meeting], b[meeting], cosine[meeting], offset[meeting]
    step = pieces.points[b] - points[a]
    below = np.einsum("ij,ij->i", step, pieces.normals[b])  # of the patch under the piece's plane
    under = -np.einsum("ij,ij->i", step, normals[a])  # of the piece under the patch's plane
    convex = (
        (below > -LIMITS.concave_tolerance * mfp)
        & (under > -LIMITS.concave_tolerance * mfp)
        & (under < thickness[chosen[edged]][a] + LIMITS.piece_size * mfp)
    )
    distance = np.maximum(below, 0.0) / np.sqrt(1.0 - cosine * cosine)
    share = falling(cosine, LIMITS.other_face_cosine, SAME_FACE)
    share *= rising(cosine, LIMITS.opposite_cosine, LIMITS.blade_cosine)
    share *= pieces.counts[pieces.of_patch[edged]][a] * pieces.counts[b]
    width = LIMITS.weight_width * mfp
    share *= pieces.areas[b] * np.exp(-np.square(offset / width)) / _half_plane(distance, cosine, width)
    weighted = np.flatnonzero(convex & (share > 0.0))
    a, b, share = a[weighted], b[weighted], share[weighted]
    # Pieces of one octant of normals are one face of a patch.
    key, pair = np.unique(8 * a.astype(np.int64) + octants(pieces.normals)[b], return_inverse=True)
    total = np.bincount(pair, share, len(key)).astype(np.float64)
    means = csr_array((share / total[pair], (pair, b)), shape=(len(key), len(pieces.areas)))
    beyond = unit(means @ pieces.normals)
    cosine = np.asarray(np.einsum("ij,ij->i", normals[key // 8], beyond), np.float64)
    distance = np.bincount(pair, share * distance[weighted], len(key)) / total
    turn = np.arccos(np.clip(cosine, -1.0, 1.0)) * _edge_fractions(key // 8, total, beyond)
    return Pairs(chosen[edged[key // 8]], pieces.sums, pieces.areas, means, beyond, distance, cosine, total, turn)


def _edge_fractions(patch: Ints, share: Array, normals: Array) -> Array:
    """Return the fraction of an edge that each pair stands for, (k,): a curved face has several pairs in one edge.

    Pairs of a patch whose normals are alike are of one edge, at right angles of two, as at a corner. `patch` ascends.
    An edge with less than `LIMITS.least_share` of its weight counts as one.
    """
    first = np.flatnonzero(np.diff(patch, prepend=-1))
    row = np.repeat(np.arange(len(first)), np.diff(first, append=len(patch)))
    slot = np.arange(len(patch)) - first[row]
    shares, directions = np.zeros((len(first), 8)), np.zeros((len(first), 8, 3))
    shares[row, slot], directions[row, slot] = share, normals
    alike = np.maximum(np.einsum("iaj,ibj->iab", directions, directions), 0.0)
    of_edge = np.einsum("iab,ib->ia", alike, shares)
    return np.asarray((shares / np.maximum(of_edge, LIMITS.least_share))[row, slot])


def _faces(points: Array, normals: Array, mfp: float) -> tuple[Array, Array]:
    """Return shares to which pieces are flat, in [0, 1], and the least length, mm, over which a near edge turns."""
    start, end, cosine = _neighbours(points, normals, LIMITS.round_turn * mfp)
    n, coplanar = len(points), cosine > SAME_FACE
    alike = np.bincount(start[coplanar], cosine[coplanar], n) / np.maximum(np.bincount(start[coplanar], minlength=n), 1)
    turned = np.flatnonzero(~coplanar & (cosine > LIMITS.opposite_cosine))
    turn = np.full(n, np.inf)
    np.minimum.at(turn, start[turned], np.linalg.norm(points[end[turned]] - points[start[turned]], axis=1))
    sharpest = turn.copy()
    sharp = np.flatnonzero(turn < LIMITS.round_turn * mfp)
    if len(sharp):
        near = cKDTree(points).sparse_distance_matrix(cKDTree(points[sharp]), LIMITS.reach * mfp, output_type="ndarray")
        np.minimum.at(sharpest, near["i"], turn[sharp[near["j"]]])
    return rising(alike, LIMITS.rough_evenness, LIMITS.flat_evenness), sharpest


def _neighbours(points: Array, normals: Array, reach: float) -> tuple[Ints, Ints, Array]:
    """Return all ordered pairs no further apart than `reach`, mm, and the cosines between their normals."""
    near = cKDTree(points).query_pairs(reach, output_type="ndarray")
    cosine = np.einsum("ij,ij->i", normals[near[:, 0]], normals[near[:, 1]])
    start, end = np.concatenate([near, near[:, ::-1]]).T
    return start, end, np.concatenate([cosine, cosine])


def _half_plane(distance: Array, cosine: Array, width: float) -> Array:
    """Return int exp(-(r / width)^2) dA over the other face, a half plane, from points at distances from the edge."""
    under = distance * np.sqrt(1.0 - cosine * cosine)
    inside = -distance * cosine  # of the foot on the other plane, from the edge
    return np.asarray(0.5 * np.pi * width**2 * np.exp(-np.square(under / width)) * erfc(-inside / width))
