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


def luminance(rgb: npt.ArrayLike) -> Array:
    """Luminance of linear RGB (..., 3)."""
    return np.asarray(np.asarray(rgb, np.float64) @ LUMINANCE)


def brightest(rgb: npt.ArrayLike) -> Array:
    """Return the brightest channel of RGB (..., 3), by which pictures are exposed.

    Exposed by luminance, which weighs red by 0.21 and blue by 0.07, saturated colours would leave the display's gamut.
    """
    return np.asarray(np.max(np.asarray(rgb, np.float64), axis=-1))


def log_average(values: npt.ArrayLike, coverage: npt.ArrayLike) -> float:
    """Return the log-average brightness of what is lit of the object; 0 where nothing is.

    Equation (1) of Reinhard et al. 2002 with weights L / (L + mean L) in place of its floor: deep shadow, whose
    logarithms would drag the average down, does not count, and a highlight counts by its area.

    Parameters
    ----------
    values : (...) array
        Brightness of each pixel, see `brightest`; what is negative or not finite does not count.
    coverage : (...) array
        Weight of each value, [0, 1].
    """
    lit, share = np.asarray(values, np.float64), np.asarray(coverage, np.float64)
    counts = np.isfinite(lit) & (lit >= 0.0) & (share > 0.0)
    total = float((share * lit)[counts].sum())
    if total == 0.0:
        return 0.0
    mean = total / float(share[counts].sum())
    counts &= lit > 0.0
    weights = share[counts] * lit[counts] / (lit[counts] + mean)
    return float(np.exp((weights * np.log(lit[counts])).sum() / weights.sum()))


def tone_map(rgb: npt.ArrayLike, exposure: float, white: float) -> Array:
    """Scale luminance by L (1 + L / white^2) / (1 + L), L = exposure * luminance: linear RGB, may exceed 1."""
    rgb = np.asarray(rgb, np.float64)
    scaled = exposure * luminance(rgb)[..., None]
    return exposure * rgb * (1.0 + scaled / white**2) / (1.0 + scaled)


def srgb(linear: npt.ArrayLike) -> Array:
    """Encode linear values, clipped to [0, 1], as sRGB in [0, 1] (IEC 61966-2-1)."""
    x = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)
