"""Light on a photographed object: what surrounds it, as bright and from where its own shading says.

A photograph shows half of the surroundings at most, lamps and windows cut off at white, and seldom the lamp above.
The object tells the rest: a matt surface of outline-inflated shape (`core.photo_depth.inflated`, which no luminance
went into) is brighter where it faces the light. The linear part of that is fitted, as is usual for a light's direction
(Pentland 1982, "Finding the illuminant direction"), and the surround weighted by a plane over directions so that it
shades alike; what light is missing is added all around.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.probe_maps import latlong_to_direction
from core.tonemap import luminance

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

LEAST_ALBEDO, MOST_ALBEDO = 0.15, 0.85  # that a photographed object is believed to have
STEEPEST = 4.0  # of the plane: beyond, all light comes from one half of the sphere anyway
_ROWS = 16  # of the map that the fit is made on
_NORMALS = 400
_STEPS = 12


class Shading(NamedTuple):
    """How a photographed object is lit.

    Attributes
    ----------
    level : float
        Mean luminance of what is seen of it.
    gradient : (3,) float64
        Change of luminance with the normal over the mean, fitted.
    normals : (n, 3) float64
        Some that were fitted.
    """

    level: float
    gradient: Array
    normals: Array


def measure_shading(radiance: npt.ArrayLike, height: Array, inside: npt.NDArray[np.bool_]) -> Shading:
    """Fit luminance c0 + c . n over the visible surface.

    Parameters
    ----------
    radiance : (h, w)
        Luminance of the object.
    height : (h, w) float64
        Of its surface towards the camera, in nodes, not estimated from this luminance.
    inside : (h, w) bool
        Nodes that are wholly the object.
    """
    seen = np.asarray(radiance, np.float64)[inside]
    level = float(seen.mean()) if len(seen) else 0.0
    down, right = np.gradient(height)
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)[inside]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    some = normal[:: max(1, len(normal) // _NORMALS)]
    if level <= 0.0 or len(seen) < 16:
        return Shading(level, np.zeros(3), some)
    matrix = np.concatenate([np.ones((len(normal), 1)), normal], axis=1)
    # A ridge of a hundredth: a flat object has but one normal, and no gradient.
    square = np.einsum("ni,nj->ij", matrix, matrix) / len(matrix) + np.diag([0.0, 1e-2, 1e-2, 1e-2])
    fitted = np.linalg.solve(square, np.einsum("ni,n->i", matrix, seen) / len(matrix))
    return Shading(level, fitted[1:] / level, some)


def light_around(surround: npt.NDArray[np.floating] | None, shading: Shading, size: tuple[int, int]) -> Float32:
    """Make a light probe of a surround, so that a matt object would look as the photographed one does.

    Parameters
    ----------
    surround : (h, 2h, 3), optional
        Lat-long map of the background's radiance; None or black: nothing is known of it.
    shading : Shading
    size : (h, 2h)
        Of the result where there is no surround.

    Returns
    -------
    (h, 2h, 3) float32
        Its irradiance makes the object's mean luminance with an albedo between `LEAST_ALBEDO` and `MOST_ALBEDO`.
    """
    light = np.zeros((*size, 3)) if surround is None else np.asarray(surround, np.float64)
    low, high = (np.pi * shading.level / albedo for albedo in (MOST_ALBEDO, LEAST_ALBEDO))
    if surround is None or luminance(light).max() <= 0.0:
        missing, tint = np.sqrt(low * high), np.ones(3)
    else:
        mean = light.mean(axis=(0, 1))
        missing, tint = max(0.0, low - _mean_irradiance(light, shading.normals)), mean / luminance(mean)
    light = light + missing / np.pi * tint
    light *= _plane(light, shading)[..., None]
    reached = _mean_irradiance(light, shading.normals)
    return np.asarray(light * (np.clip(reached, low, high) / max(reached, 1e-12)), np.float32)


def _plane(light: Array, shading: Shading) -> Array:
    """Weights max(0, 1 + k . d) of the directions of a map, so that its irradiance has the fitted gradient."""
    small = luminance(_reduced(light))
    cosines, directions = _transfer(small.shape, shading.normals)
    matrix = np.concatenate([np.ones((len(cosines), 1)), shading.normals], axis=1)
    square = np.einsum("ni,nj->ij", matrix, matrix) + len(matrix) * np.diag([0.0, 1e-2, 1e-2, 1e-2])
    slope = np.zeros(3)
    for _ in range(_STEPS):
        weight = np.maximum(1.0 + np.einsum("ijk,k->ij", directions, slope), 0.0)
        irradiance = np.einsum("nij,ij->n", cosines, small * weight)
        fitted = np.linalg.solve(square, np.einsum("ni,n->i", matrix, irradiance))
        # Of uniform light, a plane of slope k has a gradient of 2/3 k.
        slope += 1.5 * (shading.gradient - fitted[1:] / max(float(irradiance.mean()), 1e-12))
        slope *= min(1.0, STEEPEST / max(float(np.linalg.norm(slope)), 1e-12))
    return np.asarray(np.maximum(1.0 + np.einsum("ijk,k->ij", _directions(light.shape[:2]), slope), 0.0))


def _mean_irradiance(light: Array, normals: Array) -> float:
    small = luminance(_reduced(light))
    return float(np.einsum("nij,ij->", _transfer(small.shape, normals)[0], small) / max(len(normals), 1))


def _transfer(shape: tuple[int, ...], normals: Array) -> tuple[Array, Array]:
    """Cosine times solid angle of every texel at every normal, (n, h, w), and the directions, (h, w, 3)."""
    directions = _directions(shape)
    h, w = shape
    # Exact bands: the sum over the sphere is 4 pi.
    band = np.cos(np.pi * np.arange(h) / h) - np.cos(np.pi * (np.arange(h) + 1) / h)
    solid = (2.0 * np.pi / w) * band
    return np.maximum(np.einsum("nk,ijk->nij", normals, directions), 0.0) * solid[:, None], directions


def _directions(shape: tuple[int, ...]) -> Array:
    v, u = ((np.arange(n) + 0.5) / n for n in shape)
    return latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))


def _reduced(light: Array) -> Array:
    """Means over squares, `_ROWS` rows."""
    block = max(1, light.shape[0] // _ROWS)
    h, w = (n // block for n in light.shape[:2])
    return np.asarray(light[: h * block, : w * block].reshape(h, block, w, block, 3).mean(axis=(1, 3)))
