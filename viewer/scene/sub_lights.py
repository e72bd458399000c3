"""Lights with a size as sub-lights: points or directions spread evenly over it, each with an equal share.

The same places for the same light, so that nothing flickers; the first tell of all of it as well as their number lets
them (a spiral over a disc, a Fibonacci lattice over a rectangle). Mirrors shaders/light/arrival_soft.glsl.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.normals import across
from milkglass.viewer.scene.lights import (
    DirectionalLight,
    Light,
    PointLight,
    RectangleLight,
    SphereLight,
    SpotLight,
    axes,
    brightness,
)

Vector = tuple[float, float, float]

DIRECTIONAL, POINT, ENVIRONMENT = range(3)  # kinds of light; the last has no sub-lights
EVEN, SPHERE, FACE, CONE, BALL = range(5)  # shapes
GOLDEN = 0.6180339887498949  # turns: 1 - this is the golden angle's share
PLASTIC = 0.7548776662466927  # of the next dimension (the R2 sequence)
PARTS = 4  # numbers of sub-lights are multiples of it, so that a pixel's samples can share them out
MOST, MOST_DRAFT = 96, 8
FROM_AFAR = 32  # sub-lights of a sphere: one that needs more is so near that places of the object see other sides of it
SMALL_DEG = 1.0  # apparent diameter of a light that one shadow map and its filter do for
DEGREES_EACH = 2.0  # of the diameter: mean absolute errors of irradiance are then 1 to 3.5 %


@dataclass(frozen=True, eq=False)
class SubLights:
    """What stands for one light with a size.

    Attributes
    ----------
    kind : int
        DIRECTIONAL or POINT.
    vector : 3 floats
        Unit, towards its middle; or where that is, mm.
    vectors : (n, 3) float64
        The same of each sub-light.
    colour : 3 floats
        Irradiance or intensity of all together, so that a surface that faces the light and sees it all gets it.
    cell : float
        Radius of the disc that has a sub-light's share of the light: radians or mm.
    shape : int
        EVEN, SPHERE, FACE, CONE or BALL, a sphere in patches of its surface.
    axis : 3 floats
        Unit, the way it shines; of FACE and CONE.
    cone : 2 floats
        Cosines to the axis where a CONE is dark, and from where on it is not dimmed.
    radius : float
        Of a SPHERE or a BALL, mm.
    """

    kind: int
    vector: Vector
    vectors: Array
    colour: Vector
    cell: float
    shape: int = EVEN
    axis: Vector = (0.0, 0.0, 1.0)
    cone: tuple[float, float] = (0.0, 1.0)
    radius: float = 0.0

    def __len__(self) -> int:
        return len(self.vectors)

    def emission(self, i: int, points: npt.ArrayLike) -> Array:
        """Irradiance of a sub-light over its share of `colour`, on surfaces at points (n, 3) that face it: (n,)."""
        points = np.asarray(points, np.float64)
        if self.kind == DIRECTIONAL:
            return np.ones(len(points))
        way = self.vectors[i] - points
        distance2 = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
        along = -(way @ np.array(self.axis)) / np.sqrt(distance2)
        if self.shape == FACE:
            return np.asarray(np.maximum(along, 0.0) / distance2)
        if self.shape == CONE:
            low, high = self.cone
            t = np.clip((along - low) / (high - low), 0.0, 1.0)
            return np.asarray(t * t * (3.0 - 2.0 * t) / distance2)
        if self.shape == BALL:
            normal = (self.vectors[i] - np.array(self.vector)) / self.radius
            return np.asarray(4.0 * np.maximum(-(way @ normal), 0.0) / distance2**1.5)
        centre2 = np.maximum(np.square(np.array(self.vector) - points).sum(axis=1), max(self.radius**2, 1e-12))
        return np.asarray(2.0 / (1.0 + np.sqrt(1.0 - self.radius**2 / centre2)) / centre2)


def apparent_deg(light: Light, mesh_radius: float) -> float:
    """Angular diameter of a light as the side of the object that is next to it sees it, degrees; the larger side's."""
    if isinstance(light, DirectionalLight):
        return light.angle_deg
    distance = float(np.linalg.norm(light.position_mm))
    half = 0.0
    if isinstance(light, SphereLight):
        half = light.radius_mm
    elif isinstance(light, RectangleLight):
        half = 0.5 * max(light.size_mm)
    return 2.0 * float(np.degrees(np.arctan(half / max(distance - mesh_radius, 0.25 * distance, 1e-9))))


