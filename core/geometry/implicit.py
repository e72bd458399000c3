"""Implicit surfaces: a union of signed distance functions, polygonised by marching cubes.

Primitives are evaluated only in blocks of the grid that they reach. The vertices are then projected onto the surface
and relaxed along it: on a sheet two cells thick the interpolation of marching cubes and the differences of the grid
are too coarse for shading.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skimage.measure import label, marching_cubes

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.geometry.normals import vertex_normals

# (n,) values at, or (3, n) coordinates of, points: float32, which halves the time and is good to 1e-6 of the size.
Values = npt.NDArray[np.floating]
Coordinates = npt.NDArray[np.floating]

BLOCK_NODES = 6  # nodes along the side of a block
BACKGROUND = np.float32(1e3)  # distance where no primitive reaches

# Distances of primitives are first-order estimates: away from the surface they may be this many times too large.
STEEPNESS = 1.4

# Corners of an octahedron: six values give the gradient and, as their mean, the value. A tetrahedron's four
# would turn the normals of a rim by the step times its curvature.
OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)


# Relaxation factor towards the mean of the neighbours; 1 would oscillate.
RELAXATION = np.float32(0.7)


@dataclass(frozen=True)
class Primitive:
    """One solid of a union, by its signed distance function.

    Attributes
    ----------
    distance : callable
        (3, n) coordinates to (n,) signed distances, negative inside; exact to first order near the surface.
    blend : float
        Width of the fillet between the solid and the union of those before it, > 0.
    """

    distance: Callable[[Coordinates], Values]
    blend: float


def smooth_min(a: Values, b: Values, blend: float) -> Values:
    """Return the minimum of two distances with a fillet of width `blend` where they cross (quadratic)."""
    h = np.maximum(np.float32(blend) - np.abs(a - b), np.float32(0.0))
    result: Values = np.minimum(a, b) - h * h * np.float32(0.25 / blend)
    return result


def smooth_max(a: Values, b: Values, blend: float) -> Values:
    """Return the maximum of two distances with an edge rounded over the width `blend` (quadratic)."""
    h = np.maximum(np.float32(blend) - np.abs(a - b), np.float32(0.0))
    result: Values = np.maximum(a, b) + h * h * np.float32(0.25 / blend)
    return result


def polygonise(
    primitives: Sequence[Primitive], low: npt.ArrayLike, high: npt.ArrayLike, spacing: float, rounds: int = 5
) -> tuple[Array, Ints, Array]:
    """Return a triangle mesh of the union of `primitives`.

    Parameters
    ----------
    primitives : sequence of Primitive
    low, high : (3,) arrays
        A box that holds the surface.
    spacing : float
        Side of a grid cell; sheets should be thicker than 1.5 cells.
    rounds : int
        Number of relaxations of the vertices, each followed by a projection onto the surface.

    Returns
    -------
    vertices : (n, 3) float64
    faces : (m, 3) int64, counter-clockwise seen from outside
    normals : (n, 3) float64, unit, outward: the gradient of the distance
    """
    union = _Union(primitives, np.asarray(low, np.float64), np.asarray(high, np.float64), spacing)
    vertices, faces, _, _ = marching_cubes(union.grid(), 0.0, gradient_direction="descent")
    v = np.ascontiguousarray((union.low + vertices * spacing).T, np.float32)
    faces = faces.astype(np.int64)
    surface = union.near(v)
    degree = np.bincount(faces.ravel(), minlength=v.shape[1])
    for _ in range(rounds):
        v, normals = surface.project(v)
        shift = _neighbour_sum(v, faces) / degree - v
        v += RELAXATION * (shift - normals * (shift * normals).sum(axis=0))
    v, _ = surface.project(v)
    v, gradients = surface.project(v)
    vertices, normals = v.T.astype(np.float64), gradients.T.astype(np.float64)
    # On edges sharper than the grid the gradient of one vertex says little about its faces: their normals replace it.
    of_faces = vertex_normals(vertices, faces)
    sharp = np.einsum("ij,ij->i", normals, of_faces) < 0.8
    return vertices, faces, np.where(sharp[:, None], of_faces, normals)


def _neighbour_sum(vertices: Coordinates, faces: Ints) -> Coordinates:
    """Return the sum of the neighbours of each vertex of a closed mesh, where a directed edge belongs to one face."""
    corner, following = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    n = vertices.shape[1]
    return np.stack([np.bincount(corner, v[following], minlength=n) for v in vertices]).astype(np.float32)


class _Union:
    """A union of primitives over a grid of blocks, with the primitives that reach each block."""

    def __init__(self, primitives: Sequence[Primitive], low: Array, high: Array, spacing: float) -> None:
        self.primitives, self.low, self.spacing = primitives, low, spacing
        self.blocks = np.ceil(((high - low) / spacing + 1.0) / BLOCK_NODES).astype(np.int64)
        index = np.stack(np.meshgrid(*map(np.arange, self.blocks), indexing="ij")).reshape(3, -1)
        self.corners = (low[:, None] + index * (BLOCK_NODES * spacing)).astype(np.float32)
        centres = self.corners + np.float32(0.5 * (BLOCK_NODES - 1) * spacing)
        reach = STEEPNESS * 0.5 * np.sqrt(3.0) * BLOCK_NODES * spacing
        self.reaches: list[Bools] = [primitive.distance(centres) < reach + primitive.blend for primitive in primitives]

    def grid(self) -> Values:
        """Return the distance at all nodes, negative inside."""
        steps = np.arange(BLOCK_NODES, dtype=np.float32) * np.float32(self.spacing)
        offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij")).reshape(3, 1, -1)
        values = np.full((self.corners.shape[1], BLOCK_NODES**3), BACKGROUND)
        for primitive, reached in zip(self.primitives, self.reaches, strict=True):
            points = self.corners[:, reached, None] + offsets
            distance = primitive.distance(points.reshape(3, -1)).reshape(-1, BLOCK_NODES**3)
            values[reached] = smooth_min(values[reached], distance, primitive.blend)
        # A node exactly on the surface makes faces without area.
        values[np.abs(values) < 1e-3 * self.spacing] = 1e-3 * self.spacing
        a, b, c = self.blocks
        cubes = values.reshape(a, b, c, BLOCK_NODES, BLOCK_NODES, BLOCK_NODES).transpose(0, 3, 1, 4, 2, 5)
        volume = np.ascontiguousarray(cubes.reshape(a * BLOCK_NODES, b * BLOCK_NODES, c * BLOCK_NODES))
        # Bubbles that primitives enclose where they meet are filled: they are not visible, but would scatter light.
        air = label(volume > 0.0, connectivity=1)
        bubbles = (air > 0) & (air != air[0, 0, 0])
        volume[bubbles] *= -1.0
        return volume

    def near(self, points: Coordinates) -> "_Surface":
        """Return the surface near points (3, n) less than a cell from it, with the primitives that matter at each."""
        cell = np.floor((points.T - self.low) / (BLOCK_NODES * self.spacing)).astype(np.int64)
        cell = np.clip(cell, 0, self.blocks - 1)
        block = (cell[:, 0] * self.blocks[1] + cell[:, 1]) * self.blocks[2] + cell[:, 2]
        members = []
        for primitive, reached in zip(self.primitives, self.reaches, strict=True):
            near = np.flatnonzero(reached[block])
            distance = primitive.distance(points[:, near])
            members.append(near[distance < primitive.blend + 3.0 * self.spacing])
        return _Surface(self.primitives, members, self.spacing)


@dataclass(frozen=True)
class _Surface:
    """Zero level of a union at given points; `members` holds, for each primitive, the points where it matters."""

    primitives: Sequence[Primitive]
    members: list[Ints]
    spacing: float

    def project(self, points: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Move points (3, n) by one Newton step towards the surface; return them and the unit gradients before it."""
        step = np.float32(0.05 * self.spacing)
        values = np.full((6, points.shape[1]), BACKGROUND)
        for primitive, member in zip(self.primitives, self.members, strict=True):
            stencil = points[:, None, member] + step * OCTAHEDRON.T[:, :, None]
            distance = primitive.distance(stencil.reshape(3, -1)).reshape(6, -1)
            values[:, member] = smooth_min(values[:, member], distance, primitive.blend)
        gradient = OCTAHEDRON.T @ values / (2.0 * step)
        length = np.maximum(np.sqrt((gradient * gradient).sum(axis=0)), np.float32(1e-3))
        normals = gradient / length
        # Half a cell at most: the step of a point near an edge must not carry it to another sheet.
        limit = np.float32(0.5 * self.spacing)
        return points - normals * np.clip(values.mean(axis=0) / length, -limit, limit), normals
