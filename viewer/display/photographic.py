"""The paper's transform: photographic tone reproduction (Reinhard et al. 2002), global operator with a white point."""

import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.display import srgb, tone_map
from milkglass.viewer.display.base import Transform


class Photographic(Transform):
    """Compresses luminance L to L (1 + L / white^2) / (1 + L), and clips what is still brighter than white."""

    @property
    def in_shader(self) -> bool:
        """True: its white point is a slider."""
        return True

    def encoded(self, exposed: npt.ArrayLike, white: float) -> Array:
        """Return colours encoded as sRGB."""
        return srgb(tone_map(exposed, 1.0, white))


TRANSFORM = Photographic()
