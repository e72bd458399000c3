"""Photon beam diffusion (Habel, Christensen and Jarosz 2013) for a beam along the normal: sources all along it.

Where the dipoles of `core.profiles.dipole` and `core.profiles.better_dipole` put all light at a depth of one mean free
path, here it is spread along the beam, a better dipole at each depth; diffusion, which is wrong near the beam, is
damped; and light that scatters once is added exactly. C_phi, C_E, D, s_tr, z_b are of `core.profiles.better_dipole`:

(a)  Q(z) = s_t' exp(-s_t' z),   the share of the light that first scatters at depth z
(b)  d_r = sqrt(rho^2 + z^2),   d_v = sqrt(rho^2 + z_v^2),   z_v = z + 2 z_b: from the source and its mirror image
(c)  M_phi = C_phi / D (exp(-s_tr d_r) / d_r - exp(-s_tr d_v) / d_v),   the exitance of fluence
(d)  M_E = C_E (z (1 + s_tr d_r) exp(-s_tr d_r) / d_r^3 + z_v (1 + s_tr d_v) exp(-s_tr d_v) / d_v^3),   of flux
(e)  kappa = 1 - exp(-2 s_t' (d_r + z)),   the empirical damping
(f)  R_m(rho) = a'^2 / (4 pi) int_0^inf kappa Q (M_phi + M_E) dz,   multiple scattering
(g)  R_1(rho) = s_s' / (4 pi eta rho) int_0^1 F_t exp(-s_t' rho (1 + cos t) / sin t) ds,   sin t = s / eta,
     single scattering; s the sine of the angle outside at which it leaves, t the angle inside, so that the scattering
     is at depth rho cos t / sin t and the path beyond it rho / sin t long
(h)  R_d = R_m + R_1

(pbrt, third edition, section 15.5.5, has the same sums with 100 equal shares of the depth; both integrals are here
taken to 1e-6.) Profiles depend on s_t' by scale alone, so there is one table an albedo and index, in mean free paths,
made when it is first asked for.

Of the published profiles for a pencil of light this one is nearest to a photon walk (core/README.md). The directional
dipole (Frisvad, Hachisuka and Kjeldsen 2014) needs the direction of the light at each source, which an irradiance has
lost.
"""

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family
from milkglass.core.profiles.better_dipole import BetterDipole
from milkglass.core.profiles.radial import RadialTable, hankel

TABLE_NODES = 400  # even in log rho, cubic, 1e-6
FIRST_RADIUS = 1e-4  # mean free paths, start of a table; below, the profile is 1 / rho
LAST_RADIUS, LAST_DECAYS = 1e5, 300.0  # mean free paths and 1/s_tr; whichever comes first ends a table
LOG_STEP = 0.3  # the trapezoid rule in logarithms converges to 1e-9 where a function vanishes at both ends
DEPTHS = np.exp(np.arange(np.log(1e-8), np.log(50.0), LOG_STEP))  # mean free paths
SINGLE_STEP, SINGLE_END = 0.08, 3.4  # of the double-exponential quadrature of (g)


