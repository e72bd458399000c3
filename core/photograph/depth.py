"""Depth of an object from one photograph: its inflated outline, reshaped by luminance.

After Khan, Reinhard, Fleming and Buelthoff, "Image-based material editing" (SIGGRAPH 2006): luminance is mapped by the
sigmoid of photoreceptors, filtered bilaterally and mapped back, and dark is deep. They bend the height down at the
silhouette; here the outline is inflated, which is exact for a ball: h = sqrt(u), -lap u = 4.

Finer relief comes from shading. In light from a side, which the shading of the inflated outline reveals
(`core.photograph.light`), luminance gives slopes along that direction, and these give heights in Fourier space
(Pentland 1990, "Linear shape from shading"). In frontal or uniform light dark is deep again, scale by scale, with a
height in proportion to its size.

Arrays are (h, w), row 0 at the top; lengths are in distances of two nodes.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates, zoom

from milkglass.core.arrays import Array, Bools

# Chosen by 2,162 photogrammetry points of the Buddha's head, by rendered pictures, and by eye: see viewer/README.md.
RESHAPING = 0.2  # share of the height that follows luminance: 0 leaves the inflated outline
SMOOTHING = 0.3  # scale of the filter of that luminance, in inscribed radii
SIGMOID_RANGE = 0.1  # of the bilateral filter, in units of the sigmoid: larger steps are preserved as edges
EDGE_WIDTH = 0.15  # of an edge, over the scale of the filter
RELIEF_SLOPE = 0.7  # slope of the relief for a change of luminance by a factor e, in light that reveals no slopes
FINE_SCALE = 0.4  # of the filter's scale: the coarsest of that relief
SLANT_GRADIENT = 0.3  # sideways gradient of luminance over the mean, from which on light reveals slopes
CREASE_SHARE = 0.3  # of the relief that remains there: hollows are darker in any light
SLOPE_GAIN = 2.5  # on slopes: subsurface scattering and the inflated outline's normals both lower the gradient
ACROSS_SHARE = 0.1  # weight of slopes across the light, which it does not reveal, over those along it: they stay flat
RELIEF_RIM, SLOPE_RIM = 0.2, 0.07  # of the inscribed radius, over which relief, and slopes, fade in from the outline
MAX_LUMINANCE = 2.5  # clamp, times the mean luminance: a highlight is no hill
_COARSEST_NODES = 24  # nodes along a side of the coarsest grid
_SWEEPS_A_LEVEL = 14  # of relaxation


def estimate_height(
    luminance: npt.ArrayLike,
    inside: Bools,
    base: Array,
    *,
    residual: Array | None = None,
    gradient: npt.ArrayLike = (0.0, 0.0, 0.0),
    smoothing: float = SMOOTHING,
    strength: float = 1.0,
) -> Array:
    """Return the estimated height of an object towards the camera.

    Parameters
    ----------
    luminance : (h, w)
        Linear, >= 0; only values inside are used.
    inside : (h, w) bool
        Nodes of the object.
    base : (h, w) float64
        The outline inflated, see `inflated`.
    residual : (h, w), optional
        Luminance less that of `base` under the fitted light, over the mean; None where the light is not known.
    gradient : (3,)
        Change of luminance with the normal, over the mean.
    smoothing : float
        Scale of the bilateral filter over the radius of the largest inscribed circle, > 0.
    strength : float
        Largest height over that radius, > 0; 1 makes a disc a hemisphere.

    Returns
    -------
    (h, w) float64
        0 outside and at the outline.
    """
    radius = inscribed_radius(inside)
    weight = inside.astype(np.float64)
    luminance_inside = np.where(inside, luminance, 0.0)
    mean = luminance_inside[inside].mean()
    if mean <= 0.0:
        return base * strength
    sigmoid = luminance_inside / (luminance_inside + mean)  # Naka and Rushton 1966, Khan's "compressive" response
    sigma = max(smoothing * radius, 1.0)
    # Edges stay in place but get a width: the edge of a highlight would be a cliff.
    shape = _smooth(_expanded(bilateral(sigmoid, weight, sigma, SIGMOID_RANGE)), weight, EDGE_WIDTH * sigma)
    height = base * (1.0 + RESHAPING * (shape - shape[inside].mean()))
    fine = _expanded(bilateral(sigmoid, weight, 1.0, SIGMOID_RANGE))
    tilt = np.asarray(gradient, np.float64)[:2]
    slanted = 0.0 if residual is None else float(tilt @ tilt / (tilt @ tilt + SLANT_GRADIENT**2))
    relief = _relief(fine, weight, FINE_SCALE * sigma) * _fade(inside, RELIEF_RIM * radius)
    height += (1.0 - (1.0 - CREASE_SHARE) * slanted) * relief
    if residual is not None and slanted > 0.0:
        slopes = _slopes_integrated(residual, weight, tilt, sigma)
        height += SLOPE_GAIN * slanted * slopes * _fade(inside, SLOPE_RIM * radius)
    height = np.where(inside, np.maximum(height, 0.0), 0.0)
    return np.asarray(height * (strength * radius / max(float(height.max()), 1e-9)))


def inscribed_radius(inside: Bools) -> float:
    """Return the radius of the largest inscribed circle."""
    return float(distance_transform_edt(np.pad(inside, 1)).max())


def inflated(inside: Bools) -> Array:
    """Return an inflated outline: sqrt(u), -lap u = 4 inside and u = 0 outside, scaled to the inscribed radius.

    A disc becomes a hemisphere, an ellipse half an ellipsoid.
    """
    outside = ~np.pad(inside, 1)
    height = np.sqrt(np.maximum(_relaxed(outside, np.zeros(outside.shape), 4.0)[1:-1, 1:-1], 0.0))
    top = float(height.max())
    return height * (inscribed_radius(inside) / top) if top > 0.0 else height


def harmonic(values: Array, is_fixed: Bools) -> Array:
    """Return values with those that are not fixed replaced by the harmonic interpolant: lap u = 0."""
    fixed_values = np.where(is_fixed, values, 0.0)
    return _relaxed(is_fixed, fixed_values, 0.0) if fixed_values.any() else fixed_values


def bilateral(values: Array, weight: Array, sigma: float, sigma_range: float) -> Array:
    """Return values filtered bilaterally on a grid of space and value (Chen, Paris and Durand 2007).

    Parameters
    ----------
    values : (h, w)
    weight : (h, w)
        Weight of each value, >= 0; values without any weight nearby are returned unchanged.
    sigma : float
        Standard deviation in space, in nodes, >= 1.
    sigma_range : float
        Standard deviation in value, > 0.

    Returns
    -------
    (h, w) float64
    """
    (h, w), low = values.shape, float(values.min())
    y, x = np.mgrid[:h, :w]
    at = np.stack([y / sigma, x / sigma, (values - low) / sigma_range]) + 2.0
    size = tuple(int(axis.max()) + 4 for axis in at)
    cell = np.ravel_multi_index(tuple(np.rint(at).astype(np.intp)), size).ravel()
    total, flux = (
        gaussian_filter(
            np.bincount(cell, (weight * summand).ravel(), np.prod(size)).reshape(size), 1.0, mode="constant"
        )
        for summand in (np.ones_like(values), values)
    )
    total, flux = (map_coordinates(grid, at, order=1, mode="nearest") for grid in (total, flux))
    return np.asarray(np.where(total > 1e-9, flux / np.maximum(total, 1e-9), values))


def _expanded(sigmoid: Array) -> Array:
    """Return luminance over its mean from the sigmoid of it."""
    return np.asarray(np.minimum(sigmoid / np.maximum(1.0 - sigmoid, 1e-6), MAX_LUMINANCE))


def _relief(luminance: Array, weight: Array, sigma: float) -> Array:
    """Return relief finer than sigma: octave bands of log luminance, each with a height in proportion to its scale."""
    logs = np.log(luminance + 0.05)
    relief, scale = np.zeros_like(logs), 1.0
    finer = _smooth(logs, weight, 0.7 * scale)
    while scale < sigma:
        coarser = _smooth(logs, weight, 1.4 * scale)
        relief += RELIEF_SLOPE * scale * (finer - coarser)
        finer, scale = coarser, 2.0 * scale
    return relief


def _slopes_integrated(residual: Array, weight: Array, tilt: Array, sigma: float) -> Array:
    """Return relief finer than sigma that shades a surface by the residual of its luminance.

    Along the light, l = tilt / |tilt|, dh/dl = -residual / |tilt|; least squares with small slopes across
    it: H = i (k . l) S / ((k . l)^2 + ACROSS_SHARE k^2), S the transform of residual / |tilt|.
    """
    size = float(np.hypot(*tilt))
    change = weight * (_smooth(residual, weight, 0.7) - _smooth(residual, weight, sigma)) / size
    margin = int(np.ceil(sigma))  # what leaves on one side must not come in on the other
    change = np.pad(change, margin)
    rows, columns = (2.0 * np.pi * np.fft.fftfreq(n) for n in change.shape)
    along = (columns * tilt[0] - rows[:, None] * tilt[1]) / size
    square = rows[:, None] ** 2 + columns**2
    transform = 1j * along * np.fft.fft2(change) / np.maximum(along**2 + ACROSS_SHARE * square, 1e-12)
    return np.asarray(np.fft.ifft2(transform).real[margin:-margin, margin:-margin])


def _smooth(values: Array, weight: Array, sigma: float) -> Array:
    """Return the weighted Gaussian mean of values."""
    total = gaussian_filter(weight, sigma)
    return np.asarray(gaussian_filter(values * weight, sigma) / np.maximum(total, 1e-9))


def _fade(inside: Bools, width: float) -> Array:
    """Return a ramp from 0 at the outline to 1 at `width` inside."""
    depth = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] / max(width, 1.0)
    return np.asarray(np.minimum(depth, 1.0))


def _relaxed(fixed: Bools, values: Array, source: float) -> Array:
    """Return the solution of -lap u = source where u is not fixed, on nested grids, each started from the coarser one.

    The border is fixed. Iteration stops far above rounding, at errors far below those of the estimate.
    """
    h, w = fixed.shape
    if min(h, w) > _COARSEST_NODES:
        # A coarse node is fixed where two of its four nodes are, to the mean of the fixed ones.
        to_even = ((0, h % 2), (0, w % 2))
        fixed_values, weight = (
            _block_sums(np.pad(summand, to_even))
            for summand in (np.where(fixed, values, 0.0), fixed.astype(np.float64))
        )
        coarse = _relaxed(weight >= 2.0, fixed_values / np.maximum(weight, 1.0), 4.0 * source)
        solution = np.where(fixed, values, zoom(coarse, 2, order=1, grid_mode=True, mode="nearest")[:h, :w])
        sweeps, overrelaxation = _SWEEPS_A_LEVEL, 1.0
    else:
        solution, sweeps, overrelaxation = np.where(fixed, values, 0.0), 200, 1.7
    inner = solution[1:-1, 1:-1]
    red = np.add.outer(np.arange(1, h - 1), np.arange(1, w - 1)) % 2 == 0
    free = ~fixed[1:-1, 1:-1]
    for _ in range(sweeps):
        for colour in (red & free, ~red & free):
            mean = solution[:-2, 1:-1] + solution[2:, 1:-1] + solution[1:-1, :-2] + solution[1:-1, 2:]
            # For all nodes: indexing half of them takes longer than to compute both halves.
            np.copyto(inner, inner + overrelaxation * (0.25 * (mean + source) - inner), where=colour)
    return solution


def _block_sums(values: Array) -> Array:
    """Return sums over blocks of two by two."""
    return np.asarray(values[::2, ::2] + values[1::2, ::2] + values[::2, 1::2] + values[1::2, 1::2])
