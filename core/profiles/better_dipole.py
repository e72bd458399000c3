"""The better dipole (d'Eon 2012, "A Better Dipole"): modified diffusion and an exitance of two terms.

Against the standard dipole: Grosjean's diffusion coefficient, which does not take light that has not scattered for
diffuse; an extrapolated boundary with exact Fresnel moments; and an exitance of fluence and flux together (Kienle and
Patterson 1997).

(a)  D = (2 s_a + s_s') / (3 s_t'^2) = (2 - a') / (3 s_t')
(b)  s_tr = sqrt(s_a / D) = sqrt((1 - a') s_t' / D)
(c)  z_b = 2 A D,   A = (1 + 3 C2) / (1 - 2 C1): the plane above the surface on which fluence is extrapolated to 0
(d)  z_r = 1 / s_t',   z_v = z_r + 2 z_b (a depth above the surface, > 0, as in `core.profiles.dipole`)
(e)  C_phi = (1 - 2 C1) / 4,   C_E = (1 - 3 C2) / 2
(f)  R_d(rho) = a'^2 / (4 pi) (C_phi / D (exp(-s_tr d_r) / d_r - exp(-s_tr d_v) / d_v)
                               + C_E sum_j z_j (1 + s_tr d_j) exp(-s_tr d_j) / d_j^3),   d_j = sqrt(rho^2 + z_j^2)

One a' of (f) is the source's share that has scattered, the other comes with Grosjean's fluence. Both kernels have
closed integrals, int_rho^inf exp(-s d) / d t dt = exp(-s d) / s and
int_rho^inf z (1 + s d) exp(-s d) / d^3 t dt = z exp(-s d) / d, so that what is beyond a distance is

(g)  B(rho) = a'^2 / 2 (C_phi / D (exp(-s_tr d_r) - exp(-s_tr d_v)) / s_tr + C_E sum_j z_j exp(-s_tr d_j) / d_j)
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family


@dataclass(frozen=True)
class BetterDipole:
    """The profile of one colour channel.

    Parameters
    ----------
    alpha_prime : float
        Reduced albedo a' in [0, 1]; 0 makes every value 0.
    mean_free_path : float
        1/s_t', mm, > 0: the depth of the real source.
    eta : float
        Relative index of refraction, >= 1.
    """

    alpha_prime: float
    mean_free_path: float
    eta: float

    @property
    def is_black(self) -> bool:
        """Whether no light leaves by scattering."""
        return self.alpha_prime == 0.0

    @property
    def diffusion(self) -> float:
        """Grosjean's diffusion coefficient D of (a), mm."""
        return self.mean_free_path * (2.0 - self.alpha_prime) / 3.0

    @property
    def sigma_tr(self) -> float:
        """Effective transport coefficient of (b), mm^-1."""
        return float(np.sqrt((1.0 - self.alpha_prime) / (self.mean_free_path * self.diffusion)))

    @property
    def z_v(self) -> float:
        """Depth of the virtual source of (d), mm."""
        return self.mean_free_path + self.image_offset

    @property
    def image_offset(self) -> float:
        """Depth of a mirror image less that of its source, 2 z_b of (c), mm."""
        two_c1, three_c2 = fresnel.internal_moments(self.eta)
        return 4.0 * (1.0 + three_c2) / (1.0 - two_c1) * self.diffusion

    @property
    def detail(self) -> float:
        """The mean free path, shortened by absorption as `core.profiles.dipole.Dipole.detail`, mm."""
        return self.mean_free_path / (1.0 + 2.0 * self.sigma_tr * self.mean_free_path)

    @property
    def weights(self) -> tuple[float, float]:
        """Factors of fluence, a'^2 C_phi / D, and of flux, a'^2 C_E; (e) and (f)."""
        two_c1, three_c2 = fresnel.internal_moments(self.eta)
        square = self.alpha_prime**2
        return square * 0.25 * (1.0 - two_c1) / self.diffusion, square * 0.5 * (1.0 - three_c2)

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d of (f) at 3-D distances rho (mm), in mm^-2."""
        rho2 = np.square(np.asarray(rho, np.float64))
        phi, flux = self.weights
        s, value = self.sigma_tr, np.zeros_like(rho2)
        for z, sign in ((self.mean_free_path, 1.0), (self.z_v, -1.0)):
            d2 = rho2 + z * z
            d = np.sqrt(d2)
            value += np.exp(-s * d) / d * (sign * phi + flux * z * (1.0 + s * d) / d2)
        return np.maximum(value, 0.0) / (4.0 * np.pi)  # far off, the two fluences differ by rounding alone

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr."""
        return self._beyond(np.asarray(e, np.float64))

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return 2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be infinite."""
        e = np.asarray(e, np.float64)
        return self._beyond(e) - self._beyond(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k (mm^-1); T(e) at k = 0.

        It is (g) at d_j = sqrt(z_j^2 + e^2), with q = sqrt(k^2 + s_tr^2) in place of s_tr.
        """
        q = np.sqrt(np.square(np.asarray(k, np.float64)) + self.sigma_tr**2)
        phi, flux = self.weights
        near, far = np.hypot(self.mean_free_path, e), np.hypot(self.z_v, e)
        value = phi * _difference(near, far - near, q)
        for z, distance in ((self.mean_free_path, near), (self.z_v, far)):
            value += flux * z / distance * np.exp(-distance * q)
        return np.asarray(0.5 * value)

    def _beyond(self, rho: Array) -> Array:
        """Return B of (g), 2 pi int_rho^inf R_d t dt; rho may be infinite."""
        phi, flux = self.weights
        finite = np.where(np.isfinite(rho), rho, 1.0)
        near, far = np.hypot(self.mean_free_path, finite), np.hypot(self.z_v, finite)
        # d_v - d_r without cancellation
        separation = (self.z_v**2 - self.mean_free_path**2) / (far + near)
        value = phi * _difference(near, separation, np.asarray(self.sigma_tr))
        for z, distance in ((self.mean_free_path, near), (self.z_v, far)):
            value = value + flux * z / distance * np.exp(-distance * self.sigma_tr)
        return np.where(np.isfinite(rho), 0.5 * value, 0.0)


def _difference(near: npt.ArrayLike, separation: npt.ArrayLike, q: Array) -> Array:
    """Return (exp(-near q) - exp(-(near + separation) q)) / q, which is `separation` at q = 0."""
    near, separation = np.asarray(near, np.float64), np.asarray(separation, np.float64)
    safe = np.where(q > 0.0, q, 1.0)
    return np.where(q > 0.0, np.exp(-near * q) * -np.expm1(-separation * q) / safe, separation + 0.0 * q)


def _channel(material: Material, channel: int) -> BetterDipole:
    return BetterDipole(float(material.alpha_prime[channel]), float(material.mean_free_path[channel]), material.eta)


FAMILY = Family(_channel)
