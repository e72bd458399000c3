"""What the vertices of a mesh see of an environment: of a refined mesh, by rays, or as the cache has it. No OpenGL."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined, refined
from milkglass.core.light.bake import Cancelled, bake, opposite_places
from milkglass.core.light.visibility import Visibility, transfer
from milkglass.viewer.assets import visibility_cache
from milkglass.viewer.scene.settings import EnvironmentSettings

# Of the longest side, between places where visibility is known: a slab with a ball and a block on it has 1.2 % rms at
# 0.02 (27,000 vertices), 1.7 % at 0.03 (15,000), 5.5 % at 0.1.
LONGEST_EDGE = 0.03


@dataclass(frozen=True, eq=False)
class BakedVisibility:
    """What the vertices of a refined mesh see."""

    refined: Refined
    visibility: Visibility

    @cached_property
    def opposite(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
        """Vertices (n, 3) and weights (n, 3) that interpolate where each vertex' normal, backwards, leaves the object.

        Where it leaves it nowhere, the vertex itself.
        """
        return opposite_places(self.refined.mesh)


def bake_visibility(
    mesh: Mesh,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
    ahead: bool = False,
) -> BakedVisibility:
    """Refine a mesh and cast rays from its vertices, or find on disk what they met; errors as `core`'s `bake`.

    `ahead` makes at once what highlights and thin sheets would have to wait for when they are first asked for.
    """
    stop = cancelled or threading.Event()

    def go_on() -> None:
        if stop.is_set():
            raise Cancelled

    fine = refined(mesh, LONGEST_EDGE * float(np.ptp(mesh.bounds, axis=0).max()))
    go_on()
    sight = visibility_cache.read(fine.mesh)
    if sight is None:
        sight = bake(fine.mesh, progress, stop)
        visibility_cache.write(fine.mesh, sight)
    baked = BakedVisibility(fine, transfer(sight, go_on=go_on))
    if ahead:
        baked.visibility.blocked(go_on)
        baked.opposite  # noqa: B018  (it is kept)
    return baked


def needs_visibility(environment: EnvironmentSettings) -> bool:
    """Whether there is light that something may be in the way of."""
    return environment.given and environment.occluded and environment.intensity > 0.0
