"""Rays from the vertices of a mesh: which directions lead out of it."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.refine import barycentric
from milkglass.core.light.visibility import Bytes, Sight, blocks, direction_set, pattern_directions

# Directions over the sphere, half of them above a horizon; more where few points make that cheap, fewer than the usual
# number where very many would make it long. On the dragon, Uffizi: 256 leave 2.8 % rms, 512 2.0, 1024 1.5, 4096 1.3.
DIRECTIONS, LEAST_DIRECTIONS, MOST_DIRECTIONS = 1024, 256, 4096
FEW_RAYS, MOST_RAYS = 1 << 24, 1 << 26
RAYS_AT_A_TIME = 1 << 16  # of one thread: 0.02 s, after which it may be cancelled
# Radii that rays start above the surface, 0.06 mm at 100 mm. A scan's triangles may be folded over, and a vertex below
# such a fold would be a dark spot on it; where it sees the backs of faces yet, it looks from higher still.
LIFTS = (1e-3, 1e-2)
INWARD = 1e-4  # radii that rays into the object start below it
DARK = 0.5  # of the directions: points that see less are looked at again
TEST_DIRECTIONS = 64  # over the sphere
COPLANAR = 1e-4  # 1 - cosine between the faces of a vertex up to which they are one plane
THREADS = 8

Progress = Callable[[float], object]


class Cancelled(Exception):  # noqa: N818  (not an error)
    """The bake was given up."""


def directions_for(n: int) -> int:
    """How many directions n points get, a multiple of 8."""
    count = DIRECTIONS
    while count < MOST_DIRECTIONS and n * count <= FEW_RAYS:  # the doubled number's half
        count *= 2
    while count > LEAST_DIRECTIONS and n * count // 2 > MOST_RAYS:
        count //= 2
    return count


def bake(mesh: Mesh, progress: Progress = lambda _: None, cancelled: threading.Event | None = None) -> Sight:
    """Cast rays from every vertex, in as many threads as there are processors.

    A ray that a shading normal sends below the plane of the faces around it, where they are flat, starts along that
    plane instead: else the middle of each face of a coarse round object would be in its own way.

    Parameters
    ----------
    mesh : Mesh
        Whose vertices are the points; `core.geometry.refine.refined` adds them to large faces.
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Ends it within a tenth of a second.

    Raises
    ------
    Cancelled
        If it was.
    """
    n, caster = len(mesh.vertices), _Caster(mesh)
    bits = np.zeros((n, caster.count // 8), np.uint8)
    finished, lock, stop = 0, threading.Lock(), cancelled or threading.Event()

    def cast(block: tuple[int, npt.NDArray[np.intp]]) -> None:
        nonlocal finished
        pattern, points = block
        directions = pattern_directions(caster.count, pattern).astype(np.float32)
        step = max(1, 2 * RAYS_AT_A_TIME // caster.count)
        for start in range(0, len(points), step):
            if stop.is_set():
                raise Cancelled
            vertices = points[start : start + step]
            bits[vertices] = caster.sees(vertices, directions)
            with lock:
                finished += len(vertices)
                progress(finished / n)

    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        try:
            for future in [pool.submit(cast, block) for block in blocks(n)]:
                future.result()
        except BaseException:
            stop.set()  # else leaving the pool would wait for all that is left
            raise
    return Sight(caster.normals, bits)


class _Caster:
    """Rays from the vertices of a mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.count = directions_for(len(mesh.vertices))
        self.normals = unit_normals(mesh)
        self._vertices, self._radius = mesh.vertices, mesh.radius
        self._planes, self._faces = flat_normals(mesh), face_cross(mesh.vertices, mesh.faces)
        self._rays = RayMesh(mesh.vertices, mesh.faces)
        self._few = direction_set(TEST_DIRECTIONS).astype(np.float32)

    def sees(self, points: npt.NDArray[np.intp], directions: Float32) -> Bytes:
        """Bits of some vertices; those below a fold of the surface look from above it, if it is near."""
        bits = self._bits(points, directions, LIFTS[0])
        for lower, higher in pairwise(LIFTS):
            dark = np.flatnonzero(np.bitwise_count(bits).sum(axis=1) < DARK * self.count / 2)
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
        """Whether most of what they see are the backs of faces, as from inside a solid."""
        point, direction = np.nonzero(self._above(points, self._few))
        ways = self._few[direction]
        face, _ = self._rays.first(self._origins(points, lift)[point], ways)
        backs = (face >= 0) & (np.einsum("ij,ij->i", self._faces[face], ways) > 0.0)
        seen = np.bincount(point, minlength=len(points))
        return np.asarray(np.bincount(point, backs, minlength=len(points)) > 0.5 * seen)

    def _origins(self, points: npt.NDArray[np.intp], lift: float) -> Float32:
        return self._vertices[points] + np.float32(lift * self._radius) * self.normals[points]

    def _above(self, points: npt.NDArray[np.intp], directions: Float32) -> npt.NDArray[np.bool_]:
        """Which directions are above the horizons of points, (points, directions)."""
        # Written out: a matrix product would start threads of its own inside these.
        (x, y, z), normals = directions.T, self.normals[points]
        return np.asarray(normals[:, :1] * x + normals[:, 1:2] * y + normals[:, 2:] * z > 0.0)


def opposite_places(mesh: Mesh) -> tuple[npt.NDArray[np.int32], Float32]:
    """Where the normal of each vertex, followed backwards, leaves the mesh: corners (n, 3) and weights (n, 3).

    The vertex itself where it does not: on open meshes, and where two opposite normals cancel.
    """
    n, normals = len(mesh.vertices), unit_normals(mesh)
    origins = mesh.vertices - np.float32(INWARD * mesh.radius) * normals
    face, along = RayMesh(mesh.vertices, mesh.faces).first(origins, -normals)
    corners, weights = np.repeat(np.arange(n, dtype=np.int32)[:, None], 3, axis=1), np.zeros((n, 3), np.float32)
    weights[:, 0] = 1.0
    met = np.flatnonzero((face >= 0) & (normals != 0.0).any(axis=1))
    corners[met] = mesh.faces[face[met]]
    points = origins[met] - along[met, None] * normals[met]
    inside = np.maximum(barycentric(mesh.vertices, corners[met], points), 0.0)
    weights[met] = inside / inside.sum(axis=1, keepdims=True)
    return corners, weights


def unit_normals(mesh: Mesh) -> Float32:
    """Normals of a mesh, (n, 3); where two opposite ones cancel halfway between, 0, which sees nothing."""
    length = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    return np.where(length > 1e-6, mesh.normals / np.maximum(length, 1e-6), 0.0).astype(np.float32)


def flat_normals(mesh: Mesh) -> Float32:
    """Normal of the plane that the faces of each vertex lie in, (n, 3); 0 where they do not lie in one."""
    cross = face_cross(mesh.vertices, mesh.faces)
    corners = mesh.faces.ravel()
    total = np.stack([np.bincount(corners, np.repeat(c, 3), minlength=len(mesh.vertices)) for c in cross.T], axis=1)
    length = np.linalg.norm(total, axis=1)
    areas = np.bincount(corners, np.repeat(np.linalg.norm(cross, axis=1), 3), minlength=len(mesh.vertices))
    flat = (length > 0.0) & (length >= (1.0 - COPLANAR) * areas)
    return np.where(flat[:, None], total / np.maximum(length, 1e-300)[:, None], 0.0).astype(np.float32)
