"""Point lights."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from milkglass.viewer.scene.lights.base import NearLight, fixed_to_setting
from milkglass.viewer.scene.lights.sphere import SphereLight
from milkglass.viewer.scene.lights.sub_lights import POINT, SubLights


@dataclass(frozen=True)
class PointLight(NearLight):
    """A near light: E = I cos / d^2."""

    KIND: ClassVar[str] = "point"

    fixed_to: str = fixed_to_setting()

    @property
    def is_sharp(self) -> bool:
        """See `Light.is_sharp`."""
        return True

    def widened(self, angle_deg: float) -> NearLight:
        """See `Light.widened`: a ball."""
        return SphereLight.like(self).widened(angle_deg)

    def _divided(self, count: int) -> SubLights:
        return SubLights(POINT, self.position_mm, np.array([self.position_mm], np.float64), self.intensity, 0.0)
