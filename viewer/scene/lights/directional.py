"""Distant lights: the sun, a far lamp, a strong small source of a light probe."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from milkglass.core.paths.lamps import DISC, LEAST_ANGLE_DEG, Lamp
from milkglass.viewer.scene.declaration import plain
from milkglass.viewer.scene.lights.base import DEFAULT_DISTANCE, Light, fixed_to_setting, light_setting, on_setting
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, SubLights, Vector, spiral

# fmt: off
# ruff: noqa: RUF009  (light_setting() makes a dataclasses.field, fresh for each class)


@dataclass(frozen=True)
class DirectionalLight(Light):
    """A distant light: a direction, or a disc of even radiance."""

    KIND: ClassVar[str] = "directional"
    DISTANT: ClassVar[bool] = True
    BRIGHTNESS: ClassVar[str] = "irradiance"
    VECTORS: ClassVar[tuple[str, ...]] = ("direction",)

    direction: Vector = light_setting(
        "number", length=3, low=-1e6, high=1e6, nonzero=True, why="towards the light; any length",
        tip="direction towards the light"
    )
    irradiance: Vector = light_setting(
        "number", (3.0, 3.0, 3.0), length=3, low=0, high=1e9,
        why="R, G, B irradiance at normal incidence; about pi makes a white surface radiance 1"
    )
    on: bool = on_setting()
    angle_deg: float = light_setting(
        "number", 0.0, unit="deg", low=0, high=90,
        why="angular diameter: shadows are as soft; the sun has 0.5, 0 is sharp"
    )
    fixed_to: str = fixed_to_setting()

    @property
    def is_sharp(self) -> bool:
        """See `Light.is_sharp`."""
        return self.angle_deg == 0.0

    def widened(self, angle_deg: float) -> "DirectionalLight":
        """See `Light.widened`."""
        return replace(self, angle_deg=max(self.angle_deg, angle_deg))

    def apparent_deg(self, mesh_radius: float) -> float:
        """See `Light.apparent_deg`."""
        return self.angle_deg

    def sub_lights(self, count: int, far: float = np.inf) -> SubLights:
        """Return directions that fill the disc's cone evenly."""
        half = 0.5 * np.radians(self.angle_deg)
        towards = np.asarray(self.direction, np.float64) / np.linalg.norm(self.direction)
        i = np.arange(count) + 0.5
        cosine = 1.0 - (1.0 - np.cos(half)) * i / count
        offsets = spiral(towards, np.sqrt(1.0 - cosine**2), i)
        # A surface that faces the disc gets less of a direction at its rim; the irradiance is meant for all together.
        rim_gain = 2.0 / (1.0 + np.cos(half))
        red, green, blue = (rim_gain * channel for channel in self.irradiance)
        cell = float(2.0 * np.sin(0.5 * half) / np.sqrt(count))
        x, y, z = towards.tolist()
        vectors = cosine[:, None] * towards + offsets
        return SubLights(DIRECTIONAL, (x, y, z), vectors, (red, green, blue), cell, radius=float(half))

    def seen(self) -> Lamp:
        """See `Light.seen`."""
        half = 0.5 * np.radians(max(self.angle_deg, LEAST_ANGLE_DEG))
        x, y, z = (np.asarray(self.direction, np.float64) / np.linalg.norm(self.direction)).tolist()
        red, green, blue = (channel / (np.pi * np.sin(half) ** 2) for channel in self.irradiance)
        return Lamp(DISC, (x, y, z), (red, green, blue), float(np.cos(half)))

    @classmethod
    def _values_like(cls, light: Light) -> dict[str, Any]:
        direction, irradiance = light.as_distant()
        return super()._values_like(light) | {"direction": direction, "irradiance": irradiance}

    def as_near(self) -> tuple[Vector, Vector]:
        """See `Light.as_near`."""
        x, y, z = (DEFAULT_DISTANCE * np.array(self.direction) / np.linalg.norm(self.direction)).tolist()
        red, green, blue = (channel * DEFAULT_DISTANCE**2 for channel in self.irradiance)
        return (plain(x), plain(y), plain(z)), (red, green, blue)

    def as_distant(self) -> tuple[Vector, Vector]:
        """See `Light.as_distant`."""
        return self.direction, self.irradiance
