"""A worker thread that has the window look when it is done with something."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


class WakingWorker(ThreadPoolExecutor):
    """One thread, for one piece of work after another.

    Parameters
    ----------
    name : str
        Of the thread.
    wake : callable
        Called whenever something is done.
    """

    def __init__(self, name: str, wake: Callable[[], object]) -> None:
        super().__init__(1, thread_name_prefix=name)
        self._wake = wake

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Have work done, and wake the window after that."""
        future = super().submit(work, *args, **kwargs)
        future.add_done_callback(lambda _: self._wake())
        return future
