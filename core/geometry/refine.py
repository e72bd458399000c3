"""Refinement of a mesh on its own surface, for values that are known at vertices and interpolated between them.

Every edge longer than a limit is halved, until none is. Whether an edge is halved depends on its two ends alone, so
that the faces on both sides of it agree and no crack opens, across duplicated vertices too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from milkglass.core.arrays import Array, Int32
from milkglass.core.geometry.mesh import Mesh

MAX_FACES = 200_000  # limit of refinement; the mesh itself may have more
# Corners (0, 1, 2) and middles of the edges from them to the next (3, 4, 5) of the pieces, by which edges are halved.
_BITS = np.array([1, 2, 4], np.uint8)
_PIECES: dict[tuple[bool, bool, bool], tuple[tuple[int, int, int], ...]] = {
    (False, False, False): ((0, 1, 2),),
    (True, False, False): ((0, 3, 2), (3, 1, 2)),
    (False, True, False): ((0, 1, 4), (0, 4, 2)),
    (False, False, True): ((0, 1, 5), (5, 1, 2)),
    (True, True, False): ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    (False, True, True): ((5, 4, 2), (0, 1, 4), (0, 4, 5)),
    (True, False, True): ((0, 3, 5), (3, 1, 2), (3, 2, 5)),
    (True, True, True): ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}


def _piece_matrices(pieces: tuple[tuple[int, int, int], ...]) -> tuple[npt.NDArray[np.float32], ...]:
    """Return matrices that take barycentric coordinates (3, n) of a face to those of each of its pieces."""
    places = np.concatenate([np.eye(3), 0.5 * (np.eye(3) + np.roll(np.eye(3), 1, axis=1))])
    return tuple(np.linalg.inv(places[list(piece)]).T.astype(np.float32) for piece in pieces)


_PIECE_MATRICES = {int(np.dot(halved, _BITS)): _piece_matrices(pieces) for halved, pieces in _PIECES.items()}


@dataclass(frozen=True, eq=False)
class Level:
    """Faces before one step of refinement.

    Attributes
    ----------
    faces : (m, 3) int32
    first : (m,) int64
        Index of the first piece of each face in the next level; its other pieces follow.
    halved : (m,) uint8
        Bit mask of the halved edges; empty in the last level.
    """

    faces: Int32
    first: npt.NDArray[np.int64]
    halved: npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined mesh with the history of its faces.

    Attributes
    ----------
    mesh : Mesh
        The vertices of the original come first. Normals of new vertices are means of those of the ends, as linear
        interpolation gives them, not normalised.
    sources : (n,) int32
        For each vertex, an original vertex of the same component.
    levels : of Level
        Faces of every step, the original first.
    """

    mesh: Mesh
    sources: Int32
    levels: tuple[Level, ...]

    def locate(self, points: npt.NDArray[np.floating], faces: Int32) -> tuple[Int32, npt.NDArray[np.float32]]:
        """Return vertices (n, 3) and weights (n, 3) that interpolate at points (n, 3) on original faces (n,)."""
        current = np.asarray(faces, np.int64)
        # Coordinates by rows: columns of three are several times slower.
        weights = self._of_faces(np.asarray(points), current)
        for level in self.levels:
            if len(level.halved) == 0:
                break
            cases, current = level.halved[current], level.first[current]
            for case in np.flatnonzero(np.bincount(cases, minlength=8)).tolist():
                if case == 0:
                    continue
                rows: Any = slice(None) if (of_case := cases == case).all() else np.flatnonzero(of_case)
                face_weights = weights[:, rows]
                pieces, of_pieces = np.zeros(face_weights.shape[1], np.int64), _PIECE_MATRICES[case][0] @ face_weights
                inside = of_pieces.min(axis=0)
                for piece, matrix in enumerate(_PIECE_MATRICES[case][1:], start=1):
                    candidates = matrix @ face_weights
                    smallest = candidates.min(axis=0)
                    better = smallest > inside
                    np.copyto(pieces, piece, where=better)
                    np.copyto(of_pieces, candidates, where=better)
                    np.copyto(inside, smallest, where=better)
                current[rows] += pieces
                weights[:, rows] = of_pieces
        np.maximum(weights, 0.0, out=weights)
        weights /= weights.sum(axis=0)
        return self.levels[-1].faces[current], np.ascontiguousarray(weights.T)

    def _of_faces(self, points: npt.NDArray[np.floating], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """Return barycentric coordinates (3, n) of points in the original faces that they lie on."""
        corners = self.levels[0].faces
        a, b, c = (self.mesh.vertices[corners[:, i]].astype(np.float64) for i in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)[:, None]
        offset, weights = (
            np.asarray(points - a.astype(np.float32)[faces], np.float32),
            np.empty((3, len(faces)), np.float32),
        )
        np.einsum("ij,ij->i", offset, np.cross(c - a, normal).astype(np.float32)[faces], out=weights[1])
        np.einsum("ij,ij->i", offset, np.cross(normal, b - a).astype(np.float32)[faces], out=weights[2])
        weights[0] = 1.0 - weights[1] - weights[2]
        return weights


def interpolated(
    corners: Int32, weights: npt.NDArray[np.float32], values: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return values of vertices (m, k) interpolated at n points, (n, k), with what `Refined.locate` returns."""
    # A sparse product takes a third of the time of three lookups.
    rows = np.arange(0, corners.size + 1, 3, dtype=np.int32)
    matrix = csr_matrix((weights.ravel(), corners.ravel(), rows), shape=(len(corners), len(values)))
    return np.asarray(matrix @ values)


def refined(mesh: Mesh, longest: float) -> Refined:
    """Return the mesh with edges halved until none is longer than `longest` (mm, > 0), as far as MAX_FACES allow."""
    # A piece of longest edge s has an area of about s^2 / 4.
    longest = max(longest, 2.0 * float(np.sqrt(mesh.area / MAX_FACES)))
    vertices, normals, faces = mesh.vertices, mesh.normals, mesh.faces
    sources = np.arange(len(vertices), dtype=np.int32)
    levels = []
    while True:
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)  # (m, 3 edges, 2)
        sides = vertices[ends[..., 0]] - vertices[ends[..., 1]]
        long = np.einsum("ijk,ijk->ij", sides, sides) > np.float32(longest**2)
        if not long.any():
            break
        pairs = np.sort(ends[long], axis=1).astype(np.int64)
        unique, inverse = np.unique(pairs[:, 0] * len(vertices) + pairs[:, 1], return_inverse=True)
        a, b = np.divmod(unique, len(vertices))
        middles = np.zeros((len(faces), 3), np.int32)
        middles[long] = len(vertices) + inverse.ravel()
        vertices = np.concatenate([vertices, np.float32(0.5) * (vertices[a] + vertices[b])])
        normals = np.concatenate([normals, np.float32(0.5) * (normals[a] + normals[b])])
        sources = np.concatenate([sources, sources[a]])
        pieces, first = _split(np.concatenate([faces, middles], axis=1), long)
        levels.append(Level(faces, first, (long @ _BITS).astype(np.uint8)))
        faces = pieces
    levels.append(Level(faces, np.arange(len(faces)), np.empty(0, np.uint8)))
    fine = mesh if len(levels) == 1 else Mesh(vertices, normals, faces, outward=mesh.outward)
    return Refined(fine, sources, tuple(levels))


def _split(six: Int32, long: npt.NDArray[np.bool_]) -> tuple[Int32, npt.NDArray[np.int64]]:
    """Return the pieces of faces, given by corners and middles (m, 6), cut at long edges (m, 3), and their starts."""
    count = 1 + long.sum(axis=1)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    pieces = np.empty((first[-1], 3), np.int32)
    for halved, pieces_of_case in _PIECES.items():
        rows = np.flatnonzero((long == halved).all(axis=1))
        for i, piece in enumerate(pieces_of_case):
            pieces[first[rows] + i] = six[rows][:, piece]
    return pieces, first


def weights_within(vertices: npt.NDArray[np.float32], corners: Int32, points: npt.NDArray[np.floating]) -> Array:
    """Return weights (n, 3) >= 0 of sum 1 that interpolate at points between the corners (n, 3) of their faces."""
    weights = np.maximum(barycentric(vertices, corners, points), 0.0)
    return np.asarray(weights / np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny))


def barycentric(vertices: npt.NDArray[np.float32], corners: Int32, points: npt.NDArray[np.floating]) -> Array:
    """Return barycentric coordinates (n, 3) of points in the planes of faces, given by their corners (n, 3)."""
    a, b, c = (vertices[corners[:, i]].astype(np.float64) for i in range(3))
    normal = np.cross(b - a, c - a)
    size = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    offset = points - a
    second = np.einsum("ij,ij->i", np.cross(offset, c - a), normal) / size
    third = np.einsum("ij,ij->i", np.cross(b - a, offset), normal) / size
    return np.stack([1.0 - second - third, second, third], axis=1)
