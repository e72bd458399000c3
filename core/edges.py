"""Edges of a surface: which faces meet there, and how far from it a place on one of them is.

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

from core.patches import Patches

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

REACH = 2.5  # mean free paths from a patch to a piece of another face
WIDTH = 1.2  # mean free paths: pieces count by exp(-(distance / width)^2)
CELL = 1.0  # mean free path that a piece extends over
SAME, OTHER = 0.7, 0.3  # cosine between normals from which on two pieces are one face; below it, two
BACK, BESIDE = -0.8, -0.5  # the same for the two sides of a plate or a blade: up to BACK they are no edge
ROUGH, EVEN = 0.93, 0.98  # mean cosine between normals of a face around a piece; a rough one is no face
SHARP, ROUND = 0.7, 1.4  # mean free paths over which a surface turns from one face to the other: an edge, and none
CONCAVE = 0.15  # mean free paths that a place may lie above the other's plane, for faces that are not quite flat


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
    """

    patch: Ints
    pieces: csr_array
    areas: Array
    means: csr_array
    normals: Array
    distance: Array
    cosine: Array
    share: Array


class Edges:
    """The edges of a surface, for any mean free path; found when they are asked for, from several threads.

    Parameters
    ----------
    patches : Patches, n of them
    thickness : (n,) float64
        See `core.boundary.Boundary`.
    is_sheet : (n,) bool
        Patches that have their other side in their own equation; they have no edges here.
    """

    def __init__(self, patches: Patches, thickness: Array, is_sheet: npt.NDArray[np.bool_]) -> None:
        self.patches, self._thickness, self._is_sheet = patches, thickness, is_sheet
        self.spacing = float(np.sqrt(patches.areas.mean()))
        self._found: dict[int, Pairs] = {}
        self._finding = threading.Lock()

    def pairs(self, mean_free_path: float) -> list[tuple[float, Pairs]]:
        """Return those that serve for a mean free path, mm, and how much each counts.

        They are found for powers of two, so that a slider finds them made, and mixed, so that it moves smoothly.
        """
        level = float(np.log2(mean_free_path))
        low = int(np.floor(level))
        mixed = [(1.0 - (level - low), low), (level - low, low + 1)]
        return [(share, self._at(each)) for share, each in mixed if share > 0.0]

    def _at(self, level: int) -> Pairs:
        with self._finding:
            if level not in self._found:
                self._found[level] = self._find(2.0**level)
            return self._found[level]

    def _find(self, far: float) -> Pairs:
        """Find them for a mean free path of `far`, mm."""
        patches = self.patches
        piece = _cells(patches, CELL * far)
        n, m = len(patches), int(piece.max()) + 1
        of = csr_array((np.ones(n), (piece, np.arange(n))), shape=(m, n))
        areas = np.maximum(of @ patches.areas, np.finfo(np.float64).tiny)
        points = (of @ (patches.areas[:, None] * patches.on_surface)) / areas[:, None]
        normals = unit(of @ (patches.areas[:, None] * patches.face_normals))
        even, sharpest = _faces(points, normals, far)
        counts = even * np.clip((ROUND * far - sharpest) / ((ROUND - SHARP) * far), 0.0, 1.0)
        counts *= (of @ (patches.areas * ~self._is_sheet)) / areas
        near = np.flatnonzero(counts)
        chosen = np.flatnonzero(np.isin(piece, near))
        trees = cKDTree(patches.on_surface[chosen]), cKDTree(points[near])
        found = trees[0].sparse_distance_matrix(trees[1], REACH * far, output_type="ndarray")
        a, b = chosen[found["i"]], near[found["j"]]
        cosine = np.einsum("ij,ij->i", patches.face_normals[a], normals[b])
        two = np.flatnonzero((cosine < SAME) & (cosine > BACK))
        a, b, cosine, apart = a[two], b[two], cosine[two], found["v"][two]
        step = points[b] - patches.on_surface[a]
        below = np.einsum("ij,ij->i", step, normals[b])  # of the patch under the piece's plane
        under = -np.einsum("ij,ij->i", step, patches.face_normals[a])  # of the piece under the patch's plane
        convex = (below > -CONCAVE * far) & (under > -CONCAVE * far) & (under < self._thickness[a] + CELL * far)
        distance = np.maximum(below, 0.0) / np.sqrt(1.0 - cosine * cosine)
        share = np.clip((SAME - cosine) / (SAME - OTHER), 0.0, 1.0) * counts[piece[a]] * counts[b]
        share *= np.clip((cosine - BACK) / (BESIDE - BACK), 0.0, 1.0)
        share *= areas[b] * np.exp(-np.square(apart / (WIDTH * far))) / _half_plane(distance, cosine, WIDTH * far)
        some = np.flatnonzero(convex & (share > 0.0))
        a, b, share = a[some], b[some], share[some]
        # Pieces of one octant of normals are one face of a patch.
        key, pair = np.unique(8 * a + _octants(normals)[b], return_inverse=True)
        total = np.bincount(pair, share, len(key)).astype(np.float64)
        means = csr_array((share / total[pair], (pair, b)), shape=(len(key), m))
        there = unit(means @ normals)
        cosine = np.asarray(np.einsum("ij,ij->i", patches.face_normals[key // 8], there), np.float64)
        distance = np.bincount(pair, share * distance[some], len(key)) / total
        return Pairs(key // 8, of, areas, means, there, distance, cosine, total)


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) at length 1; 0 stays 0."""
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return np.asarray(vectors / np.maximum(length, np.finfo(np.float64).tiny)[:, None])


def _cells(patches: Patches, width: float) -> Ints:
    """Number of each patch's piece: one cell's patches whose normals lie in one octant."""
    cells = np.floor((patches.points - patches.points.min(axis=0)) / width).astype(np.int64)
    counts = cells.max(axis=0) + 1
    key = ((cells[:, 0] * counts[1] + cells[:, 1]) * counts[2] + cells[:, 2]) * 8 + _octants(patches.face_normals)
    return np.asarray(np.unique(key, return_inverse=True)[1])


def _octants(normals: Array) -> Ints:
    return np.asarray((normals > 0.0) @ np.array([1, 2, 4]))


def _faces(points: Array, normals: Array, far: float) -> tuple[Array, Array]:
    """How far pieces are of flat faces, in [0, 1], and over which way, mm, the sharpest edge near them turns."""
    start, end, cosine = _neighbours(points, normals, ROUND * far)
    n, same = len(points), cosine > SAME
    alike = np.bincount(start[same], cosine[same], n) / np.maximum(np.bincount(start[same], minlength=n), 1)
    turned = np.flatnonzero(~same & (cosine > BACK))
    turn = np.full(n, np.inf)
    np.minimum.at(turn, start[turned], np.linalg.norm(points[end[turned]] - points[start[turned]], axis=1))
    sharpest = turn.copy()
    sharp = np.flatnonzero(turn < ROUND * far)
    if len(sharp):
        near = cKDTree(points).sparse_distance_matrix(cKDTree(points[sharp]), REACH * far, output_type="ndarray")
        np.minimum.at(sharpest, near["i"], turn[sharp[near["j"]]])
    return np.clip((alike - ROUGH) / (EVEN - ROUGH), 0.0, 1.0), sharpest


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
