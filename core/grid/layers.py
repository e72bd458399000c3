"""Layers: parallel maps, equally spaced in depth, on which flux is deposited and from which exitance is gathered.

The maps are orthographic: a box aligned with the camera's orientation, square texels of h mm, layers dz mm apart, so
that distances between texels are true distances. Node (0, 0, 0) lies at the left, lower, near corner of the object's
box; grid coordinates (u, v, l) count nodes, and a texture coordinate is (u + 1/2) / n.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32

AxisWeights = tuple[npt.NDArray[np.int64], Float32]

BLOCK_POINTS = 8192  # points whose weights are computed at a time: the temporaries stay in the cache
FLAT_EXTENT = 1e-6  # of the longest side: thinner objects get one layer, since float32 positions resolve no more


@dataclass(frozen=True)
class LayerGrid:
    """Grid of parallel layers of texels in world space.

    Attributes
    ----------
    n_layers, height, width : int
        Numbers of layers and texels; n_layers is 1 where the object is flat.
    texel, layer_distance : float
        h and dz, mm; dz is 0 with a single layer.
    world_to_grid : 4 x 4 nested tuples
        Affine, row vectors: (x, y, z, 1) @ M = (u, v, l, 1).
    """

    n_layers: int
    height: int
    width: int
    texel: float
    layer_distance: float
    world_to_grid: tuple[tuple[float, ...], ...]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of grid points along each axis: (n_layers, height, width)."""
        return self.n_layers, self.height, self.width

    @property
    def world_to_texture(self) -> Array:
        """Affine map (4, 4) for row vectors from world space to the coordinates in [0, 1] of a 3-D texture."""
        counts = np.array([self.width, self.height, self.n_layers], np.float64)
        scale = np.diag([*(1.0 / counts), 1.0])
        scale[3, :3] = 0.5 / counts
        return np.asarray(np.asarray(self.world_to_grid) @ scale)

    def coordinates(self, points: npt.ArrayLike) -> Array:
        """Return grid coordinates (n, 3) of world points (n, 3)."""
        matrix = np.asarray(self.world_to_grid)
        return np.asarray(np.asarray(points, np.float64) @ matrix[:3, :3] + matrix[3, :3])


def fit_layers(vertices: npt.ArrayLike, rotation: npt.ArrayLike, n_layers: int, resolution: int) -> LayerGrid:
    """Return layers that enclose an object as the camera sees it, (3).

    Parameters
    ----------
    vertices : (n, 3) array
        World space, mm.
    rotation : (3, 3) array
        World to view rotation for row vectors (the camera looks along -z of view space).
    n_layers : int
        Number of layers, >= 1; flat objects get one.
    resolution : int
        Texels along the longer side of a map, >= 2.
    """
    view = np.asarray(vertices, np.float64) @ np.asarray(rotation, np.float64)
    low, high = view.min(axis=0), view.max(axis=0)
    extent = high - low
    longest = float(extent.max())
    # A surface seen exactly edge-on has no width: one texel of thickness keeps the maps two texels wide.
    texel = max(float(extent[:2].max()), FLAT_EXTENT * longest) / (resolution - 1)
    width, height = (max(2, int(np.ceil(side / texel - 1e-6)) + 1) for side in extent[:2])
    if n_layers == 1 or extent[2] <= FLAT_EXTENT * longest:
        n_layers, distance, per_depth = 1, 0.0, 0.0
    else:
        distance = float(extent[2]) / (n_layers - 1)
        per_depth = 1.0 / distance
    to_grid = np.diag([1.0 / texel, 1.0 / texel, -per_depth])  # depth grows along -z of view space
    matrix = np.eye(4)
    matrix[:3, :3] = np.asarray(rotation, np.float64) @ to_grid
    # The box is centred in the map, so that mirrored objects get mirrored maps.
    margin = 0.5 * (np.array([width - 1, height - 1, 0.0]) - [*(extent[:2] / texel), 0.0])
    matrix[3, :3] = margin - np.array([low[0], low[1], high[2]]) @ to_grid
    return LayerGrid(n_layers, height, width, texel, distance, tuple(tuple(map(float, row)) for row in matrix))


def fit_box(bounds: npt.ArrayLike, spacing: float, n_layers: int | None = None) -> LayerGrid:
    """Return layers along world axes that enclose an object whatever the view, with two nodes to spare on every side.

    Parameters
    ----------
    bounds : (2, 3) array
        Lowest and highest corner, mm.
    spacing : float
        Distance of nodes along x and y, mm, > 0.
    n_layers : int, optional
        Number of layers over the depth, across z; their distance is `spacing` if not given.
    """
    low, high = np.asarray(bounds, np.float64)
    extent = high - low
    distance = spacing
    if n_layers is not None and extent[2] > FLAT_EXTENT * extent.max():
        distance = float(extent[2]) / max(n_layers - 1, 1)
    step = np.array([spacing, spacing, distance])
    width, height, depth = (int(n) for n in np.ceil(extent / step - 1e-6) + 4)
    # The error of a flat face is a cosine of its position between two nodes; a shift of a quarter node, or none, brings
    # both faces of the box nearer to the zeros of the cosine.
    shift = np.where(np.cos(2.0 * np.pi * extent / step) > 0.0, 0.25, 0.0)
    matrix = np.diag([*(1.0 / step), 1.0])
    matrix[3, :3] = 0.5 * (np.array([width, height, depth]) - 1.0) + shift - 0.5 * (low + high) / step
    return LayerGrid(depth, height, width, spacing, distance, tuple(tuple(map(float, row)) for row in matrix))