def sub_light_count(light: Light, mesh_radius: float, draft: bool = False) -> int:
    """How many sub-lights a light needs: few where the filter of a shadow alone is about right, or for a draft."""
    angle = apparent_deg(light, mesh_radius)
    if angle <= SMALL_DEG:
        return 1
    # Across a flat light: what it is beside the object for counts as well, and a panel that nearly touches needs many.
    across = float(np.degrees(2.0 * np.tan(0.5 * np.radians(min(angle, 170.0)))))
    count = min(MOST, PARTS * int(np.ceil(across / DEGREES_EACH / PARTS)))
    if draft:
        return 1 if count == PARTS else min(2 + count // 6, MOST_DRAFT)
    return count


def sub_lights(light: Light, count: int, far: float = np.inf) -> SubLights:
    """Divide a light, in world space, into a number of sub-lights; one farther away than `far` mm as directions."""
    if isinstance(light, DirectionalLight):
        return _disc(light, count)
    assert not isinstance(light, PointLight)
    colour, centre = brightness(light), np.array(light.position_mm)
    if isinstance(light, SphereLight):
        radius, near = light.radius_mm, count > FROM_AFAR
        offsets = radius * _ball(count) if near else _facing_disc(light, count)
        cell, shape = float((2.0 if near else 1.0) * radius / np.sqrt(count)), BALL if near else SPHERE
        found = SubLights(POINT, light.position_mm, centre + offsets, colour, cell, shape, radius=radius)
    elif isinstance(light, RectangleLight):
        width, height, (x, y, z) = axes(light)
        places = _lattice(count) * light.size_mm
        cell = float(np.sqrt(light.size_mm[0] * light.size_mm[1] / (np.pi * count)))
        vectors = centre + places @ np.stack([width, height])
        found = SubLights(POINT, light.position_mm, vectors, colour, cell, FACE, (float(x), float(y), float(z)))
    else:
        found = _spot(light)
    return found if np.linalg.norm(centre) <= far else _as_directions(found)


def _disc(light: DirectionalLight, count: int) -> SubLights:
    """Directions that fill a cone evenly."""
    half = 0.5 * np.radians(light.angle_deg)
    towards = np.asarray(light.direction, np.float64) / np.linalg.norm(light.direction)
    i = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.cos(half)) * i / count
    around = _around(towards, np.sqrt(1.0 - cosine**2), i)
    # A surface that faces the disc gets less of a direction at its rim; the irradiance is meant for all together.
    more = 2.0 / (1.0 + np.cos(half))
    red, green, blue = (more * channel for channel in light.irradiance)
    cell = float(2.0 * np.sin(0.5 * half) / np.sqrt(count))
    x, y, z = towards.tolist()
    return SubLights(DIRECTIONAL, (x, y, z), cosine[:, None] * towards + around, (red, green, blue), cell)


def _facing_disc(light: SphereLight, count: int) -> Array:
    """Offsets in the disc that closes the cone in which the origin sees a ball: even in direction from there."""
    towards = np.asarray(light.position_mm, np.float64)
    distance = max(float(np.linalg.norm(towards)), 1e-9)
    towards = towards / distance if distance > 1e-9 else np.array([0.0, 0.0, 1.0])
    sine = min(light.radius_mm / distance, 0.99)
    i = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.sqrt(1.0 - sine**2)) * i / count
    away = distance * (1.0 - sine**2)
    around = _around(towards, away * np.sqrt(1.0 - cosine**2) / cosine, i)
    return np.asarray(around - (distance - away) * towards)


def _ball(count: int) -> Array:
    """Unit normals, even over all directions: (n, 3)."""
    i = np.arange(count) + 0.5
    height = 1.0 - 2.0 * i / count
    up = np.array([0.0, 1.0, 0.0])
    return np.asarray(height[:, None] * up + _around(up, np.sqrt(1.0 - height**2), i))


def _around(axis: Array, radii: npt.NDArray[np.floating], i: npt.NDArray[np.floating]) -> Array:
    """Points of a golden spiral about an axis, in the plane across it: (n, 3)."""
    first, second = across(axis[None])
    angle = 2.0 * np.pi * GOLDEN * i
    circle = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return np.asarray(radii[:, None] * circle)


def _lattice(count: int) -> Array:
    """(n, 2) in [-1/2, 1/2]."""
    i = np.arange(count) + 0.5
    return np.stack([i / count, (i * GOLDEN) % 1.0], axis=1) - 0.5


def _spot(light: SpotLight) -> SubLights:
    x, y, z = axes(light)[2].tolist()
    half = 0.5 * np.radians(light.cone_deg)
    inner = float(np.cos(half * (1.0 - light.softness)))
    cone = float(np.cos(half)), max(inner, float(np.cos(half)) + 1e-6)
    centre = np.array([light.position_mm], np.float64)
    return SubLights(POINT, light.position_mm, centre, light.intensity, 0.0, CONE, (x, y, z), cone)


def _as_directions(found: SubLights) -> SubLights:
    """So far away that their rays are parallel."""
    distance = np.linalg.norm(found.vectors, axis=1)
    factors = [float(found.emission(i, np.zeros((1, 3)))[0]) for i in range(len(found))]
    red, green, blue = (float(np.mean(factors)) * channel for channel in found.colour)
    x, y, z = (np.array(found.vector) / np.linalg.norm(found.vector)).tolist()
    cell = found.cell / float(distance.mean())
    return SubLights(DIRECTIONAL, (x, y, z), found.vectors / distance[:, None], (red, green, blue), cell)
