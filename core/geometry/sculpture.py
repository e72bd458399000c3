"""The built-in sculpture: a bloom on a lantern, computed.

It shows translucency: petals of 2 % of its size that glow when lit from behind, beside a seed head
and a foot that stay solid; seeds, stamens and beads for detail that light softens; a woven lantern with a
pearl in it. About 1 wide and high, y up, front +z.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.implicit import Coordinates, Primitive, Values, polygonise, smooth_max, smooth_min

SPACING = 1.0 / 110.0
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # the angle between seeds, and between the petals' small differences

# The bloom leans towards the viewer about its foot, and a little to the right, where the default camera stands.
BLOOM_ORIGIN = (0.0, -0.085, -0.015)
BLOOM_TILT = math.radians(31.0)
BLOOM_YAW = math.radians(15.0)
LANTERN_RADIUS = 0.162


@dataclass(frozen=True)
class Ring:
    """Parameters of a ring of petals; lengths in heights of the sculpture, angles in degrees.

    A petal's spine lies in a plane through the axis: it leaves the axis at `start`, heading `heading` above the
    horizontal, and follows two arcs, each (radius, sweep); a positive sweep turns upwards and inwards.
    """

    count: int
    phase: float
    start: tuple[float, float]
    heading: float
    arcs: tuple[tuple[float, float], tuple[float, float]]
    half_width: float
    cup: float  # curvature across, 1 / radius
    whirl: float  # sideways sweep of the tip
    ruffle: float  # amplitude of the wave along the edge


RINGS = (
    Ring(8, 22.5, (0.03, 0.00), 2.0, ((0.30, 66.0), (0.135, -116.0)), 0.138, 2.2, 0.06, 0.022),
    Ring(7, 0.0, (0.03, 0.02), 14.0, ((0.25, 75.0), (0.20, -68.0)), 0.115, 3.0, 0.05, 0.014),
)


def sculpture(spacing: float = SPACING) -> tuple[Array, Ints, Array]:
    """Return the mesh of the sculpture, closed and 2-manifold, about 1 high, polygonised on cells of a spacing.

    Returns
    -------
    vertices : (n, 3) float64
    faces : (m, 3) int64, counter-clockwise seen from outside
    normals : (n, 3) float64, unit, outward
    """
    return polygonise(_primitives(), (-0.63, -0.55, -0.6), (0.63, 0.55, 0.6), spacing)


def _primitives() -> list[Primitive]:
    primitives = [
        Primitive(_foot, 0.02),
        Primitive(_lantern, 0.02),
        Primitive(_pearl, 0.02),
        Primitive(_neck, 0.02),
        Primitive(_beads, 0.006),
        Primitive(_leaning(_receptacle), 0.03),
        Primitive(_leaning(_seed_head), 0.02),
        Primitive(_leaning(_stamens), 0.008),
    ]
    for ring in RINGS:
        primitives += [Primitive(_leaning(partial(_petal, ring, i)), 0.02) for i in range(ring.count)]
    return primitives


def _leaning(distance: Callable[[Coordinates], Values]) -> Callable[[Coordinates], Values]:
    """Return `distance` in the frame of the bloom, whose axis is y and whose origin is its foot."""
    tilt, yaw = BLOOM_TILT, BLOOM_YAW
    about_x = np.array([[1, 0, 0], [0, math.cos(tilt), math.sin(tilt)], [0, -math.sin(tilt), math.cos(tilt)]])
    about_y = np.array([[math.cos(yaw), 0, -math.sin(yaw)], [0, 1, 0], [math.sin(yaw), 0, math.cos(yaw)]])
    rotation = (about_x @ about_y).astype(np.float32)
    origin = np.array(BLOOM_ORIGIN, np.float32)[:, None]

    def leaning(p: Coordinates) -> Values:
        return distance(rotation @ (p - origin))

    return leaning


def _scaled(factor: float, distance: Values) -> Values:
    """Return distances measured in stretched space, times a factor that makes none too large."""
    shorter: Values = np.float32(factor) * distance
    return shorter


def _foot(p: Coordinates) -> Values:
    """Return distances to the turned foot: a rounded disc that rises to the lantern."""
    r, y = np.hypot(p[0], p[2]), p[1]
    disc = smooth_max(r - 0.245, np.abs(y + 0.50) - 0.03, 0.03)
    cone = (r - 0.085 - 1.2 * np.maximum(-0.39 - y, 0.0)) / 1.5
    return smooth_min(disc, smooth_max(cone, np.abs(y + 0.44) - 0.05, 0.02), 0.03)


def _lantern(p: Coordinates) -> Values:
    """Return distances to a hollow onion woven of two families of strands at 45 degrees, whole at its poles."""
    x, y, z = p[0], (p[1] + 0.315) / 0.85, p[2]
    height = np.sqrt(x * x + y * y + z * z) - LANTERN_RADIUS
    # In Mercator's map, longitude against atanh(sin latitude), such strands are straight and evenly spaced.
    r = np.hypot(x, z)
    mercator = np.arctanh(np.clip(y / LANTERN_RADIUS, -0.97, 0.97))
    longitude = np.arctan2(z, x)
    left, right = (_to_sector(angle, 9) for angle in (longitude + mercator, longitude - mercator))
    half = 0.013
    strands = smooth_min(np.abs(left) * r, np.abs(right) * r, 0.02) / math.sqrt(2.0) - half
    poles = 0.12 - np.abs(y)
    return _scaled(0.85, _sheet(height, smooth_min(strands, poles, 0.02), half))


def _pearl(p: Coordinates) -> Values:
    """Return distances to a pearl on a post inside the lantern."""
    r, y = np.hypot(p[0], p[2]), p[1] + 0.315
    post = smooth_max(r - 0.024, np.abs(y) - 0.135, 0.01)
    return smooth_min(np.hypot(r, y) - 0.078, post, 0.02)


def _neck(p: Coordinates) -> Values:
    """Return distances to the collared stem from the lantern to the bloom."""
    r, y = np.hypot(p[0], p[2]), p[1]
    stem = smooth_max(r - 0.05, np.abs(y + 0.13) - 0.07, 0.02)
    return smooth_min(stem, np.hypot(r - 0.062, y + 0.148) - 0.02, 0.012)


def _beads(p: Coordinates) -> Values:
    """Return distances to a ring of beads on the foot."""
    x, z = _first_sector(p, 30)
    bead: Values = np.sqrt((x - 0.222) ** 2 + z * z + (p[1] + 0.466) ** 2) - 0.0195
    return bead


def _first_sector(p: Coordinates, count: int) -> tuple[Values, Values]:
    """Return x and z of points turned about y by a multiple of 360 / count degrees into the sector about +x."""
    angle = _to_sector(np.arctan2(p[2], p[0]), count)
    r = np.hypot(p[0], p[2])
    return r * np.cos(angle), r * np.sin(angle)


def _to_sector(angle: Values, count: int) -> Values:
    sector = 2.0 * math.pi / count
    turned: Values = angle - np.round(angle / sector) * sector
    return turned


def _receptacle(p: Coordinates) -> Values:
    """Return distances to the thick cup that carries the petals."""
    return _scaled(0.8, np.sqrt(p[0] ** 2 + ((p[1] - 0.03) / 0.8) ** 2 + p[2] ** 2) - 0.10)


def _seed_head(p: Coordinates) -> Values:
    """Return distances to a solid head with seeds along a golden spiral."""
    q = np.stack([p[0], (p[1] - 0.15) / 1.25, p[2]])
    squared = (q * q).sum(axis=0)
    i = np.arange(55) + 0.5
    cos_polar = 1.0 - 1.5 * i / 55
    sin_polar = np.sqrt(1.0 - cos_polar**2)
    seeds = np.column_stack([sin_polar * np.cos(GOLDEN * i), cos_polar, sin_polar * np.sin(GOLDEN * i)])
    # All seeds lie 0.108 from the centre, so the nearest one has the largest dot product.
    nearest = (seeds.astype(np.float32) @ q).max(axis=0)
    seed = np.sqrt(np.maximum(squared + 0.108**2 - 2.0 * 0.108 * nearest, 0.0)) - 0.0195
    return _scaled(0.9, smooth_min(np.sqrt(squared) - 0.106, seed, 0.012))


def _stamens(p: Coordinates) -> Values:
    """Return distances to filaments that end in beads, around the seed head."""
    x, z = _first_sector(p, 18)
    x0, y0, x1, y1 = 0.08, 0.04, 0.185, 0.245
    dx, dy = x1 - x0, y1 - y0
    t = np.clip(((x - x0) * dx + (p[1] - y0) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
    bow = 0.03 * t * (1.0 - t)
    rod = np.sqrt((x - x0 - t * dx - bow) ** 2 + (p[1] - y0 - t * dy) ** 2 + z * z) - 0.0105
    bead = np.sqrt((x - x1) ** 2 + (p[1] - y1) ** 2 + z * z) - 0.0205
    return smooth_min(rod, bead, 0.01)


def _petal(ring: Ring, index: int, p: Coordinates) -> Values:
    """Return distances to a petal, a thin curled sheet along its spine, see `_along`."""
    chance = math.modf(0.5 + index * 0.618034)[0] - 0.5  # -0.5 .. 0.5, evenly spread
    azimuth = math.radians(ring.phase + 360.0 * (index + 0.15 * chance) / ring.count)
    c, s = math.cos(azimuth), math.sin(azimuth)
    x, z = c * p[2] + s * p[0], c * p[0] - s * p[2]
    along, above, beyond = _along(ring, ring.heading + 14.0 * chance, x, p[1])
    u = np.clip(along, 0.0, 1.0)
    z = z - ring.whirl * u * u
    leaf = np.maximum(np.sin(math.pi * u**0.85), 0.0) ** 0.75
    width = ring.half_width * (0.22 + 0.78 * leaf) * (1.0 - 0.3 * u**6)
    v = np.clip(z / width, -1.3, 1.3)
    wave = ring.ruffle * u * np.sin(9.0 * u + 6.0 * chance + 1.2 * np.sign(v))
    cup = ring.cup * (1.0 - 0.6 * u)
    rise = 0.5 * cup * z * z + wave * v * v
    slope = cup * z + 2.0 * wave * v / width
    midrib = 0.006 * np.exp(-((z / 0.014) ** 2)) * (1.0 - u)
    veins = 0.0012 * np.cos(7.0 * math.pi * v) * (1.0 - u)
    edge = smooth_max((np.abs(z) - width) / 1.15, beyond, 0.03)
    rim = 0.0045 * np.exp(-(((edge + 0.013) / 0.014) ** 2))
    half = 0.0095 + 0.006 * (1.0 - u) ** 2 + midrib + veins + rim
    return _sheet((above - rise) / np.sqrt(1.0 + slope * slope), edge, half)


def _sheet(height: Values, edge: Values, half: Values | float) -> Values:
    """Return distances to a sheet of half thickness `half` with a round rim, by height and distance past the edge."""
    sheet: Values = np.hypot(height, np.maximum(edge + half, 0.0)) - half
    return sheet


def _along(ring: Ring, heading_deg: float, x: Values, y: Values) -> tuple[Values, Values, Values]:
    """Return the position along a petal's spine (0 at its foot, 1 at its tip), height above it, distance past it."""
    (r1, a1), (r2, a2) = ((r, math.radians(a)) for r, a in ring.arcs)
    length = r1 * abs(a1) + r2 * abs(a2)
    heading = math.radians(heading_deg)
    joint = _arc_end(ring.start, heading, r1, a1)
    s1, d1 = _arc(x, y, ring.start, heading, r1, a1)
    s2, d2 = _arc(x, y, joint, heading + a1, r2, a2)
    c, s = math.cos(heading + a1), math.sin(heading + a1)
    later = (x - joint[0]) * c + (y - joint[1]) * s > 0.0
    along = np.where(later, r1 * abs(a1) + s2, s1)
    return along / length, np.where(later, d2, d1), np.maximum(along - length, -along)


def _arc_centre(start: tuple[float, float], heading: float, radius: float) -> tuple[float, float]:
    """Return the centre of an arc, on its right side for a negative radius."""
    return start[0] - radius * math.sin(heading), start[1] + radius * math.cos(heading)


def _arc_end(start: tuple[float, float], heading: float, radius: float, sweep: float) -> tuple[float, float]:
    signed = math.copysign(radius, sweep)
    return _arc_centre(_arc_centre(start, heading, signed), heading + sweep, -signed)


def _arc(
    x: Values, y: Values, start: tuple[float, float], heading: float, radius: float, sweep: float
) -> tuple[Values, Values]:
    """Return the length along an arc from its start, and the height on its left side."""
    side = math.copysign(1.0, sweep)
    centre = _arc_centre(start, heading, side * radius)
    dx, dy = x - centre[0], y - centre[1]
    # Measured from the middle of the arc, so that the jump of the angle lies opposite.
    middle = heading + 0.5 * sweep - side * 0.5 * math.pi
    c, s = math.cos(middle), math.sin(middle)
    turn = np.arctan2(c * dy - s * dx, c * dx + s * dy)
    return radius * (side * turn + 0.5 * abs(sweep)), side * (radius - np.hypot(dx, dy))
