"""Rays between parts of a mesh: cast, or as the cache has them. No OpenGL."""

import threading
from collections.abc import Callable

import numpy as np

from milkglass.core.geometry.refine import Refined
from milkglass.core.light.exchange import NEGLIGIBLE, RAYS, Hits, cast_hits, self_visible_share
from milkglass.viewer.assets.ray_cache import RayCache

CACHE = RayCache("exchange", version=1)
DTYPES = {"first": np.int64, "cosines": np.float16, "faces": np.int32, "directions": np.float16}


def find_hits(
    fine: Refined, progress: Callable[[float], object] = lambda _: None, cancelled: threading.Event | None = None
) -> Hits | None:
    """Return the rays that meet a refined mesh again, or None where next to none do, as on convex objects.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    mesh = fine.mesh
    kept = CACHE.read(mesh, DTYPES)
    if kept is not None and len(kept["first"]) == len(mesh.vertices) + 1:
        return Hits(RAYS, **kept)
    if self_visible_share(mesh) < NEGLIGIBLE:
        return None
    hits = cast_hits(mesh, RAYS, progress, cancelled)
    CACHE.keep(mesh, {name: getattr(hits, name) for name in DTYPES})
    return hits
