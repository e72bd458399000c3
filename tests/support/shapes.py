"""Shapes with closed forms or known traps, as meshes in world space (mm)."""

import trimesh

from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.bench.shapes import ball, flat_shaded, plate, torus_knot

__all__ = ["ball", "cube", "plate", "torus_knot"]


def cube(side: float = 20.0) -> Mesh:
    """Twelve triangles, flat shading."""
    box = trimesh.creation.box((side, side, side))
    return flat_shaded(box.vertices, box.faces)
