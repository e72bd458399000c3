"""Light on a photographed object, estimated from the background and from the shading of the object.

A photograph shows half of the surroundings at most, lamps and windows clipped at white, and seldom the lamp above.
Shading supplies the rest: a matt surface of the inflated outline (`core.photograph.depth.inflated`, which does not
depend on luminance) is brighter where it faces the light. The linear part of this is fitted, as is usual for a light's
direction (Pentland 1982, "Finding the illuminant direction"), and the surround is weighted by a plane over directions
so that it has the same gradient; where a lamp fits far better, a lamp is added. Missing irradiance is added as uniform
white light.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.display import luminance
from milkglass.core.light.maps import latlong_to_direction

MIN_ALBEDO, MAX_ALBEDO = 0.15, 0.85  # range assumed for a photographed object
MAX_SLOPE = 4.0  # of the plane: beyond it all light comes from one half of the sphere
LAMP_ERROR_RATIO = 0.75  # a lamp must have less than this share of the gradient's mean square error
LAMP_RADIUS = np.radians(6.0)  # small and strong, so that core.light.sources extracts it as a lamp with a shadow
MIN_LIT = 0.25  # of the mean: darker points carry no information on depth
_DIRECTIONS = 300
_ROWS = 16  # of the map used for the fit
_MAX_NORMALS = 400
_LAMP_NORMALS = 1600  # used in the fit of a lamp: with fewer, noise decides on faint lamps
_ITERATIONS = 12


class Lamp(NamedTuple):
    """A distant lamp: unit direction towards it, (3,), and its share of the irradiance of the visible surface."""

    direction: Array
    share: float


class ShadingFit(NamedTuple):
    """Fit of the luminance of a photographed object to its normals.

    Attributes
    ----------
    level : float
        Mean luminance of the visible surface.
    gradient : (3,) float64
        Fitted change of luminance with the normal, over the mean.
    normals : (n, 3) float64
        A sample of the fitted normals, unit.
    lamp : Lamp, optional
        A lamp, where one with uniform light fits the shading far better than a gradient does.
    """

    level: float
    gradient: Array
    normals: Array
    lamp: Lamp | None = None


def fit_shading(radiance: npt.ArrayLike, height: Array, inside: npt.NDArray[np.bool_]) -> ShadingFit:
    """Return the fit of luminance c0 + c . n, and of a + b max(0, n . l), over the visible surface.

    Parameters
    ----------
    radiance : (h, w)
        Luminance of the object.
    height : (h, w) float64
        Height of its surface towards the camera, in nodes, not estimated from this luminance.
    inside : (h, w) bool
        Nodes that the object covers entirely.
    """
    luminance = np.asarray(radiance, np.float64)[inside]
    level = float(luminance.mean()) if len(luminance) else 0.0
    normal = _normals(height)[inside]
    stride = max(1, len(normal) // _MAX_NORMALS)
    sparse = normal[::stride]
    if level <= 0.0 or len(luminance) < 16:
        return ShadingFit(level, np.zeros(3), sparse)
    fitted = np.linalg.solve(_square(normal), np.einsum("ni,n->i", _affine(normal), luminance) / len(normal))
    stride = max(1, len(normal) // _LAMP_NORMALS)
    normal, luminance = normal[::stride], luminance[::stride]  # both errors over the same normals
    squared_error = float(np.square(luminance - np.einsum("ni,i->n", _affine(normal), fitted)).mean())
    return ShadingFit(level, fitted[1:] / level, sparse, _fit_lamp(normal, luminance, LAMP_ERROR_RATIO * squared_error))


def shading_residual(radiance: Array, height: Array, inside: npt.NDArray[np.bool_], shading: ShadingFit) -> Array:
    """Return luminance over its mean less that of a matt surface under the fitted gradient, (h, w); 0 outside."""
    normal, mean = _normals(height), float(radiance[inside].mean())
    expected = 1.0 + np.einsum("ijk,k->ij", normal - normal[inside].mean(axis=0), shading.gradient)
    return np.asarray(np.where(inside, radiance / max(mean, 1e-12) - expected, 0.0))


def without_lamp(radiance: Array, height: Array, inside: npt.NDArray[np.bool_], shading: ShadingFit) -> Array:
    """Return luminance (h, w) divided by the shading of the fitted lamp: dark is deep then, not turned away."""
    if shading.lamp is None:
        return radiance
    lit = np.maximum(np.einsum("ijk,k->ij", _normals(height), shading.lamp.direction), 0.0)
    share = shading.lamp.share / max(float(lit[inside].mean()), 1e-3)
    return np.asarray(radiance / np.maximum(1.0 - shading.lamp.share + share * lit, MIN_LIT))


def fit_surround(surround: npt.NDArray[np.floating] | None, shading: ShadingFit, size: tuple[int, int]) -> Float32:
    """Return a lat-long map, fitted to a surround so that a matt object is shaded as the photographed one.

    Parameters
    ----------
    surround : (h, 2h, 3), optional
        Lat-long map of the background's radiance; None or black where it is not known.
    shading : ShadingFit
    size : (h, 2h)
        Size of the result where there is no surround.

    Returns
    -------
    (h, 2h, 3) float32
        Under it the object has its mean luminance with an albedo between `MIN_ALBEDO` and `MAX_ALBEDO`.
    """
    light = np.zeros((*size, 3)) if surround is None else np.asarray(surround, np.float64)
    low, high = (np.pi * shading.level / albedo for albedo in (MAX_ALBEDO, MIN_ALBEDO))
    irradiance = _mean_irradiance(light, shading.normals)
    # White, as the white balance assumes: the surroundings are coloured by reflecting it.
    light = light + (np.sqrt(low * high) if irradiance <= 0.0 else max(0.0, low - irradiance)) / np.pi
    # From other directions, but of the same irradiance.
    target = np.clip(_mean_irradiance(light, shading.normals), low, high)
    if shading.lamp is None:
        light *= _plane(light, shading)[..., None]
        return np.asarray(light * (target / max(_mean_irradiance(light, shading.normals), 1e-12)), np.float32)
    lamp = _disc(light.shape[:2], shading.lamp.direction)[..., None]
    light *= (1.0 - shading.lamp.share) * target / max(_mean_irradiance(light, shading.normals), 1e-12)
    cosine = float(np.maximum(np.einsum("nk,k->n", shading.normals, shading.lamp.direction), 0.0).mean())
    return np.asarray(light + shading.lamp.share * target / max(cosine, 1e-3) * lamp, np.float32)


def _fit_lamp(normals: Array, observed: Array, largest: float) -> Lamp | None:
    """Return the lamp of the fit a + b max(0, n . l), a, b >= 0; None unless its mean squared error is < `largest`."""
    directions, best, width = _spread(_DIRECTIONS), None, np.pi
    for _ in range(3):
        lit = np.maximum(np.einsum("nk,lk->nl", normals, directions), 0.0)
        mean, level = lit.mean(axis=0), float(observed.mean())
        variance = np.maximum(lit.var(axis=0), 1e-9)
        b = np.maximum(((lit - mean) * (observed - level)[:, None]).mean(axis=0) / variance, 0.0)
        a = level - b * mean
        scale = np.einsum("nl,n->l", lit, observed) / np.maximum(np.square(lit).sum(axis=0), 1e-9)
        a, b = np.where(a < 0.0, 0.0, a), np.where(a < 0.0, np.maximum(scale, 0.0), b)
        error = np.square(a + b * lit - observed[:, None]).mean(axis=0)
        i = int(error.argmin())
        best = (float(error[i]), directions[i], float(b[i] * mean[i] / max(a[i] + b[i] * mean[i], 1e-12)))
        # Refine around the best direction.
        width /= 6.0
        directions = best[1] + width * _spread(_DIRECTIONS)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    squared_error, direction, share = best if best is not None else (np.inf, np.zeros(3), 0.0)
    return Lamp(direction, share) if squared_error < largest else None


def _spread(n: int) -> Array:
    """Return unit directions (n, 3) evenly over the sphere, along a spiral."""
    place = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * place / n, np.pi * (1.0 + 5.0**0.5) * place
    horizontal = np.sqrt(1.0 - z**2)
    return np.stack([horizontal * np.cos(turn), horizontal * np.sin(turn), z], axis=-1)


def _disc(shape: tuple[int, ...], direction: Array) -> Array:
    """Return the radiance (h, w) of a lamp of irradiance 1 at normal incidence: a disc with a soft edge."""
    inside = np.clip((np.einsum("ijk,k->ij", _directions(shape), direction) - np.cos(LAMP_RADIUS)) * 1e3, 0.0, 1.0)
    return np.asarray(inside / max(float((inside * _solid(shape)[:, None]).sum()), 1e-12))


def _normals(height: Array) -> Array:
    """Return unit normals (h, w, 3) of heights (h, w)."""
    down, right = np.gradient(height)
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _affine(normals: Array) -> Array:
    return np.concatenate([np.ones((len(normals), 1)), normals], axis=1)


def _square(normals: Array) -> Array:
    """Return the normal equations of the linear fit, with a ridge of 0.01: a flat object has one normal only."""
    matrix = _affine(normals)
    return np.asarray(np.einsum("ni,nj->ij", matrix, matrix) / len(matrix) + np.diag([0.0, 1e-2, 1e-2, 1e-2]))


def _plane(light: Array, shading: ShadingFit) -> Array:
    """Return weights max(0, 1 + k . d) of the directions of a map under which irradiance has the fitted gradient."""
    small = luminance(_reduced(light))
    cosines, directions = _transfer(small.shape, shading.normals)
    matrix, square = _affine(shading.normals), _square(shading.normals) * len(shading.normals)
    slope = np.zeros(3)
    for _ in range(_ITERATIONS):
        weight = np.maximum(1.0 + np.einsum("ijk,k->ij", directions, slope), 0.0)
        irradiance = np.einsum("nij,ij->n", cosines, small * weight)
        fitted = np.linalg.solve(square, np.einsum("ni,n->i", matrix, irradiance))
        # A plane of slope k over uniform light gives a gradient of 2/3 k.
        slope += 1.5 * (shading.gradient - fitted[1:] / max(float(irradiance.mean()), 1e-12))
        slope *= min(1.0, MAX_SLOPE / max(float(np.linalg.norm(slope)), 1e-12))
    return np.asarray(np.maximum(1.0 + np.einsum("ijk,k->ij", _directions(light.shape[:2]), slope), 0.0))


def _mean_irradiance(light: Array, normals: Array) -> float:
    small = luminance(_reduced(light))
    return float(np.einsum("nij,ij->", _transfer(small.shape, normals)[0], small) / max(len(normals), 1))


def _transfer(shape: tuple[int, ...], normals: Array) -> tuple[Array, Array]:
    """Return cosine times solid angle of every texel at every normal, (n, h, w), and the directions, (h, w, 3)."""
    directions = _directions(shape)
    return np.maximum(np.einsum("nk,ijk->nij", normals, directions), 0.0) * _solid(shape)[:, None], directions


def _solid(shape: tuple[int, ...]) -> Array:
    """Return the solid angle of a texel of each row, (h,); all texels sum to 4 pi."""
    edges = np.cos(np.pi * np.arange(shape[0] + 1) / shape[0])
    return np.asarray(2.0 * np.pi / shape[1] * (edges[:-1] - edges[1:]))


def _directions(shape: tuple[int, ...]) -> Array:
    v, u = ((np.arange(n) + 0.5) / n for n in shape)
    return latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))


def _reduced(light: Array) -> Array:
    """Return means over square blocks, `_ROWS` rows of them."""
    block = max(1, light.shape[0] // _ROWS)
    h, w = (n // block for n in light.shape[:2])
    return np.asarray(light[: h * block, : w * block].reshape(h, block, w, block, 3).mean(axis=(1, 3)))
