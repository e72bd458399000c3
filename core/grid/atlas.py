"""Atlas: the layers of each body, cropped from those of the object and packed into one volume.

A crop keeps the nodes of the object's layers, hence their spacing and phase: deposit and gather of a body's samples on
it are those of the object's layers for these samples alone. Crops are packed wherever there is room, so bodies whose
boxes overlap (linked rings) need no copies of all layers, and air takes no memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.boxes import group_bounds
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.threads import computed_once

BORDER_NODES = 1  # nodes around a crop that repeat its edge: no filter reaches the next crop
CROP_MULTIPLE = 4  # sizes of crops are multiples of it, so that similar bodies share plans and kernels
BOUNDS_SLACK = 1e-3  # nodes: the GPU's coordinates are float32


@dataclass(frozen=True, eq=False)
class Atlas:
    """Layout of the bodies' layers in one volume.

    Attributes
    ----------
    whole : LayerGrid
        Layers of the object.
    first : (n, 3) int64
        First node (layer, row, column) of each body's crop in `grid`.
    places : (n, 3) int64
        Node of the atlas where that node lies.
    crops : tuple of n LayerGrid
        Layers of each body.
    shape : (layers, rows, columns)
        Size of the atlas in nodes.
    """

    grid: LayerGrid
    first: Ints
    origins: Ints
    crops: tuple[LayerGrid, ...]
    shape: tuple[int, int, int]

    @computed_once
    def windows(self) -> Float32:
        """Texture coordinates at which pixels read each body, (n, 3, 3) float32: x, y, z of three vectors.

        The offset from the coordinates of `world_to_texture` to the body's in the atlas; those of its first node, and
        of its last, to which lookups are clamped.
        """
        sizes = np.array([crop.shape for crop in self.crops])
        nodes = np.stack([self.origins - self.first, self.origins + 0.5, self.origins + sizes - 0.5], axis=1)
        return np.ascontiguousarray((nodes / np.array(self.shape))[..., ::-1], np.float32)

    @property
    def world_to_texture(self) -> Array:
        """Affine map (4, 4) for row vectors from world space to texture coordinates, with `grid` at the corner."""
        depth, height, width = self.shape
        return replace(self.grid, n_layers=depth, height=height, width=width).world_to_texture

    def assembled(self, exitances: Sequence[Float32 | None], channels: int = 3) -> Float32:
        """Return the atlas, (channels, *shape), of the bodies' exitances (channels, *crop.shape); None stands for 0."""
        result = np.zeros((channels, *self.shape), np.float32)
        for origin, exitance in zip(self.origins - BORDER_NODES, exitances, strict=True):
            if exitance is not None:
                border = [(0, 0), *[(BORDER_NODES, BORDER_NODES)] * 3]
                bordered = np.pad(exitance, border, mode="edge")
                result[_slices(origin, bordered.shape[1:])] = bordered
        return result

    def summed(self, volume: Float32) -> Float32:
        """Return the sum of all bodies of an atlas (3, *shape) on the layers of the object, (3, *grid.shape)."""
        result = np.zeros((3, *self.grid.shape), np.float32)
        for origin, first, crop in zip(self.origins, self.first, self.crops, strict=True):
            result[_slices(first, crop.shape)] += volume[_slices(origin, crop.shape)]
        return result


def fit_atlas(grid: LayerGrid, *, tsc: bool, vertices: npt.ArrayLike, body: npt.NDArray[np.integer]) -> Atlas:
    """Return the atlas of the bodies' layers, cropped from those of the object.

    Parameters
    ----------
    grid : LayerGrid
        Layers of the object.
    tsc : bool
        Whether assignment is by quadratic B-splines (TSC) rather than tents, see `core.grid.layers`.
    vertices : (n, 3) array
        World space, mm.
    body : (n,) int array
        Body of each vertex, from 0 without gaps.
    """
    count = int(body.max()) + 1
    low, high = (corner[:, ::-1] for corner in group_bounds(grid.coordinates(vertices), body, count))
    counts = np.array(grid.shape)
    low, high = low - BOUNDS_SLACK, high + BOUNDS_SLACK
    touched = (np.floor(low + 0.5) - 1.0, np.floor(high + 0.5) + 1.0) if tsc else (np.floor(low), np.floor(high) + 1.0)
    first, last = (np.clip(node, 0, counts - 1).astype(np.int64) for node in touched)
    sizes = np.minimum(-(-(last - first + 1) // CROP_MULTIPLE) * CROP_MULTIPLE, counts)
    first = np.minimum(first, counts - sizes)
    origins, shape = _packed(sizes + 2 * BORDER_NODES)
    crops = tuple(map(lambda f, s: _crop(grid, f, s), first, sizes))
    return Atlas(grid, first, origins + BORDER_NODES, crops, shape)


def _crop(grid: LayerGrid, first: Ints, size: Ints) -> LayerGrid:
    matrix = np.array(grid.world_to_grid)
    matrix[3, :3] -= first[::-1]
    rows = tuple(tuple(map(float, row)) for row in matrix)
    depth, height, width = (int(n) for n in size)
    return replace(grid, n_layers=depth, height=height, width=width, world_to_grid=rows)


def _packed(sizes: Ints) -> tuple[Ints, tuple[int, int, int]]:
    """Return origins (n, 3) of boxes of given sizes (n, 3), and the size of all: shelf packing, the largest first."""
    # About a cube, so that no side meets a limit before the others.
    side = int(np.ceil(np.cbrt(sizes.prod(axis=1).sum())))
    height, width = (max(side, int(n)) for n in sizes[:, 1:].max(axis=0))
    origins = np.zeros_like(sizes)
    z = y = x = depth_of_floor = height_of_row = 0
    for i in np.lexsort((-sizes[:, 2], -sizes[:, 1], -sizes[:, 0])):
        d, h, w = (int(n) for n in sizes[i])
        if x + w > width:
            x, y, height_of_row = 0, y + height_of_row, 0
        if y + h > height:
            x, y, z, height_of_row, depth_of_floor = 0, 0, z + depth_of_floor, 0, 0
        origins[i] = z, y, x
        x, height_of_row, depth_of_floor = x + w, max(height_of_row, h), max(depth_of_floor, d)
    end = (origins + sizes).max(axis=0)
    return origins, (int(end[0]), int(end[1]), int(end[2]))


def _slices(first: Ints, size: Sequence[int]) -> tuple[slice, ...]:
    return (slice(None), *(slice(int(start), int(start) + n) for start, n in zip(first, size, strict=True)))
