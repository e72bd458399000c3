"""Visibility bake: rays from the vertices of a mesh, and the directions in which they leave it."""

import threading
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Bytes, Float32
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.refine import weights_within
from milkglass.core.light.casting import Casting
from milkglass.core.light.visibility import Sight, blocks, direction_set, pattern_directions

# Directions over the sphere, half of them above a horizon: DIRECTIONS, more while all rays are at most MIN_RAYS, fewer
# where they are more than MAX_RAYS. On the dragon, Uffizi: 256 leave 2.8 % rms, 512 2.0, 1024 1.5, 4096 1.3.
DIRECTIONS, MIN_DIRECTIONS, MAX_DIRECTIONS = 1024, 256, 4096
MIN_RAYS, MAX_RAYS = 1 << 24, 1 << 26
RAYS_AT_A_TIME = 1 << 16  # in one thread: 0.02 s, between checks for cancellation
# Heights of the origins of rays above the surface, in radii of the object: 0.06 mm at 100 mm. Triangles of a scan may
# be folded over, and a vertex below such a fold would be a dark spot; where back faces are visible at the first height,
# rays start from the next.
LIFTS = (1e-3, 1e-2)
INWARD = 1e-4  # radii below the surface at which rays into the object start
BURIED_SHARE = 0.5  # of the directions: points with fewer open ones are tested for folds above them
TEST_DIRECTIONS = 64  # over the sphere, for these tests
COPLANAR = 1e-4  # 1 - cosine between the faces of a vertex up to which they are one plane


def directions_for(n: int) -> int:
    """Return the number of directions of each of n points, a multiple of 8."""
    count = DIRECTIONS
    while count < MAX_DIRECTIONS and n * count <= MIN_RAYS:  # half of the doubled directions are above the horizon
        count *= 2
    while count > MIN_DIRECTIONS and n * count // 2 > MAX_RAYS:
        count //= 2
    return count


def bake(
    mesh: Mesh, progress: Callable[[float], object] = lambda _: None, cancelled: threading.Event | None = None
) -> Sight:
    """Return the directions in which rays from every vertex leave the mesh; cast in a thread for each processor.

    A ray above the horizon of the shading normal but below the plane of the adjacent faces, where these are coplanar,
    is mirrored at that plane: else the middle of each face of a coarse round object would be occluded by the face.

    Parameters
    ----------
    mesh : Mesh
        Its vertices are the points; `core.geometry.refine.refined` adds vertices to large faces.
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Once set, the bake ends within a tenth of a second.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    n, caster = len(mesh.vertices), _Caster(mesh)
    bits, casting = np.zeros((n, caster.count // 8), np.uint8), Casting(n, progress, cancelled)

    def cast(block: tuple[int, npt.NDArray[np.intp]]) -> None:
        pattern, points = block
        directions = pattern_directions(caster.count, pattern).astype(np.float32)
        step = max(1, 2 * RAYS_AT_A_TIME // caster.count)
        for start in range(0, len(points), step):
            casting.check()
            vertices = points[start : start + step]
            bits[vertices] = caster.visible_bits(vertices, directions)
            casting.finished(len(vertices))

    casting.run(cast, blocks(n))
    return Sight(caster.normals, bits)


class _Caster:
    """Casts rays from the vertices of a mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.count = directions_for(len(mesh.vertices))
        self.normals = unit_normals(mesh)
        self._vertices, self._radius = mesh.vertices, mesh.radius
        self._planes, self._faces = plane_normals(mesh), face_cross(mesh.vertices, mesh.faces)
        self._rays = mesh.rays
        self._test_directions = direction_set(TEST_DIRECTIONS).astype(np.float32)

    def visible_bits(self, points: npt.NDArray[np.intp], directions: Float32) -> Bytes:
        """Return the bits of vertices; those below a fold of the surface cast rays from above it, if it is near."""
        bits = self._bits(points, directions, LIFTS[0])
        for lower, higher in pairwise(LIFTS):
            dark = np.flatnonzero(np.bitwise_count(bits).sum(axis=1) < BURIED_SHARE * self.count / 2)
            buried = dark[self._are_buried(points[dark], lower)]
            if len(buried):
                bits[buried] = self._bits(points[buried], directions, higher)
        return bits

    def _bits(self, points: npt.NDArray[np.intp], directions: Float32, lift: float) -> Bytes:
        above = self._above(points, directions)
        point, direction = np.nonzero(above)
        rays, planes = directions[direction], self._planes[points[point]]
        below = np.minimum(np.einsum("ij,ij->i", rays, planes), 0.0)
        rays -= 2.0 * below[:, None] * planes
        above[point, direction] = ~self._rays.occluded(self._origins(points, lift)[point], rays)
        return np.packbits(above, axis=1)

    def _are_buried(self, points: npt.NDArray[np.intp], lift: float) -> npt.NDArray[np.bool_]:
        """Return whether most test rays of each point hit back faces, as from inside a solid."""
        point, direction = np.nonzero(self._above(points, self._test_directions))
        rays = self._test_directions[direction]
        face, _ = self._rays.first(self._origins(points, lift)[point], rays)
        back_faces = (face >= 0) & (np.einsum("ij,ij->i", self._faces[face], rays) > 0.0)
        cast = np.bincount(point, minlength=len(points))
        return np.asarray(np.bincount(point, back_faces, minlength=len(points)) > 0.5 * cast)

    def _origins(self, points: npt.NDArray[np.intp], lift: float) -> Float32:
        return self._vertices[points] + np.float32(lift * self._radius) * self.normals[points]

    def _above(self, points: npt.NDArray[np.intp], directions: Float32) -> npt.NDArray[np.bool_]:
        """Return whether directions are above the horizons of points, (n_points, n_directions)."""
        # Written out: a matrix product would start threads of BLAS inside each of these.
        (x, y, z), normals = directions.T, self.normals[points]
        return np.asarray(normals[:, :1] * x + normals[:, 1:2] * y + normals[:, 2:] * z > 0.0)


