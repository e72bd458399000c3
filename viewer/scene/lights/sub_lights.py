"""Lights with a size as sub-lights: points or directions spread evenly over it, each with an equal share.

The same light has the same sub-lights, so that nothing flickers. They are low-discrepancy point sets (a golden spiral
over a disc, a Fibonacci lattice over a rectangle). Mirrors shaders/light/arrival_soft.glsl.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.normals import across

Vector = tuple[float, float, float]

DIRECTIONAL, POINT, ENVIRONMENT, REENTERING = range(4)  # kinds of light; the last two have no sub-lights
SHAPE_EVEN, SHAPE_SPHERE, SHAPE_FACE, SHAPE_CONE, SHAPE_BALL = range(5)
GOLDEN_RATIO = 0.6180339887498949  # its fractional part; in turns, 1 less it is the golden angle
PARTS = 4  # numbers of sub-lights are multiples of it, so that a pixel's samples can share them out


@dataclass(frozen=True, eq=False)
class SubLights:
    """The points or directions that stand for one light, each with an equal share of it.

    Attributes
    ----------
    kind : int
        DIRECTIONAL or POINT.
    vector : 3 floats
        Of the light: the unit direction towards its middle, or the place of its middle, mm.
    vectors : (n, 3) float64
        The same of each sub-light.
    colour : 3 floats
        Irradiance or radiant intensity of all sub-lights together, as a surface receives it that faces the whole light.
    cell : float
        Radius of the disc that has a sub-light's share of the light: radians or mm.
    shape : int
        SHAPE_EVEN, SHAPE_SPHERE, SHAPE_FACE, SHAPE_CONE or SHAPE_BALL, a sphere in patches of its surface.
    axis : 3 floats
        Unit direction in which a SHAPE_FACE or a SHAPE_CONE shines.
    cone : 2 floats
        Cosines to the axis where a SHAPE_CONE is dark, and from where on it is not dimmed.
    radius : float
        Of a SHAPE_SPHERE or a SHAPE_BALL, mm; of a SHAPE_EVEN that is a disc, radians, else 0.
    """

    kind: int
    vector: Vector
    vectors: Array
    colour: Vector
    cell: float
    shape: int = SHAPE_EVEN
    axis: Vector = (0.0, 0.0, 1.0)
    cone: tuple[float, float] = (0.0, 1.0)
    radius: float = 0.0

    def __len__(self) -> int:
        return len(self.vectors)

    def emission(self, i: int, points: npt.ArrayLike) -> Array:
        """Return the irradiance (n,) of sub-light i over its share of `colour`, at points (n, 3) that face it."""
        points = np.asarray(points, np.float64)
        if self.kind == DIRECTIONAL:
            return np.ones(len(points))
        towards = self.vectors[i] - points
        distance2 = np.maximum(np.einsum("ij,ij->i", towards, towards), 1e-12)
        along = -(towards @ np.array(self.axis)) / np.sqrt(distance2)
        if self.shape == SHAPE_FACE:
            return np.asarray(np.maximum(along, 0.0) / distance2)
        if self.shape == SHAPE_CONE:
            low, high = self.cone
            t = np.clip((along - low) / (high - low), 0.0, 1.0)
            return np.asarray(t * t * (3.0 - 2.0 * t) / distance2)
        if self.shape == SHAPE_BALL:
            normal = (self.vectors[i] - np.array(self.vector)) / self.radius
            return np.asarray(4.0 * np.maximum(-(towards @ normal), 0.0) / distance2**1.5)
        # A sphere: 2 (1 - cos a) / sin^2 a / d^2 at an angular radius a, sin a = radius / d (arrival_soft.glsl).
        centre2 = np.maximum(np.square(np.array(self.vector) - points).sum(axis=1), max(self.radius**2, 1e-12))
        return np.asarray(2.0 / (1.0 + np.sqrt(1.0 - self.radius**2 / centre2)) / centre2)

    def as_directions(self) -> "SubLights":
        """Return places that are far away as directions: their rays are parallel at the object about the origin."""
        distance = np.linalg.norm(self.vectors, axis=1)
        factors = [float(self.emission(i, np.zeros((1, 3)))[0]) for i in range(len(self))]
        red, green, blue = (float(np.mean(factors)) * channel for channel in self.colour)
        x, y, z = (np.array(self.vector) / np.linalg.norm(self.vector)).tolist()
        cell = self.cell / float(distance.mean())
        return SubLights(DIRECTIONAL, (x, y, z), self.vectors / distance[:, None], (red, green, blue), cell)


def spiral(axis: Array, radii: npt.NDArray[np.floating], i: npt.NDArray[np.floating]) -> Array:
    """Return the points (n, 3) of a golden spiral about a unit axis (3,), at `radii` (n,) in the plane across it.

    `i` (n,) counts them from 1/2 on.
    """
    first, second = across(axis[None])
    angle = 2.0 * np.pi * GOLDEN_RATIO * i
    circle = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return np.asarray(radii[:, None] * circle)


def lattice(count: int) -> Array:
    """Return the points of a Fibonacci lattice in the square [-1/2, 1/2]^2: (n, 2)."""
    i = np.arange(count) + 0.5
    return np.stack([i / count, (i * GOLDEN_RATIO) % 1.0], axis=1) - 0.5
