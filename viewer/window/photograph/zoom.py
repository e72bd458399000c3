"""How much of a photograph the window shows, and where: for painting its mask. No OpenGL in here."""

from dataclasses import dataclass

from milkglass.viewer.gui.controls import Box
from milkglass.viewer.photograph.mask import Point
from milkglass.viewer.window.view.drawing import fitted

ZOOM_STEP = 1.25  # factor for a notch of the wheel
LARGEST_SCALE = 32.0


@dataclass
class Zoom:
    """Which part of a picture a view shows.

    Attributes
    ----------
    scale : float
        1 shows all of the picture, as large as fits.
    centre : Point
        What lies in the middle of the view, as shares of the picture's sides.
    """

    scale: float = 1.0
    centre: Point = (0.5, 0.5)

    def placed(self, box: Box, size: tuple[int, int]) -> Box:
        """Return where a picture of a size, (width, height), lies in the window, which shows it in `box`."""
        left, top, right, bottom = fitted(box, size)
        width, height = self.scale * (right - left), self.scale * (bottom - top)
        x = _start(box[0], box[2], width, self.centre[0])
        y = _start(box[1], box[3], height, self.centre[1])
        return x, y, x + width, y + height

    def zoom(self, notches: float, at: Point, box: Box, size: tuple[int, int]) -> None:
        """Zoom in or out; what is at a place of the window stays there, unless it would leave a gap."""
        before = self.placed(box, size)
        self.scale = min(LARGEST_SCALE, max(1.0, self.scale * ZOOM_STEP**notches))
        left, top, right, bottom = fitted(box, size)
        width, height = self.scale * (right - left), self.scale * (bottom - top)
        self._look(
            (at[0] - (at[0] - before[0]) / (before[2] - before[0]) * width, width),
            (at[1] - (at[1] - before[1]) / (before[3] - before[1]) * height, height),
            box,
        )

    def pan(self, by: Point, box: Box, size: tuple[int, int]) -> None:
        """Move the picture along with the pointer."""
        left, top, right, bottom = self.placed(box, size)
        self._look((left + by[0], right - left), (top + by[1], bottom - top), box)

    def reset(self) -> None:
        """Show all of the picture."""
        self.scale, self.centre = 1.0, (0.5, 0.5)

    def _look(self, across: tuple[float, float], down: tuple[float, float], box: Box) -> None:
        """Centre what would lie in the middle of the box, if the picture began at a place and were as long."""
        centres = []
        for (start, length), low, high in ((across, box[0], box[2]), (down, box[1], box[3])):
            start = _start(low, high, length, (0.5 * (low + high) - start) / length)
            centres.append((0.5 * (low + high) - start) / length)
        self.centre = centres[0], centres[1]


def _start(low: float, high: float, length: float, centre: float) -> float:
    """Return where a side begins: centred where it is short, else without a gap at either end."""
    if length <= high - low:
        return 0.5 * (low + high - length)
    return min(low, max(high - length, 0.5 * (low + high) - centre * length))
