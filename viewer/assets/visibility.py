"""What the vertices of a mesh see of an environment: of a refined mesh, by rays, or as the cache has it. No OpenGL."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined, refined
from milkglass.core.light.bake import bake, directions_for, unit_normals
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.light.visibility import Sight, Visibility, transfer
from milkglass.viewer.assets.ray_cache import RayCache
from milkglass.viewer.scene.settings import EnvironmentSettings

# Of the longest side, between places where visibility is known: a slab with a ball and a block on it has 1.2 % rms at
# 0.02 (27,000 vertices), 1.7 % at 0.03 (15,000), 5.5 % at 0.1.
LONGEST_EDGE = 0.03
VERSION = 3  # of what is in the files, and of how rays are cast


def cached_sight(mesh: Mesh) -> Sight | None:
    """Return a mesh's sight from the cache; None where there is none, or its file is damaged."""
    kept = _cache(mesh).read(mesh, {"bits": np.uint8})
    if kept is None or kept["bits"].shape != (len(mesh.vertices), directions_for(len(mesh.vertices)) // 8):
        return None
    return Sight(unit_normals(mesh), kept["bits"])


def keep_sight(mesh: Mesh, sight: Sight) -> None:
    """Write a mesh's sight to the cache, whole or not at all, and delete the files that were not used for longest."""
    _cache(mesh).keep(mesh, {"bits": sight.bits})


def _cache(mesh: Mesh) -> RayCache:
    return RayCache("visibility", f"{VERSION} {directions_for(len(mesh.vertices))}")


@dataclass(frozen=True, eq=False)
class BakedVisibility:
    """What the vertices of a refined mesh see."""

    refined: Refined
    visibility: Visibility


def refine(mesh: Mesh) -> Refined:
    """Return a mesh refined to where visibility and light between its parts are known."""
    return refined(mesh, LONGEST_EDGE * float(np.ptp(mesh.bounds, axis=0).max()))


def bake_visibility(
    fine: Refined,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
    *,
    ahead: bool = False,
) -> BakedVisibility:
    """Cast rays from the vertices of a refined mesh, or find on disk what they met; errors as `core`'s `bake`.

    `ahead` makes at once what highlights would have to wait for when they are first asked for.
    """
    stop = cancelled or threading.Event()

    def check() -> None:
        if stop.is_set():
            raise BakeCancelled

    sight = cached_sight(fine.mesh)
    if sight is None:
        sight = bake(fine.mesh, progress, stop)
        keep_sight(fine.mesh, sight)
    baked = BakedVisibility(fine, transfer(sight, check=check))
    if ahead:
        baked.visibility.blocked(check)
    return baked


def needs_visibility(environment: EnvironmentSettings) -> bool:
    """Tell whether a scene has light of an environment that the object may occlude."""
    return environment.given and environment.occluded and environment.intensity > 0.0
