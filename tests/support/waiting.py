"""Waiting for events: the deadline decides how long a failure takes, never whether a slow machine passes."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

DEADLINE = 300.0  # s


def wait_until(
    condition: Callable[[], T], step: Callable[[], object] = lambda: time.sleep(0.005), seconds: float = DEADLINE
) -> T:
    """Take steps until a condition holds, and return what it is.

    Raises
    ------
    TimeoutError
    """
    end = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"it did not happen in {seconds:g} s")
        step()
    return result
