"""Display transform in float64: photographic tone reproduction (Reinhard et al. 2002), then sRGB.

The shaders do the same on the GPU; this is what they are tested against.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32


def linear(srgb: npt.NDArray[np.floating]) -> Float32:
    """Decode sRGB in [0, 1] (IEC 61966-2-1); inverse of `core.display.srgb`."""
    srgb = np.asarray(srgb, np.float32)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** np.float32(2.4)).astype(np.float32)


LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709
# Floor of the logarithm, in mean luminances: unlit parts must not drive the exposure to infinity, nor may the
# floor depend on the unit of light.
LOG_FLOOR = 1e-2


def luminance(rgb: npt.ArrayLike) -> Array:
    """Luminance of linear RGB (..., 3)."""
    return np.asarray(np.asarray(rgb, np.float64) @ LUMINANCE)


def log_average(values: npt.ArrayLike, coverage: npt.ArrayLike) -> float:
    """Log-average luminance over the object, equation (1) of Reinhard et al. 2002; 0 where nothing is lit.

    Parameters
    ----------
    values : (...) array
        Luminance, >= 0.
    coverage : (...) array
        Weight of each value, [0, 1].
    """
    values, coverage = np.asarray(values, np.float64), np.asarray(coverage, np.float64)
    total = float(coverage.sum())
    mean = float((coverage * values).sum()) / total if total > 0.0 else 0.0
    if mean == 0.0:
        return 0.0
    return float(np.exp((coverage * np.log(LOG_FLOOR * mean + values)).sum() / total))


def tone_map(rgb: npt.ArrayLike, exposure: float, white: float) -> Array:
    """Scale luminance by L (1 + L / white^2) / (1 + L), L = exposure * luminance: linear RGB, may exceed 1."""
    rgb = np.asarray(rgb, np.float64)
    scaled = exposure * luminance(rgb)[..., None]
    return exposure * rgb * (1.0 + scaled / white**2) / (1.0 + scaled)


def srgb(linear: npt.ArrayLike) -> Array:
    """Encode linear values, clipped to [0, 1], as sRGB in [0, 1] (IEC 61966-2-1)."""
    x = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)
