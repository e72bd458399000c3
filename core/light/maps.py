"""Maps of light probes: conventions of directions, projections, and resampling of all of them to lat-long.

World +y is up. Lat-long: u = phi / 2 pi + 1/2 and v = theta / pi in [0, 1], d = (sin theta sin phi, cos
theta, -sin theta cos phi), so the centre is -z, the right half +x, the top +y. The others have u right and v up in
[-1, 1]. Angular map (Debevec): centre -z, radius = angle from -z over pi. Mirror ball, photographed from far on +z:
centre +z, radius = sine of half the angle from +z. Octahedral: equal areas (Clarberg, "Fast Equal-Area Mapping of the
(Hemi)Sphere using SIMD", 2008), +y in the middle, -y at the corners. Cubes: faces seen from within, -z in front, and
in a strip the order +x -x +y -y -z +z.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError

Radiance = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.floating]
Projection = Literal["latlong", "angular", "mirrorball", "octahedral", "cross", "strip"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)

ASPECT_TOLERANCE = 0.01
DISC_RADIUS = 0.995  # of the angular map: outside it stand text and a half-covered rim
BALL_RADIUS = (
    0.995  # of a mirror ball: the last 0.5 % hold what is within 11 degrees of behind it, squeezed and grazing
)
DARK = 0.01  # median of a square's corners over the mean of its disc: less is outside a disc, more is part of a picture
ASPECTS = {
    "latlong": (2.0,), "angular": (1.0,), "mirrorball": (1.0,), "octahedral": (1.0,), "cross": (4 / 3, 3 / 4),
    "strip": (6.0,),
}  # fmt: skip
# Of each face: column and row in a horizontal cross and column in a strip, then axes that point right and up in it.
_FACES = {
    "+x": ((2, 1), 0, (0, 0, 1), (0, 1, 0)),
    "-x": ((0, 1), 1, (0, 0, -1), (0, 1, 0)),
    "+y": ((1, 0), 2, (1, 0, 0), (0, 0, 1)),
    "-y": ((1, 2), 3, (1, 0, 0), (0, 0, -1)),
    "-z": ((1, 1), 4, (1, 0, 0), (0, 1, 0)),
    "+z": ((3, 1), 5, (-1, 0, 0), (0, 1, 0)),
}
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


def direction_to_mirrorball(directions: npt.ArrayLike) -> Array:
    """Return (u, v) on a mirror ball, (..., 2) in the unit disc, of unit directions (..., 3); -z is its whole rim."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    # The normal is halfway between the direction and +z, of length sqrt(2 (1 + z)), which near -z is hypot(x, y).
    ahead = np.where(z > -0.5, 1.0 + z, (x**2 + y**2) / np.where(z > -0.5, 1.0, 1.0 - z))
    length = np.sqrt(2.0 * np.maximum(ahead, 1e-30))
    return np.stack([x / length, y / length], axis=-1)


