"""Photon beam diffusion (Habel, Christensen and Jarosz 2013) for a beam along the normal: sources all along it.

Where the dipoles of `core.profiles.dipole` and `core.profiles.better_dipole` put all light at a depth of one mean free
path, here it is spread as it really is, s_t' exp(-s_t' z), a better dipole at each depth. The diffusion that is wrong
near the beam is damped by kappa = 1 - exp(-2 s_t' (d_r + z)), and light that scatters once is added exactly:

R_1(rho) = s_s' / (4 pi eta rho) int_0^1 F_t exp(-s_t' rho (1 + cos t) / sin t) ds,   sin t = s / eta,

s the sine of the angle at which it leaves. (pbrt, volume 3, section 15.5.5, has the same sums with 100 equal shares of
the depth; both integrals are here taken to 1e-6.) Profiles depend on s_t' by scale alone, so there is one table an
albedo and index, in mean free paths, made when it is first asked for.

Of the published profiles for a pencil of light this one is nearest to a photon walk (README). The directional dipole
(Frisvad, Hachisuka and Kjeldsen 2014) needs the direction of the light at each source, which an irradiance has lost.
"""

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.profiles.better_dipole import BetterDipole
from milkglass.core.profiles.radial import RadialTable, hankel

NODES = 400  # of a table: even in log rho, cubic, 1e-6
LEAST = 1e-4  # mean free paths, start of a table; below, the profile is 1 / rho
MOST, DECAYS = 1e5, 300.0  # mean free paths and 1/s_tr; whatever comes first ends a table
STEP = 0.3  # in logarithms; the trapezoid rule converges to 1e-9 where a function vanishes at both ends
DEPTHS = np.exp(np.arange(np.log(1e-8), np.log(50.0), STEP))


@dataclass(frozen=True)
class PhotonBeam:
    """One colour channel's profile.

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
        """As of the dipoles, mm."""
        return BetterDipole(self.alpha_prime, self.mean_free_path, self.eta).detail

    def radial(self, rho: npt.ArrayLike) -> Array:
        """R_d at 3-D distance rho (mm), in mm^-2; finite at 0, where it diverges."""
        return self._table.value(np.asarray(rho, np.float64) / self.mean_free_path) * (
            self._scale / self.mean_free_path**2
        )

    def total(self, e: npt.ArrayLike) -> Array:
        """T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr."""
        return self._table.beyond(np.asarray(e, np.float64) / self.mean_free_path) * self._scale

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be inf."""
        e = np.asarray(e, np.float64)
        return self.total(e) - self.total(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequency k > 0 (mm^-1), numerical."""
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
    sigma_tr = np.sqrt(3.0 * (1.0 - alpha_prime) / (2.0 - alpha_prime))
    x = np.geomspace(LEAST, min(MOST, DECAYS / max(sigma_tr, 1e-30)), NODES)
    return RadialTable(x, multiple_scattering(x, alpha_prime, eta) + single_scattering(x, alpha_prime, eta))


def reflectance(alpha_prime: float, eta: float) -> float:
    """T(0) alone, without a table, to 1e-8: for those who search an albedo."""
    if alpha_prime == 0.0:
        return 0.0
    # Even in log rho, where r^2 R_d vanishes at both ends: the trapezoid rule again.
    x = np.exp(np.arange(np.log(1e-9), np.log(1e9), STEP))
    profile = multiple_scattering(x, alpha_prime, eta) + single_scattering(x, alpha_prime, eta)
    return float(2.0 * np.pi * STEP * np.sum(profile * x * x))


def multiple_scattering(x: Array, alpha_prime: float, eta: float) -> Array:
    """Diffusion from all depths at radii x (n,), lengths in mean free paths."""
    dipole, z = BetterDipole(alpha_prime, 1.0, eta), DEPTHS
    of_fluence, of_flux = dipole.weights
    sigma_tr, mirrored = dipole.sigma_tr, z + dipole.mirrored_by
    r2 = np.square(x)[:, None]
    near, far = np.sqrt(r2 + z * z), np.sqrt(r2 + mirrored * mirrored)
    direct, image = np.exp(-sigma_tr * near) / near, np.exp(-sigma_tr * far) / far
    flux = z * (1.0 + sigma_tr * near) * direct / near**2 + mirrored * (1.0 + sigma_tr * far) * image / far**2
    damped = -np.expm1(-2.0 * (near + z)) * (of_fluence * (direct - image) + of_flux * flux)
    weights = STEP * z * np.exp(-z)
    return np.asarray(np.einsum("ij,j->i", damped, weights) / (4.0 * np.pi))


def single_scattering(x: Array, alpha_prime: float, eta: float) -> Array:
    """Light that scatters once, at radii x (n,), lengths in mean free paths."""
    # Double-exponential quadrature: at small x all changes near s = 0.
    v = np.arange(-3.4, 3.4, 0.08)
    share = 1.0 / (1.0 + np.exp(-np.pi * np.sinh(v)))
    weights = 0.08 * np.pi * np.cosh(v) * share * (1.0 - share)
    sine = share / eta
    path = (1.0 + np.sqrt(1.0 - sine * sine)) / sine
    leaving = weights * fresnel.transmittance(eta, np.sqrt(np.maximum(0.0, 1.0 - share * share)))
    return np.asarray(alpha_prime / (4.0 * np.pi * eta * x) * np.einsum("ij,j->i", np.exp(-np.outer(x, path)), leaving))