def opposite_points(mesh: Mesh) -> tuple[npt.NDArray[np.int32], Float32]:
    """Return the point opposite to each vertex along its inverted normal: corners (n, 3) of a face, weights (n, 3).

    The vertex itself where there is none: on open meshes, and where two opposite normals cancel.
    """
    n, normals = len(mesh.vertices), unit_normals(mesh)
    origins = mesh.vertices - np.float32(INWARD * mesh.radius) * normals
    face, along = mesh.rays.first(origins, -normals)
    corners, weights = np.repeat(np.arange(n, dtype=np.int32)[:, None], 3, axis=1), np.zeros((n, 3), np.float32)
    weights[:, 0] = 1.0
    hit = np.flatnonzero((face >= 0) & (normals != 0.0).any(axis=1))
    corners[hit] = mesh.faces[face[hit]]
    points = origins[hit] - along[hit, None] * normals[hit]
    weights[hit] = weights_within(mesh.vertices, corners[hit], points)
    return corners, weights


def unit_normals(mesh: Mesh) -> Float32:
    """Return unit normals of the vertices, (n, 3); 0 where interpolated ones cancel: no direction is visible."""
    length = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    return np.where(length > 1e-6, mesh.normals / np.maximum(length, 1e-6), 0.0).astype(np.float32)


def plane_normals(mesh: Mesh) -> Float32:
    """Return the unit normal of the plane of each vertex' faces, (n, 3); 0 where they are not coplanar."""
    cross = face_cross(mesh.vertices, mesh.faces)
    corners = mesh.faces.ravel()
    total = np.stack([np.bincount(corners, np.repeat(c, 3), minlength=len(mesh.vertices)) for c in cross.T], axis=1)
    length = np.linalg.norm(total, axis=1)
    areas = np.bincount(corners, np.repeat(np.linalg.norm(cross, axis=1), 3), minlength=len(mesh.vertices))
    flat = (length > 0.0) & (length >= (1.0 - COPLANAR) * areas)
    return np.where(flat[:, None], total / np.maximum(length, 1e-300)[:, None], 0.0).astype(np.float32)
