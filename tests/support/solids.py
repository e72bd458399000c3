"""Models of several parts, as meshes in world space (mm)."""

import numpy as np
import trimesh

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.normals import crease_normals


def mesh_of(*parts: trimesh.Trimesh) -> Mesh:
    """Join parts, with normals as the program computes them for files without."""
    placed = [crease_normals(np.asarray(part.vertices), np.asarray(part.faces)) for part in parts]
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in placed)])
    return Mesh.of(
        np.concatenate([vertices for vertices, _, _ in placed]),
        np.concatenate([normals for _, normals, _ in placed]),
        np.concatenate([faces + start for (_, _, faces), start in zip(placed, starts, strict=False)]),
    )


def ball(radius=1.0, at=(0.0, 0.0, 0.0), subdivisions=3, inverted=False) -> trimesh.Trimesh:
    part = trimesh.creation.icosphere(subdivisions, radius)
    part.apply_translation(at)
    if inverted:
        part.invert()
    return part


def block(extents, at=(0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    part = trimesh.creation.box(extents)
    part.apply_translation(at)
    return part


def hollow(outer: trimesh.Trimesh, inner: trimesh.Trimesh) -> Mesh:
    """A wall between two surfaces."""
    turned = inner.copy()
    turned.invert()
    return mesh_of(outer, turned)


def sheet(z: float, side: float = 2.0) -> trimesh.Trimesh:
    corners = 0.5 * side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return trimesh.Trimesh(np.column_stack([corners, np.full(4, z)]), [[0, 1, 2], [0, 2, 3]], process=False)


def rings(radius: float = 6.0) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """Two linked tori, whose boxes overlap."""
    one = trimesh.creation.torus(radius, 0.3 * radius, 48, 24)
    other = one.copy()
    other.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [1, 0, 0]))
    other.apply_translation([radius, 0.0, 0.0])
    return one, other


def plates(thickness: float = 2.0, gap: float = 0.5, side: float = 20.0) -> Mesh:
    """Two square plates across z; the first is at the back."""
    off = 0.5 * (thickness + gap)
    extents = (side, side, thickness)
    return mesh_of(block(extents, (0.0, 0.0, -off)), block(extents, (0.0, 0.0, off)))


def scattered(count: int, subdivisions: int = 1, seed: int = 0) -> Mesh:
    """Balls of radius 0.4 on a lattice of spacing 1, a little moved, but never enough to touch."""
    side = int(np.ceil(count ** (1.0 / 3.0)))
    places = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:count]
    moved = places + np.random.default_rng(seed).uniform(-0.05, 0.05, places.shape)
    return mesh_of(*(ball(0.4, at, subdivisions) for at in moved))


def tubes() -> Mesh:
    """Two capped tubes that touch along a line; for light from -x the second one lies in the shadow of the first."""
    parts = []
    for radius, length, at, turn in ((5.0, 40.0, (-5.0, 0.0, 0.0), 0.0), (4.2, 39.0, (4.195, 0.37, 0.0), np.pi / 64)):
        part = trimesh.creation.cylinder(radius, length, sections=64).subdivide_to_size(2.5)
        part.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, 0, 1]))
        part.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, [1, 0, 0]))
        part.apply_translation(at)
        parts.append(part)
    return mesh_of(*parts)
