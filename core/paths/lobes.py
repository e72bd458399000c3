"""How light that comes from about one direction goes on when it scatters, by Henyey and Greenstein's phase function.

Delta-Eddington's two moments say what scatters on average. Of light that scatters once on its way to the eye the whole
phase function is seen, above all what it throws straight back: as Nakajima and Tanaka (1988) have it, scattering is
taken off a scaled beam by the unscaled phase function. What the beam has kept is its most forward share f = g^2: here
what rises above a level. The rest, min(p, level) / (1 - f), ends in a flat top and scatters all there is.

The peak that the beam keeps has some width. Light that scatters has taken turns of it before, and takes some after: as
many as leave it the mean cosine g'' of delta-Eddington, by which s_s' is right. Moments are those of the rest times
powers of the peak's, which hardly changes what goes back.

Light does not come from one direction alone. By its power and mean direction v at a place it is taken to come evenly
from a disc about v, of a rim at the cosine 2 abs(v) - 1: a lamp's disc, the half of a sky, or all around, where v is 0
and light scatters evenly.
"""

import functools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from milkglass.core.arrays import Array, Float32, Ints

ROWS = 32  # of the table, over abs(v) in [0, 1]
COLUMNS = 64  # over the sine of half the angle in [0, 1]
MOMENTS = 48
NODES = 256  # of the Gauss rule over the cosine
ANGLES = 1024  # at which the density of one direction is kept


def tables(cosines: Sequence[float]) -> Float32:
    """Return densities over that of even scattering, (n, ROWS, COLUMNS), for mean cosines (n,) in [0, 1)."""
    return np.stack([_table(float(g)) for g in cosines])


def density(cosine: Array, g: float) -> Array:
    """Return that of light from one direction, at cosines (n,) to it."""
    return np.interp(cosine, *_density(float(g)))


def turned(random: Array, channels: Ints, cosines: Sequence[float]) -> Array:
    """Return cosines, (n,), drawn from `density` of the channels' mean cosines, by numbers uniform in [0, 1)."""
    found = np.empty(len(random))
    for i, g in enumerate(cosines):
        at, values = _density(float(g))
        shares = np.append(0.0, np.cumsum(np.diff(at) * (values[1:] + values[:-1])))
        found[channels == i] = np.interp(random[channels == i], shares / shares[-1], at)
    return found


def peak_cosine(g: float) -> float:
    """Return the mean cosine of what the peak scatters of a phase function of mean cosine g in [0, 1)."""
    return float(_parts(g)[0][1])


@functools.lru_cache(maxsize=16)
def _moments(g: float) -> Array:
    """Return the mean of each Legendre polynomial over what scatters, (MOMENTS + 1,)."""
    if g == 0.0:
        return np.where(np.arange(MOMENTS + 1) == 0, 1.0, 0.0)
    peak, rest = _parts(g)
    turns = np.log(g / (1.0 + g) / rest[1]) / np.log(peak[1])
    return np.asarray(rest * peak**turns)


@functools.lru_cache(maxsize=16)
def _parts(g: float) -> tuple[Array, Array]:
    """Return the mean of each Legendre polynomial over the peak, and over the rest, (MOMENTS + 1,) each."""
    orders, f = np.arange(MOMENTS + 1), g * g
    if g == 0.0:
        return np.ones(MOMENTS + 1), np.where(orders == 0, 1.0, 0.0)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    level = _phase(np.asarray(brentq(lambda c: _above(c, g) - f, -1.0, 1.0)), g)
    capped = np.minimum(_phase(nodes, g), level) / (1.0 - f)
    rest = 0.5 * (weights * capped) @ np.polynomial.legendre.legvander(nodes, MOMENTS)
    return np.clip((g**orders - (1.0 - f) * rest) / f, 0.0, 1.0), rest


@functools.lru_cache(maxsize=16)
def _density(g: float) -> tuple[Array, Array]:
    """Return ascending cosines and the density at them, (ANGLES,) each, whose mean is 1."""
    cosines = -np.cos(np.linspace(0.0, np.pi, ANGLES))
    values = np.maximum(_series(cosines) @ _moments(g), 0.0)
    return cosines, values / (0.5 * np.trapezoid(values, cosines))


@functools.lru_cache(maxsize=16)
def _table(g: float) -> Float32:
    sines = np.linspace(0.0, 1.0, COLUMNS)
    moments = _moments(g) * _of_discs(2.0 * np.linspace(0.0, 1.0, ROWS) - 1.0)
    found = np.maximum(moments @ _series(1.0 - 2.0 * sines * sines).T, 0.0)
    # Means over the sphere, of a density that is linear between columns.
    weights = sines.copy()
    weights[[0, -1]] = 1.0 / (6.0 * (COLUMNS - 1)), 0.5 - 1.0 / (6.0 * (COLUMNS - 1))
    return np.asarray(found / (found @ weights / weights.sum())[:, None], np.float32)


def _series(cosines: Array) -> Array:
    """Return Legendre polynomials times 2 l + 1 at cosines (n,), (n, MOMENTS + 1)."""
    return np.asarray(np.polynomial.legendre.legvander(cosines, MOMENTS) * (2 * np.arange(MOMENTS + 1) + 1))


def _of_discs(rims: Array) -> Array:
    """Return the moments of even discs of these cosines at their rims, (n, MOMENTS + 1); the last one's is a point."""
    values = np.polynomial.legendre.legvander(rims, MOMENTS + 1)
    orders, found = np.arange(1, MOMENTS + 1), np.ones((len(rims), MOMENTS + 1))
    size = (2 * orders + 1) * np.maximum(1.0 - rims, 1e-9)[:, None]
    found[:-1, 1:] = ((values[:, :-2] - values[:, 2:]) / size)[:-1]
    return found


def _phase(cosine: Array, g: float) -> Array:
    return np.asarray((1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def _above(cosine: float, g: float) -> float:
    """Return the share of the phase function that rises above its level at a cosine."""
    within = (1.0 - g * g) / (2.0 * g) * (1.0 / (1.0 - g) - (1.0 + g * g - 2.0 * g * cosine) ** -0.5)
    return float(within - 0.5 * (1.0 - cosine) * _phase(np.asarray(cosine), g))
