"""Light that leaves a half space of matter that scatters forward: adding and doubling of layers.

Reduced coefficients say of a half space what it does where light scatters often. Where matter is dark, light that
leaves has scattered a few times at most, and forward scattering sends little of it back: at a mean cosine of 0.9 half
of what isotropic scattering does at a reduced albedo of 0.1, still 4 % less at 0.9.

A layer so thin that light scatters in it once at most is doubled until it is opaque (van de Hulst 1980; Prahl et al.
1993), for radiance at Gauss nodes of the cosine on either side of the critical angle, azimuths' mean, and the phase
function of Henyey and Greenstein in Legendre polynomials without its forward peak (delta-M, Wiscombe 1977). The
boundary mirrors F_r of what comes up any number of times. By reciprocity light that enters at a cosine leaves by the
share that comes up there where light is let in as F_t.
"""

import functools

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.single_scattering import cosine_rule

SIMILAR_ALBEDO = 0.99  # reduced, from which on forward scattering changes 0.1 % of what a half space returns
NODES = 8  # of the Gauss rule on either side of the critical angle: 0.1 %
SMOOTH = 3  # degree over the cosine: of forward peaks so few moments make ripples, of no flux
FIRST_LAYER = 1e-6  # optical thickness
MOST_DOUBLINGS = 40
OPAQUE = 1e-6  # of radiance that crosses


def reflectance_at(cosines: Array, albedo: float, g: float, eta: float) -> Array:
    """Return the share of light that leaves, (n,), of what has entered at cosines (n,) in (0, 1] to the normal inside.

    Parameters
    ----------
    cosines : (n,) array
        Not below that of the critical angle.
    albedo : float
        s_s / s_t of unreduced scattering, [0, 1).
    g : float
        Mean cosine of scattering, [0, 1).
    eta : float
        Relative index of refraction, >= 1.
    """
    nodes, shares = _leaving(albedo, g, eta)
    return np.asarray(np.polynomial.Polynomial.fit(nodes, shares, SMOOTH)(cosines))


@functools.lru_cache(maxsize=64)
def _leaving(albedo: float, g: float, eta: float) -> tuple[Array, Array]:
    """Return the nodes above the critical angle's cosine, and the share of light that leaves of what entered there."""
    mu, weights = cosine_rule(eta, NODES)
    mirrored = fresnel.reflectance(1.0 / eta, mu)
    reflected = _half_space(albedo, g, mu, weights)
    above = mirrored < 1.0
    upwards = np.linalg.solve(np.eye(len(mu)) - reflected * mirrored, reflected @ (1.0 - mirrored))
    return mu[above], np.asarray(upwards[above], np.float64)


def _half_space(albedo: float, g: float, mu: Array, weights: Array) -> Array:
    """Return the matrix from radiance down at the nodes to radiance up, (n, n), without a boundary."""
    orders = np.arange(len(mu))
    peak = g ** len(orders)
    without_peak = albedo * (1.0 - peak) / (1.0 - albedo * peak)
    moments = (2 * orders + 1) * (g**orders - peak) / (1.0 - peak)
    legendre = np.polynomial.legendre.legvander(mu, len(orders) - 1)
    forward, back = ((legendre * moments * sign**orders) @ legendre.T for sign in (1.0, -1.0))
    layer, identity = FIRST_LAYER / mu[:, None], np.eye(len(mu))
    reflected = 0.5 * without_peak * layer * back * weights
    crossed = identity * (1.0 - layer) + 0.5 * without_peak * layer * forward * weights
    for _ in range(MOST_DOUBLINGS):
        both = np.linalg.solve(identity - reflected @ reflected, np.hstack([crossed, reflected @ crossed]))
        down, up = both[:, : len(mu)], both[:, len(mu) :]
        reflected, crossed = reflected + crossed @ up, crossed @ down
        if crossed.max() < OPAQUE:
            break
    return np.asarray(reflected)
