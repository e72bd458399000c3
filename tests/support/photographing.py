"""Small photographs made for the tests of `milkglass edit`."""

from pathlib import Path

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.viewer.files.images import write_png
from milkglass.viewer.files.photograph import Photo, load_photo


def ball_photo(size: int = 96, towards: tuple[float, float, float] = (0.0, 0.6, 0.8)) -> tuple[Array, Array, Array]:
    """A matt ball lit by a lamp before a coloured wall: linear RGB (n, n, 3), mask (n, n), normals (n, n, 3)."""
    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) / (0.3 * size)
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    normals = np.stack([x, -y, z], axis=-1)
    mask = (x**2 + y**2 < 1.0).astype(np.float64)
    lit = 0.1 + 0.5 * np.maximum(normals @ (np.array(towards) / np.linalg.norm(towards)), 0.0)
    wall = np.broadcast_to([0.3, 0.25, 0.2], (size, size, 3))
    picture = np.where(mask[..., None] > 0.0, lit[..., None] * np.array([1.0, 0.9, 0.8]), wall)
    return picture, mask, normals


def write_photo(folder: Path, linear: Array, mask: Array, bits: int = 8) -> tuple[Path, Path]:
    """Write a photograph, sRGB, and its mask."""
    most, kind = (255, np.uint8) if bits == 8 else (65535, np.uint16)
    write_png(folder / "photo.png", np.rint(srgb(linear) * most).astype(kind))
    write_png(folder / "mask.png", np.rint(mask * 255).astype(np.uint8)[..., None])
    return folder / "photo.png", folder / "mask.png"


def small_photo(folder: Path) -> Photo:
    picture, mask, _ = ball_photo()
    return load_photo(*write_photo(folder, picture, mask))
