"""Values at the vertices of a refined mesh, looked up between them and on the other side of a thin part."""

import numpy as np

from milkglass.core.geometry.refine import refined
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.passes.refined import RefinedSurface
from tests.support.solids import block, mesh_of


def test_values_are_those_of_the_face_and_of_the_other_side(context):
    fine = refined(mesh_of(block((10.0, 10.0, 1.0))), 1.0)
    surface = RefinedSurface(fine, MeshBuffers(context, fine.mesh))
    places, up = fine.mesh.vertices, np.array([[0.0, 0.0, 1.0]] * 3)
    points = np.array([[1.23, 0.71, 0.5], [-2.4, 3.1, 0.5], [0.0, 0.0, 0.5]])
    np.testing.assert_allclose(surface.at(places, points, up), points, atol=1e-3)
    np.testing.assert_allclose(surface.at(surface.behind(places), points, up), points - up, atol=1e-2)
