"""A mask that is painted: strokes of a round brush, each undone as a whole. No OpenGL in here."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

UNDO_STEPS = 50  # strokes that can be undone

Pixels8 = npt.NDArray[np.uint8]
Point = tuple[float, float]  # column and row, pixels, the middle of the first pixel at 0.5
Window = tuple[slice, slice]


class _Step(NamedTuple):
    """What a part of the mask was before a step, and the state of all of it then."""

    window: Window
    pixels: Pixels8
    state: int


class PaintedMask:
    """A mask, white where the object is.

    Parameters
    ----------
    pixels : (h, w) uint8
        Taken over, and painted into.

    Attributes
    ----------
    version : int
        Grows with every finished change: what is made of the mask is outdated then.
    shown : int
        Grows with every change, those of a stroke on its way included.
    state : int
        Another for every other finished mask; the same again where a step is taken back.
    noted : callable
        Called for every step that can be undone.
    """

    def __init__(self, pixels: Pixels8) -> None:
        self.pixels = pixels
        self.version = self.shown = self.state = 0
        self.noted: Callable[[], object] = lambda: None
        self._before: Pixels8 | None = None  # while a stroke is on its way
        self._touched: Window | None = None
        self._history: list[_Step] = []
        self._undone: list[_Step] = []

    @property
    def can_undo(self) -> bool:
        """Whether there is a stroke to take back."""
        return bool(self._history)

    def begin(self) -> None:
        """Begin a stroke of the brush."""
        self._before, self._touched = self.pixels.copy(), None

    def paint(self, start: Point, end: Point, radius: float, *, erases: bool = False) -> None:
        """Paint a part of the stroke from `start` to `end`, its edge softened by a pixel."""
        (x0, y0), (x1, y1) = start, end
        reach = radius + 1.0
        rows = _span(min(y0, y1) - reach, max(y0, y1) + reach, self.pixels.shape[0])
        columns = _span(min(x0, x1) - reach, max(x0, x1) + reach, self.pixels.shape[1])
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        y, x = np.ogrid[rows, columns]
        y, x = y + 0.5 - y0, x + 0.5 - x0
        dx, dy = x1 - x0, y1 - y0
        share = np.clip((x * dx + y * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        inside = np.clip(radius + 0.5 - np.hypot(x - share * dx, y - share * dy), 0.0, 1.0)
        brush = np.rint(255.0 * inside).astype(np.uint8)
        window = rows, columns
        part = self.pixels[window]
        self.pixels[window] = np.minimum(part, 255 - brush) if erases else np.maximum(part, brush)
        self._touched = window if self._touched is None else _around(self._touched, window)
        self.shown += 1

    def end(self) -> None:
        """End the stroke; one that changed nothing cannot be undone."""
        before, window, self._before = self._before, self._touched, None
        if before is not None and window is not None:
            self._remember(window, before[window].copy())

    def replace(self, pixels: Pixels8) -> None:
        """Replace the mask by another of the same size, as one step that can be undone."""
        everything = slice(0, pixels.shape[0]), slice(0, pixels.shape[1])
        before, self.pixels = self.pixels, pixels
        self._remember(everything, before)

    def undo(self) -> bool:
        """Take the last step back; False if there is none."""
        return self._exchange(self._history, self._undone)

    def redo(self) -> bool:
        """Make the step that was taken back last again; False if there is none."""
        return self._exchange(self._undone, self._history)

    def _exchange(self, source: list[_Step], target: list[_Step]) -> bool:
        if not source:
            return False
        step = source.pop()
        target.append(_Step(step.window, self.pixels[step.window].copy(), self.state))
        self.pixels[step.window] = step.pixels
        self.state = step.state
        self.version += 1
        self.shown += 1
        return True

    def _remember(self, window: Window, before: Pixels8) -> None:
        self._history.append(_Step(window, before, self.state))
        del self._history[:-UNDO_STEPS]
        self._undone.clear()
        self.version += 1
        self.shown += 1
        self.state = self.version
        self.noted()


def _span(low: float, high: float, length: int) -> slice:
    return slice(max(0, int(np.floor(low))), min(length, int(np.ceil(high))))


def _around(a: Window, b: Window) -> Window:
    """Return the smallest window around two."""
    rows, columns = (slice(min(x.start, y.start), max(x.stop, y.stop)) for x, y in zip(a, b, strict=True))
    return rows, columns
