"""A kind of light that the viewer does not know: what a new one needs is a class and its line in the registry."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from milkglass.viewer.scene.lights.base import AimedLight, fixed_to_setting, light_setting
from milkglass.viewer.scene.lights.sub_lights import POINT, SHAPE_FACE, SubLights


@dataclass(frozen=True)
class RingLight(AimedLight):
    """Patches on a circle, such as around a lens, that shine by the cosine to its normal."""

    KIND: ClassVar[str] = "ring"

    radius_mm: float = light_setting("number", 50.0, unit="mm", low=1e-3, high=1e9, why="radius of the circle")
    tube_mm: float = light_setting("number", 2.0, unit="mm", low=1e-3, high=1e9, why="thickness of the ring")
    fixed_to: str = fixed_to_setting()

    @property
    def half_extent(self) -> float:
        return self.radius_mm

    def _divided(self, count: int) -> SubLights:
        angles, frame = 2.0 * np.pi * np.arange(count) / count, self.axes
        circle = self.radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1) @ frame[:2]
        normal = tuple(frame[2].tolist())
        vectors = self.position_mm + circle
        return SubLights(POINT, self.position_mm, vectors, self.intensity, self.tube_mm, SHAPE_FACE, normal)
