"""Planes of a frame as files of their own: the object's coverage, its depth, its normals."""

from pathlib import Path

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.viewer.files.images import check_output, write_exr, write_png

MASK_SUFFIXES, DEPTH_SUFFIXES = (".png",), (".exr", ".png")
STEPS = 65535  # of 16 bits


def write_mask(path: str | Path, mask: Float32) -> None:
    """Write coverage (H, W) as 8 bits."""
    check_output(path, MASK_SUFFIXES)
    write_png(path, _steps(mask, 255).astype(np.uint8)[..., None])


def write_depth(path: str | Path, depth: Float32, mask: Float32) -> tuple[float, float]:
    """Write depth (H, W), mm, and return the nearest and the farthest.

    ``.exr`` holds mm in the channel Z; ``.png`` 16 bits, 1 the nearest and 65535 the farthest, evenly between, with
    these two in its texts `near_mm` and `far_mm`. Both are 0 where the object is not.
    """
    check_output(path, DEPTH_SUFFIXES)
    seen = depth[mask > 0.0]
    near, far = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 0.0)
    if Path(path).suffix.lower() == ".exr":
        write_exr(path, {"Z": depth})
        return near, far
    places = (depth - near) / max(far - near, 1e-9)
    steps = np.where(mask > 0.0, 1 + _steps(places, STEPS - 1), 0).astype(np.uint16)
    write_png(path, steps[..., None], texts={"near_mm": repr(near), "far_mm": repr(far)})
    return near, far


def write_normals(path: str | Path, normal: Float32) -> None:
    """Write unit vectors (H, W, 3) in world space as 16 bits, 0 to 1 for -1 to 1."""
    write_png(path, _steps(0.5 + 0.5 * normal, STEPS).astype(np.uint16))


def _steps(values: Float32, top: int) -> Float32:
    return np.asarray(np.rint(np.clip(values, 0.0, 1.0) * top))
