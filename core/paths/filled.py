"""How much of the cells around the nodes of a grid lies inside a closed surface.

An integral over the inside is a sum over the surface: along columns through the grid, each crossing of a face adds the
antiderivative of what is integrated, with the sign of the face's normal along the column. Columns that pass an edge
cross exactly one of its two faces, so that the sum has no leak; along a column it is exact. No two columns of a cell
have one x or one y, so that sheets thinner than a cell, along the axes too, are as thick as they are.
"""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.paths.compiled import compiled

COLUMNS = 6  # along each side of a cell
LEAST_WEIGHT = 0.03  # below it a node is too far outside for what is divided by its weight


@dataclass(frozen=True, eq=False)
class Filled:
    """What of the surroundings of each node is inside an object.

    Attributes
    ----------
    share : (n_layers, height, width) float32
        Share of the node's cell, [0, 1].
    weight : (n_layers, height, width) float32
        What a uniform density of 1 a cell inside the object assigns to the node by tents, at least `LEAST_WEIGHT`.
    """

    share: Float32
    weight: Float32


def filled(mesh: Mesh, grid: LayerGrid) -> Filled:
    """Return what of a grid a closed mesh, wound outwards, fills; the grid is along world axes and encloses it."""
    corners = grid.coordinates(mesh.vertices)[mesh.faces]
    steps, tents = (np.zeros((depth, grid.height, grid.width)) for depth in (grid.n_layers, grid.n_layers))
    _cross(np.ascontiguousarray(corners), COLUMNS, steps, tents)
    share, weight = (np.cumsum(part[::-1], axis=0)[::-1] / COLUMNS**2 for part in (steps, tents))
    return Filled(np.clip(share, 0.0, 1.0).astype(np.float32), np.clip(weight, LEAST_WEIGHT, 1.0).astype(np.float32))


@compiled
def _side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> bool:
    """Return whether a point lies left of the line from a to b, alike for both faces of an edge."""
    if ax < bx or (ax == bx and ay < by):
        return bool((bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0)
    return not (ax - bx) * (y - by) - (ay - by) * (x - bx) >= 0.0


@compiled
def _cross(corners: Array, columns: int, steps: Array, tents: Array) -> None:
    """Add for each crossing the differences along z of the antiderivatives, of cells and of tents."""
    depth, height, width = steps.shape
    for face in range(len(corners)):
        a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        sign = 1.0 if area > 0.0 else -1.0
        first_row = int(np.ceil((min(a[1], b[1], c[1]) + 0.5) * columns - 1.0))
        last_row = int(np.floor((max(a[1], b[1], c[1]) + 0.5) * columns))
        first_column = int(np.ceil((min(a[0], b[0], c[0]) + 0.5) * columns - 1.0))
        last_column = int(np.floor((max(a[0], b[0], c[0]) + 0.5) * columns))
        for i in range(max(first_row, 0), min(last_row, columns * height - 1) + 1):
            for j in range(max(first_column, 0), min(last_column, columns * width - 1) + 1):
                x = (j + (i % columns + 0.5) / columns) / columns - 0.5
                y = (i + (columns - j % columns - 0.5) / columns) / columns - 0.5
                left = _side(a[0], a[1], b[0], b[1], x, y)
                if left != _side(b[0], b[1], c[0], c[1], x, y) or left != _side(c[0], c[1], a[0], a[1], x, y):
                    continue
                v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                z = min(max(a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2]), 0.0), depth - 1.001)
                nearest = int(z + 0.5)
                over = z + 0.5 - nearest  # share of the nearest node's cell that is below z
                steps[nearest, i // columns, j // columns] += sign * over
                if nearest > 0:
                    steps[nearest - 1, i // columns, j // columns] += sign * (1.0 - over)
                # Tents: what lies below z of those of the two nodes next to it, and all of the lower ones.
                lower = int(z)
                t = z - lower
                at_lower, at_upper = 1.0 - 0.5 * (1.0 - t) * (1.0 - t), 0.5 * t * t
                row, column = int(np.floor(y)), int(np.floor(x))
                for q in range(2):
                    for p in range(2):
                        if 0 <= row + q < height and 0 <= column + p < width:
                            share = sign * (1.0 - abs(y - row - q)) * (1.0 - abs(x - column - p))
                            tents[lower + 1, row + q, column + p] += share * at_upper
                            tents[lower, row + q, column + p] += share * (at_lower - at_upper)
                            if lower > 0:
                                tents[lower - 1, row + q, column + p] += share * (1.0 - at_lower)
