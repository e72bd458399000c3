"""A refined mesh on the GPU: values that are known at its vertices are drawn and looked up between them."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from milkglass.core.geometry.refine import Refined
from milkglass.core.light.bake import opposite_points
from milkglass.core.threads import computed_once
from milkglass.viewer.assets.visibility import LONGEST_EDGE
from milkglass.viewer.gl.buffers import MeshBuffers


@dataclass(frozen=True, eq=False)
class RefinedSurface:
    """A refined mesh of n vertices.

    Attributes
    ----------
    refined : Refined
    buffers : MeshBuffers
        Of it.
    """

    refined: Refined
    buffers: MeshBuffers

    @computed_once
    def opposite(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
        """Vertices (n, 3) and weights (n, 3) that interpolate where each vertex' normal, backwards, leaves the object.

        Where it leaves it nowhere, the vertex itself.
        """
        return opposite_points(self.refined.mesh)

    @computed_once
    def _tree(self) -> cKDTree:
        mesh = self.refined.mesh
        return cKDTree(np.concatenate([mesh.vertices, self._turn * mesh.normals], axis=1))

    @property
    def _turn(self) -> float:
        return LONGEST_EDGE * self.refined.mesh.radius  # mm that a turn of the normal by a radian counts

    def at(
        self, values: npt.NDArray[np.floating], points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.float64]:
        """Return values of the vertices (n, k) at m points with normals, (m, k): of the nearest that face that way."""
        mesh = self.refined.mesh
        places = np.concatenate([points, self._turn * normals], axis=1)
        distance, nearest = self._tree.query(places, k=min(3, len(mesh.vertices)))
        distance, nearest = (np.reshape(found, (len(points), -1)) for found in (distance, nearest))
        weights = 1.0 / (distance**2 + (1e-6 * mesh.radius) ** 2)
        weights /= weights.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum("nk,nkc->nc", weights, values[nearest]))

    def bodies(self, context: moderngl.Context, of_vertex: npt.NDArray[np.int32]) -> moderngl.Buffer:
        """Return the body of each vertex, as a buffer of one float a vertex."""
        return context.buffer(of_vertex[self.refined.sources].astype(np.float32))
