"""A refined mesh on the GPU: values that are known at its vertices are drawn and looked up between them."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from milkglass.core.arrays import Float32
from milkglass.core.geometry.refine import Refined, interpolated, weights_within
from milkglass.core.light.bake import opposite_points
from milkglass.core.threads import computed_once
from milkglass.viewer.assets.visibility import LONGEST_EDGE
from milkglass.viewer.gl.buffers import MeshBuffers

LIFT = 1e-3  # radii above the surface from which points are looked for on it


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
        """Return values of the vertices (n, k) at m points of the surface with normals, (m, k), as pixels have them."""
        mesh, lift = self.refined.mesh, LIFT * self.refined.mesh.radius
        face, along = self.refined.mesh.rays.first(points + lift * normals, -normals)
        corners = mesh.faces[face]
        weights = weights_within(mesh.vertices, corners, points)
        found = np.einsum("nk,nkc->nc", weights, values[corners])
        far = np.flatnonzero((face < 0) | (np.abs(along - lift) > lift))
        if len(far):  # not quite on the surface: the nearest vertex that faces that way
            places = np.concatenate([points[far], self._turn * normals[far]], axis=1)
            found[far] = values[self._tree.query(places)[1]]
        return np.asarray(found)

    def behind(self, values: Float32) -> Float32:
        """Return values of the vertices, (n, k), on the other side of the object, seen against each normal: (n, k)."""
        return np.asarray(interpolated(*self.opposite, values))

    def bodies(self, context: moderngl.Context, of_vertex: npt.NDArray[np.int32]) -> moderngl.Buffer:
        """Return the body of each vertex, as a buffer of one float a vertex."""
        return context.buffer(of_vertex[self.refined.sources].astype(np.float32))
