"""Threads that work for the window, and are left behind where it closes before they have ended."""

import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")

_WORKERS: "weakref.WeakSet[Worker]" = weakref.WeakSet()
STEP = 0.01  # seconds between looks at whether they have ended


class Worker(ThreadPoolExecutor):
    """One thread, at one thing after another.

    Parameters
    ----------
    name : str
        Of the thread.
    wake : callable, optional
        Called whenever something is done.
    """

    def __init__(self, name: str, wake: Callable[[], object] = lambda: None) -> None:
        super().__init__(1, thread_name_prefix=name)
        self._wake = wake
        self._begun: list[Future[Any]] = []
        _WORKERS.add(self)

    @property
    def busy(self) -> bool:
        """Whether something is being done, or waits to be."""
        return any(not future.done() for future in self._begun)

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Begin work once what was begun before is done."""
        future = super().submit(work, *args, **kwargs)
        self._begun = [*(begun for begun in self._begun if not begun.done()), future]
        future.add_done_callback(lambda _: self._wake())
        return future

    def stop(self) -> None:
        """Take nothing more, and do not wait for what is being done."""
        self.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """Take nothing more, and wait for what is being done."""
        self.shutdown(wait=True, cancel_futures=True)


def have_ended(patience: float = 0.0) -> bool:
    """Return whether all workers have ended what they did, waiting for some seconds at most."""
    end = time.monotonic() + patience
    while busy := any(worker.busy for worker in list(_WORKERS)):
        if time.monotonic() >= end:
            break
        time.sleep(STEP)
    return not busy
