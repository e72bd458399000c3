"""Edges of a surface, as light meets them that scatters once: pieces of it, and the pairs that are two faces.

A piece is half a mean free path wide, and a pair no further apart than light goes.
"""

import functools
import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from core.patches import Patches

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

REACH = 2.5  # mean free paths between the two places
CELL = 0.6  # mean free path that the pieces extend over
SAME, OTHER = 0.7, 0.3  # cosine between normals from which on two pieces are one face; below it, two
BACK, BESIDE = -0.8, -0.5  # the same for the two sides of a plate or a blade: up to BACK they are no edge
ROUGH, EVEN = 0.93, 0.98  # mean cosine between normals of a face around a piece; a rough one is no face
SHARP, ROUND = 0.7, 1.4  # mean free paths over which a surface turns from one face to the other: an edge, and none
LEVELS = 2  # sizes of pieces each factor of two, so that a slider finds most of them made
NEIGHBOURS, SMOOTH = 6, 0.75  # pieces that a patch takes means over, and their widths that it looks around


@dataclass(frozen=True, eq=False)
class Pieces:
    """m pieces of a surface, each of some patches, and the k pairs that light may cross between.

    Attributes
    ----------
    patches : Patches, n of them
    width : float
        mm.
    of : (m, n) sparse float64
        1 where a patch belongs to a piece.
    points, normals : (m, 3) float64
    areas : (m,) float64
    start, end : (k,) int
        Pieces.
    depth : (k,) float64
        Thickness of the object below the end, mm.
    share : (k,) float64
        How far start and end are two faces, in (0, 1].
    """

    patches: Patches
    width: float
    of: csr_array
    points: Array
    normals: Array
    areas: Array
    start: Ints
    end: Ints
    depth: Array
    share: Array

    @functools.cached_property
    def near(self) -> csr_array:
        """Means over the pieces around each patch whose normals are like its own: (n, m) sparse float64."""
        count = min(NEIGHBOURS, len(self.points))
        places = np.hstack([self.points, self.width * self.normals])
        at = np.hstack([self.patches.on_surface, self.width * self.patches.face_normals])
        distance, others = (each.reshape(len(at), count) for each in cKDTree(places).query(at, count))
        weights = self.areas[others] * np.exp(-np.square(distance / (SMOOTH * self.width)))
        weights[:, 0] += 1e-9 * self.areas[others[:, 0]] + np.finfo(np.float64).tiny
        weights /= weights.sum(axis=1, keepdims=True)
        rows = np.arange(0, weights.size + 1, count)
        return csr_array((weights.ravel(), others.ravel(), rows), shape=(len(at), len(self.points)))


class Edges:
    """The pieces of a surface, for any mean free path; made when they are asked for, from several threads.

    Parameters
    ----------
    patches : Patches, n of them
    thickness : (n,) float64
        See `core.boundary.Boundary`.
    is_sheet : (n,) bool
        Patches that have their other side in their own equation; no light crosses from or to them here.
    """

    def __init__(self, patches: Patches, thickness: Array, is_sheet: npt.NDArray[np.bool_]) -> None:
        self._patches, self._thickness, self._is_sheet = patches, thickness, is_sheet
        self.areas, self.spacing = patches.areas, float(np.sqrt(patches.areas.mean()))
        self._made: dict[int, Pieces] = {}
        self._making = threading.Lock()

    def pieces(self, mean_free_path: float) -> Pieces:
        """Return those that serve for a mean free path, mm."""
        level = int(np.ceil(LEVELS * np.log2(mean_free_path)))
        with self._making:
            if level not in self._made:
                self._made[level] = _pieces(self._patches, self._thickness, self._is_sheet, 2.0 ** (level / LEVELS))
            return self._made[level]


def _pieces(patches: Patches, thickness: Array, is_sheet: npt.NDArray[np.bool_], far: float) -> Pieces:
    """Gather patches in cells of `CELL` mean free paths of `far` mm, and pair the pieces."""
    normals = patches.face_normals
    cells = np.floor((patches.points - patches.points.min(axis=0)) / (CELL * far)).astype(np.int64)
    octants = (normals > 0.0) @ np.array([1, 2, 4])
    counts = cells.max(axis=0) + 1
    key = ((cells[:, 0] * counts[1] + cells[:, 1]) * counts[2] + cells[:, 2]) * 8 + octants
    _, piece = np.unique(key, return_inverse=True)
    n, m = len(patches), int(piece.max()) + 1
    of = csr_array((np.ones(n), (piece, np.arange(n))), shape=(m, n))
    areas = np.maximum(of @ patches.areas, np.finfo(np.float64).tiny)
    points = (of @ (patches.areas[:, None] * patches.on_surface)) / areas[:, None]
    mean_normals = of @ (patches.areas[:, None] * normals)
    mean_normals /= np.maximum(np.linalg.norm(mean_normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    depth = (of @ (patches.areas * thickness)) / areas
    counts = (of @ (patches.areas * ~is_sheet)) / areas
    start, end, share = _pairs(points, mean_normals, counts, far)
    return Pieces(patches, CELL * far, of, points, mean_normals, areas, start, end, depth[end], share)


def _pairs(points: Array, normals: Array, counts: Array, far: float) -> tuple[Ints, Ints, Array]:
    """Ordered pairs that light may cross between, and how far they are two faces of one edge, (k,) each."""
    tree = cKDTree(points)
    start, end, cosine = _neighbours(tree, normals, ROUND * far)
    n, same = len(points), cosine > SAME
    alike = np.bincount(start[same], cosine[same], n) / np.maximum(np.bincount(start[same], minlength=n), 1)
    counts = counts * np.clip((alike - ROUGH) / (EVEN - ROUGH), 0.0, 1.0)
    turned = np.flatnonzero(~same & (cosine > BACK))
    turn = np.full(n, np.inf)  # how far away from each piece the surface has turned
    np.minimum.at(turn, start[turned], np.linalg.norm(points[end[turned]] - points[start[turned]], axis=1))
    some = np.flatnonzero(counts)
    start, end, cosine = _neighbours(cKDTree(points[some]), normals[some], REACH * far)
    two = np.flatnonzero((cosine < SAME) & (cosine > BACK))
    start, end, cosine = some[start[two]], some[end[two]], cosine[two]
    sharpest = turn.copy()
    np.minimum.at(sharpest, start, turn[end])
    share = np.clip((SAME - cosine) / (SAME - OTHER), 0.0, 1.0) * np.clip((cosine - BACK) / (BESIDE - BACK), 0.0, 1.0)
    share *= counts[start] * counts[end]
    share *= np.clip((ROUND * far - sharpest[start]) / ((ROUND - SHARP) * far), 0.0, 1.0)
    height = np.einsum("ij,ij->i", points[end] - points[start], normals[end])
    over = np.maximum(height, height + REACH * far * cosine) > 0.0
    some = np.flatnonzero((share > 0.0) & over)
    return start[some], end[some], share[some]


def _neighbours(tree: cKDTree, normals: Array, reach: float) -> tuple[Ints, Ints, Array]:
    """All ordered pairs no further apart than `reach`, and the cosines between their normals."""
    near = tree.query_pairs(reach, output_type="ndarray")
    cosine = np.einsum("ij,ij->i", normals[near[:, 0]], normals[near[:, 1]])
    start, end = np.concatenate([near, near[:, ::-1]]).T
    return start, end, np.concatenate([cosine, cosine])
