"""The standard dipole diffusion profile (Jensen, Marschner, Levoy, Hanrahan 2001), with every closed form.

(a)  R_d(rho) = a'/(4 pi) sum_{j = r, v} z_j (1 + s_tr d_j) exp(-s_tr d_j) / d_j^3,   d_j = sqrt(rho^2 + z_j^2)
(b)  z_r = 1 / s_t',   the depth of the real source
(c)  z_v = z_r + 4 A D = z_r (1 + 4 A / 3),   D = 1 / (3 s_t'): the virtual source, mirrored at the plane z = -2 A D on
     which fluence is extrapolated to 0; a depth above the surface, > 0, so that its sign is in (a)
(d)  A = (1 + F_dr) / (1 - F_dr),   F_dr the mean Fresnel reflectance of diffuse light from the inside
(e)  s_tr = sqrt(3 s_a s_t') = sqrt(s_a / D),   the effective transport coefficient

rho is the 3-D distance, so a layer at distance e sees Z_j = sqrt(z_j^2 + e^2) in place of z_j wherever z_j is not the
strength. As d/drho (exp(-s d) / d) = -rho (1 + s d) exp(-s d) / d^3, discs have the closed form

(f)  2 pi int_0^r R_d r' dr' = a'/2 sum_j z_j (exp(-s_tr Z_j) / Z_j - exp(-s_tr Z_j(r)) / Z_j(r)),
     Z_j(r) = sqrt(z_j^2 + e^2 + r^2)
(g)  F(k) = a'/2 sum_j z_j / Z_j exp(-Z_j q),   q = sqrt(k^2 + s_tr^2): the 2-D Fourier transform
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family


@dataclass(frozen=True)
class Dipole:
    """The profile of one colour channel.

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
        """z_r, shortened by absorption, mm: in a strong absorber only the light of short paths is left."""
        return self.z_r / (1.0 + 2.0 * self.sigma_tr * self.z_r)

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d of (a) at 3-D distances rho (mm), in mm^-2."""
        rho2 = np.square(np.asarray(rho, np.float64))
        value = np.zeros_like(rho2)
        for z in (self.z_r, self.z_v):
            d2 = rho2 + z * z
            d = np.sqrt(d2)
            value += z * (1.0 + self.sigma_tr * d) * np.exp(-self.sigma_tr * d) / (d2 * d)
        return self.alpha_prime / (4.0 * np.pi) * value

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr: the share of flux that reaches a plane e mm away."""
        return self.total_within(np.inf, e)

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return the part of T(e) inside radius r (mm; may be infinite), (f)."""
        r2, e2 = np.square(np.asarray(r, np.float64)), np.square(np.asarray(e, np.float64))
        value = np.zeros(np.broadcast_shapes(r2.shape, e2.shape))
        for z in (self.z_r, self.z_v):
            near, far = np.sqrt(e2 + z * z), np.sqrt(r2 + e2 + z * z)
            value += z * np.exp(-self.sigma_tr * near) / near
            # The term of r vanishes at infinity, also where sigma_tr = 0 (0 * inf is no number).
            finite = np.where(np.isfinite(far), far, 1.0)
            value -= np.where(np.isfinite(far), z * np.exp(-self.sigma_tr * finite) / finite, 0.0)
        return 0.5 * self.alpha_prime * value

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k (mm^-1), (g)."""
        q = np.sqrt(np.square(np.asarray(k, np.float64)) + self.sigma_tr**2)
        value = np.zeros_like(q)
        for z in (self.z_r, self.z_v):
            distance = np.hypot(z, e)
            value += z / distance * np.exp(-distance * q)
        return 0.5 * self.alpha_prime * value


def dipoles(material: Material) -> tuple[Dipole, Dipole, Dipole]:
    """Return the R, G and B standard dipoles of a material."""
    f_dr = fresnel.diffuse_reflectance_fit(material.eta)
    a = (1.0 + f_dr) / (1.0 - f_dr)  # (d)

    def channel(sigma_s_prime: float, sigma_a: float) -> Dipole:
        sigma_t_prime = sigma_s_prime + sigma_a
        if sigma_s_prime == 0.0:  # nothing scatters: a' = 0, and 1/s_t' may be infinite
            return Dipole(0.0, 0.0, 1.0, 1.0)
        z_r = 1.0 / sigma_t_prime  # (b)
        return Dipole(
            alpha_prime=sigma_s_prime / sigma_t_prime,
            sigma_tr=float(np.sqrt(3.0 * sigma_a * sigma_t_prime)),  # (e)
            z_r=z_r,
            z_v=z_r * (1.0 + 4.0 * a / 3.0),  # (c)
        )

    red, green, blue = (channel(*pair) for pair in zip(material.sigma_s_prime, material.sigma_a, strict=True))
    return red, green, blue


def diffuse_reflectance(material: Material) -> Array:
    """Return the total diffuse reflectance T(0) of a material, (3,), in [0, 1]."""
    return np.array([float(profile.total(0.0)) for profile in dipoles(material)])


FAMILY = Family(lambda material, channel: dipoles(material)[channel])
