"""Edges of a surface: which faces meet there, how far from it a place on one of them is, and how curved that is.

Patches are gathered to pieces a mean free path wide. A piece's plane stands for the face that it is of, so that
a patch near an edge knows its distance from it through any piece of the other face, whichever way cells cut that.
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
    """K pairs of a patch and a face beyond an edge, which is seen through m pieces.

    Attributes
    ----------
    patch : (k,) int
    pieces : (m, n) sparse float64
        Sums over the patches of each.
    areas : (m,) float64
        Of the pieces, mm^2.
    means : (k, m) sparse float64
        Over the pieces of that face, by area and nearness.
    normals : (k, 3) float64
        Unit, of that face.
    distance : (k,) float64
        From the patch to the edge, mm.
    cosine : (k,) float64
        Between the two normals.
    share : (k,) float64
        How far there is an edge and a face; 1 for a straight edge between faces that go on for ever.
    turn : (k,) float64
        Angle between the two normals; less of it where several pairs are of one edge.
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
    """The edges of a surface, for any mean free path; found when they are asked for, from several threads.

    Parameters
    ----------
    patches : Patches, n of them
    thickness : (n,) float64
        See `core.transport.diffusion.boundary.Boundary`.
    plain : (n,) bool
        Patches that may be of a face with edges; the others cost nothing.
    """

    def __init__(self, patches: Patches, thickness: Array, plain: npt.NDArray[np.bool_]) -> None:
        self.patches, self._thickness, self._plain = patches, thickness, np.flatnonzero(plain)
        self.spacing = float(np.sqrt(patches.areas.mean()))
        self._found: dict[int, Pairs] = {}
        self._finding = threading.Lock()

    def pairs(self, mean_free_path: float) -> list[tuple[float, Pairs]]:
        """Return those that serve for a mean free path, mm, and how much each counts; none where there are none.

        They are found for powers of two, so that a slider finds them made, and mixed, so that it moves smoothly.
        """
        level = float(np.log2(mean_free_path))
        low = int(np.floor(level))
        mixed = [(1.0 - (level - low), low), (level - low, low + 1)]
        each = [(share, self._at(one)) for share, one in mixed if share > 0.0 and len(self._plain)]
        return [(share, pairs) for share, pairs in each if pairs.share.sum() > LIMITS.least_pairs * len(self.patches)]

    def shown(self, mean_free_path: float) -> float:
        """How far patches are fine enough to show what light does beside edges, in [0, 1]."""
        return float(falling(self.spacing / mean_free_path, LIMITS.resolved_spacing, LIMITS.unresolved_spacing))

    def curvature(self, mean_free_path: float) -> Array:
        """Sum of the two principal curvatures that edges are, 1/mm, of each patch, (n,)."""
        found = np.zeros(len(self.patches))
        # Of strips narrower than a patch.
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
    """M pieces of some patches: which each is of, sums over them (m, n), areas, centres, normals; how far they end."""

    of_patch: Ints
    sums: csr_array
    areas: Array
    points: Array
    normals: Array
    counts: Array


def _gather(patches: Patches, chosen: Ints, far: float) -> _Pieces:
    """Gather chosen patches of a cell whose normals lie in one octant."""
    points, normals, areas = patches.on_surface[chosen], patches.face_normals[chosen], patches.areas[chosen]
    piece = np.unique(cells(points, normals, LIMITS.piece_size * far), return_inverse=True)[1]
    sums = csr_array((np.ones(len(chosen)), (piece, chosen)), shape=(int(piece.max()) + 1, len(patches)))
    of = sums[:, chosen]
    total = np.maximum(of @ areas, np.finfo(np.float64).tiny)
    centres, means = (of @ (areas[:, None] * points)) / total[:, None], unit(of @ (areas[:, None] * normals))
    even, sharpest = _faces(centres, means, far)
    turning = (LIMITS.round_turn * far - sharpest) / ((LIMITS.round_turn - LIMITS.sharp_turn) * far)
    edged = even * np.clip(turning, 0.0, 1.0)
    return _Pieces(piece, sums, total, centres, means, edged)


