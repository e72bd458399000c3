"""Rays between parts of a mesh: cast, or as the cache has them. No OpenGL."""

import threading
from collections.abc import Callable

import numpy as np

from milkglass.core.geometry.refine import Refined
from milkglass.core.light.crossing import Crossings, Needed, cast_crossings
from milkglass.core.light.exchange import NEGLIGIBLE, Hits, cast_hits, self_visible_share
from milkglass.core.light.indices import Eta, Indices
from milkglass.core.light.vertex_rays import RAYS
from milkglass.viewer.assets.ray_cache import RayCache

CACHE = RayCache("exchange", version=3)
DTYPES = {"first": np.int64, "cosines": np.float16, "faces": np.int32, "directions": np.float16}

CROSSINGS_VERSION = 2
CROSSING_DTYPES = {
    "first": np.int64, "faces": np.int32, "weights": np.float16, "lengths": np.float32, "left_first": np.int64,
    "directions": np.float16, "left_weights": np.float16, "left_lengths": np.float32,
}  # fmt: skip


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


def find_crossings(
    fine: Refined,
    eta: Eta,
    needed: Needed,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
) -> Crossings:
    """Return the paths through the matter of a refined mesh that are needed.

    Raises
    ------
    BakeCancelled
        If `cancelled` was set.
    """
    mesh, rays, reach = fine.mesh, needed.rays, needed.reach
    if isinstance(eta, Indices):
        return cast_crossings(mesh, eta, reach, rays, progress=progress, cancelled=cancelled)
    cache = RayCache("crossings", f"{CROSSINGS_VERSION} {eta} {rays} {reach}")
    kept = cache.read(mesh, CROSSING_DTYPES)
    if kept is not None and len(kept["first"]) == len(mesh.vertices) + 1:
        return Crossings(rays, eta, reach, **kept)
    found = cast_crossings(mesh, eta, reach, rays, progress=progress, cancelled=cancelled)
    cache.keep(mesh, {name: getattr(found, name) for name in CROSSING_DTYPES})
    return found
