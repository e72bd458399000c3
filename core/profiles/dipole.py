"""The standard dipole diffusion profile (Jensen, Marschner, Levoy, Hanrahan 2001), with every closed form.

R_d(rho) = a'/(4 pi) sum_{j = r, v} z_j (1 + s_tr d_j) exp(-s_tr d_j) / d_j^3,   d_j = sqrt(rho^2 + z_j^2)

with the real source at depth z_r = 1/s_t' and the virtual one mirrored at z_v = z_r (1 + 4A/3). rho is the 3-D
distance, so a layer at distance e sees Z_j = sqrt(z_j^2 + e^2) in place of z_j wherever z_j is not the strength.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material


@dataclass(frozen=True)
class Dipole:
    """One colour channel's profile.

    Parameters
    ----------
    alpha_prime : float
        Reduced albedo a' in [0, 1]; 0 makes every value 0.
    sigma_tr : float
        Effective transport coefficient, mm^-1, >= 0; at 0 the tail falls as 1/rho^3.
    z_r, z_v : float
        Depths of the real and the virtual source, mm, > 0.
    """

    alpha_prime: float
    sigma_tr: float
    z_r: float
    z_v: float

    @property
    def is_black(self) -> bool:
        """Whether no light leaves by scattering, so that a stage may skip the channel."""
        return self.alpha_prime == 0.0

    @property
    def mean_free_path(self) -> float:
        """Depth of the real source, mm: the shortest length over which the profile bends."""
        return self.z_r

    @property
    def detail(self) -> float:
        """z_r, shortened by absorption, mm: what little crosses a strong absorber was never far from its way."""
        return self.z_r / (1.0 + 2.0 * self.sigma_tr * self.z_r)

    def radial(self, rho: npt.ArrayLike) -> Array:
        """R_d at 3-D distance rho (mm), in mm^-2."""
        rho2 = np.square(np.asarray(rho, np.float64))
        value = np.zeros_like(rho2)
        for z in (self.z_r, self.z_v):
            d2 = rho2 + z * z
            d = np.sqrt(d2)
            value += z * (1.0 + self.sigma_tr * d) * np.exp(-self.sigma_tr * d) / (d2 * d)
        return self.alpha_prime / (4.0 * np.pi) * value

    def total(self, e: npt.ArrayLike) -> Array:
        """T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr: the share of flux that reaches a plane e mm away."""
        return self.total_within(np.inf, e)

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr': the part of T(e) inside radius r (mm; may be inf)."""
        r2, e2 = np.square(np.asarray(r, np.float64)), np.square(np.asarray(e, np.float64))
        value = np.zeros(np.broadcast_shapes(r2.shape, e2.shape))
        for z in (self.z_r, self.z_v):
            near, far = np.sqrt(e2 + z * z), np.sqrt(r2 + e2 + z * z)
            value += z * np.exp(-self.sigma_tr * near) / near
            # the far end vanishes at infinity, also where sigma_tr = 0 (0 * inf is no number)
            finite = np.where(np.isfinite(far), far, 1.0)
            value -= np.where(np.isfinite(far), z * np.exp(-self.sigma_tr * finite) / finite, 0.0)
        return 0.5 * self.alpha_prime * value

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequency k (mm^-1); T(e) at k = 0."""
        q = np.sqrt(np.square(np.asarray(k, np.float64)) + self.sigma_tr**2)
        value = np.zeros_like(q)
        for z in (self.z_r, self.z_v):
            distance = np.hypot(z, e)
            value += z / distance * np.exp(-distance * q)
        return 0.5 * self.alpha_prime * value


def dipoles(material: Material) -> tuple[Dipole, Dipole, Dipole]:
    """Return the R, G and B profiles of a material."""
    f_dr = fresnel.diffuse_reflectance_fit(material.eta)
    a = (1.0 + f_dr) / (1.0 - f_dr)

    def channel(sigma_s_prime: float, sigma_a: float) -> Dipole:
        sigma_t_prime = sigma_s_prime + sigma_a
        if sigma_s_prime == 0.0:  # nothing scatters: a' = 0, and 1/s_t' may be infinite
            return Dipole(0.0, 0.0, 1.0, 1.0)
        z_r = 1.0 / sigma_t_prime
        return Dipole(
            alpha_prime=sigma_s_prime / sigma_t_prime,
            sigma_tr=float(np.sqrt(3.0 * sigma_a * sigma_t_prime)),
            z_r=z_r,
            z_v=z_r * (1.0 + 4.0 * a / 3.0),
        )

    red, green, blue = (channel(*pair) for pair in zip(material.sigma_s_prime, material.sigma_a, strict=True))
    return red, green, blue


def diffuse_reflectance(material: Material) -> Array:
    """Total diffuse reflectance R_d = T(0) per channel, (3,), in [0, 1]."""
    return np.array([float(profile.total(0.0)) for profile in dipoles(material)])