@dataclass(frozen=True)
class PhotonBeam:
    """The profile of one colour channel.

    Parameters
    ----------
    alpha_prime : float
        Reduced albedo a' in [0, 1]; 0 makes every value 0.
    mean_free_path : float
        1/s_t', mm, > 0.
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
    def detail(self) -> float:
        """Mean free path shortened by absorption, mm, as of `core.profiles.better_dipole.BetterDipole.detail`."""
        return BetterDipole(self.alpha_prime, self.mean_free_path, self.eta).detail

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d of (h) at 3-D distances rho (mm), in mm^-2; finite at 0, where it diverges."""
        return self._table.value(np.asarray(rho, np.float64) / self.mean_free_path) * (
            self._scale / self.mean_free_path**2
        )

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr."""
        return self._table.beyond(np.asarray(e, np.float64) / self.mean_free_path) * self._scale

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return 2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be infinite."""
        e = np.asarray(e, np.float64)
        return self.total(e) - self.total(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k > 0 (mm^-1), numerical."""
        return hankel(self.radial, k, e, self.mean_free_path)

    @property
    def _table(self) -> RadialTable:
        return beam_table(self.alpha_prime or 1.0, self.eta)

    @property
    def _scale(self) -> float:
        return float(self.alpha_prime > 0.0)


@functools.lru_cache(maxsize=64)
def beam_table(alpha_prime: float, eta: float) -> RadialTable:
    """Return the profile for an albedo above 0, in units of the mean free path."""
    sigma_tr = np.sqrt(3.0 * (1.0 - alpha_prime) / (2.0 - alpha_prime))  # s_tr / s_t' of the better dipole
    x = np.geomspace(FIRST_RADIUS, min(LAST_RADIUS, LAST_DECAYS / max(sigma_tr, 1e-30)), TABLE_NODES)
    return RadialTable(x, multiple_scattering(x, alpha_prime, eta) + single_scattering(x, alpha_prime, eta))


def reflectance(alpha_prime: float, eta: float) -> float:
    """Return T(0) alone, without a table, to 1e-8: fast enough to search an albedo by it."""
    if alpha_prime == 0.0:
        return 0.0
    # 2 pi int R_d rho^2 dlog(rho), whose integrand vanishes at both ends: the trapezoid rule again.
    x = np.exp(np.arange(np.log(1e-9), np.log(1e9), LOG_STEP))
    profile = multiple_scattering(x, alpha_prime, eta) + single_scattering(x, alpha_prime, eta)
    return float(2.0 * np.pi * LOG_STEP * np.sum(profile * x * x))


def multiple_scattering(x: Array, alpha_prime: float, eta: float) -> Array:
    """Return R_m of (f), diffusion from all depths, at radii x (n,); lengths in mean free paths."""
    dipole, z = BetterDipole(alpha_prime, 1.0, eta), DEPTHS
    fluence_weight, flux_weight = dipole.weights  # a'^2 C_phi / D and a'^2 C_E
    sigma_tr = dipole.sigma_tr
    z_v = z + dipole.image_offset  # (b), (depths,)
    r2 = np.square(x)[:, None]
    d_r, d_v = np.sqrt(r2 + z * z), np.sqrt(r2 + z_v * z_v)  # (b), (n, depths)
    # The kernels exp(-s_tr d) / d of both, whose difference is the fluence of (c).
    source, image = np.exp(-sigma_tr * d_r) / d_r, np.exp(-sigma_tr * d_v) / d_v
    flux = z * (1.0 + sigma_tr * d_r) * source / d_r**2 + z_v * (1.0 + sigma_tr * d_v) * image / d_v**2  # (d)
    kappa = -np.expm1(-2.0 * (d_r + z))  # (e)
    exitance = kappa * (fluence_weight * (source - image) + flux_weight * flux)
    weights = LOG_STEP * z * np.exp(-z)  # Q dz of (a), dz = z dlog(z)
    return np.asarray(np.einsum("ij,j->i", exitance, weights) / (4.0 * np.pi))


def single_scattering(x: Array, alpha_prime: float, eta: float) -> Array:
    """Return R_1 of (g), light that scatters once, at radii x (n,); lengths in mean free paths."""
    # Double-exponential quadrature over s in [0, 1] (Takahasi and Mori 1974), s = 1 / (1 + exp(-pi sinh v)): at small x
    # all changes near s = 0.
    v = np.arange(-SINGLE_END, SINGLE_END, SINGLE_STEP)
    s = 1.0 / (1.0 + np.exp(-np.pi * np.sinh(v)))
    weights = SINGLE_STEP * np.pi * np.cosh(v) * s * (1.0 - s)  # ds
    sin_t = s / eta  # Snell
    path = (1.0 + np.sqrt(1.0 - sin_t * sin_t)) / sin_t  # (1 + cos t) / sin t, both ways over rho
    transmitted = weights * fresnel.transmittance(eta, np.sqrt(np.maximum(0.0, 1.0 - s * s)))  # F_t ds
    attenuated = np.einsum("ij,j->i", np.exp(-np.outer(x, path)), transmitted)
    return np.asarray(alpha_prime / (4.0 * np.pi * eta * x) * attenuated)


def _channel(material: Material, channel: int) -> PhotonBeam:
    return PhotonBeam(float(material.alpha_prime[channel]), float(material.mean_free_path[channel]), material.eta)


FAMILY = Family(_channel, reflectance)
