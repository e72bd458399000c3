"""A profile that the registry does not know: R_d = A exp(-rho / l) / (2 pi l^2)."""

from dataclasses import dataclass

import numpy as np

from milkglass.core.profiles.base import Family


@dataclass(frozen=True)
class Exponential:
    albedo: float
    mean_free_path: float

    @property
    def is_black(self):
        return self.albedo == 0.0

    @property
    def detail(self):
        return 0.5 * self.mean_free_path

    def radial(self, rho):
        x = np.asarray(rho, np.float64) / self.mean_free_path
        return self.albedo * np.exp(-x) / (2.0 * np.pi * self.mean_free_path**2)

    def total(self, e):
        x = np.asarray(e, np.float64) / self.mean_free_path
        return self.albedo * (1.0 + x) * np.exp(-x)

    def total_within(self, r, e=0.0):
        return self.total(e) - self.total(np.hypot(r, e))


FAMILY = Family(lambda material, i: Exponential(float(material.alpha_prime[i]) ** 2, float(material.mean_free_path[i])))
