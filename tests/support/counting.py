"""Work counted, where a test asks what something costs: times depend on what else the machine does, counts do not."""

import gc
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import ExitStack
from types import FrameType
from unittest.mock import patch

from milkglass.core.arrays import Floats
from milkglass.core.geometry.rays import RayMesh


def calls(work: Callable[[], object]) -> int:
    """Functions that this thread calls during some work, Python's and C's: loops over elements show, arrays do not.

    Not those that the garbage collector calls for what earlier work left behind.
    """
    count = 0

    def profile(_: FrameType, event: str, __: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    previous = sys.getprofile()
    gc.collect()
    gc.disable()
    sys.setprofile(profile)
    try:
        work()
    finally:
        sys.setprofile(previous)
        gc.enable()
    return count


def peak_bytes(work: Callable[[], object]) -> int:
    """Most memory that Python and NumPy hold at once for some work, beyond what they held before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def rays_cast(work: Callable[[], object]) -> int:
    """Rays that any thread casts against meshes during some work."""
    count = 0

    def counted(cast: Callable[..., object]) -> Callable[..., object]:
        def run(mesh: RayMesh, origins: Floats, *arguments: object, **named: object) -> object:
            nonlocal count
            count += len(origins)
            return cast(mesh, origins, *arguments, **named)

        return run

    with ExitStack() as patched:
        for name in ("first", "places", "occluded"):
            patched.enter_context(patch.object(RayMesh, name, counted(getattr(RayMesh, name))))
        work()
    return count
