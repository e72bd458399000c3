"""Light that leaves a half space, and the share of single scattering in it, which diffusion does not describe.

A half space with a smooth dielectric boundary, lit along its normal where no cosine is given, isotropic scattering with
the reduced coefficients (as `core.reference.photons`), fluxes relative to what has entered. Light that scatters once,
at a depth of z mean free paths with probability exp(-z), and then goes up at a cosine mu inside, leaves with
exp(-z / mu) F_t(mu):

    R_1 = a'/2 int_0^1 F_t(mu) mu / (1 + mu) dmu.

All orders together: without a boundary a half space returns the radiance a'/(4 pi) H(mu) H(mu') / (mu + mu') of a beam
from mu' (Chandrasekhar 1950, section 37), H in closed form,

    H(mu) = exp(-mu/pi int_0^{pi/2} ln(1 - a' t cot t) / (cos^2 t + mu^2 sin^2 t) dt)   (Stibbs and Weir 1959);

the boundary sends the share F_r of it back in, any number of times, which is a linear system in the radiance that comes
up to it. What leaves is R = 2 pi int F_t I mu dmu, exact for every albedo and index.
"""

import functools

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material

NODES = 24  # of the Gauss rule in cosine on either side of the critical angle
NOTABLE_SHARE = 1.0 / 3.0  # share above which a picture without single scattering is another picture
# Double-exponential nodes in (0, 1): the integrand has logarithms at both ends.
_V = np.arange(-3.2, 3.2, 0.05)
_SHARE = 1.0 / (1.0 + np.exp(-np.pi * np.sinh(_V)))
_WEIGHT = 0.05 * np.pi * np.cosh(_V) * _SHARE * (1.0 - _SHARE)


def share(material: Material) -> Array:
    """Return R_1 / R of R, G and B, (3,), in [0, 1]; 0 where nothing scatters."""
    return np.array([_share(float(albedo), material.eta) for albedo in material.alpha_prime])


def statement(material: Material) -> str:
    """Return a sentence on the share of single scattering, or that nothing scatters."""
    shares = share(material)
    if not shares.any():
        return "nothing scatters"
    listed = ", ".join(f"{100.0 * value:.0f} %" for value in shares)
    return (
        f"{listed} of the light that leaves (R, G, B; a half space lit along its normal) has scattered only once, and "
        "is drawn as if it had often where it is not followed: by ewald and layered, and below the distance of nodes"
    )


def reflected_once(albedo: float, eta: float) -> float:
    """Return R_1, the share of the entered flux that leaves after one scattering; albedo in [0, 1], eta >= 1."""
    mu, weights = cosine_rule(eta, NODES)
    leaving = fresnel.transmittance(1.0 / eta, mu)
    return float(0.5 * albedo * np.sum(weights * leaving * mu / (1.0 + mu)))


@functools.lru_cache(maxsize=1024)
def _share(albedo: float, eta: float) -> float:
    return reflected_once(albedo, eta) / reflectance(albedo, eta) if albedo > 0.0 else 0.0


def reflectance(albedo: float, eta: float) -> float:
    """Return R, the share of the entered flux that leaves after any number of scatterings; arguments likewise."""
    return float(reflectance_at(np.ones(1), albedo, eta)[0])


def reflectance_at(cosines: Array, albedo: float, eta: float) -> Array:
    """Return R, (n,), of light that has entered at cosines (n,) in (0, 1] to the normal inside."""
    mu, weights = cosine_rule(eta, NODES)
    h, of_beams = chandrasekhar_h(mu, albedo), chandrasekhar_h(cosines, albedo)
    inside = fresnel.reflectance(1.0 / eta, mu)
    kernel = 0.5 * albedo * h[:, None] * h / (mu[:, None] + mu) * (mu * inside * weights)
    beams = albedo / (4.0 * np.pi) * h[:, None] * of_beams / (mu[:, None] + cosines)
    upwards = np.linalg.solve(np.eye(len(mu)) - kernel, beams)
    return np.asarray(2.0 * np.pi * (weights * mu * (1.0 - inside)) @ upwards)


def chandrasekhar_h(mu: Array, albedo: float) -> Array:
    """Return Chandrasekhar's H(mu) of isotropic scattering at cosines (n,) in (0, 1]."""
    t = 0.5 * np.pi * _SHARE
    # t cot t = 1 - t^2/3 - t^4/45 - ... loses all digits near 0, and from there on only its distance to 1 counts.
    missing = np.where(t < 1e-2, t * t / 3.0 + t**4 / 45.0, 1.0 - t / np.tan(np.maximum(t, 1e-2)))
    logarithm = np.log((1.0 - albedo) + albedo * missing)
    below = np.cos(t) ** 2 + np.square(mu[:, None] * np.sin(t))
    integral = 0.5 * np.pi * np.sum(_WEIGHT * logarithm / below, axis=1)
    return np.asarray(np.exp(-mu / np.pi * integral))


@functools.lru_cache(maxsize=64)
def cosine_rule(eta: float, count: int) -> tuple[Array, Array]:
    """Return nodes and weights on [0, 1], `count` on either side of the cosine below which all is reflected."""
    critical = float(np.sqrt(max(0.0, 1.0 - 1.0 / eta**2)))
    nodes, weights = np.polynomial.legendre.leggauss(count)
    t, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    # F_t rises as a square root from the critical angle on, and H has a logarithm at 0: both ends in t^2.
    above, below = critical + (1.0 - critical) * t * t, critical * t * t
    of_above, of_below = 2.0 * t * (1.0 - critical) * weights, 2.0 * t * critical * weights
    return (above, of_above) if critical == 0.0 else (np.append(below, above), np.append(of_below, of_above))
