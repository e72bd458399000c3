"""Maps of light probes: conventions of directions, the two projections, and resampling between them.

World +y is up. Lat-long: u = phi / 2 pi + 1/2 and v = theta / pi in [0, 1], d = (sin theta sin phi, cos
theta, -sin theta cos phi), so the centre is -z, the right half +x, the top +y. Angular map (Debevec): centre
-z, u right, v up, both in [-1, 1], radius = angle from -z over pi.
"""

from typing import Literal

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError

Radiance = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.floating]
Projection = Literal["latlong", "angular"]

ASPECT_TOLERANCE = 0.01
DISC_RADIUS = 0.995  # of the angular map: outside it stand text and a half-covered rim
_BLOCK = 1 << 15  # samples at a time: the arrays of a block stay in the cache


def direction_to_latlong(directions: npt.ArrayLike) -> Array:
    """Return (u, v) in [0, 1], (..., 2), of unit directions (..., 3); u = 1/2 at the poles, without an azimuth."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    # hypot keeps accuracy near the poles, where acos(y) has none; + 0.0 turns -0.0 into 0.0: phi = 0 at +-y.
    phi = np.arctan2(x, -z + 0.0)
    return np.stack([phi / (2.0 * np.pi) + 0.5, np.arctan2(np.hypot(x, z), y) / np.pi], axis=-1)


def latlong_to_direction(uv: npt.ArrayLike) -> Array:
    """Return unit directions (..., 3) of (u, v), (..., 2); the inverse of `direction_to_latlong`."""
    u, v = np.moveaxis(np.asarray(uv, np.float64), -1, 0)
    theta, phi = np.pi * v, 2.0 * np.pi * (u - 0.5)
    sine = np.sin(theta)
    return np.stack([sine * np.sin(phi), np.cos(theta), -sine * np.cos(phi)], axis=-1)


def direction_to_angular(directions: npt.ArrayLike) -> Array:
    """Return (u, v) of the angular map, (..., 2) in the unit disc, of unit directions (..., 3); +z gives (1, 0)."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    sine = np.hypot(x, y)
    radius = np.arctan2(sine, -z) / np.pi
    on_axis = sine == 0.0
    safe = np.where(on_axis, 1.0, sine)
    return np.stack([np.where(on_axis, 1.0, x / safe) * radius, y / safe * radius], axis=-1)


def angular_to_direction(uv: npt.ArrayLike) -> Array:
    """Return unit directions (..., 3) of (u, v) of the angular map, (..., 2) in the unit disc."""
    u, v = np.moveaxis(np.asarray(uv, np.float64), -1, 0)
    radius = np.hypot(u, v)
    scale = np.pi * np.sinc(radius)  # sin(pi r) / r
    return np.stack([u * scale, v * scale, -np.cos(np.pi * radius)], axis=-1)


def to_probe_frame(directions: npt.ArrayLike, rotation_deg: float) -> Array:
    """Return world directions (..., 3) in the frame of a probe rotated by rotation_deg about +y: R_y(-a) d.

    A positive rotation carries the probe's +z towards world +x.
    """
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    cosine, sine = np.cos(np.radians(rotation_deg)), np.sin(np.radians(rotation_deg))
    return np.stack([cosine * x - sine * z, y, sine * x + cosine * z], axis=-1)


def detect_projection(pixels: Pixels) -> Projection:
    """Return the projection of pixels (h, w, 3) by their aspect: lat-long (2:1) or angular (square).

    Raises
    ------
    InputError
        If pixels are not (h, w, 3) with at least two rows, or the aspect is neither within 1 %.
    """
    if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < 2:
        raise InputError(f"A probe needs pixels of shape (height, width, 3), not {pixels.shape}.")
    height, width = pixels.shape[:2]
    if abs(width / height - 2.0) <= 2.0 * ASPECT_TOLERANCE:
        return "latlong"
    if abs(width / height - 1.0) <= ASPECT_TOLERANCE:
        return "angular"
    raise InputError(
        f"The probe measures {width}x{height} pixels, but must be a lat-long map twice as wide as high or a "
        "square angular map: convert it first."
    )


