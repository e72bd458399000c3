"""Which part of a photograph an object's surface is made of, which part of that is rendered, and how finely."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from milkglass.viewer.files.photograph import Photo, Region

T = TypeVar("T", npt.NDArray[np.float32], npt.NDArray[np.float64])

MAX_NODES = 192  # nodes along the outline's longer side, at most; solvers resolve a third of it
MAX_READ_PIXELS = 1536  # pixels along the longer side of what is read of a photograph, at most
MAX_PIXELS_PER_NODE = (
    3  # rendered pixels between two nodes, at most: nothing of a surface is finer, and the mask cuts its outline
)
MARGIN_NODES = 4  # nodes around the outline


@dataclass(frozen=True)
class Framing:
    """Which part of a photograph is read and rendered, and how finely.

    Attributes
    ----------
    region : Region
        The part that the surface is made of; its sides are multiples of `node`.
    shown : Region
        The part of the region that is rendered: squares of nodes inside the photograph.
    block : int
        Side of a pixel that is read, in pixels of the photograph.
    step : int
        Distance between two nodes of the surface, in pixels that are read.
    mm : float
        Distance between two nodes, mm.
    """

    region: Region
    shown: Region
    block: int
    step: int
    mm: float

    @property
    def node(self) -> int:
        """Distance between two nodes of the surface, in pixels of the photograph."""
        return self.block * self.step

    @property
    def shades(self) -> int:
        """Distance between two nodes, in rendered pixels."""
        return min(self.step, MAX_PIXELS_PER_NODE)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the rendered picture."""
        return self.shown.height // self.node * self.shades, self.shown.width // self.node * self.shades

    def cut(self, values: T, squares: int = 1) -> T:
        """Return the rendered part of an array over the region with `squares` values along a side of a node."""
        top, left = (self.shown.top - self.region.top) // self.node, (self.shown.left - self.region.left) // self.node
        rows, columns = self.shown.height // self.node, self.shown.width // self.node
        return values[squares * top : squares * (top + rows), squares * left : squares * (left + columns)]


def frame_object(photo: Photo, size_mm: float) -> Framing:
    """Return what to render of a photograph, and how finely; `size_mm` is the longer side of the object's outline."""
    outline = photo.outline
    longest = max(outline.height, outline.width)
    block = -(-longest // MAX_READ_PIXELS)
    step = max(1, -(-longest // (block * MAX_NODES)))
    node = block * step
    h, w = photo.size

    def side(start: int, length: int, end: int) -> tuple[int, int]:
        # What the photograph cuts off goes on beyond it: an outline there would bend to a rim that is not one.
        before = longest // 4 if start == 0 else MARGIN_NODES * node
        after = longest // 4 if start + length == end else MARGIN_NODES * node
        total = max(length + before + after, 16 * block)
        return start - before, -(-total // node) * node

    (top, height), (left, width) = side(outline.top, outline.height, h), side(outline.left, outline.width, w)

    def in_sight(start: int, length: int, end: int) -> tuple[int, int]:
        before, after = max(0, -start) // node * node, max(0, start + length - end) // node * node
        return start + before, length - before - after

    (above, high), (beside, wide) = in_sight(top, height, h), in_sight(left, width, w)
    regions = Region(top, left, height, width), Region(above, beside, high, wide)
    return Framing(*regions, block, step, size_mm * node / longest)