def fit_nodes(bounds: npt.ArrayLike, resolution: int, n_layers: int | None = None) -> LayerGrid:
    """Return layers as `fit_box` does, with `resolution` nodes, >= 2, along the longest side."""
    longest = float(np.ptp(np.asarray(bounds, np.float64), axis=0).max())
    return fit_box(bounds, longest / (resolution - 1), n_layers)


def tent_matrix(grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
    """Return the assignment matrix W of tents (order 2), (4): weights of points on the nodes, one column a point.

    W @ flux deposits, W.T @ volume gathers; the weights of a point, 8 or fewer, sum to 1.

    Parameters
    ----------
    grid : LayerGrid
    coordinates : (n, 3) array
        Grid coordinates; points outside are clamped to the box of the nodes.

    Returns
    -------
    (n_layers * height * width, n) sparse float32
    """

    def tent_weights(u: npt.NDArray[np.floating], count: int) -> AxisWeights:
        if count == 1:  # a single layer takes all flux
            return np.zeros(len(u), np.int64), np.ones((1, len(u)), np.float32)
        position = np.clip(u, 0.0, count - 1.0)
        lower = np.minimum(position.astype(np.int64), count - 2)
        fraction = (position - lower).astype(np.float32)
        return lower, np.stack([1.0 - fraction, fraction])

    return _product_matrix(grid, coordinates, tent_weights)


def tsc_matrix(grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
    """Return the assignment matrix of quadratic B-splines (TSC, order 3): 27 nodes a point, otherwise as `tent_matrix`.

    The grid must have a node to spare on every side of the points, as `fit_box` gives.
    """
    return _product_matrix(grid, coordinates, _tsc_weights)


def tsc_gradient_matrix(
    grid: LayerGrid, coordinates: npt.NDArray[np.floating], vectors: npt.NDArray[np.floating], weights: csc_array
) -> csc_array:
    """Return the directional derivatives v . grad of the weights of `tsc_matrix`, 1/mm, along vectors v (n, 3), world.

    The grid must be along world axes, as `fit_box` gives; `weights` is the matrix of the same points.
    """
    n_axes = 3
    steps = np.array([grid.texel, grid.texel, grid.layer_distance])
    axis_weights = [_tsc_weights(coordinates[:, i], grid.shape[::-1][i]) for i in range(n_axes)]
    data = np.zeros((len(coordinates), 27), np.float32)
    for axis in range(n_axes):
        factors = [w for _, w in axis_weights]
        fraction = (coordinates[:, axis] - axis_weights[axis][0] - 1).astype(np.float32)
        scale = (vectors[:, axis] / steps[axis]).astype(np.float32)
        factors[axis] = np.stack([fraction - 0.5, -2.0 * fraction, fraction + 0.5]) * scale
        x, y, z = factors
        data += np.einsum("kn,jn,in->nkji", z, y, x).reshape(-1, 27)
    return csc_array((data.ravel(), weights.indices, weights.indptr), shape=weights.shape)


def _tsc_weights(u: npt.NDArray[np.floating], count: int) -> AxisWeights:
    nearest = np.clip(np.floor(u + 0.5), 1, count - 2).astype(np.int64)
    fraction = (u - nearest).astype(np.float32)
    return nearest - 1, np.stack([0.5 * (0.5 - fraction) ** 2, 0.75 - fraction**2, 0.5 * (0.5 + fraction) ** 2])


def _product_matrix(
    grid: LayerGrid,
    coordinates: npt.NDArray[np.floating],
    axis_weights: Callable[[npt.NDArray[np.floating], int], AxisWeights],
) -> csc_array:
    """Return products over the axes; `axis_weights` returns the first nodes and the weights (k, n) along one axis."""
    n, n_nodes = len(coordinates), int(np.prod(grid.shape))
    index = np.int64 if n_nodes > np.iinfo(np.int32).max else np.int32
    blocks: list[tuple[npt.NDArray[np.signedinteger], Float32]] = []
    for start in range(0, max(n, 1), BLOCK_POINTS):
        block = coordinates[start : start + BLOCK_POINTS]
        nodes, weights = np.zeros((1, len(block)), np.int64), np.ones((1, len(block)), np.float32)
        for axis, count in ((2, grid.n_layers), (1, grid.height), (0, grid.width)):
            first, along = axis_weights(block[:, axis], count)
            steps = first + np.arange(len(along))[:, None]
            shape = len(nodes) * len(along), len(block)
            nodes = (nodes[:, None] * count + steps).reshape(shape)
            weights = (weights[:, None] * along).reshape(shape)
        blocks.append((np.ascontiguousarray(nodes.T, index), np.ascontiguousarray(weights.T)))
    node = np.concatenate([nodes for nodes, _ in blocks])
    weight = np.concatenate([weights for _, weights in blocks])
    columns = np.arange(0, node.size + 1, node.shape[1], dtype=index)
    return csc_array((weight.ravel(), node.ravel(), columns), shape=(n_nodes, n))


def deposit(grid: LayerGrid, weights: csc_array, flux: Float32) -> Float32:
    """Return flux spread over the layers, (4).

    Parameters
    ----------
    grid : LayerGrid
    weights : sparse matrix
        From `tent_matrix` or `tsc_matrix`.
    flux : (n, 3) float32
        E dA of each sample and channel (the paper's sum has no dA, so its result grows with the number of samples).

    Returns
    -------
    (3, n_layers, height, width) float32
        Flux a texel; every channel sums to the sum of its flux.
    """
    return np.ascontiguousarray((weights @ flux).T).reshape(3, *grid.shape)


def gather(weights: csc_array, volume: Float32) -> Float32:
    """Return a volume (3, *grid.shape) gathered at points, (n, 3) float32, (7); tents are the GPU's linear filter."""
    return np.asarray(weights.T @ volume.reshape(3, -1).T)
