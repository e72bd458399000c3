"""Sums of Gaussians, and the classic six of skin (d'Eon and Luebke 2007, GPU Gems 3, chapter 14, figure 14-13).

(a)  R_d(rho) = sum_i w_i exp(-rho^2 / (2 v_i)) / (2 pi v_i),   variances v_i in mm^2, weights w_i of a channel
(b)  2 pi int_0^r R_d r' dr' = sum_i w_i exp(-e^2 / (2 v_i)) (1 - exp(-r^2 / (2 v_i))),   on a plane at distance e
(c)  F(k) = sum_i w_i exp(-e^2 / (2 v_i) - v_i k^2 / 2)

The published weights sum to 1: a white that a colour texture multiplies. Here the sum of each channel is the diffuse
reflectance of the material, while the widths are those of skin, whatever the mean free path.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family
from milkglass.core.profiles.dipole import dipoles

LEAST_EXPONENT = -700.0  # below it exp underflows, which takes 7 to 40 times as long, and is 0 here

# Variance, mm^2, and the weights of red, green and blue.
SKIN = (
    (0.0064, 0.233, 0.455, 0.649),
    (0.0484, 0.100, 0.336, 0.344),
    (0.187, 0.118, 0.198, 0.0),
    (0.567, 0.113, 0.007, 0.007),
    (1.99, 0.358, 0.004, 0.0),
    (7.41, 0.078, 0.0, 0.0),
)


@dataclass(frozen=True)
class Gaussians:
    """The profile of one colour channel.

    Parameters
    ----------
    weights : share of the flux of each, >= 0; all 0 makes every value 0
    variances : mm^2, > 0
    """

    weights: tuple[float, ...]
    variances: tuple[float, ...]

    @property
    def is_black(self) -> bool:
        """Whether no light leaves by scattering."""
        return not any(self.weights)

    @property
    def mean_free_path(self) -> float:
        """Standard deviation of the narrowest Gaussian, mm."""
        return float(np.sqrt(min((v for w, v in self._pairs if w > 0.0), default=1.0)))

    @property
    def detail(self) -> float:
        """Geometric mean of the narrowest and the mean standard deviation, mm; measured on errors of pictures."""
        flux = sum(self.weights)
        mean = sum(w * np.sqrt(v) for w, v in self._pairs) / flux if flux > 0.0 else 1.0
        return float(np.sqrt(self.mean_free_path * mean))

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d of (a) at 3-D distances rho (mm), in mm^-2."""
        rho2 = np.square(np.asarray(rho, np.float64))
        value = np.zeros_like(rho2)
        for w, v in self._pairs:
            if w > 0.0:  # green and blue have fewer than six
                power = np.multiply(rho2, -0.5 / v)
                value += np.exp(np.maximum(power, LEAST_EXPONENT)) * (w / (2.0 * np.pi * v) * (power > LEAST_EXPONENT))
        return np.asarray(value)

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = sum_i w_i exp(-e^2 / (2 v_i))."""
        e2 = np.square(np.asarray(e, np.float64))
        return np.asarray(sum(w * np.exp(-0.5 * e2 / v) for w, v in self._pairs))

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return the part of T(e) inside radius r (mm; may be infinite), (b)."""
        r2, e2 = np.square(np.asarray(r, np.float64)), np.square(np.asarray(e, np.float64))
        return np.asarray(sum(w * np.exp(-0.5 * e2 / v) * -np.expm1(-0.5 * r2 / v) for w, v in self._pairs))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k (mm^-1), (c)."""
        k2 = np.square(np.asarray(k, np.float64))
        return np.asarray(sum(w * np.exp(-0.5 * e * e / v - 0.5 * v * k2) for w, v in self._pairs))

    @property
    def _pairs(self) -> tuple[tuple[float, float], ...]:
        return tuple(zip(self.weights, self.variances, strict=True))


def skin(channel: int, reflectance: float) -> Gaussians:
    """Return the six-Gaussian skin of a channel (0, 1, 2) for a diffuse reflectance in [0, 1]."""
    total = sum(row[1 + channel] for row in SKIN)
    weights = tuple(reflectance * row[1 + channel] / total for row in SKIN)
    return Gaussians(weights, tuple(row[0] for row in SKIN))


def _channel(material: Material, channel: int) -> Gaussians:
    return skin(channel, float(dipoles(material)[channel].total(0.0)))


FAMILY = Family(_channel, has_given_total=True, has_given_widths=True)
