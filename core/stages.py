"""Run a stage only when something that it depends on has changed, and keep the time that it took."""

import time
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
Steps = Generator[None, None, T]  # work that yields wherever it may be left for a while


class Unfinished(Exception):  # noqa: N818 (nothing went wrong)
    """A stage has more to do than this frame allows; asked for again in the next one, it goes on."""


class Allowance:
    """How many steps of stages that are spread over frames one frame may take, and for how long it may begin more."""

    def __init__(self, steps: int, seconds: float) -> None:
        self._steps, self._end = steps, time.perf_counter() + seconds

    def take(self) -> bool:
        """Whether one more step may be taken, which is then counted."""
        self._steps -= 1
        return self._steps >= 0 and time.perf_counter() < self._end


def exhausted(steps: Steps[T]) -> T:
    """Take all steps and return what they come to."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


@dataclass(eq=False)
class _Begun:
    """A stage on the way: what it depends on, what is left of it, and ms that it took in earlier frames."""

    key: tuple[object, ...]
    steps: Steps[Any]
    spent: float = 0.0
    wanted: bool = True  # in this frame


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
        self._begun: dict[str, _Begun] = {}
        self._allowance: Allowance | None = None

    def begin(self, allowance: Allowance | None = None) -> None:
        """Start a new frame: forget the timings, keep the results, and drop what is half done and no longer wanted.

        Stages that `spread` runs take as many steps as the frame has an allowance for, without one all of them.
        """
        self.timings, self._allowance = {}, allowance
        self._begun = {name: begun for name, begun in self._begun.items() if begun.wanted}
        for begun in self._begun.values():
            begun.wanted = False

    def has(self, name: str, depends_on: Iterable[object]) -> bool:
        """Whether `run` would return what it kept."""
        kept = self._kept.get(name)
        return kept is not None and _alike(kept[0], tuple(depends_on))

    def kept(self, name: str) -> tuple[tuple[object, ...], Any] | None:
        """Return what a stage last depended on and gave, outdated or not: parts of it may serve again."""
        return self._kept.get(name)

    def forget(self, name: str) -> None:
        """Drop a stage's result, because what it holds is no longer what it says."""
        self._kept.pop(name, None)

    def clear(self) -> None:
        """Drop all results, and keep the timings."""
        self._kept.clear()
        self._begun.clear()

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

    def spread(self, name: str, depends_on: Iterable[object], work: Callable[[], Steps[T]]) -> T:
        """As `run`, for work in steps, of which a frame with an allowance takes one and then what that leaves.

        Raises
        ------
        Unfinished
            Where steps are left.
        """
        key = tuple(depends_on)
        if self.has(name, key):
            return self._kept[name][1]  # type: ignore[no-any-return]
        begun = self._begun.get(name)
        if begun is None or not _alike(begun.key, key):
            begun = self._begun[name] = _Begun(key, work())
        begun.wanted = True
        result: T = self.run(name, key, lambda: self._proceed(name, begun))
        self.timings[name] += begun.spent
        return result

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Take all steps meanwhile, whatever the frame's allowance."""
        allowance, self._allowance = self._allowance, None
        try:
            yield
        finally:
            self._allowance = allowance

    def _proceed(self, name: str, begun: _Begun) -> Any:
        start = time.perf_counter()
        del self._begun[name]  # work that fails is over
        while True:
            try:
                next(begun.steps)
            except StopIteration as end:
                return end.value
            if self._allowance is not None:
                self._finish()
                if not self._allowance.take():
                    self._begun[name] = begun
                    begun.spent += 1e3 * (time.perf_counter() - start)
                    raise Unfinished(name)


def _alike(a: tuple[object, ...], b: tuple[object, ...]) -> bool:
    return len(a) == len(b) and all(map(_same, a, b))


def _same(a: object, b: object) -> bool:
    return a is b or (isinstance(a, Hashable) and isinstance(b, Hashable) and a == b)
