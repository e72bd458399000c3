"""Rays from the plane below a mesh: cast, or as the cache has them. No OpenGL."""

import threading
from collections.abc import Callable

import numpy as np

from milkglass.core.geometry.refine import Refined
from milkglass.core.light.ground import RAYS, SIDE, GroundPlane, GroundRays, cast_from_ground
from milkglass.viewer.assets.ray_cache import RayCache

VERSION = 1  # of what is in the files, and of how rays are cast
DTYPES = {"free": np.uint8, "first": np.int64, "faces": np.int32, "cosines": np.float16}


def find_ground_rays(
    fine: Refined,
    plane: GroundPlane,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> GroundRays:
    """Return the rays from a plane to a refined mesh.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    cache = RayCache("ground", f"{VERSION} {plane}")
    kept = cache.read(fine.mesh, DTYPES)
    if kept is not None and kept["free"].shape == (SIDE**2, RAYS // 8) and len(kept["first"]) == SIDE**2 + 1:
        return GroundRays(**kept)
    rays = cast_from_ground(fine.mesh, plane, progress, cancelled)
    cache.keep(fine.mesh, {name: getattr(rays, name) for name in DTYPES})
    return rays
