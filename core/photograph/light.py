"""Light on a photographed object: what surrounds it, as bright and from where its own shading says.

A photograph shows half of the surroundings at most, lamps and windows cut off at white, and seldom the lamp above.
The object tells the rest: a matt surface of outline-inflated shape (`core.photograph.depth.inflated`, which no
luminance went into) is brighter where it faces the light. The linear part of that is fitted, as is usual for a light's
direction (Pentland 1982, "Finding the illuminant direction"), and the surround weighted by a plane over directions so
that it shades alike; or where a lamp explains the shading far better, there is a lamp. What light is missing is added
all around, white.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.display import luminance
from milkglass.core.light.maps import latlong_to_direction

LEAST_ALBEDO, MOST_ALBEDO = 0.15, 0.85  # that a photographed object is believed to have
STEEPEST = 4.0  # of the plane: beyond, all light comes from one half of the sphere anyway
LAMP_GAIN = 0.75  # of the gradient's mean square: a lamp that leaves no less is not believed
LAMP_RADIUS = np.radians(6.0)  # small and strong, so that it shines as a lamp with a shadow, see core.light.sources
LEAST_LIT = 0.25  # of the mean: what a lamp hardly lights says nothing of depth
_DIRECTIONS = 300
_ROWS = 16  # of the map that the fit is made on
_NORMALS = 400
_FITTED = 1600  # of the normals, to a lamp: with fewer, chance decides on faint ones
_STEPS = 12


class Lamp(NamedTuple):
    """A distant lamp: unit direction towards it, (3,), and its share of the light on what is seen."""

    direction: Array
    share: float


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
    lamp : Lamp, optional
        Where one, with the same light from everywhere, explains the shading far better than a gradient does.
    """

    level: float
    gradient: Array
    normals: Array
    lamp: Lamp | None = None


