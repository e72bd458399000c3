"""Rays from the plane below a mesh: cast, or as the cache has them. No OpenGL."""

import threading
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from milkglass.core.geometry.refine import Refined
from milkglass.core.light.ground import RAYS, SIDE, GroundPlane, GroundRays, ReturningRays, cast_from_ground
from milkglass.viewer.assets.ray_cache import RayCache

VERSION = 2  # of what is in the files, and of how rays are cast
DTYPES = {
    "free": np.uint8, "first": np.int64, "faces": np.int32, "cosines": np.float16, "directions": np.float16,
    "ends": np.int32,
}  # fmt: skip
RETURNING_DTYPES = {"returning_first": np.int64, "returning_cosines": np.float16, "returning_ends": np.int32}


def find_ground_rays(
    fine: Refined,
    plane: GroundPlane,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> GroundRays:
    """Return the rays between a plane and a refined mesh.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    cache = RayCache("ground", f"{VERSION} {plane}")
    kept = cache.read(fine.mesh, DTYPES | RETURNING_DTYPES)
    if kept is not None and _fits(kept, fine):
        returning = ReturningRays(*(kept.pop(name) for name in RETURNING_DTYPES))
        return GroundRays(**kept, returning=returning)
    rays = cast_from_ground(fine.mesh, plane, progress, cancelled)
    of_mesh = {name: getattr(rays.returning, name.removeprefix("returning_")) for name in RETURNING_DTYPES}
    cache.keep(fine.mesh, {name: getattr(rays, name) for name in DTYPES} | of_mesh)
    return rays


def _fits(kept: dict[str, npt.NDArray[np.generic]], fine: Refined) -> bool:
    """Tell whether what a file holds is of this map and this mesh."""
    lengths = len(kept["first"]), len(kept["returning_first"])
    return kept["free"].shape == (SIDE**2, RAYS // 8) and lengths == (SIDE**2 + 1, len(fine.mesh.vertices) + 1)
