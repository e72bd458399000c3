"""Rays cast block by block, in a thread for each processor, with progress told and an end that may be asked for."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

B = TypeVar("B")
T = TypeVar("T")

THREADS = 8


class BakeCancelled(Exception):  # noqa: N818  (not an error)
    """Raised where rays are not wanted any longer."""


class Casting:
    """One run over points of which each casts rays.

    Parameters
    ----------
    count : int
        Number of points.
    progress : callable
        Called with the finished share, in [0, 1], from any thread.
    cancelled : Event, optional
        Once set, blocks end at their next `check`.
    """

    def __init__(self, count: int, progress: Callable[[float], object], cancelled: threading.Event | None) -> None:
        self._count, self._progress = count, progress
        self._stopped, self._lock, self._finished = cancelled or threading.Event(), threading.Lock(), 0

    def check(self) -> None:
        """Raise BakeCancelled if the end was asked for."""
        if self._stopped.is_set():
            raise BakeCancelled

    def finished(self, count: int) -> None:
        """Count points that are done."""
        with self._lock:
            self._finished += count
            self._progress(self._finished / self._count)

    def run(self, cast: Callable[[B], T], blocks: Iterable[B]) -> list[T]:
        """Return what is cast for each block, in their order.

        Raises
        ------
        BakeCancelled
            If `cancelled` was set.
        """
        with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
            futures = [pool.submit(cast, block) for block in blocks]
            try:
                return [future.result() for future in futures]
            except BaseException:
                self._stopped.set()  # else leaving the pool would wait for all remaining blocks
                raise
