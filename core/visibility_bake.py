"""Rays from the vertices of a mesh: which directions lead out of it."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from core.mesh import Mesh, face_cross
from core.rays import RayMesh
from core.visibility import Bytes, Float32, Sight, blocks, pattern_directions

# Directions over the sphere, half of them above a horizon, of a mesh of up to MOST_RAYS in all. On the Buddha, Uffizi:
# 512 leave 2.1 % rms, 1024 1.7 %, 4096 1.5 %.
DIRECTIONS, LEAST_DIRECTIONS = 1024, 256
MOST_RAYS = 1 << 26
RAYS_AT_A_TIME = 1 << 17  # of one thread: 0.04 s, after which it may be cancelled
# Radii that rays start above the surface. Scans have creases of a hundredth of a radius, float32 knows a millionth.
RAY_OFFSET = 1e-4
FLAT = 1e-4  # 1 - cosine between the faces of a vertex up to which they are one plane
THREADS = 8

Progress = Callable[[float], object]


class Cancelled(Exception):  # noqa: N818  (not an error)
    """The bake was given up."""


def directions_for(n: int) -> int:
    """How many directions n points get, a multiple of 8."""
    affordable = DIRECTIONS
    while affordable > LEAST_DIRECTIONS and n * affordable // 2 > MOST_RAYS:
        affordable //= 2
    return affordable


def bake(mesh: Mesh, progress: Progress = lambda _: None, cancelled: threading.Event | None = None) -> Sight:
    """Cast rays from every vertex, in as many threads as there are processors.

    A ray that a shading normal sends below the plane of the faces around it, where they are flat, starts along that
    plane instead: else the middle of each face of a coarse round object would be in its own way.

    Parameters
    ----------
    mesh : Mesh
        Whose vertices are the points; `core.refine.refined` adds them to large faces.
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Ends it within a tenth of a second.

    Raises
    ------
    Cancelled
        If it was.
    """
    n, count = len(mesh.vertices), directions_for(len(mesh.vertices))
    normals = unit_normals(mesh)
    origins = mesh.vertices + np.float32(RAY_OFFSET * mesh.radius) * normals
    planes = flat_normals(mesh)
    rays = RayMesh(mesh.vertices, mesh.faces)
    bits = np.zeros((n, count // 8), np.uint8)
    done, lock, stop = 0, threading.Lock(), cancelled or threading.Event()

    def cast(block: tuple[int, npt.NDArray[np.intp]]) -> None:
        nonlocal done
        pattern, points = block
        directions = pattern_directions(count, pattern).astype(np.float32)
        step = max(1, 2 * RAYS_AT_A_TIME // count)
        for start in range(0, len(points), step):
            if stop.is_set():
                raise Cancelled
            some = points[start : start + step]
            bits[some] = _sees(rays, origins[some], normals[some], planes[some], directions)
            with lock:
                done += len(some)
                progress(done / n)

    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        try:
            for future in [pool.submit(cast, block) for block in blocks(n)]:
                future.result()
        except BaseException:
            stop.set()  # else leaving the pool would wait for all that is left
            raise
    return Sight(normals, bits)


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
    flat = (length > 0.0) & (length >= (1.0 - FLAT) * areas)
    return np.where(flat[:, None], total / np.maximum(length, 1e-300)[:, None], 0.0).astype(np.float32)


def _sees(rays: RayMesh, origins: Float32, normals: Float32, planes: Float32, directions: Float32) -> Bytes:
    """Bits of a few points."""
    x, y, z = directions.T
    # Written out: a matrix product would start threads of its own inside these.
    above = normals[:, :1] * x + normals[:, 1:2] * y + normals[:, 2:] * z > 0.0
    point, direction = np.nonzero(above)
    ways, plane = directions[direction], planes[point]
    below = np.minimum(np.einsum("ij,ij->i", ways, plane), 0.0)
    ways -= 2.0 * below[:, None] * plane
    above[point, direction] = ~rays.occluded(origins[point], ways)
    return np.packbits(above, axis=1)
