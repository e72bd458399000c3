"""Particle-mesh Ewald split of equation (1): a smooth part on the layers, the rest local.

R_d = R_L + (R_d - R_L). R_L is R_d filtered in three dimensions by a window of width s, a little above the spacing of
the layers, so that they can carry it; what remains has a range of s and sees a surface that is flat and evenly lit,
where it acts as one factor rho_s on the irradiance of the point itself (Hockney and Eastwood 1988; Ewald 1921).
That factor is applied at every pixel, with the pixel's own irradiance, and restores the detail that layers lose.

Works for any radial profile: the filter needs no Bessel functions, only the profile's values along a line.
"""

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve

from core.spectra import Profile

Array = npt.NDArray[np.float64]

WINDOW = 0.9  # c: width of the window in spacings, for quadratic B-splines (TSC)
REACH = 8.0  # widths beyond which the window is below 1e-11 of its peak
MAX_NODES = 1 << 20  # of the radial table

# Spacing over the shortest mean free path -> rms error of exitance over rms exitance, the worst of several shapes,
# lights and materials (`milkglass bench`); interpolated in logarithms. Far beyond, nearly all is local and it levels off.
ERROR_CURVE = np.array([[0.5, 0.002], [0.85, 0.004], [1.3, 0.01], [2.5, 0.02], [5.0, 0.035], [20.0, 0.05]])


def window(t: npt.ArrayLike, s: float) -> Array:
    """Smoothing window along a line, unit integral: w(t) = exp(-u/2) (15 - 10 u + u^2) / (8 s sqrt(2 pi)), u = (t/s)^2.

    Its moments up to the fifth vanish: in Fourier space it is exp(-x) (1 + x + x^2/2), x = (s k)^2 / 2, flat to the
    sixth order at k = 0.
    """
    u = np.square(np.asarray(t, np.float64) / s)
    return np.asarray(np.exp(-0.5 * u) * (15.0 - 10.0 * u + u * u) / (8.0 * s * np.sqrt(2.0 * np.pi)))


def long_range(profile: Profile, s: float, furthest: float) -> CubicSpline:
    """Radial function R_L(rho), 0 <= rho <= furthest (mm), mm^-2.

    R_L(rho) = (1 / rho) int w(t) (rho - t) R_d(|rho - t|) dt: in three dimensions rho f(rho) of a radial function f
    behaves as in one, so filtering by a radial window is a convolution along a line.
    """
    reach = REACH * s
    step = max(min(s / 20.0, profile.mean_free_path / 6.0), (furthest + 2.0 * reach) / MAX_NODES)
    n, m = int(np.ceil(furthest / step)) + 1, int(np.ceil(reach / step))
    t = step * np.arange(-2 * m, n + 2 * m + 1)
    strength = t * profile.radial(np.abs(t))
    smooth = step * fftconvolve(strength, window(step * np.arange(-m, m + 1), s), mode="valid")
    rho = t[m:-m]
    # rho R_L is odd; its slope at 0 is R_L(0), which the quotient cannot give.
    odd = CubicSpline(rho, smooth)
    rho = step * np.arange(n + 1)
    values = np.concatenate([[float(odd(0.0, 1))], odd(rho[1:]) / rho[1:]])
    return CubicSpline(rho, values)


def local_coefficient(profile: Profile, s: float, e: float = 0.0) -> float:
    """rho_s(e) = T(e) - int w(t) T(|e - t|) dt: what a flat sheet at distance e returns outside R_L; rho_s at e = 0."""

    def integrand(t: float) -> float:
        return float(window(t, s) * (profile.total(e - t) + profile.total(e + t)))

    z = profile.mean_free_path
    edges = sorted({0.0, REACH * s, *(x for x in (z, 5.0 * z, s, 3.0 * s, e) if 0.0 < x < REACH * s)})
    smooth = sum(quad(integrand, a, b, epsabs=1e-12, epsrel=1e-9)[0] for a, b in zip(edges, edges[1:], strict=False))
    return float(profile.total(e)) - smooth


def influence(frequency: Array) -> Array:
    """Factor of one axis that undoes what deposit and gather with TSC weights do, at frequency k h in radians.

    sinc^6(k h / 2) / B(k h)^2, B(t) = (33 + 26 cos t + cos 2t) / 60 (Hockney and Eastwood 1988, the optimal influence
    function: B is the sum of sinc^6 over all aliases).
    """
    aliases = (33.0 + 26.0 * np.cos(frequency) + np.cos(2.0 * frequency)) / 60.0
    return np.asarray(np.sinc(frequency / (2.0 * np.pi)) ** 6 / aliases**2)


def predicted_error(spacing: float, mean_free_path: float) -> float:
    """Rms error to expect of a grid, for the shortest mean free path of the channels (both mm)."""
    ratio, error = np.log(ERROR_CURVE).T
    return float(np.exp(np.interp(np.log(spacing / mean_free_path), ratio, error)))


def finest_spacing(target: float, mean_free_path: float) -> float:
    """Spacing, mm, whose `predicted_error` is the target."""
    ratio, error = np.log(ERROR_CURVE).T
    return float(mean_free_path * np.exp(np.interp(np.log(target), error, ratio)))
