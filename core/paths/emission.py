"""Light on its way to an object: rays from distant lights, near ones, and from all around.

Rays are stratified, and their places follow from their number alone: whatever the colours of a light, the same rays
carry it, so that no noise moves with a slider.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Floats
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.normals import across
from milkglass.core.light.maps import latlong_to_direction, texel_solid_angles
from milkglass.core.paths.beams import Emitted

LEAST_MET = 0.05  # of rays onto a ball: more are not cast than make up for it
BESIDE = 1e-4  # radii that a box is taken to be larger


@dataclass(frozen=True)
class Ball:
    """A sphere around an object: its centre, (3,), and radius, mm, and the object's box along the axes, (2, 3) mm.

    Rays are cast onto the sphere, and those that miss the box are left out: of a bottle's three in four.
    """

    centre: Array
    radius: float
    box: Array

    @classmethod
    def around(cls, mesh: Mesh) -> "Ball":
        """Return the sphere about the middle of a mesh's box that holds the mesh."""
        return cls.holding(mesh.vertices)

    @classmethod
    def holding(cls, points: Floats) -> "Ball":
        """Return the sphere about the middle of the box of points (n, 3) that holds them."""
        box = np.array([points.min(axis=0), points.max(axis=0)], np.float64)
        centre = box.mean(axis=0)
        return cls(centre, float(np.linalg.norm(points - centre, axis=1).max()), box)

    def met(self, count: int, cast: Callable[[int], Emitted]) -> Emitted:
        """Return about `count` rays that meet the box, of as many more as it takes; `cast` gives so many of a light."""
        first = self._meeting(few := cast(count))
        share = max(len(first.power) / max(len(few.power), 1), LEAST_MET)
        return first if share == 1.0 else self._meeting(cast(int(count / share)))

    def _meeting(self, light: Emitted) -> Emitted:
        """Return the rays that meet the box."""
        low, high = self.box[0] - BESIDE * self.radius, self.box[1] + BESIDE * self.radius
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.stack([low, high])[:, None] - light.origins) / light.directions
        near, far = np.fmin(*ends).max(axis=1), np.fmax(*ends).min(axis=1)
        meets = (near <= far) & (far >= 0.0)
        return Emitted(light.origins[meets], light.directions[meets], light.power[meets])


def parallel(towards: npt.ArrayLike, irradiance: npt.ArrayLike, ball: Ball, count: int) -> Emitted:
    """Return about `count` rays from the unit direction `towards`, of an irradiance (3,) on what faces it."""
    return ball.met(count, lambda number: _parallel(np.asarray(towards, np.float64), irradiance, ball, number))


def _parallel(axis: Array, irradiance: npt.ArrayLike, ball: Ball, count: int) -> Emitted:
    u, v = _strata(count)
    r, angle = ball.radius * np.sqrt(u), 2.0 * np.pi * v
    first, second = across(axis[None])
    places = ball.centre + ball.radius * axis + (r * np.cos(angle))[:, None] * first
    places += (r * np.sin(angle))[:, None] * second
    share = np.full(len(u), np.pi * ball.radius**2 / len(u))
    return _emitted(places, np.broadcast_to(-axis, places.shape), share[:, None] * np.asarray(irradiance))


def diverging(
    place: npt.ArrayLike, emission: Callable[[Array], Array], colour: npt.ArrayLike, ball: Ball, count: int
) -> Emitted:
    """Return about `count` rays from a place, mm, into the cone in which an object lies.

    Parameters
    ----------
    place : (3,)
    emission : callable
        Irradiance over `colour`, (n,), at points (n, 3) that face the light.
    colour : (3,)
    ball : Ball
    count : int
    """
    origin, shining = np.asarray(place, np.float64), np.asarray(colour, np.float64)
    return ball.met(count, lambda number: _diverging(origin, emission, shining, ball, number))


def _diverging(origin: Array, emission: Callable[[Array], Array], colour: Array, ball: Ball, count: int) -> Emitted:
    axis = ball.centre - origin
    distance = max(float(np.linalg.norm(axis)), 1e-9)
    sine = min(ball.radius / distance, 1.0)
    rim = np.sqrt(1.0 - sine * sine) if distance > ball.radius else -1.0
    u, v = _strata(count)
    mu, angle = 1.0 - u * (1.0 - rim), 2.0 * np.pi * v
    first, second = across(axis[None] / distance)
    sine_mu = np.sqrt(np.maximum(1.0 - mu * mu, 0.0))
    directions = mu[:, None] * axis / distance + (sine_mu * np.cos(angle))[:, None] * first
    directions += (sine_mu * np.sin(angle))[:, None] * second
    intensity = distance**2 * emission(origin + distance * directions)
    power = (intensity * 2.0 * np.pi * (1.0 - rim) / len(u))[:, None] * colour
    return _emitted(np.broadcast_to(origin, directions.shape), directions, power)


def surrounding(latlong: Floats, to_probe: Array, ball: Ball, count: int) -> Emitted:
    """Return about `count` rays of light from all around, in directions of a density like the luminance there.

    Directions are in the order of the map's texels and places across them those of a sequence, so that what comes from
    a region of any size covers the object evenly.

    Parameters
    ----------
    latlong : (h, 2 h, 3) array
        Radiance, as `core.light.probe.Probe` has it.
    to_probe : (3, 3) array
        From world space to the probe's frame, row vectors.
    ball : Ball
    count : int
    """
    return ball.met(count, lambda number: _surrounding(latlong, to_probe, ball, number))


def _surrounding(latlong: Floats, to_probe: Array, ball: Ball, count: int) -> Emitted:
    radiance = latlong.reshape(-1, 3).astype(np.float64)
    height, width = latlong.shape[:2]
    solid_angles = np.repeat(texel_solid_angles(latlong), width)
    total = np.cumsum(solid_angles * radiance.sum(axis=1))
    chosen = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1]).clip(0, len(total) - 1)
    row, column = np.divmod(chosen, width)
    x, y, u, v = sequence(4, count)
    towards = latlong_to_direction(np.stack([(column + x) / width, (row + y) / height], axis=1)) @ to_probe.T
    first, second = across(towards)
    r, angle = ball.radius * np.sqrt(u), 2.0 * np.pi * v
    places = ball.centre + ball.radius * towards
    places += (r * np.cos(angle))[:, None] * first + (r * np.sin(angle))[:, None] * second
    share = np.pi * ball.radius**2 / count * total[-1] / np.maximum(radiance[chosen].sum(axis=1), 1e-300)
    return _emitted(places, -towards, share[:, None] * radiance[chosen])


def _strata(count: int) -> tuple[Array, Array]:
    """Return a jittered grid over the unit square, of at least `count` places: (n,) each."""
    side = int(np.ceil(np.sqrt(count)))
    random = np.random.default_rng(0).random((2, side * side))
    row, column = np.divmod(np.arange(side * side), side)
    return (row + random[0]) / side, (column + random[1]) / side


def sequence(dimensions: int, count: int) -> Array:
    """Return a Kronecker sequence of the generalised golden ratio: (dimensions, count) in [0, 1)."""
    ratio = 1.0
    for _ in range(32):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1.0))
    steps = ratio ** -np.arange(1.0, dimensions + 1.0)
    return np.asarray((0.5 + steps[:, None] * np.arange(1.0, count + 1.0)) % 1.0)


def _emitted(origins: Array, directions: Array, power: Array) -> Emitted:
    bright = power.any(axis=1)
    return Emitted(*(np.array(part[bright], np.float32, order="C") for part in (origins, directions, power)))
