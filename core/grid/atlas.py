"""Atlas: the layers of each body, cut out of the whole object's, side by side in one volume.

A crop keeps the nodes of the whole object's layers, hence their spacing and phase: what a body's samples put on it and
get from it is what the whole layers would give for those samples alone. In the atlas crops lie wherever there is room,
so bodies whose boxes overlap (linked rings) need no copies of the whole, and air takes no memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.boxes import group_bounds
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.threads import computed_once

Ints = npt.NDArray[np.int64]

BORDER = 1  # nodes around a crop that repeat its edge: no filter reaches the next one
CROP_MULTIPLE = 4  # sizes of crops are multiples of it, so that alike bodies share plans and kernels
SLACK = 1e-3  # nodes: the GPU's coordinates are float32


@dataclass(frozen=True, eq=False)
class Atlas:
    """Places of the bodies' layers in one volume.

    Attributes
    ----------
    whole : LayerGrid
        The whole object's layers.
    first : (n, 3) int64
        First node (layer, row, column) of each body's crop in them.
    places : (n, 3) int64
        Where that node lies in the atlas.
    crops : tuple of n LayerGrid
    shape : (layers, rows, columns)
        Of the atlas.
    """

    whole: LayerGrid
    first: Ints
    places: Ints
    crops: tuple[LayerGrid, ...]
    shape: tuple[int, int, int]

    @computed_once
    def windows(self) -> Float32:
        """Return where pixels read each body: three vectors x, y, z in texture coordinates, (n, 3, 3).

        The offset from coordinates of `world_to_texture` to the body's place; its first node; its last node, beyond
        which the edge goes on.
        """
        sizes = np.array([crop.shape for crop in self.crops])
        nodes = np.stack([self.places - self.first, self.places + 0.5, self.places + sizes - 0.5], axis=1)
        return np.ascontiguousarray((nodes / np.array(self.shape))[..., ::-1], np.float32)

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) from world space to texture coordinates if all layers lay at the atlas' corner."""
        depth, height, width = self.shape
        return replace(self.whole, n_layers=depth, height=height, width=width).world_to_texture

    def filled(self, parts: Sequence[Float32 | None], channels: int = 3) -> Float32:
        """Return a volume with the part of each body, (channels, *its crop's shape), or None, in its place."""
        out = np.zeros((channels, *self.shape), np.float32)
        for place, part in zip(self.places - BORDER, parts, strict=True):
            if part is not None:
                border = [(0, 0), *[(BORDER, BORDER)] * 3]
                bordered = np.pad(part, border, mode="edge")
                out[_window(place, bordered.shape[1:])] = bordered
        return out

    def unfolded(self, volume: Float32) -> Float32:
        """Return the sum of an atlas' bodies on the whole layers, (3, *whole.shape)."""
        out = np.zeros((3, *self.whole.shape), np.float32)
        for place, first, crop in zip(self.places, self.first, self.crops, strict=True):
            out[_window(first, crop.shape)] += volume[_window(place, crop.shape)]
        return out


def fit_atlas(grid: LayerGrid, smooth: bool, vertices: npt.ArrayLike, body: npt.NDArray[np.integer]) -> Atlas:
    """Return an atlas of the bodies' layers, cut out of those of the whole object.

    Parameters
    ----------
    grid : LayerGrid
    smooth : bool
        Whether weights are quadratic B-splines rather than tents, see `core.grid.layers`.
    vertices : (n, 3) array
        World space, mm.
    body : (n,) int array
        Of each vertex, from 0 without gaps.
    """
    count = int(body.max()) + 1
    low, high = (each[:, ::-1] for each in group_bounds(grid.coordinates(vertices), body, count))
    counts = np.array(grid.shape)
    low, high = low - SLACK, high + SLACK
    if smooth:
        touched = np.floor(low + 0.5) - 1.0, np.floor(high + 0.5) + 1.0
    else:
        touched = np.floor(low), np.floor(high) + 1.0
    first, last = (np.clip(node, 0, counts - 1).astype(np.int64) for node in touched)
    sizes = np.minimum(-(-(last - first + 1) // CROP_MULTIPLE) * CROP_MULTIPLE, counts)
    first = np.minimum(first, counts - sizes)
    places, shape = _packed(sizes + 2 * BORDER)
    crops = tuple(map(lambda f, s: _crop(grid, f, s), first, sizes))
    return Atlas(grid, first, places + BORDER, crops, shape)


def _crop(grid: LayerGrid, first: Ints, size: Ints) -> LayerGrid:
    matrix = np.array(grid.world_to_grid)
    matrix[3, :3] -= first[::-1]
    rows = tuple(tuple(map(float, row)) for row in matrix)
    depth, height, width = (int(n) for n in size)
    return replace(grid, n_layers=depth, height=height, width=width, world_to_grid=rows)


def _packed(sizes: Ints) -> tuple[Ints, tuple[int, int, int]]:
    """Return places of boxes (n, 3) on shelves, and the size of all: rows on floors, the largest first."""
    # As long on each side, about, so that no side meets a limit before the others.
    side = int(np.ceil(np.cbrt(sizes.prod(axis=1).sum())))
    height, width = (max(side, int(n)) for n in sizes[:, 1:].max(axis=0))
    places = np.zeros_like(sizes)
    z = y = x = depth_of_floor = height_of_row = 0
    for i in np.lexsort((-sizes[:, 2], -sizes[:, 1], -sizes[:, 0])):
        d, h, w = (int(n) for n in sizes[i])
        if x + w > width:
            x, y, height_of_row = 0, y + height_of_row, 0
        if y + h > height:
            x, y, z, height_of_row, depth_of_floor = 0, 0, z + depth_of_floor, 0, 0
        places[i] = z, y, x
        x, height_of_row, depth_of_floor = x + w, max(height_of_row, h), max(depth_of_floor, d)
    end = (places + sizes).max(axis=0)
    return places, (int(end[0]), int(end[1]), int(end[2]))


def _window(first: Ints, size: Sequence[int]) -> tuple[slice, ...]:
    return (slice(None), *(slice(int(start), int(start) + n) for start, n in zip(first, size, strict=True)))
