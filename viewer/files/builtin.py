"""The built-in sculpture as a model, without the readers of files, whose imports take half a second."""

from dataclasses import replace

from milkglass.core.geometry.mesh import Mesh, place_in_world, up_rotation
from milkglass.core.geometry.sculpture import SPACING, sculpture


def builtin_model(size_mm: float, up: str = "y", spacing: float = SPACING) -> Mesh:
    """Place the built-in sculpture in world space; parameters as in `load_model`, and `spacing` as in `sculpture`."""
    vertices, faces, normals = sculpture(spacing)
    mesh = Mesh.of(place_in_world(vertices, size_mm, up), normals @ up_rotation(up).T, faces)
    return replace(mesh, outward=True)
