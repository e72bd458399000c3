"""What rays see that leave the object: an environment, lamps with a size, and a plane below."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.light.harmonics import convolve_zonal, evaluate_grid, order_of
from milkglass.core.light.maps import Radiance
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.events import ALL, NONE, Rays
from milkglass.core.paths.lamps import BALL, DISC, EVERYWHERE, Lamp
from milkglass.core.paths.peaks import MOST_VARIANCE

FIRST_WIDTH = 0.08  # standard deviation of the first lobe, radians
WIDTHS = 4  # lobes, each twice as wide as the one before
LOBE_ROWS = 64  # of a map seen by a lobe
SMALL, LARGE = 1.0, 3.0  # radii of a lamp over a lobe's width, up to and from which its image is a Gaussian, and a disc


class Lamps(NamedTuple):
    """Lamps as arrays of n rows; see `Lamp`."""

    shapes: npt.NDArray[np.int32]
    places: Float32
    radiance: Float32
    sizes: Float32
    widths: Float32
    heights: Float32
    forwards: Float32
    cones: Float32


class Floor(NamedTuple):
    """A horizontal plane, seen from above, whose radiance is known at the places of a map; see `core.light.ground`.

    Attributes
    ----------
    radiance : (s, s, 3) float32
        Row by row along z; s is 0 of no plane.
    height : float
        mm.
    centre, fade : (2,) float32
        World x and z of the map's middle, mm; distances from there between which the plane fades away, mm.
    spread, last : float
        Places are at the middle + spread sinh(u), u evenly spread between -last and last; mm.
    """

    radiance: Float32
    height: float
    centre: Float32
    fade: Float32
    spread: float
    last: float


NO_FLOOR = Floor(np.zeros((0, 0, 3), np.float32), 0.0, np.zeros(2, np.float32), np.ones(2, np.float32), 1.0, 1.0)


class Surroundings(NamedTuple):
    """Radiance that arrives from all around; compared by identity.

    Attributes
    ----------
    whole, even : (h, 2h, 3) float32
        Lat-long maps of the environment, with and without what shines as lamps of a scene.
    by_lobes : (m, h, 2h, 3) float32
        `whole` as lobes see it, of standard deviations `FIRST_WIDTH` 2^i; no maps where they see it as all rays do.
    turn : (2,) float32
        Cosine and sine of the environment's rotation about +y.
    intensity : float
        Factor on both maps.
    lamps : Lamps
    floor : Floor
        Before the environment.
    """

    whole: Float32
    even: Float32
    by_lobes: Float32
    turn: Float32
    intensity: float
    lamps: Lamps
    floor: Floor

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    @classmethod
    def of(
        cls,
        whole: Radiance | None = None,
        even: Radiance | None = None,
        rotation_deg: float = 0.0,
        intensity: float = 1.0,
        lamps: Sequence[Lamp] = (),
        sh: Array | None = None,
    ) -> "Surroundings":
        """Return the surroundings of an environment, if there is one, and of lamps.

        Parameters
        ----------
        whole : (h, 2h, 3), optional
            Lat-long map of radiance.
        even : (h, 2h, 3), optional
            The same without strong sources that the scene has as lamps; without, `whole`.
        rotation_deg, intensity : float
            Of the environment, as of `core.light.maps.to_probe_frame`.
        lamps : sequence of Lamp
        sh : (k, 3), optional
            Spherical harmonics of `whole`, where rays with lobes see it.
        """
        whole = np.zeros((1, 2, 3), np.float32) if whole is None else whole
        even = whole if even is None else even
        angle, n = np.radians(rotation_deg), len(lamps)
        arrays = Lamps(
            np.array([lamp.shape for lamp in lamps], np.int32),
            np.array([lamp.place for lamp in lamps], np.float32).reshape(n, 3),
            np.array([lamp.radiance for lamp in lamps], np.float32).reshape(n, 3),
            np.array([lamp.size for lamp in lamps], np.float32),
            np.array([lamp.width for lamp in lamps], np.float32).reshape(n, 3),
            np.array([lamp.height for lamp in lamps], np.float32).reshape(n, 3),
            np.array([lamp.forward for lamp in lamps], np.float32).reshape(n, 3),
            np.array([lamp.cone for lamp in lamps], np.float32).reshape(n, 2),
        )
        return cls(
            np.array(whole, np.float32, order="C"),
            np.array(even, np.float32, order="C"),
            _by_lobes(sh),
            np.array([np.cos(angle), np.sin(angle)], np.float32),
            float(intensity),
            arrays,
            NO_FLOOR,
        )

    @property
    def has_lamps(self) -> bool:
        """Whether any lamps shine."""
        return bool(self.lamps.radiance.any())

    def above(self, floor: Floor) -> "Surroundings":
        """Return the surroundings with a plane before the environment."""
        return self._replace(floor=floor)

    def add(self, rays: Rays, radiance: Float32, first: int, highlights: float = np.inf) -> None:
        """Add weights times what rays see to the rows of `radiance`, (n, 3), that their sources number.

        Parameters
        ----------
        rays : Rays
        radiance : (n, 3) float32
        first : int
            1 where rays have met the surface once, else 0: those with an even source were mirrored there, and of lamps
            they see what is not drawn as highlights.
        highlights : float
            Angular radius up to which lamps are, radians; those twice as wide are not, and between they are in part.
            Panels, and balls that shine in a cone alone, always are.
        """
        _add(rays, self, radiance, first, highlights)


@compiled
def _add(rays: Rays, surroundings: Surroundings, radiance: Float32, first: int, highlights: float) -> None:
    cosine, sine = surroundings.turn
    floor, on_floor = surroundings.floor, np.zeros(3, np.float32)
    around, by_lobe, wider = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(rays.sources)):
        y = rays.directions[i, 1]
        is_first = first == 1 and rays.sources[i] % 2 == 0
        azimuth, polar = _placed(rays.directions[i], cosine, sine)
        _read(surroundings.even if is_first else surroundings.whole, azimuth, polar, around)
        turned, variance = ALL - rays.straight[i], min(rays.lobes[i, 0], np.float32(MOST_VARIANCE))
        if turned > 0.0:
            azimuth, polar = _placed(rays.leanings[i], cosine, sine)
            _read(surroundings.whole, azimuth, polar, by_lobe)
            _see_by_lobe(surroundings.by_lobes, azimuth, polar, variance, by_lobe, wider)
            for channel in range(3):
                around[channel] += turned * (by_lobe[channel] - around[channel])
        pixel, share = rays.sources[i], NONE
        if len(floor.radiance) > 0 and y < 0.0:
            share = _see_floor(rays.origins[i], rays.directions[i], floor, on_floor)
        for channel in range(3):
            value = around[channel] * surroundings.intensity
            if share > 0.0:
                value += share * (on_floor[channel] - value)
            radiance[pixel, channel] += rays.weights[i, channel] * value
        for lamp in range(len(surroundings.lamps.shapes)):
            share = _seen(rays.origins[i], rays.directions[i], surroundings.lamps, lamp)
            if turned > 0.0:
                wide = _seen_by_lobe(rays.origins[i], rays.leanings[i], surroundings.lamps, lamp, variance)
                share += turned * (wide - share)
            if share > 0.0 and is_first:
                share *= _image(rays.origins[i], surroundings.lamps, lamp, highlights)
            for channel in range(3):
                light = share * surroundings.lamps.radiance[lamp, channel]
                radiance[pixel, channel] += rays.weights[i, channel] * light


def _by_lobes(sh: Array | None) -> Float32:
    """Return what lobes see of harmonics, on the texels of maps: heat that has spread on the sphere."""
    if sh is None:
        return np.zeros((0, LOBE_ROWS, 2 * LOBE_ROWS, 3), np.float32)
    theta, degrees = (np.arange(LOBE_ROWS) + 0.5) * np.pi / LOBE_ROWS, np.arange(order_of(sh) + 1)
    phi = ((np.arange(2 * LOBE_ROWS) + 0.5) / LOBE_ROWS - 1.0) * np.pi
    variances = (FIRST_WIDTH * 2.0 ** np.arange(WIDTHS)) ** 2
    kept = np.exp(-0.5 * variances[:, None] * degrees * (degrees + 1))
    maps = np.stack([evaluate_grid(convolve_zonal(sh, of_width), theta, phi) for of_width in kept])
    return np.maximum(maps, 0.0).astype(np.float32)


@compiled
def _placed(direction: Float32, cosine: np.float32, sine: np.float32) -> tuple[float, float]:
    """Return the azimuth and the polar angle of a direction in a turned environment, of 0 to 1."""
    x, y, z = direction
    across, back = cosine * x - sine * z, sine * x + cosine * z
    azimuth = np.arctan2(across, -back) / (2.0 * np.pi) + 0.5
    return azimuth, np.arctan2(np.sqrt(across * across + back * back), y) / np.pi


@compiled
def _read(latlong: Float32, azimuth: float, polar: float, value: Array) -> None:
    """Put what a map has at an azimuth and a polar angle, of 0 to 1, into (3,)."""
    rows, columns = latlong.shape[:2]
    column = azimuth * columns - 0.5
    row = polar * rows - 0.5
    row = min(max(row, 0.0), rows - 1.0)
    left, top = int(np.floor(column)), int(row)
    along, down = np.float32(column - left), np.float32(row - top)
    right, bottom = (left + 1) % columns, min(top + 1, rows - 1)
    left = left % columns
    for channel in range(3):
        upper = (1 - along) * latlong[top, left, channel] + along * latlong[top, right, channel]
        lower = (1 - along) * latlong[bottom, left, channel] + along * latlong[bottom, right, channel]
        value[channel] = (1 - down) * upper + down * lower


@compiled
def _see_by_lobe(maps: Float32, azimuth: float, polar: float, variance: float, value: Array, wider: Array) -> None:
    """Replace what a ray sees, (3,), by what its lobe does, between those of two widths by its variance."""
    if len(maps) == 0:
        return
    over, below = variance / FIRST_WIDTH**2, 0
    while below < len(maps) and over >= 4.0**below:
        below += 1
    least = 4.0 ** (below - 1) if below > 0 else 0.0
    part = min((over - least) / (4.0**below - least), 1.0)
    if below > 0:
        _read(maps[below - 1], azimuth, polar, value)
    if below < len(maps):
        _read(maps[below], azimuth, polar, wider)
        for channel in range(3):
            value[channel] += part * (wider[channel] - value[channel])


@compiled
def _see_floor(origin: Float32, direction: Float32, floor: Floor, radiance: Float32) -> np.float32:
    """Put the radiance of a plane where a ray meets it into (3,), and return how far the plane is there, [0, 1]."""
    along = (floor.height - origin[1]) / direction[1]
    x = origin[0] + along * direction[0] - floor.centre[0]
    z = origin[2] + along * direction[2] - floor.centre[1]
    gone = min(max((np.sqrt(x * x + z * z) - floor.fade[0]) / (floor.fade[1] - floor.fade[0]), 0.0), 1.0)
    if along < 0.0 or gone == 1.0:
        return NONE
    side = len(floor.radiance)
    column = (0.5 * np.arcsinh(x / floor.spread) / floor.last + 0.5) * side - 0.5
    row = (0.5 * np.arcsinh(z / floor.spread) / floor.last + 0.5) * side - 0.5
    column, row = min(max(column, 0.0), side - 1.0), min(max(row, 0.0), side - 1.0)
    left, top = min(int(column), side - 2), min(int(row), side - 2)
    right, down = np.float32(column - left), np.float32(row - top)
    for channel in range(3):
        upper = (1 - right) * floor.radiance[top, left, channel] + right * floor.radiance[top, left + 1, channel]
        lower = (1 - right) * floor.radiance[top + 1, left, channel] + right * floor.radiance[
            top + 1, left + 1, channel
        ]
        radiance[channel] = (1 - down) * upper + down * lower
    return np.float32(1.0 - gone * gone * (3.0 - 2.0 * gone))


@compiled
def _seen(origin: Float32, direction: Float32, lamps: Lamps, i: int) -> np.float32:
    """Return the share of a lamp's radiance that a ray sees, 0 where it does not meet it."""
    place = lamps.places[i]
    if lamps.shapes[i] == DISC:
        return ALL if _dot(direction, place) >= lamps.sizes[i] else NONE
    to_centre = place - origin
    if lamps.shapes[i] == BALL:
        along = _dot(to_centre, direction)
        if along <= 0.0 or _dot(to_centre, to_centre) - along * along > lamps.sizes[i] ** 2:
            return NONE
        return _in_cone(-_dot(direction, lamps.forwards[i]), lamps, i)
    facing, distance = _dot(direction, lamps.forwards[i]), _dot(to_centre, lamps.forwards[i])
    if facing >= 0.0 or distance >= 0.0:
        return NONE
    off = distance / facing * direction - to_centre
    inside_width = abs(_dot(off, lamps.widths[i])) <= _dot(lamps.widths[i], lamps.widths[i])
    inside_height = abs(_dot(off, lamps.heights[i])) <= _dot(lamps.heights[i], lamps.heights[i])
    return ALL if inside_width and inside_height else NONE