def _pair(patches: Patches, thickness: Array, chosen: Ints, pieces: _Pieces, far: float) -> Pairs:
    """Pair patches with the pieces of other faces that light may come from."""
    near = np.flatnonzero(pieces.counts)
    own = np.flatnonzero(pieces.counts[pieces.of_patch])
    points, normals = patches.on_surface[chosen[own]], patches.face_normals[chosen[own]]
    trees = cKDTree(points), cKDTree(pieces.points[near])
    found = trees[0].sparse_distance_matrix(trees[1], LIMITS.reach * far, output_type="ndarray")
    a, b, apart = found["i"], near[found["j"]], found["v"]
    cosine = np.einsum("ij,ij->i", normals[a], pieces.normals[b])
    two = np.flatnonzero((cosine < SAME_FACE) & (cosine > LIMITS.opposite_cosine))
    a, b, cosine, apart = a[two], b[two], cosine[two], apart[two]
    step = pieces.points[b] - points[a]
    below = np.einsum("ij,ij->i", step, pieces.normals[b])  # of the patch under the piece's plane
    under = -np.einsum("ij,ij->i", step, normals[a])  # of the piece under the patch's plane
    convex = (
        (below > -LIMITS.concave_tolerance * far)
        & (under > -LIMITS.concave_tolerance * far)
        & (under < thickness[chosen[own]][a] + LIMITS.piece_size * far)
    )
    distance = np.maximum(below, 0.0) / np.sqrt(1.0 - cosine * cosine)
    share = falling(cosine, LIMITS.other_face_cosine, SAME_FACE)
    share *= rising(cosine, LIMITS.opposite_cosine, LIMITS.blade_cosine)
    share *= pieces.counts[pieces.of_patch[own]][a] * pieces.counts[b]
    width = LIMITS.weight_width * far
    share *= pieces.areas[b] * np.exp(-np.square(apart / width)) / _half_plane(distance, cosine, width)
    some = np.flatnonzero(convex & (share > 0.0))
    a, b, share = a[some], b[some], share[some]
    # Pieces of one octant of normals are one face of a patch.
    key, pair = np.unique(8 * a.astype(np.int64) + octants(pieces.normals)[b], return_inverse=True)
    total = np.bincount(pair, share, len(key)).astype(np.float64)
    means = csr_array((share / total[pair], (pair, b)), shape=(len(key), len(pieces.areas)))
    there = unit(means @ pieces.normals)
    cosine = np.asarray(np.einsum("ij,ij->i", normals[key // 8], there), np.float64)
    distance = np.bincount(pair, share * distance[some], len(key)) / total
    turn = np.arccos(np.clip(cosine, -1.0, 1.0)) * _alone(key // 8, total, there)
    return Pairs(chosen[own[key // 8]], pieces.sums, pieces.areas, means, there, distance, cosine, total, turn)


def _alone(patch: Ints, share: Array, normals: Array) -> Array:
    """How far each pair is the only one of an edge: a curved face has several in one, a corner has two edges.

    `patch` ascends. A half of an edge, as at a corner, is one.
    """
    first = np.flatnonzero(np.diff(patch, prepend=-1))
    row = np.repeat(np.arange(len(first)), np.diff(first, append=len(patch)))
    slot = np.arange(len(patch)) - first[row]
    shares, ways = np.zeros((len(first), 8)), np.zeros((len(first), 8, 3))
    shares[row, slot], ways[row, slot] = share, normals
    alike = np.maximum(np.einsum("iaj,ibj->iab", ways, ways), 0.0)
    of_edge = np.einsum("iab,ib->ia", alike, shares)
    return np.asarray((shares / np.maximum(of_edge, LIMITS.least_share))[row, slot])


def _faces(points: Array, normals: Array, far: float) -> tuple[Array, Array]:
    """How far pieces are of flat faces, in [0, 1], and over which way, mm, the sharpest edge near them turns."""
    start, end, cosine = _neighbours(points, normals, LIMITS.round_turn * far)
    n, same = len(points), cosine > SAME_FACE
    alike = np.bincount(start[same], cosine[same], n) / np.maximum(np.bincount(start[same], minlength=n), 1)
    turned = np.flatnonzero(~same & (cosine > LIMITS.opposite_cosine))
    turn = np.full(n, np.inf)
    np.minimum.at(turn, start[turned], np.linalg.norm(points[end[turned]] - points[start[turned]], axis=1))
    sharpest = turn.copy()
    sharp = np.flatnonzero(turn < LIMITS.round_turn * far)
    if len(sharp):
        near = cKDTree(points).sparse_distance_matrix(cKDTree(points[sharp]), LIMITS.reach * far, output_type="ndarray")
        np.minimum.at(sharpest, near["i"], turn[sharp[near["j"]]])
    return rising(alike, LIMITS.rough_evenness, LIMITS.flat_evenness), sharpest


def _neighbours(points: Array, normals: Array, reach: float) -> tuple[Ints, Ints, Array]:
    """All ordered pairs no further apart than `reach`, and the cosines between their normals."""
    near = cKDTree(points).query_pairs(reach, output_type="ndarray")
    cosine = np.einsum("ij,ij->i", normals[near[:, 0]], normals[near[:, 1]])
    start, end = np.concatenate([near, near[:, ::-1]]).T
    return start, end, np.concatenate([cosine, cosine])


def _half_plane(distance: Array, cosine: Array, width: float) -> Array:
    """Integral of exp(-(r / width)^2) over the other face, from places at distances from the edge, mm^2."""
    under = distance * np.sqrt(1.0 - cosine * cosine)
    inside = -distance * cosine  # of the foot on the other plane, from the edge
    return np.asarray(0.5 * np.pi * width**2 * np.exp(-np.square(under / width)) * erfc(-inside / width))
