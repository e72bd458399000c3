"""Threads of the numerics: one pool of them for the process, and BLAS kept from making more.

Work in the pool must not wait for the pool: with every thread waiting, none would be left to work. `each` is therefore
safe anywhere, one item after another where it is called by such work; asking the pool itself for more there is refused.
"""

import functools
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from threadpoolctl import OpenBLASController, ThreadpoolController

S = TypeVar("S")
T = TypeVar("T")


class Pool(ThreadPoolExecutor):
    """Worker threads, one a core; FFTW and NumPy release the GIL."""

    def __init__(self) -> None:
        self._here = threading.local()
        super().__init__(os.cpu_count() or 1, "milkglass", self._mark)

    @property
    def is_here(self) -> bool:
        """Whether the calling thread is one of the pool's."""
        return getattr(self._here, "is_worker", False)

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Begin work in one of the threads, where BLAS makes no more of them.

        Raises
        ------
        RuntimeError
            If work in the pool asks for it.
        """
        if self.is_here:
            raise RuntimeError("work in the thread pool must not wait for the thread pool; use core.threads.each")
        return super().submit(one_blas_thread()(work), *args, **kwargs)

    def _mark(self) -> None:
        self._here.is_worker = True


class _Blas:
    """How many blocks of `one_blas_thread` are entered, in all threads: BLAS knows one number for the process."""

    def __init__(self) -> None:
        self._lock, self._depth = threading.Lock(), 0
        self._limits: Any = None

    def enter(self) -> None:
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                with _control():
                    self._limits = _controller().limit(limits=1)

    def leave(self) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self.restore()

    def restore(self) -> None:
        if self._limits is not None:
            with _control():
                self._limits.restore_original_limits()
            self._limits = None


@functools.cache
def _controller() -> Any:
    import numpy as np  # noqa: F401  (its BLAS must be there to be found)

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def _control() -> Iterator[None]:
    """Let this thread set the number, of which threadpoolctl ignores all but one; the last block may end in another."""
    OpenBLASController.clear_controlling_thread(force=True)
    yield
    OpenBLASController.clear_controlling_thread(force=True)


_pool = Pool()  # its threads start with the first work
_blas = _Blas()


def _after_fork() -> None:
    """Begin anew in a child process, which has none of its parent's threads."""
    global _pool, _blas
    _blas.restore()
    _pool, _blas = Pool(), _Blas()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def thread_pool() -> Pool:
    """Return the process's worker threads."""
    return _pool


def each(work: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """Return what work gives for each item, in their order: side by side, or one after another within the pool."""
    items = list(items)
    if len(items) < 2 or _pool.is_here:
        return [work(item) for item in items]
    return list(_pool.map(work, items))


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Have matrix products take one thread until the block ends, or while a function runs that this decorates.

    Threads of a product wait for one another where cores are busy, up to ten times as long as one alone would work,
    and wake in the way of the transforms'. Outside such blocks the process's own number of them is as it was.
    """
    _blas.enter()
    try:
        yield
    finally:
        _blas.leave()