@compiled
def _seen_by_lobe(origin: Float32, direction: Float32, lamps: Lamps, i: int, variance: float) -> np.float32:
    """Return the mean share of a lamp's radiance over a lobe about a ray; of a panel as of a disc as large.

    Chords stand for angles, of which the sphere is an image of equal areas: over all directions of the ray a lamp has
    its solid angle. Lamps that are small beside the lobe are a Gaussian of both variances, large ones a disc with a
    soft rim.
    """
    fading, towards, cosine = NONE, lamps.places[i] - origin, np.float32(-1.0)
    if lamps.shapes[i] == DISC:
        towards, cosine, fading = lamps.places[i], lamps.sizes[i], ALL
    distance2 = max(_dot(towards, towards), np.float32(1e-20))
    towards = towards / np.sqrt(distance2)
    facing = -_dot(towards, lamps.forwards[i])
    if lamps.shapes[i] == BALL:
        cosine = np.sqrt(max(ALL - lamps.sizes[i] ** 2 / distance2, NONE))
        fading = _in_cone(facing, lamps, i)
    elif lamps.shapes[i] != DISC and facing > 0.0:
        area = 4.0 * np.sqrt(_dot(lamps.widths[i], lamps.widths[i]) * _dot(lamps.heights[i], lamps.heights[i]))
        cosine, fading = np.float32(1.0 - min(area * facing / distance2 / (2.0 * np.pi), 1.0)), ALL
    if fading == 0.0:
        return NONE
    radius2, off2 = float(2.0 * (1.0 - cosine)), max(float(2.0 * (1.0 - _dot(direction, towards))), 0.0)
    width = np.sqrt(variance)
    both = float(variance + 0.25 * radius2)
    small = 0.5 * radius2 / both * np.exp(-0.5 * off2 / both)
    size = np.sqrt(radius2) / width
    part = float(min(max((size - SMALL) / (LARGE - SMALL), 0.0), 1.0))
    if part == 0.0:
        return np.float32(fading * small)
    area = (size * size + 1.0) * _normal(size) + size * np.exp(-0.5 * size * size) / np.sqrt(2.0 * np.pi)
    large = size * size / area * _normal(size - np.sqrt(off2) / width)
    part *= part * (3.0 - 2.0 * part)
    return np.float32(fading * (small + part * (large - small)))