def direction_to_octahedral(directions: npt.ArrayLike) -> Array:
    """Return (u, v) of the equal-area octahedral map, (..., 2) in [-1, 1], of unit directions (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    radius = np.sqrt(np.maximum(1.0 - np.abs(y), 0.0))
    along = radius * (2.0 / np.pi) * np.arctan2(np.abs(z), np.abs(x))
    across = radius - along
    below = y < 0.0
    u, v = np.where(below, 1.0 - along, across), np.where(below, 1.0 - across, along)
    return np.stack([np.copysign(u, x), np.copysign(v, z)], axis=-1)


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
    _check_shape(pixels)
    for projection in ("latlong", "angular"):
        if _fits(pixels, projection):
            return projection
    height, width = pixels.shape[:2]
    raise InputError(
        f"The probe measures {width}x{height} pixels, but must be a lat-long map twice as wide as high or a "
        "square angular map: say what else it is (environment.projection), or convert it first."
    )


def check_projection(pixels: Pixels, projection: Projection | None) -> Projection:
    """Return the projection of pixels (h, w, 3), checked; None tells it by the aspect, and a square by its corners.

    Raises
    ------
    InputError
        If the aspect is not the projection's within 1 %, or corners of a square of unknown projection are lit: outside
        its disc an angular map has nothing but text.
    """
    found = detect_projection(pixels) if projection is None else projection
    _check_shape(pixels)
    height, width = pixels.shape[:2]
    if not _fits(pixels, found):
        wanted = " or ".join(f"{aspect:.3g}:1" for aspect in ASPECTS[found])
        raise InputError(
            f"The probe measures {width}x{height} pixels, but as {found} (environment.projection) it must be {wanted}."
        )
    if projection is None and found == "angular" and _corners_are_lit(pixels):
        raise InputError(
            f"The probe is a square of {width}x{height} pixels with lit corners, so no angular map: "
            'environment.projection = "octahedral" reads it as an equal-area octahedral map, "angular" as it is.'
        )
    return found


def _check_shape(pixels: Pixels) -> None:
    if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < 2:
        raise InputError(f"A probe needs pixels of shape (height, width, 3), not {pixels.shape}.")


def _fits(pixels: Pixels, projection: Projection) -> bool:
    aspect = pixels.shape[1] / pixels.shape[0]
    return any(abs(aspect / wanted - 1.0) <= ASPECT_TOLERANCE for wanted in ASPECTS[projection])


def _corners_are_lit(pixels: Pixels) -> bool:
    """Tell whether a square holds light outside its disc; the median passes over text."""
    rows, columns = pixels.shape[:2]
    v, u = (2.0 * (np.arange(count) + 0.5) / count - 1.0 for count in (rows, columns))
    radius = np.hypot(u, v[:, None])
    level = pixels.mean(axis=2)
    outside = level[radius > 1.0 + 2.0 / min(rows, columns)]
    return bool(outside.size and np.median(outside) > DARK * level[radius <= 1.0].mean(dtype=np.float64))


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


def to_latlong(pixels: Pixels, projection: Projection, most_height: int) -> Radiance:
    """Return a probe of any projection as a lat-long map (h, 2 h, 3) float32 as fine as itself, h <= most_height."""
    if projection == "latlong":
        return resample_latlong(pixels, min(pixels.shape[0], most_height))
    return _sampled(pixels, projection, min(max(_rows(pixels, projection), 2), most_height))


def _rows(pixels: Pixels, projection: Projection) -> int:
    """Return how many rows a lat-long map as fine as pixels has: a disc's diameter is 360 degrees, a cube's face 90."""
    rows = int(pixels.shape[0])
    if projection == "cross":
        return min(rows, int(pixels.shape[1])) * 2 // 3
    return rows * 2 if projection == "strip" else rows // 2


def angular_to_latlong(pixels: Pixels, height: int) -> Radiance:
    """Return Debevec's angular map (n, n, 3) resampled to a lat-long map (height, 2 height, 3) float32.

    Directions beyond DISC_RADIUS read the pixel at that radius, so that text outside the disc is not read.
    """
    return _sampled(pixels, "angular", height)


def _sampled(pixels: Pixels, projection: Projection, height: int) -> Radiance:
    """Return a map resampled to a lat-long map (height, 2 height, 3) float32.

    Each texel averages the map's pixels at a regular grid of directions, at least nine a texel (which conserve
    the flux of Galileo's Tomb, whose windows are small, to 0.02 %; four to 0.1 %).
    """
    rows, columns = pixels.shape[:2]
    pixel_of = _PIXEL_OF[projection]
    per_side = max(3, -(-2 * _rows(pixels, projection) // height))
    u = (np.arange(2 * height * per_side) + 0.5) / (2 * height * per_side)
    result = np.empty((height, 2 * height, 3), np.float32)
    step = max(1, _BLOCK // (u.size * per_side))
    for start in range(0, height, step):
        stop = min(start + step, height)
        v = (np.arange(start * per_side, stop * per_side) + 0.5) / (height * per_side)
        at = pixel_of(latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1)), rows, columns).astype(np.intp)
        column, row = np.clip(at[..., 0], 0, columns - 1), np.clip(at[..., 1], 0, rows - 1)
        samples = np.asarray(pixels[row, column], np.float64)
        weights = np.sin(np.pi * v)  # of each sub-row; they differ within a texel next to the poles
        samples = samples.reshape(stop - start, per_side, 2 * height, per_side, 3).mean(axis=3)
        weights = weights.reshape(stop - start, per_side, 1, 1)
        result[start:stop] = (samples * weights).sum(axis=1) / weights.sum(axis=1)
    return result


def _square_pixel(uv: Array, rows: int, columns: int) -> Array:
    """Return columns and rows of (u, v) in [-1, 1], v up."""
    return (uv * (1.0, -1.0) + 1.0) * (0.5 * columns, 0.5 * rows)


def _disc_pixel(uv: Array, most_radius: float, rows: int, columns: int) -> Array:
    """Return columns and rows of (u, v), kept within a radius."""
    radius = np.hypot(uv[..., 0], uv[..., 1])
    # In a tiny map the rim is more than 0.5 % wide: keep the pixel's centre inside the disc as well.
    limit = min(most_radius, 1.0 - np.sqrt(2.0) / min(rows, columns))
    return _square_pixel(uv * np.minimum(1.0, limit / np.maximum(radius, 1e-9))[..., None], rows, columns)


def _angular_pixel(directions: Array, rows: int, columns: int) -> Array:
    return _disc_pixel(direction_to_angular(directions), DISC_RADIUS, rows, columns)


def _mirrorball_pixel(directions: Array, rows: int, columns: int) -> Array:
    return _disc_pixel(direction_to_mirrorball(directions), BALL_RADIUS, rows, columns)


def _octahedral_pixel(directions: Array, rows: int, columns: int) -> Array:
    # v of the map grows with +z, down the picture
    return _square_pixel(direction_to_octahedral(directions) * (1.0, -1.0), rows, columns)


def _cross_pixel(directions: Array, rows: int, columns: int) -> Array:
    upright = rows > columns
    size = min(rows, columns) / 3.0
    at = _cube_pixel(directions, {name: cell for name, (cell, *_) in _FACES.items()}, size)
    if upright:  # +z stands below -y, upside down
        behind = np.argmax(np.abs(directions), axis=-1) == 2
        behind &= directions[..., 2] > 0.0
        at[behind] = 5.0 * size - 1e-6 - at[behind]
    return at


def _strip_pixel(directions: Array, rows: int, columns: int) -> Array:
    return _cube_pixel(directions, {name: (column, 0) for name, (_, column, *_) in _FACES.items()}, columns / 6.0)


def _cube_pixel(directions: Array, cells: dict[str, tuple[int, int]], size: float) -> Array:
    """Return columns and rows of directions (..., 3) on a cube's faces, each `size` pixels wide in its cell."""
    major = np.argmax(np.abs(directions), axis=-1)
    at = np.empty((*directions.shape[:-1], 2))
    for name, (column, row) in cells.items():
        axis, sign = "xyz".index(name[1]), float(name[0] + "1")
        chosen = (major == axis) & (directions[..., axis] * sign > 0.0)
        towards = directions[chosen] / np.abs(directions[chosen][:, axis : axis + 1])
        right, up = (towards @ np.asarray(edge, np.float64) for edge in _FACES[name][2:])
        # a ray along an edge stays in its face
        inside = np.clip(np.stack([right, -up], axis=-1) * 0.5 + 0.5, 0.0, 1.0 - 1e-9)
        at[chosen] = (inside + np.array([column, row])) * size
    return at


# Columns and rows, (..., 2) float64, of directions (..., 3) in a map of so many rows and columns.
_PIXEL_OF: dict[str, Callable[[Array, int, int], Array]] = {
    "angular": _angular_pixel,
    "mirrorball": _mirrorball_pixel,
    "octahedral": _octahedral_pixel,
    "cross": _cross_pixel,
    "strip": _strip_pixel,
}


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
