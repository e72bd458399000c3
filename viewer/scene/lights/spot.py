"""Spot lights."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from milkglass.core.paths.lamps import Lamp
from milkglass.viewer.scene.lights.base import AimedLight, fixed_to_setting, intensity_setting, light_setting
from milkglass.viewer.scene.lights.sub_lights import POINT, SHAPE_CONE, SubLights, Vector

# fmt: off
# ruff: noqa: RUF009  (light_setting() makes a dataclasses.field, fresh for each class)


@dataclass(frozen=True)
class SpotLight(AimedLight):
    """A point light that shines into a cone only."""

    KIND: ClassVar[str] = "spot"

    intensity: Vector = intensity_setting(" along its axis")
    cone_deg: float = light_setting(
        "number", 30.0, unit="deg", low=0.1, high=170, why="full angle of the cone, where it is dark"
    )
    softness: float = light_setting(
        "number", 0.2, low=0, high=1, why="share of that angle over which light fades; 0 is a sharp edge"
    )
    fixed_to: str = fixed_to_setting()

    @property
    def cone(self) -> tuple[float, float]:
        """Cosines to its axis at which it is dark, and from which on it is as bright as along the axis."""
        half = 0.5 * np.radians(self.cone_deg)
        inner = float(np.cos(half * (1.0 - self.softness)))
        return float(np.cos(half)), max(inner, float(np.cos(half)) + 1e-6)

    def seen(self) -> Lamp:
        """See `Light.seen`."""
        x, y, z = self.axes[2].tolist()
        return replace(super().seen(), forward=(x, y, z), cone=self.cone)

    def _divided(self, count: int) -> SubLights:
        x, y, z = self.axes[2].tolist()
        centre = np.array([self.position_mm], np.float64)
        return SubLights(POINT, self.position_mm, centre, self.intensity, 0.0, SHAPE_CONE, (x, y, z), self.cone)
