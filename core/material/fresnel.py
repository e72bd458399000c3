"""Fresnel reflectance of unpolarised light at a smooth dielectric, and its averages over diffuse light."""

import functools

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from milkglass.core.arrays import Array, Floats


def reflectance(eta: float, cos_i: npt.ArrayLike) -> Array:
    """Return the unpolarised reflectance F_r of light from the outside (Born and Wolf, section 1.5).

    Parameters
    ----------
    eta : float
        Relative index of refraction, inside over outside, > 0. Below 1 total reflection returns 1.
    cos_i : (...) array
        Cosine between the direction and the outward normal, in [0, 1]; clamped to that range.

    Returns
    -------
    (...) float64 array in [0, 1]
    """
    mu_i = np.clip(np.asarray(cos_i, np.float64), 0.0, 1.0)
    sin2_t = (1.0 - mu_i**2) / eta**2
    mu_t = np.sqrt(np.maximum(0.0, 1.0 - sin2_t))
    # 0/0 only where eta = 1 meets grazing incidence: there is no interface, so nothing reflects.
    perpendicular = _ratio(mu_i - eta * mu_t, mu_i + eta * mu_t)
    parallel = _ratio(eta * mu_i - mu_t, eta * mu_i + mu_t)
    return np.where(sin2_t > 1.0, 1.0, 0.5 * (perpendicular**2 + parallel**2))


def transmittance(eta: float, cos_i: npt.ArrayLike) -> Array:
    """Return the transmittance F_t = 1 - F_r, the share of arriving flux that enters; arguments as `reflectance`."""
    return 1.0 - reflectance(eta, cos_i)


def row_of(cosines: Floats, rows: int) -> npt.NDArray[np.int32]:
    """Return the nearest row of a table at `rows` + 1 evenly spaced cosines, for cosines clamped to [0, 1]: (...)."""
    numbers: npt.NDArray[np.int32] = np.clip(cosines * rows + 0.5, 0.0, rows).astype(np.int32)
    return numbers


def diffuse_reflectance_fit(eta: float) -> float:
    """Return F_dr, the average of F_r over diffuse light from the inside (fit of Egan and Hilgeman 1973).

    The polynomial of Jensen et al. 2001 for eta >= 1, the one of Donner and Jensen 2005 below. The published
    reflectances of measured materials were computed with it, so we keep it although it is up to 10 % high in A.
    At eta = 1 the fit gives 0.0016 instead of 0; clamped to [0, 1).
    """
    if eta >= 1.0:
        value = -1.440 / eta**2 + 0.710 / eta + 0.668 + 0.0636 * eta
    else:
        value = -0.4399 + 0.7099 / eta - 0.3319 / eta**2 + 0.0636 / eta**3
    return float(np.clip(value, 0.0, 0.999))


def internal_moments(eta: float) -> tuple[float, float]:
    """Return R1 = 2 int F_r mu dmu and R2 = 3 int F_r mu^2 dmu over [0, 1], F_r from the inside, eta >= 1; exact."""
    return internal_moment(eta, 1), internal_moment(eta, 2)


@functools.cache
def internal_moment(eta: float, power: int) -> float:
    """Return R_n = (n + 1) int F_r mu^n dmu over [0, 1], n = `power`, F_r from the inside, eta >= 1; exact."""
    critical = float(np.sqrt(max(0.0, 1.0 - 1.0 / eta**2)))  # cosine below which all is reflected
    nodes, weights = np.polynomial.legendre.leggauss(64)
    t, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    mu = critical + (1.0 - critical) * t * t  # F_r rises like a square root towards the critical angle
    weights = weights * 2.0 * t * (1.0 - critical)
    reflected = reflectance(1.0 / eta, mu)
    return critical ** (power + 1) + float(np.sum(weights * (power + 1.0) * mu**power * reflected))


def index_of(reflected: float) -> float:
    """Return the index of refraction in [1, 3] whose R1 is nearest to a share, see `internal_moments`."""
    least, most = internal_moment(1.0, 1), internal_moment(3.0, 1)
    if not least < reflected < most:
        return 1.0 if reflected <= least else 3.0
    return float(brentq(lambda eta: internal_moment(eta, 1) - reflected, 1.0, 3.0, xtol=1e-4))


@functools.cache
def hemispherical_transmittance(eta: float) -> float:
    """Return 2 int_0^1 F_t(mu) mu dmu, the share of uniform diffuse light that enters, in [0, 1]."""
    # Gauss-Legendre in t = sqrt(mu), which resolves the steep rise of F_t near grazing incidence.
    nodes, weights = np.polynomial.legendre.leggauss(64)
    t = 0.5 * (nodes + 1.0)
    mu = t**2
    return float(np.sum(0.5 * weights * 2.0 * t * 2.0 * mu * transmittance(eta, mu)))


def _ratio(numerator: Array, denominator: Array) -> Array:
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0.0)
