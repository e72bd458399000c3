"""Panels that shine: soft boxes, windows."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.paths.lamps import PANEL, Lamp
from milkglass.viewer.scene.lights.base import AimedLight, fixed_to_setting, intensity_setting, light_setting
from milkglass.viewer.scene.lights.sub_lights import POINT, SHAPE_FACE, SubLights, Vector, lattice

# fmt: off
# ruff: noqa: RUF009  (light_setting() makes a dataclasses.field, fresh for each class)


@dataclass(frozen=True)
class RectangleLight(AimedLight):
    """A panel that shines from its front, by the cosine to its normal."""

    KIND: ClassVar[str] = "rectangle"

    intensity: Vector = intensity_setting(" along its normal")
    size_mm: tuple[float, float] = light_setting(
        "number", (120.0, 120.0), unit="mm", length=2, low=1e-3, high=1e9, why="width and height"
    )
    roll_deg: float = light_setting("number", 0.0, unit="deg", low=-360, high=360, why="turn about its normal")
    fixed_to: str = fixed_to_setting()

    @property
    def half_extent(self) -> float:
        """See `NearLight.half_extent`."""
        return 0.5 * max(self.size_mm)

    @property
    def axes(self) -> Array:
        """See `AimedLight.axes`; turned by the roll."""
        width, height, forward = super().axes
        roll = np.radians(self.roll_deg)
        turned_width = np.cos(roll) * width + np.sin(roll) * height
        return np.stack([turned_width, np.cross(forward, turned_width), forward])

    def widened(self, angle_deg: float) -> "RectangleLight":
        """See `Light.widened`; of the shorter side, seen from the origin."""
        least = 2.0 * float(np.linalg.norm(self.position_mm) * np.tan(0.5 * np.radians(angle_deg)))
        scale = max(1.0, least / min(self.size_mm))
        return replace(self, size_mm=(scale * self.size_mm[0], scale * self.size_mm[1]))

    def turned(self, turn: Array) -> Self:
        """See `Light.turned`; the roll about the new normal keeps the sides where the turn takes them."""
        width, moved = self.axes[0] @ turn, super().turned(turn)
        upright = super(RectangleLight, moved).axes
        return moved.with_values(roll_deg=float(np.degrees(np.arctan2(width @ upright[1], width @ upright[0]))))

    def seen(self) -> Lamp:
        """See `Light.seen`."""
        half = 0.5 * np.array([*self.size_mm, 2.0])[:, None] * self.axes
        width, height, forward = ((float(x), float(y), float(z)) for x, y, z in half)
        red, green, blue = (channel / (self.size_mm[0] * self.size_mm[1]) for channel in self.intensity)
        return Lamp(PANEL, self.position_mm, (red, green, blue), 0.0, width, height, forward)

    def _divided(self, count: int) -> SubLights:
        width, height, (x, y, z) = self.axes
        places = lattice(count) * self.size_mm
        cell = float(np.sqrt(self.size_mm[0] * self.size_mm[1] / (np.pi * count)))
        vectors = np.array(self.position_mm) + places @ np.stack([width, height])
        normal = float(x), float(y), float(z)
        return SubLights(POINT, self.position_mm, vectors, self.intensity, cell, SHAPE_FACE, normal)
