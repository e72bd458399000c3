"""Shares of the environment that vertices see, as the passes take them."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from milkglass.core.arrays import Float32
from milkglass.core.geometry.refine import interpolated
from milkglass.viewer.assets.visibility import LONGEST_EDGE, BakedVisibility
from milkglass.viewer.gl.buffers import MeshBuffers


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Shares of one environment's light, on both sides.

    Attributes
    ----------
    baked : BakedVisibility
    shares : (n, 3) float32
        Of the vertices of the refined mesh, in [0, 1].
    buffers : MeshBuffers
        Of that mesh.
    values : buffer
        Shares, three floats a vertex.
    """

    baked: BakedVisibility
    shares: Float32
    buffers: MeshBuffers
    values: moderngl.Buffer

    def at(self, points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return shares (n, 3) at points of the surface with normals: of the nearest vertices that face that way."""
        weights, nearest = self._neighbours(points, normals)
        return np.asarray(np.einsum("nk,nkc->nc", weights, self.shares[nearest]))

    def _neighbours(
        self, points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
        mesh = self.baked.refined.mesh
        turn = LONGEST_EDGE * mesh.radius  # mm that a turn of the normal by a radian counts
        tree = cKDTree(np.concatenate([mesh.vertices, turn * mesh.normals], axis=1))
        distance, nearest = tree.query(np.concatenate([points, turn * normals], axis=1), k=min(3, len(mesh.vertices)))
        distance, nearest = (np.reshape(values, (len(points), -1)) for values in (distance, nearest))
        weights = 1.0 / (distance**2 + (1e-6 * mesh.radius) ** 2)
        return weights / weights.sum(axis=1, keepdims=True), nearest

    def behind(self, context: moderngl.Context) -> moderngl.Buffer:
        """Return the shares seen against each vertex' normal, as a buffer of three floats a vertex."""
        return context.buffer(interpolated(*self.baked.opposite, self.shares))

    def bodies(self, context: moderngl.Context, of_vertex: npt.NDArray[np.int32]) -> moderngl.Buffer:
        """Return the body of each vertex of the refined mesh, as a buffer of one float a vertex."""
        return context.buffer(of_vertex[self.baked.refined.sources].astype(np.float32))
