"""What of a photograph an object is made of, what of that is rendered, and how finely."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from milkglass.viewer.files.photograph import Photo, Region

T = TypeVar("T", npt.NDArray[np.float32], npt.NDArray[np.float64])

GRID = 192  # nodes along the outline's longer side, at most; solvers resolve a third of it
PICTURE = 1536  # pixels along the longer side of what is read of a photograph, at most
SHADES = 3  # rendered pixels between two nodes, at most: nothing of a surface is finer, and the mask cuts its outline
MARGIN = 4  # nodes around the outline


@dataclass(frozen=True)
class Framing:
    """What of a photograph is rendered, and how finely.

    Attributes
    ----------
    region : Region
        What a surface is made of. Its sides are multiples of `node`.
    shown : Region
        What of it is rendered: squares of nodes that are in the photograph.
    block : int
        Pixels of the photograph a side of a pixel that is read.
    step : int
        Pixels read between two nodes of the surface.
    mm : float
        Between two nodes.
    """

    region: Region
    shown: Region
    block: int
    step: int
    mm: float

    @property
    def node(self) -> int:
        """Pixels of the photograph between two nodes of the surface."""
        return self.block * self.step

    @property
    def shades(self) -> int:
        """Rendered pixels between two nodes."""
        return min(self.step, SHADES)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the rendered picture."""
        return self.shown.height // self.node * self.shades, self.shown.width // self.node * self.shades

    def cut(self, values: T, squares: int = 1) -> T:
        """Cut what is rendered out of an array that has some `squares` of the region a side of a node."""
        top, left = (self.shown.top - self.region.top) // self.node, (self.shown.left - self.region.left) // self.node
        rows, columns = self.shown.height // self.node, self.shown.width // self.node
        return values[squares * top : squares * (top + rows), squares * left : squares * (left + columns)]


def frame_object(photo: Photo, size_mm: float) -> Framing:
    """Choose what to render, and how finely; `size_mm` is the longer side of the object's outline."""
    outline = photo.outline
    longest = max(outline.height, outline.width)
    block = -(-longest // PICTURE)
    step = max(1, -(-longest // (block * GRID)))
    node = block * step
    h, w = photo.size

    def side(start: int, length: int, end: int) -> tuple[int, int]:
        # What the photograph cuts off goes on beyond it: an outline there would bend to a rim that is not one.
        before = longest // 4 if start == 0 else MARGIN * node
        after = longest // 4 if start + length == end else MARGIN * node
        total = max(length + before + after, 16 * block)
        return start - before, -(-total // node) * node

    (top, height), (left, width) = side(outline.top, outline.height, h), side(outline.left, outline.width, w)

    def in_sight(start: int, length: int, end: int) -> tuple[int, int]:
        before, after = max(0, -start) // node * node, max(0, start + length - end) // node * node
        return start + before, length - before - after

    (above, high), (beside, wide) = in_sight(top, height, h), in_sight(left, width, w)
    regions = Region(top, left, height, width), Region(above, beside, high, wide)
    return Framing(*regions, block, step, size_mm * node / longest)
