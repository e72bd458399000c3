"""Radial functions known by value alone: tabulated, with the integrals that layers ask for, and their transform.

On a plane at distance e, r dr = rho drho with rho^2 = r^2 + e^2. So one function of one variable, the integral beyond a
distance B(rho) = 2 pi int_rho^inf R t dt, answers for all planes and discs: T(e) = B(e), and inside a radius r it is
B(e) - B(sqrt(r^2 + e^2)).
"""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.special import j0, jn_zeros

from milkglass.core.arrays import Array

NEAREST_RADIUS = 1e-9  # of the table's unit: values that diverge at 0 go no further, so that they stay finite
EULER_LOBES = 24  # of J0, whose partial sums alternate; their repeated means converge like a power of 1/2
LOBES = 120  # of J0 that are integrated


class RadialTable:
    """A positive function R(x) that falls, as a cubic spline in logarithms, and B(x); power laws beyond both ends.

    Parameters
    ----------
    x : (n,) array
        Rising, > 0; evenly spaced in log x is best.
    values : (n,) array
        R at x, > 0 and finite. Falls faster than 1/x^2 at the end, and rises slower than 1/x^2 at the start.
    """

    def __init__(self, x: Array, values: Array) -> None:
        u = np.log(x)
        self._u, self._value = u, CubicSpline(u, np.log(values))
        self._slopes = float(self._value(u[0], 1)), float(self._value(u[-1], 1))
        nodes, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * np.diff(u)
        places = u[:-1] + half + half * nodes[:, None]
        flux = 2.0 * np.pi * half * (weights[:, None] * np.exp(self._value(places) + 2.0 * places)).sum(axis=0)
        rate = 2.0 * np.pi * values * x * x  # -dB/du, u = log x
        tail = rate[-1] / -(self._slopes[1] + 2.0)  # B at the last x, of the power law beyond it
        beyond = np.append(np.cumsum(flux[::-1])[::-1] + tail, tail)
        self._beyond = CubicHermiteSpline(u, np.log(beyond), -rate / beyond)
        # int_0^x0 of the power law, and its exponent
        self._core = float(rate[0]) / (self._slopes[0] + 2.0), self._slopes[0] + 2.0
        self.total = float(beyond[0]) + self._core[0]
        """B(0)."""

    def value(self, x: npt.ArrayLike) -> Array:
        """Return R(x); where it diverges at 0, that at `NEAREST_RADIUS`."""
        u, inside = self._places(x)
        excess = u - inside
        log = self._value(inside) + np.where(excess < 0.0, self._slopes[0], self._slopes[1]) * excess
        return np.asarray(np.exp(log))

    def beyond(self, x: npt.ArrayLike) -> Array:
        """Return B(x), to 1e-7 of itself; x may be infinite."""
        u, inside = self._places(x)
        excess = u - inside
        value = np.exp(self._beyond(inside) + (self._slopes[1] + 2.0) * np.maximum(excess, 0.0))
        share, power = self._core
        return np.asarray(np.where(excess < 0.0, value + share * -np.expm1(power * np.minimum(excess, 0.0)), value))

    def _places(self, x: npt.ArrayLike) -> tuple[Array, Array]:
        u = np.log(np.clip(np.asarray(x, np.float64), NEAREST_RADIUS, 1e300))
        return u, np.clip(u, self._u[0], self._u[-1])


def flux_radius(total: Callable[[float], npt.ArrayLike], share: float, scale: float) -> float:
    """Return the radius within which a share in (0, 1) of the flux stays, by bisection.

    `total` is B, and `scale` a length of the order of the radius.
    """
    rest, low, high = (1.0 - share) * float(np.asarray(total(0.0))), 0.0, scale
    while float(np.asarray(total(high))) > rest:
        high *= 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(np.asarray(total(middle))) > rest else (low, middle)
    return high


def hankel(
    radial: Callable[[Array], Array],
    k: npt.ArrayLike,
    e: float = 0.0,
    scale: float = 1.0,
    kinks: Sequence[float] = (),
) -> Array:
    """Return the 2-D Fourier transform of R(sqrt(r^2 + e^2)) at angular frequencies k > 0 (mm^-1).

    It is the Hankel transform 2 pi int_0^inf R J0(k r) r dr, to 1e-7 of that at 0, lobe by lobe of J0. Partial sums
    over the last lobes alternate around their limit, so their repeated means are taken (Euler's transformation).

    Parameters
    ----------
    radial : callable
        Positive and falling, at most as 1/rho near 0.
    k : (...) array
    e : float
        Distance of the plane, mm, >= 0.
    scale : float
        A length over which R changes, mm; for frequencies far below its inverse.
    kinks : distances, mm, where R is not smooth
    """
    frequencies = np.asarray(k, np.float64)
    corners = np.array([np.sqrt(kink * kink - e * e) for kink in kinks if kink > e])
    values = [_transform(radial, float(frequency), e, scale, corners) for frequency in frequencies.ravel()]
    return np.array(values).reshape(frequencies.shape)


def _transform(radial: Callable[[Array], Array], k: float, e: float, scale: float, corners: Array) -> float:
    nodes, weights = np.polynomial.legendre.leggauss(24)
    zeros = jn_zeros(0, LOBES) / k
    # Within the first lobe R may change much: pieces grow from far below `scale`.
    start = min(1e-6 * scale, 1e-3 * zeros[0])
    inner = np.geomspace(start, zeros[0], 2 + int(3.0 * np.log(zeros[0] / start)))
    edges = np.concatenate([[0.0], inner, zeros[1:]])
    edges = np.unique(np.concatenate([edges, corners[corners < zeros[-1]]]))
    half = 0.5 * np.diff(edges)[:, None]
    r = edges[:-1, None] + half * (nodes + 1.0)
    pieces = 2.0 * np.pi * (half * weights * radial(np.sqrt(r * r + e * e)) * j0(k * r) * r).sum(axis=1)
    sums = np.append(0.0, np.cumsum(pieces))[np.searchsorted(edges, zeros)][-EULER_LOBES:]
    while len(sums) > 1:
        sums = 0.5 * (sums[1:] + sums[:-1])
    return float(sums[0])
