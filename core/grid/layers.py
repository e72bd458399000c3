"""Layers: parallel maps, equally spaced in view depth, on which irradiance is deposited and exitance gathered.

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

BLOCK = 8192  # points whose weights are made at a time: the temporaries stay in the cache
FLAT_EXTENT = 1e-6  # of the longest side: thinner than this is one layer, for float32 positions know no better


@dataclass(frozen=True)
class LayerGrid:
    """Placement of parallel layers of texels in world space.

    Attributes
    ----------
    n_layers, height, width : int
        Layers and texels; n_layers is 1 where the object is flat.
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
        """(4, 4): world space to the 3-D texture's coordinates in [0, 1], row vectors."""
        counts = np.array([self.width, self.height, self.n_layers], np.float64)
        scale = np.diag([*(1.0 / counts), 1.0])
        scale[3, :3] = 0.5 / counts
        return np.asarray(np.asarray(self.world_to_grid) @ scale)

    def coordinates(self, points: npt.ArrayLike) -> Array:
        """Grid coordinates (n, 3) of world points (n, 3); the GPU does the same for the surface samples."""
        matrix = np.asarray(self.world_to_grid)
        return np.asarray(np.asarray(points, np.float64) @ matrix[:3, :3] + matrix[3, :3])


def fit_layers(vertices: npt.ArrayLike, rotation: npt.ArrayLike, n_layers: int, resolution: int) -> LayerGrid:
    """Fit layers to an object as the camera sees it, (3).

    Parameters
    ----------
    vertices : (n, 3) array
        World space, mm.
    rotation : (3, 3) array
        World to view rotation for row vectors (the camera looks along -z of view space).
    n_layers : int
        Wanted number of layers, >= 1.
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
    """Fit layers to an object itself, whatever the view: world axes, layers across z, two nodes to spare all around.

    Parameters
    ----------
    bounds : (2, 3) array
        Lowest and highest corner, mm.
    spacing : float
        Between nodes along x and y, mm, > 0.
    n_layers : int, optional
        Layers over the depth; as dense as `spacing` if not given.
    """
    low, high = np.asarray(bounds, np.float64)
    extent = high - low
    distance = spacing
    if n_layers is not None and extent[2] > FLAT_EXTENT * extent.max():
        distance = float(extent[2]) / max(n_layers - 1, 1)
    step = np.array([spacing, spacing, distance])
    width, height, depth = (int(n) for n in np.ceil(extent / step - 1e-6) + 4)
    # A flat face errs by a cosine of its place between two nodes; a quarter node to the side or none, whichever brings
    # both faces of the box nearer to the cosine's zeros.
    shift = np.where(np.cos(2.0 * np.pi * extent / step) > 0.0, 0.25, 0.0)
    matrix = np.diag([*(1.0 / step), 1.0])
    matrix[3, :3] = 0.5 * (np.array([width, height, depth]) - 1.0) + shift - 0.5 * (low + high) / step
    return LayerGrid(depth, height, width, spacing, distance, tuple(tuple(map(float, row)) for row in matrix))


def fit_nodes(bounds: npt.ArrayLike, resolution: int, n_layers: int | None = None) -> LayerGrid:
    """`fit_box` with so many nodes along the longest side, >= 2."""
    longest = float(np.ptp(np.asarray(bounds, np.float64), axis=0).max())
    return fit_box(bounds, longest / (resolution - 1), n_layers)


def tent_matrix(grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
    """Tent weights of points on the nodes, (4): a sparse matrix W, one column a point.

    W @ flux deposits, W.T @ volume gathers; the weights of a point, 8 or fewer, sum to 1.

    Parameters
    ----------
    grid : LayerGrid
    coordinates : (n, 3) array
        Grid coordinates; points outside are moved to the nearest face of the box.

    Returns
    -------
    (n_layers * height * width, n) sparse float32
    """

    def tent(u: npt.NDArray[np.floating], count: int) -> AxisWeights:
        if count == 1:  # a single layer takes all
            return np.zeros(len(u), np.int64), np.ones((1, len(u)), np.float32)
        position = np.clip(u, 0.0, count - 1.0)
        lower = np.minimum(position.astype(np.int64), count - 2)
        fraction = (position - lower).astype(np.float32)
        return lower, np.stack([1.0 - fraction, fraction])

    return _product_matrix(grid, coordinates, tent)


def smooth_matrix(grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
    """Quadratic B-spline (TSC) weights of points, 27 nodes each; otherwise as `tent_matrix`.

    The grid must have a node to spare on every side of the points, as `fit_box` gives.
    """
    return _product_matrix(grid, coordinates, _spline)


def smooth_slope_matrix(
    grid: LayerGrid, coordinates: npt.NDArray[np.floating], vectors: npt.NDArray[np.floating], weights: csc_array
) -> csc_array:
    """Slopes v . grad of the weights of `smooth_matrix`, 1/mm, along a world vector v (n, 3) of each point.

    For grids along world axes, as `fit_box` gives; `weights` are those of the same points, entry by entry.
    """
    axes = 3
    steps = np.array([grid.texel, grid.texel, grid.layer_distance])
    parts = [_spline(coordinates[:, i], grid.shape[::-1][i]) for i in range(axes)]
    data = np.zeros((len(coordinates), 27), np.float32)
    for axis in range(axes):
        factors = [w for _, w in parts]
        f = (coordinates[:, axis] - parts[axis][0] - 1).astype(np.float32)
        scale = (vectors[:, axis] / steps[axis]).astype(np.float32)
        factors[axis] = np.stack([f - 0.5, -2.0 * f, f + 0.5]) * scale
        x, y, z = factors
        data += np.einsum("kn,jn,in->nkji", z, y, x).reshape(-1, 27)
    return csc_array((data.ravel(), weights.indices, weights.indptr), shape=weights.shape)


def _spline(u: npt.NDArray[np.floating], count: int) -> AxisWeights:
    nearest = np.clip(np.floor(u + 0.5), 1, count - 2).astype(np.int64)
    f = (u - nearest).astype(np.float32)
    return nearest - 1, np.stack([0.5 * (0.5 - f) ** 2, 0.75 - f**2, 0.5 * (0.5 + f) ** 2])


def _product_matrix(
    grid: LayerGrid,
    coordinates: npt.NDArray[np.floating],
    axis_weights: Callable[[npt.NDArray[np.floating], int], AxisWeights],
) -> csc_array:
    """Weights that are products over the axes; `axis_weights` gives the first node and (k, n) weights along one."""
    n, n_nodes = len(coordinates), int(np.prod(grid.shape))
    index = np.int64 if n_nodes > np.iinfo(np.int32).max else np.int32
    blocks: list[tuple[npt.NDArray[np.signedinteger], Float32]] = []
    for start in range(0, max(n, 1), BLOCK):
        part = coordinates[start : start + BLOCK]
        nodes, weights = np.zeros((1, len(part)), np.int64), np.ones((1, len(part)), np.float32)
        for axis, count in ((2, grid.n_layers), (1, grid.height), (0, grid.width)):
            first, along = axis_weights(part[:, axis], count)
            steps = first + np.arange(len(along))[:, None]
            nodes = (nodes[:, None] * count + steps).reshape(-1, len(part))
            weights = (weights[:, None] * along).reshape(-1, len(part))
        blocks.append((np.ascontiguousarray(nodes.T, index), np.ascontiguousarray(weights.T)))
    node = np.concatenate([nodes for nodes, _ in blocks])
    weight = np.concatenate([weights for _, weights in blocks])
    columns = np.arange(0, node.size + 1, node.shape[1], dtype=index)
    return csc_array((weight.ravel(), node.ravel(), columns), shape=(n_nodes, n))


def deposit(grid: LayerGrid, weights: csc_array, flux: Float32) -> Float32:
    """Spread flux over the layers, (4).

    Parameters
    ----------
    grid : LayerGrid
    weights : from `tent_matrix`
    flux : (n, 3) float32
        E dA per sample and channel (the paper's sum has no dA; without it the result grows with the samples).

    Returns
    -------
    (3, n_layers, height, width) float32
        Flux per texel; every channel sums to the sum of its flux.
    """
    return np.ascontiguousarray((weights @ flux).T).reshape(3, *grid.shape)


def gather(weights: csc_array, volume: Float32) -> Float32:
    """Trilinear gather (7), as the GPU's linear filter does it: (3, *grid.shape) -> (n, 3) float32."""
    return np.asarray(weights.T @ volume.reshape(3, -1).T)
