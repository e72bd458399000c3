"""Exitance of transport `diffusion` at any points of the surface: on the CPU, what the shaders do at pixels.

The equation of `core.transport.diffusion.pixels` from the same volume and tables, for points that no camera needs to
see.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid, tent_matrix, tsc_matrix
from milkglass.core.transport.base import LightAtPoints
from milkglass.core.transport.diffusion.pixels import WEAK_EIGENVALUE
from milkglass.core.transport.pixels import PixelEquation

LEAST_SPLIT = 1e-4  # of two eigenvalues
BORDER = 2  # nodes: as far as the weights reach over the edge


def point_exitance(
    volume: Float32,
    mean_fluence: Float32,
    grid: LayerGrid,
    terms: PixelEquation,
    eta: float,
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    lights: Sequence[LightAtPoints],
) -> Array:
    """Return exitance M at points of the surface.

    Parameters
    ----------
    volume : (4, n_layers, height, width) float32
        Of a `core.transport.diffusion.solver.Solution`, on its boundary's `grid`.
    mean_fluence : (3, n_layers, height, width) float32
        `core.transport.diffusion.pixels.mean_fluence` of the solution.
    terms : PixelEquation
    eta : float
    points, normals : (n, 3) arrays
        mm; unit, outward.
    lights : at the points

    Returns
    -------
    (n, 3) float64, >= 0
    """
    points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    thickness, share = sheet_depths(grid, terms, points)
    entering, entering_behind = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    sheet = share[:, None]
    for light in lights:
        front, back = (_inside(terms, eta, mu, len(points)) for mu in (light.cosine, _behind_cosine(light)))
        entering += _entering(terms, terms.front, front, thickness) * light.irradiance
        entering += sheet * _entering(terms, terms.across, back, thickness) * light.behind
        entering_behind += sheet * _entering(terms, terms.across, front, thickness) * light.irradiance
        entering_behind += (sheet > 0.0) * _entering(terms, terms.front, back, thickness) * light.behind
    mean = np.asarray(tent_matrix(grid, grid.coordinates(points)).T @ mean_fluence.reshape(3, -1).T, np.float64)
    gathered = _gather4(grid, volume, points)
    coupling = sheet * _interpolated(terms.coupling[None], thickness / max(terms.reach, 1e-9), np.zeros(len(points)))
    behind = points - thickness[:, None] * normals
    gathered_behind = _gather4(grid, volume, behind)
    bend, bend_behind = _bending(grid, terms, points), _bending(grid, terms, behind)
    diagonal = terms.diagonal - bend * (gathered[:, 3:] + coupling[:, 3:])
    diagonal_behind = terms.diagonal - bend_behind * (gathered_behind[:, 3:] + coupling[:, 3:])
    coupled, coupled_behind = (coupling[:, :3] + (b - 1.0) * coupling[:, 3:] for b in (bend_behind, bend))
    rhs = gathered[:, :3] + entering - (diagonal + coupled) * mean
    rhs_behind = gathered_behind[:, :3] + entering_behind - (diagonal_behind + coupled_behind) * mean
    solved = _damped(diagonal, diagonal_behind, coupled, coupled_behind, rhs, rhs_behind)
    excess = np.where(sheet > 0.0, solved, _damped_inverse(diagonal) * rhs)
    return np.maximum((mean + excess) / terms.doubled, 0.0)


def _damped_inverse(eigenvalue: Array) -> Array:
    """Return 1 / eigenvalue, smaller where it is weak."""
    return np.asarray(eigenvalue**3 / (eigenvalue**4 + WEAK_EIGENVALUE**4))


def _damped(
    diagonal: Array, diagonal_behind: Array, coupled: Array, coupled_behind: Array, rhs: Array, rhs_behind: Array
) -> Array:
    """First part of the solution of two equations, for both sides of a sheet, eigenvalues inverted as above.

    The matrix is ((diagonal, coupled), (coupled_behind, diagonal_behind)).
    """
    middle, half_difference = 0.5 * (diagonal + diagonal_behind), 0.5 * (diagonal - diagonal_behind)
    split = np.sqrt(np.maximum(half_difference * half_difference + coupled * coupled_behind, LEAST_SPLIT**2))
    upper, lower = _damped_inverse(middle + split), _damped_inverse(middle - split)
    slope = (upper - lower) / (2.0 * split)
    return np.asarray((0.5 * (upper + lower) + slope * half_difference) * rhs + slope * coupled * rhs_behind)


def sheet_depths(grid: LayerGrid, terms: PixelEquation, points: Array) -> tuple[Array, Array]:
    """Return the thickness at points, mm, and its share of a thin slab, (n,) each; 0 where no part is thin."""
    if terms.depths is None:
        return np.zeros(len(points)), np.zeros(len(points))
    weights = tent_matrix(grid, grid.coordinates(points))
    inverse, share = (np.asarray(weights.T @ image.ravel(), np.float64) for image in terms.depths)
    return 1.0 / np.maximum(inverse, 1.0 / terms.reach), share


def _bending(grid: LayerGrid, terms: PixelEquation, points: Array) -> Array:
    """Return b at points, (n, 3)."""
    if terms.bending is None:
        return np.ones((len(points), 3))
    weights = tent_matrix(grid, grid.coordinates(points))
    return 1.0 + np.asarray(weights.T @ terms.bending.reshape(3, -1).T, np.float64)


def _behind_cosine(light: LightAtPoints) -> Array | None:
    return None if light.cosine is None else light.behind_cosine


def _inside(terms: PixelEquation, eta: float, cosine: Array | None, n: int) -> Array:
    """Return the cosine of the refracted ray, (n,)."""
    if cosine is None:
        return np.full(n, terms.diffuse_cosine)
    return np.asarray(np.sqrt(np.maximum(0.0, 1.0 - (1.0 - np.square(cosine)) / eta**2)))


def _entering(terms: PixelEquation, table: Float32, inside: Array, thickness: Array) -> Array:
    """Return the factors on irradiance, (n, 3)."""
    row = (inside - terms.least_cosine) / max(1.0 - terms.least_cosine, 1e-6)
    column = thickness / terms.reach if terms.reach > 0.0 else np.zeros(len(inside))
    return _interpolated(table, column, row)


def _interpolated(table: Float32, column: Array, row: Array) -> Array:
    """Look up (rows, columns, c) linearly at places (n,) from 0, the first, to 1, the last: (n, c)."""
    rows, columns = table.shape[:2]
    y, x = np.clip(row, 0.0, 1.0) * (rows - 1), np.clip(column, 0.0, 1.0) * (columns - 1)
    i, j = y.astype(np.int64), x.astype(np.int64)
    i1, j1 = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
    v, u = (y - i)[:, None], (x - j)[:, None]
    upper, lower = (table[k, j] * (1.0 - u) + table[k, j1] * u for k in (i, i1))
    return np.asarray(upper * (1.0 - v) + lower * v, np.float64)


def _gather4(grid: LayerGrid, volume: Float32, points: Array) -> Array:
    """Return O of R, G and B, and K_L 1, (n, 4); outside the layers their edges go on, as a clamped texture's do."""
    border = [(0, 0), *[(BORDER, BORDER)] * 3]
    wide = [n + 2 * BORDER for n in grid.shape]
    coordinates = np.clip(grid.coordinates(points), -1.0, np.array(grid.shape[::-1])) + BORDER
    wider = replace(grid, n_layers=wide[0], height=wide[1], width=wide[2])
    bordered = np.pad(volume, border, mode="edge").reshape(len(volume), -1)
    return np.asarray(tsc_matrix(wider, coordinates).T @ bordered.T, np.float64)
