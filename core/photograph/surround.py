"""What surrounds a photographed object: its background filled in behind it, and taken for the light all around.

As Khan et al. 2006 do: the photograph without the object is laid over the half of the sphere behind it, and
mirrored for the half that nobody saw.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from milkglass.core.arrays import Float32
from milkglass.core.display import luminance
from milkglass.core.light.maps import latlong_to_direction

MAP_HEIGHT = 128  # rows of the light probe: a photograph of the surroundings tells no more


def filled(values: npt.NDArray[np.floating], weight: npt.NDArray[np.floating]) -> Float32:
    """Fill where there is no weight from around it, smoothly, by a pyramid of weighted means ("push-pull").

    Parameters
    ----------
    values : (h, w, c)
    weight : (h, w)
        In [0, 1]: 1 keeps the value, 0 replaces it, between is mixed.

    Returns
    -------
    (h, w, c) float32
        All 0 where nothing has weight.
    """
    weight = weight.astype(np.float32)[..., None]
    return _pulled(values.astype(np.float32) * weight, weight)


def filled_halves(values: npt.NDArray[np.floating], weight: npt.NDArray[np.floating]) -> Float32:
    """Return what `filled` doubles to fill gaps: (h, w, c) of half the size, rounded up, known pixels averaged."""
    weight = weight.astype(np.float32)[..., None]
    return _pulled(*_saturated(_halved(values.astype(np.float32) * weight), _halved(weight)))


def surround_map(radiance: npt.NDArray[np.floating], centre: tuple[float, float]) -> Float32:
    """Lay a background over the sphere.

    A direction (x, y, z) is where the photograph, centred at the object and stretched to its four sides, lies
    under (x, y): straight behind the object and straight before it is its own place, sideways the photograph's edge.

    Parameters
    ----------
    radiance : (h, w, 3)
        Of the background, the object filled in.
    centre : (row, column)
        Of the object, as shares of height and width, in (0, 1).

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
    at = row + y * np.where(y > 0.0, 1.0 - row, row), column + x * np.where(x > 0.0, 1.0 - column, column)
    places = np.stack([at[0] * rows - 0.5, at[1] * columns - 0.5])
    planes = [map_coordinates(radiance[..., i], places, order=1, mode="nearest") for i in range(3)]
    return np.stack(planes, axis=-1).astype(np.float32)


def scene_radiance(display: npt.NDArray[np.floating], white: float) -> Float32:
    """Undo the photographic tone map of `core.display.tone_map` at exposure 1: radiance, of linear RGB in [0, 1].

    A photograph is a picture that some such curve has made; white stands for the luminance `white`, so that lamps
    and windows shine brighter than paper. Results go back through the same curve, so that they match what is around.
    """
    shown = luminance(display)
    ratio = np.where(shown > 1e-6, scene_luminance(shown, white) / np.maximum(shown, 1e-6), 1.0)
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
    # Weights saturate: one known pixel among four is known.
    coarser = _pulled(*_saturated(coarse_flux, coarse_weight))
    between = (1.0 - weight) * _doubled(coarser, (h, w))
    between += flux
    return np.asarray(between, np.float32)


def _saturated(flux: Float32, weight: Float32) -> tuple[Float32, Float32]:
    share = np.minimum(weight, 1.0)
    return (flux * (share / np.maximum(weight, 1e-12))).astype(np.float32), share.astype(np.float32)


def _halved(values: Float32) -> Float32:
    """Sums of two by two."""
    h, w = values.shape[:2]
    if h % 2 or w % 2:
        values = np.pad(values, ((0, h % 2), (0, w % 2), (0, 0)))
    rows = values[::2] + values[1::2]  # first, along memory
    return np.asarray(rows[:, ::2] + rows[:, 1::2], np.float32)


def _doubled(values: Float32, size: tuple[int, int]) -> Float32:
    """Interpolate to twice the size, linearly, and cut to `size`."""
    for axis in (1, 0):  # of the larger part along memory
        n, shape = values.shape[axis], list(values.shape)
        shape[axis] = 2 * n
        doubled = np.empty(shape, np.float32)
        from_, to = np.moveaxis(values, axis, 0), np.moveaxis(doubled, axis, 0)
        near_share, far_share = np.float32(0.75) * from_, np.float32(0.25) * from_
        to[0], to[-1] = from_[0], from_[-1]
        np.add(near_share[1:], far_share[:-1], out=to[2::2])
        np.add(near_share[:-1], far_share[1:], out=to[1:-1:2])
        values = doubled[tuple(slice(size[i]) if i == axis else slice(None) for i in range(3))]
    return values