@compiled
def _normal(x: float) -> float:
    """Return the share of a normal distribution up to x standard deviations."""
    return 0.5 * math.erfc(-x / np.sqrt(2.0))


@compiled
def _in_cone(facing: np.float32, lamps: Lamps, i: int) -> np.float32:
    """Return how bright a ball is along a way of a cosine to its cone's axis."""
    none, whole = lamps.cones[i]
    fading = min(max((facing - none) / (whole - none), NONE), ALL)
    return np.float32(fading * fading * (3.0 - 2.0 * fading))


@compiled
def _image(origin: Float32, lamps: Lamps, i: int, highlights: float) -> np.float32:
    """Return the share of a lamp that is seen from a place in a mirror, and not drawn as a highlight."""
    radius = 0.0
    if lamps.shapes[i] == DISC:
        radius = np.arccos(min(lamps.sizes[i], ALL))
    elif lamps.shapes[i] == BALL and lamps.cones[i, 1] <= EVERYWHERE[1]:
        to_centre = lamps.places[i] - origin
        radius = np.arcsin(min(lamps.sizes[i] / max(np.sqrt(_dot(to_centre, to_centre)), np.float32(1e-20)), ALL))
    share = min(max(radius / highlights - 1.0, 0.0), 1.0)
    return np.float32(share * share * (3.0 - 2.0 * share))


@compiled
def _dot(a: Float32, b: Float32) -> np.float32:
    dot: np.float32 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return dot
