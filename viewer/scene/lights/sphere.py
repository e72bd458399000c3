"""Balls that shine: bulbs, lanterns."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from milkglass.core.arrays import Array
from milkglass.viewer.scene.lights.base import NearLight, fixed_to_setting, light_setting
from milkglass.viewer.scene.lights.sub_lights import POINT, SHAPE_BALL, SHAPE_SPHERE, SubLights, spiral

# fmt: off


# Sub-lights of a sphere that needs more are on its surface: it is so near that places of the object see other sides.
MAX_FACING = 32


@dataclass(frozen=True)
class SphereLight(NearLight):
    """A ball of even radiance: a point light with a size."""

    KIND: ClassVar[str] = "sphere"

    radius_mm: float = light_setting(
        "number", 40.0, unit="mm", low=1e-3, high=1e9, why="radius: the larger, the softer are shadows"
    )
    fixed_to: str = fixed_to_setting()

    @property
    def half_extent(self) -> float:
        """See `NearLight.half_extent`."""
        return self.radius_mm

    def widened(self, angle_deg: float) -> "SphereLight":
        """See `Light.widened`; seen from the origin."""
        least = np.linalg.norm(self.position_mm) * np.sin(0.5 * np.radians(angle_deg))
        return replace(self, radius_mm=max(self.radius_mm, float(least)))

    def _divided(self, count: int) -> SubLights:
        centre, radius, near = np.array(self.position_mm), self.radius_mm, count > MAX_FACING
        offsets = radius * _ball(count) if near else self._facing_disc(count)
        cell, shape = float((2.0 if near else 1.0) * radius / np.sqrt(count)), SHAPE_BALL if near else SHAPE_SPHERE
        return SubLights(POINT, self.position_mm, centre + offsets, self.intensity, cell, shape, radius=radius)

    def _facing_disc(self, count: int) -> Array:
        """Offsets (n, 3) in the disc that closes the cone in which the origin sees the ball, even in direction."""
        towards = np.asarray(self.position_mm, np.float64)
        distance = max(float(np.linalg.norm(towards)), 1e-9)
        towards = towards / distance if distance > 1e-9 else np.array([0.0, 0.0, 1.0])
        sine = min(self.radius_mm / distance, 0.99)
        i = np.arange(count) + 0.5
        cosine = 1.0 - (1.0 - np.sqrt(1.0 - sine**2)) * i / count
        plane_distance = distance * (1.0 - sine**2)
        offsets = spiral(towards, plane_distance * np.sqrt(1.0 - cosine**2) / cosine, i)
        return np.asarray(offsets - (distance - plane_distance) * towards)


def _ball(count: int) -> Array:
    """Return unit normals, even over all directions: (n, 3)."""
    i = np.arange(count) + 0.5
    height = 1.0 - 2.0 * i / count
    up = np.array([0.0, 1.0, 0.0])
    return np.asarray(height[:, None] * up + spiral(up, np.sqrt(1.0 - height**2), i))
