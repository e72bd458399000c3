"""What the vertices of a mesh see of an environment: of a refined mesh, by rays, or as the cache has it. No OpenGL."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from core.mesh import Mesh
from core.refine import Refined, refined
from core.visibility import Visibility, transfer
from core.visibility_bake import bake
from viewer import visibility_cache
from viewer.settings import EnvironmentSettings

# Of the longest side, between places where visibility is known: a slab with a ball and a block on it has 1.2 % rms at
# 0.02 (27,000 vertices), 1.7 % at 0.03 (15,000), 5.5 % at 0.1.
LONGEST_EDGE = 0.03


@dataclass(frozen=True, eq=False)
class BakedVisibility:
    """What the vertices of a refined mesh see."""

    refined: Refined
    visibility: Visibility


def bake_visibility(
    mesh: Mesh, progress: Callable[[float], object] = lambda _: None, cancelled: threading.Event | None = None
) -> BakedVisibility:
    """Refine a mesh and cast rays from its vertices, or find on disk what they met; errors as `core`'s `bake`."""
    fine = refined(mesh, LONGEST_EDGE * float(np.ptp(mesh.bounds, axis=0).max()))
    sight = visibility_cache.read(fine.mesh)
    if sight is None:
        sight = bake(fine.mesh, progress, cancelled)
        visibility_cache.write(fine.mesh, sight)
    return BakedVisibility(fine, transfer(sight))


def needs_visibility(environment: EnvironmentSettings) -> bool:
    """Whether there is light that something may be in the way of."""
    return environment.given and environment.occluded and environment.intensity > 0.0
