"""A closed mesh from the height field of a photographed object: front and back, joined along the rim.

Vertices are nodes of a grid over the photograph; those of the rim are moved onto the outline, so that it has no steps.
The back is the inflated outline without relief, mirrored, since the photograph shows nothing of it but the outline.
Being smooth, it has a fifth of the front's triangles.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.geometry.mesh import Mesh, compact
from milkglass.core.geometry.normals import vertex_normals
from milkglass.core.photograph.depth import harmonic

BLOCK_SQUARES = 4  # squares along a side of a block that the back triangulates coarsely; even
RIM_COVERAGE = 0.25  # smoothed coverage at the rim, 0.7 nodes beyond the outline, which cuts it


@dataclass(frozen=True, eq=False)
class Outline:
    """Nodes and squares of a grid that the surface of an object occupies.

    Attributes
    ----------
    soft : (h, w) float64
        Coverage smoothed over a node.
    quads : (h - 1, w - 1) bool
        Squares of four nodes that belong to the surface.
    inner : (h, w) bool
        Nodes all of whose squares belong to it; the other used nodes are the rim.
    used : (h, w) bool
        Nodes of any such square.
    """

    soft: Array
    quads: Bools
    inner: Bools
    used: Bools


def find_outline(coverage: npt.ArrayLike) -> Outline:
    """Return the outline of an object from the share (h, w) in [0, 1] of each node's square that it covers.

    The border of the grid is outside, and so are parts too thin to have an inner node.
    """
    soft = gaussian_filter(np.asarray(coverage, np.float64), 1.0, mode="constant")
    quads = 0.25 * (soft[:-1, :-1] + soft[1:, :-1] + soft[:-1, 1:] + soft[1:, 1:]) > RIM_COVERAGE
    quads[[0, -1]] = False
    quads[:, [0, -1]] = False
    while True:
        count = np.pad(quads, 1).astype(np.int8)
        filled = count[:-1, :-1] + count[1:, :-1] + count[:-1, 1:] + count[1:, 1:]
        inner, used = filled == 4, filled > 0
        narrow = quads & _narrow(quads, inner)
        if not narrow.any():
            return Outline(soft, quads, inner, used)
        quads &= ~narrow


def _narrow(quads: Bools, inner: Bools) -> Bools:
    """Return a mask (h - 1, w - 1) of squares whose front and back would share an edge that is not at the rim."""
    without_inner = ~(inner[:-1, :-1] | inner[1:, :-1] | inner[:-1, 1:] | inner[1:, 1:])
    outer = quads[:, :-1] & quads[:, 1:] & ~(inner[:-1, 1:-1] | inner[1:, 1:-1])
    above = quads[:-1] & quads[1:] & ~(inner[1:-1, :-1] | inner[1:-1, 1:])
    without_inner[:, :-1] |= outer
    without_inner[:, 1:] |= outer
    without_inner[:-1] |= above
    without_inner[1:] |= above
    return without_inner


def height_surface(outline: Outline, height: Array, base: Array, spacing: float) -> Mesh:
    """Return a closed mesh of a height field and its inflated back.

    Parameters
    ----------
    outline : Outline
    height : (h, w) float64
        Height towards the camera, in nodes; finite where a node is used.
    base : (h, w) float64
        The inflated inner nodes: the thickness behind the rim.
    spacing : float
        Distance of two nodes, mm, > 0.

    Returns
    -------
    Mesh
        Closed. x to the right, y up, z towards the camera; the middle of the grid at x = y = 0, heights from z = 0.
    """
    h, w = outline.used.shape
    y, x = _rows_and_columns(outline)
    rim = outline.used & ~outline.inner
    # From rim to rim behind the object; behind the front where that is hollow.
    bridging = harmonic(height, rim | ~outline.used)
    back = np.minimum(bridging, height) - base
    number = np.arange(h * w).reshape(h, w)
    front_faces = _faces(number, outline.quads, outline.inner)
    behind = np.where(outline.inner, number + h * w, number)  # the rim belongs to both
    blocks = _blocks(outline.inner & (height >= bridging))
    covered = np.zeros_like(outline.quads)
    rows, columns = (BLOCK_SQUARES * n for n in blocks.shape)
    covered[:rows, :columns] = blocks.repeat(BLOCK_SQUARES, axis=0).repeat(BLOCK_SQUARES, axis=1)
    fine = _faces(behind, outline.quads & ~covered, outline.inner)
    back_faces = np.concatenate([fine, _fans(behind, blocks)])[:, ::-1]
    place = np.stack([x - 0.5 * (w - 1), 0.5 * (h - 1) - y, height], axis=-1).reshape(-1, 3)
    place_behind = place.copy()
    place_behind[:, 2] = back.ravel()
    used, faces = compact(np.concatenate([front_faces, back_faces]), 2 * h * w)
    vertices = np.concatenate([place, place_behind])[used] * spacing
    return replace(Mesh.of(vertices, vertex_normals(vertices, faces), faces), closed=True)


def _rows_and_columns(outline: Outline) -> tuple[Array, Array]:
    """Return the row and column of each node, with those of the rim moved onto the outline along its gradient."""
    y, x = np.mgrid[: outline.used.shape[0], : outline.used.shape[1]].astype(np.float64)
    rim = outline.used & ~outline.inner
    slopes = np.gradient(outline.soft)
    positions = np.stack([y[rim], x[rim]])
    start = positions.copy()
    for _ in range(3):
        value, *slope = (map_coordinates(field, positions, order=1) for field in (outline.soft, *slopes))
        steepness = np.maximum(slope[0] ** 2 + slope[1] ** 2, 1e-4)
        positions += np.clip((RIM_COVERAGE - value) * np.stack(slope) / steepness, -0.3, 0.3)
        # A larger shift would fold faces of the rim over.
        positions = start + np.clip(positions - start, -0.45, 0.45)
    y[rim], x[rim] = positions
    return y, x


def _faces(number: npt.NDArray[np.integer], quads: Bools, inner: Bools) -> Ints:
    """Return two triangles for each square, counter-clockwise as the camera sees them."""
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    a, b, c, d = (corner[quads] for corner in corners)
    # Cut along a diagonal that has an inner node: front and back would share one from rim to rim.
    along = (inner[:-1, :-1] | inner[1:, 1:])[quads]
    across = (inner[1:, :-1] | inner[:-1, 1:])[quads]
    odd = (np.add.outer(np.arange(quads.shape[0]), np.arange(quads.shape[1])) % 2 == 1)[quads]
    cut = (along & (odd | ~across))[:, None]
    first = np.where(cut, np.stack([a, b, c], axis=-1), np.stack([a, b, d], axis=-1))
    second = np.where(cut, np.stack([a, c, d], axis=-1), np.stack([b, c, d], axis=-1))
    return np.concatenate([first, second]).astype(np.int64)


def _blocks(smooth: Bools) -> Bools:
    """Return a mask of the blocks, from the first node on, all of whose nodes are smooth."""
    rows, columns = ((n - 1) // BLOCK_SQUARES for n in smooth.shape)
    all_smooth = np.ones((rows, columns), bool)
    for down in range(BLOCK_SQUARES + 1):
        for right in range(BLOCK_SQUARES + 1):
            nodes = smooth[
                down : down + BLOCK_SQUARES * rows : BLOCK_SQUARES,
                right : right + BLOCK_SQUARES * columns : BLOCK_SQUARES,
            ]
            all_smooth &= nodes
    return all_smooth


def _fans(number: npt.NDArray[np.integer], blocks: Bools) -> Ints:
    """Return triangle fans of the blocks about their middle nodes; sides next to single squares have all nodes."""
    last, framed = BLOCK_SQUARES, np.pad(blocks, 1)
    sides = {
        (0, -1): [(k, 0) for k in range(last + 1)],
        (1, 0): [(last, k) for k in range(last + 1)],
        (0, 1): [(last - k, last) for k in range(last + 1)],
        (-1, 0): [(0, last - k) for k in range(last + 1)],
    }
    faces = [np.empty((0, 3), np.int64)]
    for (down, right), side in sides.items():
        neighbours = framed[1 + down :, 1 + right :][: blocks.shape[0], : blocks.shape[1]]
        for joined, nodes in ((blocks & neighbours, [side[0], side[last]]), (blocks & ~neighbours, side)):
            rows, columns = (BLOCK_SQUARES * positions for positions in np.nonzero(joined))
            middle = number[rows + last // 2, columns + last // 2]
            rim = [number[rows + positions[0], columns + positions[1]] for positions in nodes]
            faces += [np.stack([middle, *pair], axis=-1) for pair in itertools.pairwise(rim)]
    return np.concatenate(faces).astype(np.int64)
