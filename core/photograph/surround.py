"""Surround of a photographed object: its background, filled in behind it and mapped to the sphere of directions.

As in Khan et al. 2006, the photograph without the object covers the half of the sphere behind it, and its mirror
image the half that the photograph does not show.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from milkglass.core.arrays import Float32
from milkglass.core.display import luminance
from milkglass.core.light.maps import latlong_to_direction

MAP_HEIGHT = 128  # rows of the light probe: a photograph resolves no more of the surroundings


def filled(values: npt.NDArray[np.floating], weight: npt.NDArray[np.floating]) -> Float32:
    """Return values with gaps filled smoothly from their surroundings by a pyramid of weighted means ("push-pull").

    Parameters
    ----------
    values : (h, w, c)
    weight : (h, w)
        In [0, 1]: 1 keeps the value, 0 replaces it, shares between mix both.

    Returns
    -------
    (h, w, c) float32
        All 0 where nothing has weight.
    """
    weight = weight.astype(np.float32)[..., None]
    return _pulled(values.astype(np.float32) * weight, weight)


def filled_halves(values: npt.NDArray[np.floating], weight: npt.NDArray[np.floating]) -> Float32:
    """Return the level of half the size, rounded up, from which `filled` interpolates gaps: (h / 2, w / 2, c)."""
    weight = weight.astype(np.float32)[..., None]
    return _pulled(*_saturated(_halved(values.astype(np.float32) * weight), _halved(weight)))


def surround_map(radiance: npt.NDArray[np.floating], centre: tuple[float, float]) -> Float32:
    """Return a background mapped to the sphere, as a lat-long map.

    A direction (x, y, z) reads the photograph, centred at the object and stretched to its four sides, at (x, y): the
    object's centre straight behind and before it, the edges of the photograph sideways.

    Parameters
    ----------
    radiance : (h, w, 3)
        Radiance of the background, the object filled in.
    centre : (row, column)
        Centre of the object, as shares of height and width, in (0, 1).

    Returns
    -------
    (MAP_HEIGHT, 2 MAP_HEIGHT, 3) float32
        Lat-long, as `core.light.probe.Probe` takes it.
    """
    rows, columns = radiance.shape[:2]
    v, u = ((np.arange(n) + 0.5) / n for n in (MAP_HEIGHT, 2 * MAP_HEIGHT))
    direction = latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))
    x, y = direction[..., 0], -direction[..., 1]
    row, column = centre
    position = row + y * np.where(y > 0.0, 1.0 - row, row), column + x * np.where(x > 0.0, 1.0 - column, column)
    coordinates = np.stack([position[0] * rows - 0.5, position[1] * columns - 0.5])
    planes = [map_coordinates(radiance[..., i], coordinates, order=1, mode="nearest") for i in range(3)]
    return np.stack(planes, axis=-1).astype(np.float32)


def scene_radiance(display: npt.NDArray[np.floating], white: float) -> Float32:
    """Return radiance of linear RGB in [0, 1] by the inverse of `core.display.tone_map` at exposure 1.

    A photograph is assumed to be tone-mapped so; white stands for the luminance `white`, so that lamps and windows are
    brighter than paper. Results are tone-mapped by the same curve, so that they match their surroundings.
    """
    displayed = luminance(display)
    ratio = np.where(displayed > 1e-6, scene_luminance(displayed, white) / np.maximum(displayed, 1e-6), 1.0)
    return np.asarray(display * ratio[..., None], np.float32)


def scene_luminance(displayed: npt.NDArray[np.floating], white: float) -> npt.NDArray[np.floating]:
    """Return the scene luminance of displayed luminance in [0, 1], in its own dtype; see `scene_radiance`."""
    # L (1 + L / w^2) / (1 + L) = d, solved for L >= 0 without a difference that cancels.
    half = 0.5 * white**2 * (1.0 - displayed)
    return white**2 * displayed / (half + np.sqrt(half**2 + white**2 * displayed))


def _pulled(flux: Float32, weight: Float32) -> Float32:
    h, w = weight.shape[:2]
    if max(h, w) == 1:
        return np.asarray(flux / np.maximum(weight, 1e-12), np.float32)
    coarse_flux, coarse_weight = _halved(flux), _halved(weight)
    # Weights saturate: a block with one known pixel among four is known.
    coarser = _pulled(*_saturated(coarse_flux, coarse_weight))
    result = (1.0 - weight) * _doubled(coarser, (h, w))
    result += flux
    return np.asarray(result, np.float32)


def _saturated(flux: Float32, weight: Float32) -> tuple[Float32, Float32]:
    share = np.minimum(weight, 1.0)
    return (flux * (share / np.maximum(weight, 1e-12))).astype(np.float32), share.astype(np.float32)


def _halved(values: Float32) -> Float32:
    """Return sums over blocks of two by two."""
    h, w = values.shape[:2]
    if h % 2 or w % 2:
        values = np.pad(values, ((0, h % 2), (0, w % 2), (0, 0)))
    rows = values[::2] + values[1::2]  # first, along memory
    return np.asarray(rows[:, ::2] + rows[:, 1::2], np.float32)


def _doubled(values: Float32, size: tuple[int, int]) -> Float32:
    """Return values interpolated linearly to twice the size and cropped to `size`."""
    for axis in (1, 0):  # contiguous rows first
        n, shape = values.shape[axis], list(values.shape)
        shape[axis] = 2 * n
        doubled = np.empty(shape, np.float32)
        source, target = np.moveaxis(values, axis, 0), np.moveaxis(doubled, axis, 0)
        near_share, far_share = np.float32(0.75) * source, np.float32(0.25) * source
        target[0], target[-1] = source[0], source[-1]
        np.add(near_share[1:], far_share[:-1], out=target[2::2])
        np.add(near_share[:-1], far_share[1:], out=target[1:-1:2])
        values = doubled[tuple(slice(size[i]) if i == axis else slice(None) for i in range(3))]
    return values
