"""A closed surface from the height of a photographed object: front, mirrored back, one rim.

Vertices stand at the nodes of a grid over the photograph; those of the rim are moved onto the outline, so that it
has no steps. The back is the inflated outline without relief, mirrored: how thick a thing is, its outline tells as
well as anything, and what is behind it, nobody saw.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from core.mesh import Ints, Mesh, compact
from core.normals import vertex_normals
from core.photo_depth import harmonic

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

LEVEL = 0.25  # of coverage, smoothed over a node, where the rim stands: 0.7 nodes beyond the outline, which cuts it


@dataclass(frozen=True, eq=False)
class Outline:
    """Nodes of a grid that an object's surface has.

    Attributes
    ----------
    soft : (h, w) float64
        Coverage smoothed over a node.
    quads : (h - 1, w - 1) bool
        Squares of four nodes that are its surface.
    inner : (h, w) bool
        Nodes all of whose squares are: the rest of the used ones is the rim.
    used : (h, w) bool
    """

    soft: Array
    quads: Bools
    inner: Bools
    used: Bools


def find_outline(coverage: npt.ArrayLike) -> Outline:
    """Find the surface's nodes, from the share (h, w) in [0, 1] of each node's square that the object covers.

    The border of the grid stays outside, and so does what is too thin to have an inner node.
    """
    soft = gaussian_filter(np.asarray(coverage, np.float64), 1.0, mode="constant")
    quads = 0.25 * (soft[:-1, :-1] + soft[1:, :-1] + soft[:-1, 1:] + soft[1:, 1:]) > LEVEL
    quads[[0, -1]] = False
    quads[:, [0, -1]] = False
    while True:
        count = np.pad(quads, 1).astype(np.int8)
        around = count[:-1, :-1] + count[1:, :-1] + count[:-1, 1:] + count[1:, 1:]
        inner, used = around == 4, around > 0
        narrow = quads & _narrow(quads, inner)
        if not narrow.any():
            return Outline(soft, quads, inner, used)
        quads &= ~narrow


def _narrow(quads: Bools, inner: Bools) -> Bools:
    """Squares whose front and back would share an edge that is not at the rim, (h - 1, w - 1)."""
    none = ~(inner[:-1, :-1] | inner[1:, :-1] | inner[:-1, 1:] | inner[1:, 1:])
    beside = quads[:, :-1] & quads[:, 1:] & ~(inner[:-1, 1:-1] | inner[1:, 1:-1])
    above = quads[:-1] & quads[1:] & ~(inner[1:-1, :-1] | inner[1:-1, 1:])
    none[:, :-1] |= beside
    none[:, 1:] |= beside
    none[:-1] |= above
    none[1:] |= above
    return none


def height_surface(outline: Outline, height: Array, base: Array, spacing: float) -> Mesh:
    """Close a height field.

    Parameters
    ----------
    outline : Outline
    height : (h, w) float64
        Towards the camera, in nodes; finite where a node is used.
    base : (h, w) float64
        The outline's inner nodes inflated, which the back is.
    spacing : float
        mm between two nodes, > 0.

    Returns
    -------
    Mesh
        Closed. x to the right, y up, z towards the camera; the middle of the grid at x = y = 0, heights from z = 0.
    """
    h, w = outline.used.shape
    y, x = _rows_and_columns(outline)
    rim = outline.used & ~outline.inner
    # From rim to rim behind the object; where the front is hollow, behind that.
    between = harmonic(height, rim | ~outline.used)
    back = np.minimum(between, height) - base
    number = np.arange(h * w).reshape(h, w)
    front_faces = _faces(number, outline)
    behind = np.where(outline.inner, number + h * w, number)  # the rim belongs to both
    back_faces = _faces(behind, outline)[:, ::-1]
    place = np.stack([x - 0.5 * (w - 1), 0.5 * (h - 1) - y, height], axis=-1).reshape(-1, 3)
    place_behind = place.copy()
    place_behind[:, 2] = back.ravel()
    used, faces = compact(np.concatenate([front_faces, back_faces]), 2 * h * w)
    vertices = np.concatenate([place, place_behind])[used] * spacing
    return Mesh.of(vertices, vertex_normals(vertices, faces), faces)


def _rows_and_columns(outline: Outline) -> tuple[Array, Array]:
    """Row and column of each node, those of the rim moved to the outline along the gradient of its coverage."""
    y, x = np.mgrid[: outline.used.shape[0], : outline.used.shape[1]].astype(np.float64)
    rim = outline.used & ~outline.inner
    slopes = np.gradient(outline.soft)
    at = np.stack([y[rim], x[rim]])
    start = at.copy()
    for _ in range(3):
        value, *slope = (map_coordinates(field, at, order=1) for field in (outline.soft, *slopes))
        steepness = np.maximum(slope[0] ** 2 + slope[1] ** 2, 1e-4)
        at += np.clip((LEVEL - value) * np.stack(slope) / steepness, -0.3, 0.3)
        # Farther, and faces of the rim would fold over.
        at = start + np.clip(at - start, -0.45, 0.45)
    y[rim], x[rim] = at
    return y, x


def _faces(number: npt.NDArray[np.integer], outline: Outline) -> Ints:
    """Two triangles for each square, counter-clockwise as the camera sees them."""
    quads, inner = outline.quads, outline.inner
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
