"""Normalised diffusion (Christensen and Burley 2015, "Approximate Reflectance Profiles for Efficient SSS").

R_d(rho) = A (exp(-rho/d) + exp(-rho/(3 d))) / (8 pi d rho): two exponentials fitted to a photon walk, whose integral is
the surface albedo A by construction. d = l / s(A), where l is the mean free path and, for light along the normal,
s = 1.85 - A + 7 |A - 0.8|^3 (their equation 5; fitted without a refracting boundary). Diffuse light would have
s = 1.9 - A + 3.5 (A - 0.8)^2, and a diffuse mean free path s = 3.5 + 100 (A - 0.33)^4; they are not used here.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array

NEAREST = 1e-9  # d: the profile diverges at 0, and stays finite here


@dataclass(frozen=True)
class Burley:
    """One colour channel's profile.

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
        """Length d of the steeper exponential, mm."""
        return self.length / (1.85 - self.albedo + 7.0 * abs(self.albedo - 0.8) ** 3)

    @property
    def mean_free_path(self) -> float:
        """Length d of the steeper exponential, mm."""
        return self.width

    @property
    def detail(self) -> float:
        """Below d, mm, for the profile is 1 / rho at its centre: what errors of pictures ask for."""
        return 0.6 * self.width

    def radial(self, rho: npt.ArrayLike) -> Array:
        """R_d at 3-D distance rho (mm), in mm^-2; finite at 0, where it diverges."""
        x = np.maximum(np.asarray(rho, np.float64) / self.width, NEAREST)
        return np.asarray(self.albedo * (np.exp(-x) + np.exp(-x / 3.0)) / (8.0 * np.pi * self.width**2 * x))

    def total(self, e: npt.ArrayLike) -> Array:
        """T(e) = A (exp(-e/d) + 3 exp(-e/(3 d))) / 4."""
        x = np.asarray(e, np.float64) / self.width
        return np.asarray(0.25 * self.albedo * (np.exp(-x) + 3.0 * np.exp(-x / 3.0)))

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be inf."""
        e = np.asarray(e, np.float64)
        return self.total(e) - self.total(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequency k (mm^-1); T(e) at k = 0."""
        k2 = np.square(np.asarray(k, np.float64))
        value = np.zeros_like(k2)
        for s in (1.0 / self.width, 1.0 / (3.0 * self.width)):
            q = np.sqrt(k2 + s * s)
            value = value + 2.0 * np.pi * np.exp(-e * q) / q
        return np.asarray(self.albedo / (8.0 * np.pi * self.width) * value)
