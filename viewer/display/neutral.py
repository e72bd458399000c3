"""Khronos PBR Neutral (Khronos Group 2024, PBR Neutral Tone Mapper specification; Lalish 2024).

Colours are shown as they are up to 0.8, less 0.04 for what a dielectric mirrors at normal incidence; above, the
brightest channel is compressed and the colour bleached towards white.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.viewer.display.base import Transform

MIRRORED = 0.04  # F_90 = 1, F_0 = 0.04
START = 0.8 - MIRRORED  # from where on the brightest channel is compressed
DESATURATION = 0.15


class Neutral(Transform):
    """Keeps the colours of materials."""

    def encoded(self, exposed: npt.ArrayLike, white: float) -> Array:
        """Return colours encoded as sRGB."""
        rgb = np.asarray(exposed, np.float64)
        darkest = rgb.min(axis=-1, keepdims=True)
        rgb = rgb - np.where(darkest < 2.0 * MIRRORED, darkest - darkest**2 / (4.0 * MIRRORED), MIRRORED)
        peak = rgb.max(axis=-1, keepdims=True)
        compressed = 1.0 - (1.0 - START) ** 2 / (np.maximum(peak, START) + 1.0 - 2.0 * START)
        bleach = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0)
        bright = rgb * compressed / np.maximum(peak, START)
        return srgb(np.where(peak < START, rgb, bright + bleach * (compressed - bright)))


TRANSFORM = Neutral()
