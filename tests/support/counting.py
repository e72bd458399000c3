"""Work counted, where a test asks what something costs: times depend on what else the machine does, counts do not."""

import sys
import tracemalloc
from collections.abc import Callable
from types import FrameType


def calls(work: Callable[[], object]) -> int:
    """Functions that this thread calls during some work, Python's and C's: loops over elements show, arrays do not."""
    count = 0

    def profile(_: FrameType, event: str, __: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    previous = sys.getprofile()
    sys.setprofile(profile)
    try:
        work()
    finally:
        sys.setprofile(previous)
    return count


def peak_bytes(work: Callable[[], object]) -> int:
    """Most memory that Python and NumPy hold at once for some work, beyond what they held before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
