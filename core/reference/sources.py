"""Sources of the float64 reference: the surface in pieces, finest around the points where exitance is wanted.

Equation (1) needs pieces well below the mean free path beside a point and a share of the distance far from it. Graded
so, a few points take a few hundred thousand sources where an even cover would take hundreds of millions.
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

SHARE = 0.2  # longest edge over the distance to the nearest point: R_d ~ rho^-3 is then met within 0.3 %
OF_MEAN_FREE_PATH = 0.3  # longest edge at the points; irregular pieces err by 0.4 % at 0.37, by 0.06 % at 0.3
COARSEST = 1.0 / 80.0  # of the longest side: shadows and the light's changes
CENTRE, OF_CENTRE = 0.01, 10.0  # share of the flux, and mean free paths of a profile in its radius
FINEST = 1e-5  # of the longest side: float32 vertices know no better


@dataclass(frozen=True, eq=False)
class Sources:
    """Pieces of a surface, float64.

    Attributes
    ----------
    points, normals, face_normals : (n, 3)
        Centroids, mm; interpolated unit normals; those of the faces, on the same side.
    areas : (n,)
        mm^2; they sum to the area of the mesh.
    """

    points: Array
    normals: Array
    face_normals: Array
    areas: Array

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, part: slice) -> "Sources":
        return Sources(self.points[part], self.normals[part], self.face_normals[part], self.areas[part])


def resolved_length(profile: Profile) -> float:
    """Mean free path to cover a surface for, mm: shorter than the profile's own where much flux falls at its centre.

    A hundredth of a dipole's flux falls within 0.14 of its mean free path, and of a profile like 1 / rho far nearer.
    """
    centre = flux_radius(profile.total, CENTRE, profile.mean_free_path)
    return min(profile.mean_free_path, OF_CENTRE * centre)


def graded_sources(
    mesh: Mesh, points: npt.ArrayLike, mean_free_path: float, check: Callable[[], object] = lambda: None
) -> Sources:
    """Cover a mesh with pieces for the exitance at points (n, 3), mm; shortest mean free path of the profiles, mm.

    Faces are halved across their longest edge until it suits the distance to the nearest point. `check` is called
    before every halving; what it raises ends the work.
    """
    longest_side = float(np.ptp(mesh.bounds, axis=0).max())
    finest = max(OF_MEAN_FREE_PATH * mean_free_path, FINEST * longest_side)
    coarsest = max(COARSEST * longest_side, FINEST * longest_side)
    nearest = cKDTree(np.asarray(points, np.float64))
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (m, 3 corners, 3)
    normals = mesh.normals[mesh.faces].astype(np.float64)
    done: list[Sources] = []
    while len(corners):
        check()
        edge, length = _longest_edges(corners)
        distance = nearest.query(corners.mean(axis=1))[0] - 0.6 * length  # from the nearest corner, about
        small = length <= np.minimum(np.maximum(finest, SHARE * distance), coarsest)
        done.append(_sources(corners[small], normals[small]))
        corners, normals = _halved(corners[~small], edge[~small]), _halved(normals[~small], edge[~small])
    return Sources(*(np.concatenate([getattr(part, name) for part in done]) for name in Sources.__dataclass_fields__))


def _sources(corners: Array, normals: Array) -> Sources:
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1, keepdims=True)
    keep = double[:, 0] > 0.0
    faces, normal = cross[keep] / double[keep], normals[keep].sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), faces)
    faces *= np.where(np.einsum("ij,ij->i", faces, normal) < 0.0, -1.0, 1.0)[:, None]
    return Sources(corners[keep].mean(axis=1), normal, faces, 0.5 * double[keep, 0])


def _longest_edges(corners: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Which edge of each triangle is longest (edge i runs from corner i to i + 1), and its length."""
    sides = np.roll(corners, -1, axis=1) - corners
    squares = np.einsum("nij,nij->ni", sides, sides)
    edge = squares.argmax(axis=1)
    return edge, np.sqrt(squares[np.arange(len(edge)), edge])


def _halved(values: Array, edge: npt.NDArray[np.intp]) -> Array:
    """Split triangles at the middle of the given edge; (n, 3 corners, 3) -> (2 n, 3 corners, 3)."""
    rows = np.arange(len(edge))
    a, b, c = (values[rows, (edge + i) % 3] for i in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
