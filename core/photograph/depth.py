"""Depth of an object from one photograph: its outline inflated, and reshaped by what is bright and what is dark.

After Khan, Reinhard, Fleming and Buelthoff, "Image-based material editing" (SIGGRAPH 2006): luminance goes through the
sigmoid of photoreceptors, a bilateral filter and the sigmoid's inverse, and dark is deep. Where they bend the height
down at the silhouette, the outline is inflated here, so that both are right for a ball: h = sqrt(u), -lap u = 4.

Finer relief is what shading shows. Light from a side, which the outline's shape tells (`core.photograph.light`), makes
bright what is turned towards it: slopes along it follow, and heights from those in Fourier space (Pentland 1990,
"Linear shape from shading"). In light from the front or from all around dark is deep again, scale by scale, its
height in proportion to its size.

Arrays are (h, w), row 0 at the top; lengths in the distance of two nodes.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates, zoom

from milkglass.core.arrays import Array

Bools = npt.NDArray[np.bool_]

# Chosen by the 2,162 photogrammetry points of the Buddha's head, by our own pictures, and by eye: see viewer/README.md.
RESHAPING = 0.2  # share of the height that follows the luminance: 0 leaves the inflated outline
SMOOTHING = 0.3  # scale of the luminance that reshapes, in inscribed radii
RANGE = 0.1  # of the bilateral filter, in units of the sigmoid: larger steps are edges, and stay
EDGE = 0.15  # of the filter's scale that an edge is wide
RELIEF = 0.7  # slope of the relief for a change of luminance by a factor e, in light that shows no slopes
FINE_SCALE = 0.4  # of the filter's scale, up to which that relief goes
SLANTED = 0.3  # gradient of luminance over the mean, sideways, from which on it is the light that shows slopes
CREASES = 0.3  # of the relief that stays there: what is hollow is darker in any light
GAIN = 2.5  # on slopes: light that scatters inside evens shading out, and the outline's normals even out its gradient
ACROSS = 0.1  # of slopes across the light, which it does not show, for those along it: they stay flat
RIM, SLOPING_RIM = 0.2, 0.07  # of the inscribed radius, over which relief, and slopes, fade in from the outline
MAX_LUMINANCE = 2.5  # times the mean luminance that counts at most: a highlight is no hill
_COARSEST = 24  # nodes a side where the solution starts
_SWEEPS = 14  # of relaxation a level


def estimate_height(
    luminance: npt.ArrayLike,
    inside: Bools,
    base: Array,
    *,
    unexplained: Array | None = None,
    gradient: npt.ArrayLike = (0.0, 0.0, 0.0),
    smoothing: float = SMOOTHING,
    strength: float = 1.0,
) -> Array:
    """Estimate the height of an object towards the camera.

    Parameters
    ----------
    luminance : (h, w)
        Linear, >= 0; only what is inside counts.
    inside : (h, w) bool
    base : (h, w) float64
        The outline inflated, see `inflated`.
    unexplained : (h, w), optional
        What the luminance has more than `base` would in the light that there is, over the mean; None where that is
        not to be told.
    gradient : (3,)
        Change of luminance with the normal over the mean.
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
    light = np.where(inside, luminance, 0.0)
    mean = light[inside].mean()
    if mean <= 0.0:
        return base * strength
    sigmoid = light / (light + mean)  # Naka and Rushton 1966, Khan's "compressive" response
    sigma = max(smoothing * radius, 1.0)
    # Edges stay in place, but no cliffs: a highlight's edge would be one.
    shape = _smooth(_expanded(bilateral(sigmoid, weight, sigma, RANGE)), weight, EDGE * sigma)
    height = base * (1.0 + RESHAPING * (shape - shape[inside].mean()))
    fine = _expanded(bilateral(sigmoid, weight, 1.0, RANGE))
    tilt = np.asarray(gradient, np.float64)[:2]
    slanted = 0.0 if unexplained is None else float(tilt @ tilt / (tilt @ tilt + SLANTED**2))
    relief = _relief(fine, weight, FINE_SCALE * sigma) * _fade(inside, RIM * radius)
    height += (1.0 - (1.0 - CREASES) * slanted) * relief
    if unexplained is not None and slanted > 0.0:
        slopes = _slopes_integrated(unexplained, weight, tilt, sigma)
        height += GAIN * slanted * slopes * _fade(inside, SLOPING_RIM * radius)
    height = np.where(inside, np.maximum(height, 0.0), 0.0)
    return np.asarray(height * (strength * radius / max(float(height.max()), 1e-9)))


def inscribed_radius(inside: Bools) -> float:
    """Radius of the largest circle inside."""
    return float(distance_transform_edt(np.pad(inside, 1)).max())


def inflated(inside: Bools) -> Array:
    """Inflate an outline: the root of the solution of -lap u = 4 that is 0 outside, as high as the inscribed radius.

    A disc becomes a hemisphere, an ellipse half an ellipsoid.
    """
    outside = ~np.pad(inside, 1)
    height = np.sqrt(np.maximum(_relaxed(outside, np.zeros(outside.shape), 4.0)[1:-1, 1:-1], 0.0))
    top = float(height.max())
    return height * (inscribed_radius(inside) / top) if top > 0.0 else height


