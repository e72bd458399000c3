"""Threads of the numerics: one pool of them for the process, BLAS kept from making more, and what they share.

Work in the pool must not wait for the pool: with every thread waiting, none would be left to work. `pool_map` is
therefore safe anywhere, one item after another where it is called by such work; asking the pool itself for more there
is refused.
"""

import functools
import os
import sys
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Generic, Self, TypeVar, overload

from threadpoolctl import OpenBLASController, ThreadpoolController

S = TypeVar("S")
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
K = TypeVar("K", bound=Hashable)


class Pool(ThreadPoolExecutor):
    """Worker threads, one a core; FFTW and NumPy release the GIL."""

    def __init__(self) -> None:
        self._here = threading.local()
        super().__init__(os.cpu_count() or 1, "milkglass", self._mark)

    @property
    def is_here(self) -> bool:
        """Whether the calling thread must not wait for the pool: it is one of the pool's, or others wait for it."""
        return getattr(self._here, "depth", 0) > 0

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Have the calling thread do without the pool until the block ends."""
        self._mark()
        try:
            yield
        finally:
            self._here.depth -= 1

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Begin work in one of the threads, where BLAS makes no more of them.

        Raises
        ------
        RuntimeError
            If work in the pool asks for it.
        """
        if self.is_here:
            raise RuntimeError("work in the thread pool must not wait for the thread pool; use core.threads.pool_map")
        return super().submit(one_blas_thread()(work), *args, **kwargs)

    def _mark(self) -> None:
        self._here.depth = getattr(self._here, "depth", 0) + 1


class AtOnce(Executor):
    """Does work where it is submitted, before that returns."""

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Do the work, and return its result; what it raises is raised here."""
        future: Future[T] = Future()
        future.set_result(work(*args, **kwargs))
        return future


class _Blas:
    """How many blocks of `one_blas_thread` are entered, in all threads: BLAS knows one number for the process."""

    def __init__(self) -> None:
        self._lock, self._depth = threading.Lock(), 0
        self._limits: list[Any] = []  # the later ones of libraries that were loaded meanwhile, too
        self._modules = 0

    def enter(self) -> None:
        with self._lock:
            self._depth += 1
            modules = len(sys.modules)
            if self._depth == 1 or modules != self._modules:
                with _control():
                    self._limits.append(_controller(modules).limit(limits=1))
                self._modules = modules

    def leave(self) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self.restore()

    def restore(self) -> None:
        with _control():
            while self._limits:
                self._limits.pop().restore_original_limits()


@functools.lru_cache(1)
def _controller(modules: int) -> Any:
    """Return the BLAS libraries of the process; only a new one of Python's modules brings a new library."""
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


def pool_map(work: Callable[[S], T], items: Iterable[S]) -> list[T]:
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


class computed_once(Generic[T_co]):  # noqa: N801  (a decorator)
    """A property that is computed when it is first asked for, in one thread, and kept; other threads wait for it.

    Each instance has a lock of its own for it. (Of `functools.cached_property` Python 3.11 has one for all instances,
    later versions have none and may compute twice.) What is computed does without the thread pool, whose threads may
    be those that wait.
    """

    def __init__(self, compute: Callable[[Any], T_co]) -> None:
        self._compute, self._name, self.__doc__ = compute, "", compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T_co: ...
    def __get__(self, instance: object | None, owner: type) -> Self | T_co:
        """Compute the value and keep it in the instance, where it is found without this from then on."""
        if instance is None:
            return self
        kept, lock = vars(instance), f"lock of {self._name}"
        with kept.setdefault(lock, threading.RLock()):
            if self._name not in kept:
                with _pool.apart():
                    kept[self._name] = self._compute(instance)
                kept.pop(lock, None)
            value: T_co = kept[self._name]
            return value


class Recent(Generic[K, T]):
    """The most recent results of some work, by what they are of; one thread does it, others that ask for it wait.

    Work of different keys goes on side by side; it does without the thread pool, as that of `computed_once`.

    Parameters
    ----------
    count : int
        Of results that are kept.
    """

    def __init__(self, count: int) -> None:
        self._count, self._lock = count, threading.Lock()
        self._kept: dict[K, _Result[T]] = {}  # the newest last

    def of(self, key: K, compute: Callable[[], T]) -> T:
        """Return the result of a key, which is now the newest; it is computed unless it is kept."""
        with self._lock:
            result = self._kept.pop(key) if key in self._kept else _Result[T]()
            self._kept[key] = result
            if len(self._kept) > self._count:
                del self._kept[next(iter(self._kept))]
        with result.lock:
            if not result.values:
                with _pool.apart():
                    result.values.append(compute())
            return result.values[0]


class _Result(Generic[T]):
    """A result, or the place for one, and the lock of the thread that works on it."""

    def __init__(self) -> None:
        self.lock, self.values = threading.RLock(), list[T]()
