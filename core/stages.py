"""Run a stage only when something that it depends on has changed, and keep the time that it took."""

import time
from collections.abc import Callable, Hashable, Iterable
from typing import Any, TypeVar

T = TypeVar("T")


class Stages:
    """The last result of every named stage.

    A stage states what it depends on: hashable values are compared by equality, arrays, lists and other objects by
    identity, so that results of earlier stages serve as they are.

    Parameters
    ----------
    finish : callable, optional
        Waits for work that runs elsewhere (the GPU's), so that a stage's time is its own.

    Attributes
    ----------
    timings : dict
        Stage -> ms, of the stages that ran since `begin`; a stage run inside another counts for itself alone.
    """

    def __init__(self, finish: Callable[[], object] = lambda: None) -> None:
        self._kept: dict[str, tuple[tuple[object, ...], Any]] = {}
        self._finish = finish
        self._nested = 0.0  # ms spent in the stages that ran inside the current one
        self.timings: dict[str, float] = {}

    def begin(self) -> None:
        """Start a new frame: forget the timings, keep the results."""
        self.timings = {}

    def has(self, name: str, depends_on: Iterable[object]) -> bool:
        """Whether `run` would return what it kept."""
        key, kept = tuple(depends_on), self._kept.get(name)
        return kept is not None and len(kept[0]) == len(key) and all(map(_same, kept[0], key))

    def kept(self, name: str) -> tuple[tuple[object, ...], Any] | None:
        """Return what a stage last depended on and gave, outdated or not: parts of it may serve again."""
        return self._kept.get(name)

    def forget(self, name: str) -> None:
        """Drop a stage's result, because what it holds is no longer what it says."""
        self._kept.pop(name, None)

    def clear(self) -> None:
        """Drop all results, and keep the timings."""
        self._kept.clear()

    def run(self, name: str, depends_on: Iterable[object], compute: Callable[[], T]) -> T:
        """Return the stage's result, computing it only if `depends_on` differs from the last time."""
        key = tuple(depends_on)
        if self.has(name, key):
            return self._kept[name][1]  # type: ignore[no-any-return]
        self._kept.pop(name, None)  # free the old result before the new one is allocated
        outer, self._nested = self._nested, 0.0
        start = time.perf_counter()
        try:
            result = compute()
            self._finish()
        finally:
            elapsed = 1e3 * (time.perf_counter() - start)
            self.timings[name] = self.timings.get(name, 0.0) + elapsed - self._nested
            self._nested = outer + elapsed
        self._kept[name] = (key, result)
        return result


def _same(a: object, b: object) -> bool:
    return a is b or (isinstance(a, Hashable) and isinstance(b, Hashable) and a == b)
