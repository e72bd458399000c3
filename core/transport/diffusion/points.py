"""Exitance of transport `diffusion` at any points of the surface: on the CPU, what the shaders do at pixels.

The equation of `core.transport.diffusion.pixels` from the same volume and tables, for points that no camera needs to
see.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid, smooth_matrix, tent_matrix
from milkglass.core.transport.diffusion.pixels import WEAK, PixelTerms

LEAST_SPLIT = 1e-4  # of two eigenvalues
BORDER = 2  # nodes: as far as the weights reach over the edge


@dataclass(frozen=True, eq=False)
class PointLight:
    """One light at n points.

    Attributes
    ----------
    irradiance : (n, 3)
        E that enters here.
    cosine : (n,) or None
        Of the light to the normal, outside; None where it comes from all around.
    behind : (n, 3)
        E on the other side of a sheet, times how far the two sides are one.
    behind_cosine : (n,)
        Of the light to the normal over there.
    """

    irradiance: Array
    cosine: Array | None
    behind: Array
    behind_cosine: Array


def point_exitance(
    volume: Float32,
    mean: Float32,
    grid: LayerGrid,
    terms: PixelTerms,
    eta: float,
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    lights: Sequence[PointLight],
) -> Array:
    """M at points of the surface.

    Parameters
    ----------
    volume : (4, n_layers, height, width) float32
        Of a `core.transport.diffusion.solver.Solution`, on its boundary's `grid`.
    mean : (3, n_layers, height, width) float32
        Its `mean_fluence`.
    terms : PixelTerms
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
    own, other = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    sheet = share[:, None]
    for light in lights:
        here, there = (_inside(terms, eta, mu, len(points)) for mu in (light.cosine, _behind_cosine(light)))
        own += _entering(terms, terms.own, here, thickness) * light.irradiance
        own += sheet * _entering(terms, terms.across, there, thickness) * light.behind
        other += sheet * _entering(terms, terms.across, here, thickness) * light.irradiance
        other += (sheet > 0.0) * _entering(terms, terms.own, there, thickness) * light.behind
    around = np.asarray(tent_matrix(grid, grid.coordinates(points)).T @ mean.reshape(3, -1).T, np.float64)
    gathered = _gather4(grid, volume, points)
    coupling = sheet * _interpolated(terms.coupling[None], thickness / max(terms.reach, 1e-9), np.zeros(len(points)))
    beyond = points - thickness[:, None] * normals
    over_there = _gather4(grid, volume, beyond)
    bent, bent_there = _bending(grid, terms, points), _bending(grid, terms, beyond)
    here_own = terms.diagonal - bent * (gathered[:, 3:] + coupling[:, 3:])
    there_own = terms.diagonal - bent_there * (over_there[:, 3:] + coupling[:, 3:])
    of_there, of_here = (coupling[:, :3] + (b - 1.0) * coupling[:, 3:] for b in (bent_there, bent))
    right = gathered[:, :3] + own - (here_own + of_there) * around
    right_there = over_there[:, :3] + other - (there_own + of_here) * around
    solved = _damped(here_own, there_own, of_there, of_here, right, right_there)
    more = np.where(sheet > 0.0, solved, _weak(here_own) * right)
    return np.maximum((around + more) / terms.doubled, 0.0)


def _weak(eigenvalue: Array) -> Array:
    return np.asarray(eigenvalue**3 / (eigenvalue**4 + WEAK**4))


def _damped(a: Array, d: Array, f: Array, g: Array, right: Array, right_there: Array) -> Array:
    """First part of the solution of ((a, f), (g, d)) x = right with inverses of eigenvalues as `_weak` takes them."""
    middle, half = 0.5 * (a + d), 0.5 * (a - d)
    split = np.sqrt(np.maximum(half * half + f * g, LEAST_SPLIT**2))
    upper, lower = _weak(middle + split), _weak(middle - split)
    slope = (upper - lower) / (2.0 * split)
    return np.asarray((0.5 * (upper + lower) + slope * half) * right + slope * f * right_there)


def sheet_depths(grid: LayerGrid, terms: PixelTerms, points: Array) -> tuple[Array, Array]:
    """Thickness at points, mm, and how far it is that of a sheet, (n,) each; 0 where no part of the object is thin."""
    if terms.depths is None:
        return np.zeros(len(points)), np.zeros(len(points))
    weights = tent_matrix(grid, grid.coordinates(points))
    inverse, share = (np.asarray(weights.T @ image.ravel(), np.float64) for image in terms.depths)
    return 1.0 / np.maximum(inverse, 1.0 / terms.reach), share


def _bending(grid: LayerGrid, terms: PixelTerms, points: Array) -> Array:
    """B at points, (n, 3)."""
    if terms.bending is None:
        return np.ones((len(points), 3))
    weights = tent_matrix(grid, grid.coordinates(points))
    return 1.0 + np.asarray(weights.T @ terms.bending.reshape(3, -1).T, np.float64)


def _behind_cosine(light: PointLight) -> Array | None:
    return None if light.cosine is None else light.behind_cosine


def _inside(terms: PixelTerms, eta: float, cosine: Array | None, n: int) -> Array:
    """Cosine of the refracted ray, (n,)."""
    if cosine is None:
        return np.full(n, terms.diffuse_cosine)
    return np.asarray(np.sqrt(np.maximum(0.0, 1.0 - (1.0 - np.square(cosine)) / eta**2)))


def _entering(terms: PixelTerms, table: Float32, inside: Array, thickness: Array) -> Array:
    """Factors on irradiance, (n, 3)."""
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
    """O of R, G and B, and K_L 1: (n, 4); outside the layers their edges go on, as those of a texture do."""
    border = [(0, 0), *[(BORDER, BORDER)] * 3]
    wide = [n + 2 * BORDER for n in grid.shape]
    coordinates = np.clip(grid.coordinates(points), -1.0, np.array(grid.shape[::-1])) + BORDER
    wider = replace(grid, n_layers=wide[0], height=wide[1], width=wide[2])
    bordered = np.pad(volume, border, mode="edge").reshape(len(volume), -1)
    return np.asarray(smooth_matrix(wider, coordinates).T @ bordered.T, np.float64)