def harmonic(values: Array, known: Bools) -> Array:
    """Extend values to where they are not known, smoothly: the solution of lap u = 0."""
    held = np.where(known, values, 0.0)
    return _relaxed(known, held, 0.0) if held.any() else held


def bilateral(values: Array, weight: Array, sigma: float, sigma_range: float) -> Array:
    """Bilateral filter on a grid of space and value (Chen, Paris and Durand 2007).

    Parameters
    ----------
    values : (h, w)
    weight : (h, w)
        How much each counts, >= 0; results where there is no weight nearby are those of the nearest that has some.
    sigma : float
        In nodes, >= 1.
    sigma_range : float
        In the unit of the values, > 0.

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
        gaussian_filter(np.bincount(cell, (weight * part).ravel(), np.prod(size)).reshape(size), 1.0, mode="constant")
        for part in (np.ones_like(values), values)
    )
    total, flux = (map_coordinates(grid, at, order=1, mode="nearest") for grid in (total, flux))
    return np.asarray(np.where(total > 1e-9, flux / np.maximum(total, 1e-9), values))


def _expanded(sigmoid: Array) -> Array:
    """Invert the sigmoid: luminance over its mean."""
    return np.asarray(np.minimum(sigmoid / np.maximum(1.0 - sigmoid, 1e-6), MAX_LUMINANCE))


def _relief(light: Array, weight: Array, sigma: float) -> Array:
    """Height of what is finer than sigma: bands of the logarithm, each as high as it is wide."""
    logs = np.log(light + 0.05)
    relief, scale = np.zeros_like(logs), 1.0
    finer = _smooth(logs, weight, 0.7 * scale)
    while scale < sigma:
        coarser = _smooth(logs, weight, 1.4 * scale)
        relief += RELIEF * scale * (finer - coarser)
        finer, scale = coarser, 2.0 * scale
    return relief


def _slopes_integrated(light: Array, weight: Array, tilt: Array, sigma: float) -> Array:
    """Height of what is finer than sigma, added to a surface that explains all but `light` of what is seen.

    Along the light, l = tilt / |tilt|, dh/dl = -light / |tilt|; least squares with small slopes across
    it: H = i (k . l) S / ((k . l)^2 + ACROSS k^2), S the transform of the right side's negative.
    """
    size = float(np.hypot(*tilt))
    change = weight * (_smooth(light, weight, 0.7) - _smooth(light, weight, sigma)) / size
    margin = int(np.ceil(sigma))  # what leaves on one side must not come in on the other
    change = np.pad(change, margin)
    rows, columns = (2.0 * np.pi * np.fft.fftfreq(n) for n in change.shape)
    along = (columns * tilt[0] - rows[:, None] * tilt[1]) / size
    square = rows[:, None] ** 2 + columns**2
    transform = 1j * along * np.fft.fft2(change) / np.maximum(along**2 + ACROSS * square, 1e-12)
    return np.asarray(np.fft.ifft2(transform).real[margin:-margin, margin:-margin])


def _smooth(values: Array, weight: Array, sigma: float) -> Array:
    """Gaussian mean of what has weight."""
    total = gaussian_filter(weight, sigma)
    return np.asarray(gaussian_filter(values * weight, sigma) / np.maximum(total, 1e-9))


def _fade(inside: Bools, width: float) -> Array:
    """0 at the outline, 1 from `width` inwards."""
    depth = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] / max(width, 1.0)
    return np.asarray(np.minimum(depth, 1.0))


def _relaxed(fixed: Bools, values: Array, source: float) -> Array:
    """Solve -lap u = source where u is not fixed: nested grids, each relaxed from the solution of the coarser one.

    The border is fixed. Not converged to rounding: what is left is far below what an estimate is worth.
    """
    h, w = fixed.shape
    if min(h, w) > _COARSEST:
        # A coarse node is fixed where two of its four are, to the mean of those.
        even = ((0, h % 2), (0, w % 2))
        held, weight = (_fours(np.pad(part, even)) for part in (np.where(fixed, values, 0.0), fixed.astype(np.float64)))
        coarse = _relaxed(weight >= 2.0, held / np.maximum(weight, 1.0), 4.0 * source)
        solution = np.where(fixed, values, zoom(coarse, 2, order=1, grid_mode=True, mode="nearest")[:h, :w])
        sweeps, over = _SWEEPS, 1.0
    else:
        solution, sweeps, over = np.where(fixed, values, 0.0), 200, 1.7
    inner = solution[1:-1, 1:-1]
    red = np.add.outer(np.arange(1, h - 1), np.arange(1, w - 1)) % 2 == 0
    free = ~fixed[1:-1, 1:-1]
    for _ in range(sweeps):
        for colour in (red & free, ~red & free):
            mean = solution[:-2, 1:-1] + solution[2:, 1:-1] + solution[1:-1, :-2] + solution[1:-1, 2:]
            # All of them: to pick half takes longer than to compute both.
            np.copyto(inner, inner + over * (0.25 * (mean + source) - inner), where=colour)
    return solution


def _fours(values: Array) -> Array:
    """Sums of two by two."""
    return np.asarray(values[::2, ::2] + values[1::2, ::2] + values[::2, 1::2] + values[1::2, 1::2])
