"""Normalised diffusion (Christensen and Burley 2015, "Approximate Reflectance Profiles for Efficient SSS").

(a)  R_d(rho) = A (exp(-rho / d) + exp(-rho / (3 d))) / (8 pi d rho)
(b)  d = l / s(A),   s(A) = 1.85 - A + 7 |A - 0.8|^3

Two exponentials fitted to a photon walk, whose integral is the surface albedo A by construction; l is the mean free
path. (b) is their equation 5, for light along the normal, fitted without a refracting boundary. Diffuse light would
have s = 1.9 - A + 3.5 (A - 0.8)^2, and a diffuse mean free path s = 3.5 + 100 (A - 0.33)^4; they are not used here. As
rho R_d is a sum of exponentials, the integral beyond a distance is

(c)  B(rho) = A (exp(-rho / d) + 3 exp(-rho / (3 d))) / 4
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family
from milkglass.core.profiles.dipole import dipoles

NEAREST_RADIUS = 1e-9  # d: the profile diverges at 0, and stays finite here


@dataclass(frozen=True)
class Burley:
    """The profile of one colour channel.

    Parameters
    ----------
    albedo : float
        Surface albedo A, the diffuse reflectance, in [0, 1]; 0 makes every value 0.
    length : float
        Mean free path l, mm, > 0.
    """

    albedo: float
    length: float

    @property
    def is_black(self) -> bool:
        """Whether no light leaves by scattering."""
        return self.albedo == 0.0

    @property
    def width(self) -> float:
        """Length d of the steeper exponential, (b), mm."""
        return self.length / (1.85 - self.albedo + 7.0 * abs(self.albedo - 0.8) ** 3)

    @property
    def mean_free_path(self) -> float:
        """Length d of the steeper exponential, mm."""
        return self.width

    @property
    def detail(self) -> float:
        """A length below d, mm, as the profile is 1 / rho at its centre; its factor is from errors of pictures."""
        return 0.6 * self.width

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d of (a) at 3-D distances rho (mm), in mm^-2; finite at 0, where it diverges."""
        x = np.maximum(np.asarray(rho, np.float64) / self.width, NEAREST_RADIUS)
        return np.asarray(self.albedo * (np.exp(-x) + np.exp(-x / 3.0)) / (8.0 * np.pi * self.width**2 * x))

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = B(e) of (c)."""
        x = np.asarray(e, np.float64) / self.width
        return np.asarray(0.25 * self.albedo * (np.exp(-x) + 3.0 * np.exp(-x / 3.0)))

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return 2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be infinite."""
        e = np.asarray(e, np.float64)
        return self.total(e) - self.total(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k (mm^-1); T(e) at k = 0.

        That of exp(-s rho) / rho is 2 pi exp(-e q) / q, q = sqrt(k^2 + s^2).
        """
        k2 = np.square(np.asarray(k, np.float64))
        value = np.zeros_like(k2)
        for s in (1.0 / self.width, 1.0 / (3.0 * self.width)):
            q = np.sqrt(k2 + s * s)
            value = value + 2.0 * np.pi * np.exp(-e * q) / q
        return np.asarray(self.albedo / (8.0 * np.pi * self.width) * value)


def _channel(material: Material, channel: int) -> Burley:
    return Burley(float(dipoles(material)[channel].total(0.0)), float(material.mean_free_path[channel]))


FAMILY = Family(_channel, has_given_total=True)
