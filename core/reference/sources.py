"""Sources of the float64 reference: the surface in pieces, graded around the points of exitance.

Equation (1) needs pieces well below the mean free path near a point, and below a share of the distance far from it. So
a few points need a few hundred thousand sources where a uniform cover would need hundreds of millions.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.profiles.base import Profile
from milkglass.core.profiles.radial import flux_radius

EDGE_OVER_DISTANCE = 0.2  # longest edge over the distance to the nearest point: R_d ~ rho^-3 is then summed to 0.3 %
EDGE_OVER_MEAN_FREE_PATH = 0.3  # longest edge at the points; errors of irregular pieces: 0.4 % at 0.37, 0.06 % at 0.3
MAX_EDGE = 1.0 / 80.0  # of the longest side: for shadows and changes of the light
CENTRE_FLUX_SHARE = 0.01  # of the flux of a profile, which the centre holds
MEAN_FREE_PATH_OVER_CENTRE = 10.0  # at most, of a profile to be resolved
MIN_EDGE = 1e-5  # of the longest side: float32 vertices resolve no more


@dataclass(frozen=True, eq=False)
class SourcePieces:
    """Pieces of a surface, float64.

    Attributes
    ----------
    points, normals, face_normals : (n, 3)
        Centroids, mm; interpolated unit normals; unit normals of the faces, on the same side.
    areas : (n,)
        mm^2, which sum to the area of the mesh.
    """

    points: Array
    normals: Array
    face_normals: Array
    areas: Array

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, piece: slice) -> "SourcePieces":
        return SourcePieces(self.points[piece], self.normals[piece], self.face_normals[piece], self.areas[piece])


def resolved_length(profile: Profile) -> float:
    """Return the length to resolve for a profile, mm: its mean free path, or less where much flux is near its centre.

    A hundredth of a dipole's flux is within 0.14 of its mean free path, and of a profile like 1 / rho within far less.
    """
    centre = flux_radius(profile.total, CENTRE_FLUX_SHARE, profile.mean_free_path)
    return min(profile.mean_free_path, MEAN_FREE_PATH_OVER_CENTRE * centre)


def graded_sources(
    mesh: Mesh, points: npt.ArrayLike, mean_free_path: float, check: Callable[[], object] = lambda: None
) -> SourcePieces:
    """Return pieces that cover a mesh for the exitance at points (n, 3), mm, and the shortest mean free path, mm.

    Faces are halved across their longest edge until it is short enough for the distance to the nearest point. `check`
    is called before every halving; what it raises ends the work.
    """
    longest_side = float(np.ptp(mesh.bounds, axis=0).max())
    finest = max(EDGE_OVER_MEAN_FREE_PATH * mean_free_path, MIN_EDGE * longest_side)
    coarsest = max(MAX_EDGE * longest_side, MIN_EDGE * longest_side)
    nearest = cKDTree(np.asarray(points, np.float64))
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (m, 3 corners, 3)
    normals = mesh.normals[mesh.faces].astype(np.float64)
    finished: list[SourcePieces] = []
    while len(corners):
        check()
        edge, length = _longest_edges(corners)
        distance = nearest.query(corners.mean(axis=1))[0] - 0.6 * length  # from the nearest corner, about
        small = length <= np.minimum(np.maximum(finest, EDGE_OVER_DISTANCE * distance), coarsest)
        finished.append(_sources(corners[small], normals[small]))
        corners, normals = _halved(corners[~small], edge[~small]), _halved(normals[~small], edge[~small])
    return SourcePieces(
        *(np.concatenate([getattr(piece, name) for piece in finished]) for name in SourcePieces.__dataclass_fields__)
    )


def _sources(corners: Array, normals: Array) -> SourcePieces:
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1, keepdims=True)
    has_area = double[:, 0] > 0.0
    faces, normal = cross[has_area] / double[has_area], normals[has_area].sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), faces)
    faces *= np.where(np.einsum("ij,ij->i", faces, normal) < 0.0, -1.0, 1.0)[:, None]
    return SourcePieces(corners[has_area].mean(axis=1), normal, faces, 0.5 * double[has_area, 0])


def _longest_edges(corners: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the longest edge of each triangle (edge i runs from corner i to i + 1), and its length."""
    sides = np.roll(corners, -1, axis=1) - corners
    squares = np.einsum("nij,nij->ni", sides, sides)
    edge = squares.argmax(axis=1)
    return edge, np.sqrt(squares[np.arange(len(edge)), edge])


def _halved(values: Array, edge: npt.NDArray[np.intp]) -> Array:
    """Return triangles split at the middle of the given edge: (n, 3 corners, 3) -> (2 n, 3 corners, 3)."""
    rows = np.arange(len(edge))
    a, b, c = (values[rows, (edge + i) % 3] for i in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