def resample_latlong(pixels: Pixels, height: int) -> Radiance:
    """Return a lat-long map averaged to (height, 2 height, 3) float32, which conserves the flux of every new texel.

    Old texels are weighted by the solid angle that they share with the new one, so any ratio of sizes is exact.
    """
    old_height, old_width = pixels.shape[:2]
    if (old_height, old_width) == (height, 2 * height):
        return np.ascontiguousarray(pixels, np.float32)
    row_edges = -np.cos(np.pi * np.arange(old_height + 1) / old_height)
    new_edges = -np.cos(np.pi * np.arange(height + 1) / height)
    column_edges = np.arange(2 * height + 1) * (old_width / (2 * height))
    result = np.empty((height, 2 * height, 3), np.float32)
    for row in range(height):
        first = int(row * old_height / height)
        last = min(old_height, int(np.ceil((row + 1) * old_height / height - 1e-9)))
        low = np.maximum(row_edges[first:last], new_edges[row])
        high = np.minimum(row_edges[first + 1 : last + 1], new_edges[row + 1])
        weights = np.maximum(high - low, 0.0)
        band = np.tensordot(weights / weights.sum(), pixels[first:last].astype(np.float64), axes=1)  # (w, 3)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(band, axis=0)])
        at_edges = np.stack([np.interp(column_edges, np.arange(old_width + 1), c) for c in total.T], axis=1)
        result[row] = np.diff(at_edges, axis=0) * (2 * height / old_width)
    return np.maximum(result, 0.0)


def angular_to_latlong(pixels: Pixels, height: int) -> Radiance:
    """Return Debevec's angular map (n, n, 3) resampled to a lat-long map (height, 2 height, 3) float32.

    Each texel averages the map's pixels at a regular grid of directions, at least nine a texel (which conserve
    the flux of Galileo's Tomb, whose windows are small, to 0.02 %; four to 0.1 %). Directions beyond
    DISC_RADIUS read the pixel at that radius, so that text outside the disc is not read.
    """
    per_side = max(3, -(-pixels.shape[0] // height))
    u = (np.arange(2 * height * per_side) + 0.5) / (2 * height * per_side)
    result = np.empty((height, 2 * height, 3), np.float32)
    step = max(1, _BLOCK // (u.size * per_side))
    for start in range(0, height, step):
        stop = min(start + step, height)
        v = (np.arange(start * per_side, stop * per_side) + 0.5) / (height * per_side)
        samples = _angular_nearest(pixels, latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1)))
        weights = np.sin(np.pi * v)  # of each sub-row; they differ within a texel next to the poles
        samples = samples.reshape(stop - start, per_side, 2 * height, per_side, 3).mean(axis=3)
        weights = weights.reshape(stop - start, per_side, 1, 1)
        result[start:stop] = (samples * weights).sum(axis=1) / weights.sum(axis=1)
    return result


def _angular_nearest(pixels: Pixels, directions: Array) -> Array:
    """Return the angular map's pixel in each direction (..., 3), at most DISC_RADIUS from the centre."""
    rows, columns = pixels.shape[:2]
    uv = direction_to_angular(directions)
    radius = np.hypot(uv[..., 0], uv[..., 1])
    # In a tiny map the rim is more than 0.5 % wide: keep the pixel's centre inside the disc as well.
    limit = min(DISC_RADIUS, 1.0 - np.sqrt(2.0) / min(rows, columns))
    uv *= np.minimum(1.0, limit / np.maximum(radius, 1e-9))[..., None]
    column = np.clip(((uv[..., 0] + 1.0) * 0.5 * columns).astype(np.intp), 0, columns - 1)
    row = np.clip(((1.0 - uv[..., 1]) * 0.5 * rows).astype(np.intp), 0, rows - 1)
    return np.asarray(pixels[row, column], np.float64)


def texel_solid_angles(latlong: Pixels) -> Array:
    """Return the solid angle of a texel of each row of a lat-long map, sr, (h,)."""
    height, width = latlong.shape[:2]
    return np.asarray(-np.diff(np.cos(np.pi * np.arange(height + 1) / height)) * (2.0 * np.pi / width))


def solid_angles(pixels: Pixels) -> tuple[Array, Array]:
    """Return directions (k, 3) and solid angles (k,), sr, of all pixels row by row; 0 outside an angular disc."""
    rows, columns = pixels.shape[:2]
    i, j = np.arange(rows) + 0.5, np.arange(columns) + 0.5
    if detect_projection(pixels) == "latlong":
        uv = np.stack(np.meshgrid(j / columns, i / rows), axis=-1).reshape(-1, 2)
        return latlong_to_direction(uv), np.repeat(texel_solid_angles(pixels), columns)
    uv = np.stack(np.meshgrid(2.0 * j / columns - 1.0, 1.0 - 2.0 * i / rows), axis=-1).reshape(-1, 2)
    radius = np.hypot(uv[:, 0], uv[:, 1])
    # dw = sin(theta) dtheta dphi with theta = pi r, du dv = r dr dphi: dw = pi^2 sinc(r) du dv
    d_omega = np.pi**2 * np.sinc(radius) * (4.0 / (rows * columns))
    return angular_to_direction(uv), np.where(radius <= 1.0, d_omega, 0.0)