def measure_shading(radiance: npt.ArrayLike, height: Array, inside: npt.NDArray[np.bool_]) -> Shading:
    """Fit luminance c0 + c . n, and a + b max(0, n . l), over the visible surface.

    Parameters
    ----------
    radiance : (h, w)
        Luminance of the object.
    height : (h, w) float64
        Of its surface towards the camera, in nodes, not estimated from this luminance.
    inside : (h, w) bool
        Nodes that are wholly the object.
    """
    luminance = np.asarray(radiance, np.float64)[inside]
    level = float(luminance.mean()) if len(luminance) else 0.0
    normal = _normals(height)[inside]
    stride = max(1, len(normal) // _NORMALS)
    sparse = normal[::stride]
    if level <= 0.0 or len(luminance) < 16:
        return Shading(level, np.zeros(3), sparse)
    fitted = np.linalg.solve(_square(normal), np.einsum("ni,n->i", _with_one(normal), luminance) / len(normal))
    stride = max(1, len(normal) // _FITTED)
    normal, luminance = normal[::stride], luminance[::stride]  # both fits judged by the same
    missed = float(np.square(luminance - np.einsum("ni,i->n", _with_one(normal), fitted)).mean())
    return Shading(level, fitted[1:] / level, sparse, _fit_lamp(normal, luminance, LAMP_GAIN * missed))


def unexplained(radiance: Array, height: Array, inside: npt.NDArray[np.bool_], shading: Shading) -> Array:
    """Luminance (h, w) over its mean, less what a matt surface has in light of the fitted gradient; 0 beside it."""
    normal, mean = _normals(height), float(radiance[inside].mean())
    expected = 1.0 + np.einsum("ijk,k->ij", normal - normal[inside].mean(axis=0), shading.gradient)
    return np.asarray(np.where(inside, radiance / max(mean, 1e-12) - expected, 0.0))


def without_lamp(radiance: Array, height: Array, inside: npt.NDArray[np.bool_], shading: Shading) -> Array:
    """Take a lamp's shading of a surface off its luminance (h, w): what is left dark is deep, not turned away."""
    if shading.lamp is None:
        return radiance
    lit = np.maximum(np.einsum("ijk,k->ij", _normals(height), shading.lamp.direction), 0.0)
    share = shading.lamp.share / max(float(lit[inside].mean()), 1e-3)
    return np.asarray(radiance / np.maximum(1.0 - shading.lamp.share + share * lit, LEAST_LIT))


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
    current = _mean_irradiance(light, shading.normals)
    # White, as the photographer's balance has it: what is around has its colour from reflecting that.
    light = light + (np.sqrt(low * high) if current <= 0.0 else max(0.0, low - current)) / np.pi
    # From elsewhere, but no more of it.
    target = np.clip(_mean_irradiance(light, shading.normals), low, high)
    if shading.lamp is None:
        light *= _plane(light, shading)[..., None]
        return np.asarray(light * (target / max(_mean_irradiance(light, shading.normals), 1e-12)), np.float32)
    lamp = _disc(light.shape[:2], shading.lamp.direction)[..., None]
    light *= (1.0 - shading.lamp.share) * target / max(_mean_irradiance(light, shading.normals), 1e-12)
    cosine = float(np.maximum(np.einsum("nk,k->n", shading.normals, shading.lamp.direction), 0.0).mean())
    return np.asarray(light + shading.lamp.share * target / max(cosine, 1e-3) * lamp, np.float32)


def _fit_lamp(normals: Array, observed: Array, largest: float) -> Lamp | None:
    """Fit a + b max(0, n . l) with a, b >= 0; None where its mean square error is not below `largest`."""
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
        # Once more, closer around the best.
        width /= 6.0
        directions = best[1] + width * _spread(_DIRECTIONS)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    missed, direction, share = best if best is not None else (np.inf, np.zeros(3), 0.0)
    return Lamp(direction, share) if missed < largest else None


def _spread(n: int) -> Array:
    """Directions (n, 3) evenly over the sphere, along a spiral."""
    place = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * place / n, np.pi * (1.0 + 5.0**0.5) * place
    horizontal = np.sqrt(1.0 - z**2)
    return np.stack([horizontal * np.cos(turn), horizontal * np.sin(turn), z], axis=-1)


def _disc(shape: tuple[int, ...], direction: Array) -> Array:
    """Radiance (h, w) of a lamp of irradiance 1 at normal incidence: a disc with a soft edge."""
    inside = np.clip((np.einsum("ijk,k->ij", _directions(shape), direction) - np.cos(LAMP_RADIUS)) * 1e3, 0.0, 1.0)
    return np.asarray(inside / max(float((inside * _solid(shape)[:, None]).sum()), 1e-12))


def _normals(height: Array) -> Array:
    """Unit normals (h, w, 3) of heights."""
    down, right = np.gradient(height)
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _with_one(normals: Array) -> Array:
    return np.concatenate([np.ones((len(normals), 1)), normals], axis=1)


def _square(normals: Array) -> Array:
    """Normal equations of a linear fit, with a ridge of a hundredth: a flat object has one normal, and no gradient."""
    matrix = _with_one(normals)
    return np.asarray(np.einsum("ni,nj->ij", matrix, matrix) / len(matrix) + np.diag([0.0, 1e-2, 1e-2, 1e-2]))


def _plane(light: Array, shading: Shading) -> Array:
    """Weights max(0, 1 + k . d) of the directions of a map, so that its irradiance has the fitted gradient."""
    small = luminance(_reduced(light))
    cosines, directions = _transfer(small.shape, shading.normals)
    matrix, square = _with_one(shading.normals), _square(shading.normals) * len(shading.normals)
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
    return np.maximum(np.einsum("nk,ijk->nij", normals, directions), 0.0) * _solid(shape)[:, None], directions


def _solid(shape: tuple[int, ...]) -> Array:
    """Solid angle of a texel of each row, (h,); all of them make 4 pi."""
    edges = np.cos(np.pi * np.arange(shape[0] + 1) / shape[0])
    return np.asarray(2.0 * np.pi / shape[1] * (edges[:-1] - edges[1:]))


def _directions(shape: tuple[int, ...]) -> Array:
    v, u = ((np.arange(n) + 0.5) / n for n in shape)
    return latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))


def _reduced(light: Array) -> Array:
    """Means over squares, `_ROWS` rows."""
    block = max(1, light.shape[0] // _ROWS)
    h, w = (n // block for n in light.shape[:2])
    return np.asarray(light[: h * block, : w * block].reshape(h, block, w, block, 3).mean(axis=(1, 3)))
