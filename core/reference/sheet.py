"""Thin slabs by rays: the far side, where light enters, of the term in shaders/light/sheet.glsl."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh

# Injected into the shader: each pair is the range of a smooth step between a thin slab and none.
PARALLEL_COSINE = (0.6, 0.95)  # cosine between the two sides
NEAR_DISTANCE = (0.5, 1.0)  # distance along the ray, over the reach
OFF_PLANE = (0.25, 1.0)  # distance of neighbouring entries from the plane of an entry, over their distance
PROBE_DISTANCE = 0.25  # of these neighbours, over the reach


@dataclass(frozen=True, eq=False)
class FarSide:
    """Far side of a thin slab, where light enters that leaves at given points.

    Attributes
    ----------
    thickness : (n,) float64
        Thickness of the slab, mm; 0 where there is none.
    cosine : (n,) float64
        Cosine of the light on the far side.
    share : (n,) float64
        Weight of the term, in [0, 1]: how much the surroundings are a thin slab.
    face : (n,) int64
        Face where the light enters.
    """

    thickness: Array
    cosine: Array
    share: Array
    face: npt.NDArray[np.int64]


class SheetRays:
    """Rays from a distant light against a mesh, as in its shadow map."""

    def __init__(self, mesh: Mesh) -> None:
        self._scene = EmbreeScene()
        TriangleMesh(scene=self._scene, vertices=mesh.vertices, indices=mesh.faces)
        self._far = 2.0 * mesh.radius + 1.0

    def far_side(self, points: npt.ArrayLike, normals: npt.ArrayLike, towards: Array, reach: float) -> FarSide:
        """Return the far side of points (n, 3) with unit normals, along `towards` a light; `reach` as of LocalTerm."""
        points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
        entry, far_side, face = self._entries(points, towards)
        distance = (entry - points) @ towards
        facing = np.maximum(0.0, -(normals @ towards))
        parallel = _smoothstep(*PARALLEL_COSINE, -np.einsum("ij,ij->i", normals, far_side))
        near = 1.0 - _smoothstep(*NEAR_DISTANCE, distance / reach)
        flat = np.zeros(len(points))
        lateral = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
        lateral /= np.linalg.norm(lateral)
        for side in (lateral, np.cross(towards, lateral)):
            for sign in (-1.0, 1.0):
                neighbour, *_ = self._entries(points + sign * PROBE_DISTANCE * reach * side, towards)
                off = np.abs(np.einsum("ij,ij->i", neighbour - entry, far_side))
                flat += 0.25 * (1.0 - _smoothstep(*OFF_PLANE, off / (PROBE_DISTANCE * reach)))
        sheet = (facing > 0.0) & (distance > 0.0) & (distance < reach)
        cosine = np.clip(far_side @ towards, 0.0, facing)
        return FarSide(
            np.where(sheet, distance * facing, 0.0), cosine, np.where(sheet, parallel * near * flat, 0.0), face
        )

    def _entries(self, points: Array, towards: Array) -> tuple[Array, Array, npt.NDArray[np.int64]]:
        """Return where light towards points enters the mesh, the normals there, facing the light, and the faces."""
        origins = points + self._far * towards
        down = np.tile(-towards.astype(np.float32), (len(points), 1))
        hits = self._scene.run(origins.astype(np.float32), down, output=True)
        distance = np.where(hits["primID"] < 0, 2.0 * self._far, hits["tfar"])
        normals = hits["Ng"].astype(np.float64)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        normals *= np.where(normals @ towards < 0.0, -1.0, 1.0)[:, None]
        return origins - distance[:, None] * towards, normals, hits["primID"].astype(np.int64)


def _smoothstep(low: float, high: float, x: Array) -> Array:
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
