"""Small models with colours and relief, as files."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

FLAT = (128, 128, 255)


def ball_with_map(columns: int = 24, rows: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and texture coordinates of a unit ball: u around +y from +x towards -z, v upwards; one seam."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    theta, phi = np.pi * (1.0 - v), 2.0 * np.pi * u
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), -np.sin(theta) * np.sin(phi)], axis=-1)
    vertices = vertices.round(9) + 0.0  # both sides of the seam are the same points
    i = np.arange(u.size).reshape(u.shape)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    return vertices.reshape(-1, 3), faces, np.stack([u, v], axis=-1).reshape(-1, 2)


def picture(colour: tuple[int, int, int] | np.ndarray, side: int = 8) -> Image.Image:
    """One colour, or pixels (h, w, 3), row 0 at the top."""
    pixels = np.asarray(colour, np.uint8)
    return Image.fromarray(pixels if pixels.ndim == 3 else np.tile(pixels, (side, side, 1)))


def write_ball(path: Path, colour: Image.Image | None = None, normal: Image.Image | None = None, **material) -> Path:
    """A ball with textures; without any it has texture coordinates alone."""
    vertices, faces, uv = ball_with_map()
    made = trimesh.visual.material.PBRMaterial(baseColorTexture=colour, normalTexture=normal, **material)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=made)
    trimesh.Trimesh(vertices, faces, process=False, visual=visual).export(path)
    return path


def write_slab(path: Path, colour: Image.Image | None = None, normal: Image.Image | None = None) -> Path:
    """A square slab whose upper side, +z, has the whole texture upright, u along +x and v along +y."""
    box = trimesh.creation.box((2.0, 2.0, 0.5))
    corners = box.vertices[box.faces.ravel()]
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=colour, normalTexture=normal)
    visual = trimesh.visual.TextureVisuals(uv=0.5 + 0.5 * corners[:, :2], material=material)
    faces = np.arange(len(corners)).reshape(-1, 3)
    trimesh.Trimesh(corners, faces, process=False, visual=visual).export(path)
    return path
