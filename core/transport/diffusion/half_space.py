"""What diffusion lacks of the light that a half space returns: of dark matter up to a fifth.

Where little of what scatters goes on scattering, light leaves next to where it entered, and the surface is a half space
to it. There diffusion, of light whose first scattering is at depths z along a ray of cosine c,

    M / E = a' sum w exp(-sigma c z) / (1 + 2 A D sigma),

and transport theory (`core.material.single_scattering`) are both exact, and the light that enters is taken times the
ratio of the two. At an albedo of 0.9 it is within 2 % of 1 at indices of 1.3 to 1.5, and light that crosses an object
counts, which the ratio is not for: from dark to bright matter it fades out.

Where matter scatters forward (`core.material.adding`), a half space returns less than by reduced coefficients, and the
light counts times that ratio too. In bright matter the ratio is 1 by itself.

Thin parts are no half space, and there is less to add or to take off: of the ratios' difference to 1 counts the share
that three free paths, which light takes at least to enter, to scatter twice and to leave, have below the chord,
1 - (1 + x + x^2 / 2) e^-x.
"""

import functools

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.material import adding
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import LONGEST_CHORD, first_scattering
from milkglass.core.material.single_scattering import reflectance_at
from milkglass.core.transport.diffusion.constants import CONSTANTS

LIMITS = CONSTANTS.half_space
COSINES = 16  # of the table, between the critical angle's and 1
LEAST_COSINE = 1e-3


def gain(medium: Medium, cosines: Array, chords: Array) -> Array:
    """Return the factor on light that enters, (n,), with which dark half spaces return what they do by transport.

    Parameters
    ----------
    medium : Medium
    cosines, chords : (n,) arrays
        To the normal, of rays inside; mean free paths along them to the surface, inf allowed.
    """
    dark = np.clip((LIMITS.bright_albedo - medium.albedo) / (LIMITS.bright_albedo - LIMITS.dark_albedo), 0.0, 1.0)
    forward = medium.g > 0.0 and 0.0 < medium.albedo < adding.SIMILAR_ALBEDO
    if dark == 0.0 and not forward:
        return np.ones(len(cosines))
    chord = np.minimum(chords, LONGEST_CHORD)
    thick = 1.0 - (1.0 + chord + 0.5 * chord * chord) * np.exp(-chord)
    factor = np.ones(len(cosines))
    if dark > 0.0:
        ratio = np.interp(cosines, *_table(medium.albedo, medium.eta, medium.anisotropy))
        factor += dark * thick * (ratio - 1.0)
    if forward:
        ratio = np.interp(cosines, *_forward_table(medium.albedo, medium.g, medium.eta))
        factor *= 1.0 + thick * (ratio - 1.0)
    return factor


def returned(medium: Medium, cosines: Array) -> Array:
    """Return M / E of diffusion in a half space, (n,), for light that has entered at cosines (n,) inside."""
    depths, weights = first_scattering(np.full(1, np.inf))
    sigma = medium.attenuation * medium.mean_free_path
    scattered = np.sum(weights * np.exp(-sigma * depths * cosines[:, None]), axis=1)
    boundary = 1.0 + 2.0 * medium.extrapolation_factor * medium.diffusion * medium.attenuation
    return np.asarray(medium.albedo * scattered / boundary)


@functools.lru_cache(maxsize=64)
def _table(albedo: float, eta: float, anisotropy: float) -> tuple[Array, Array]:
    """Return cosines and what a half space returns over what diffusion has of it, (COSINES,) each."""
    cosines, medium = _entering(eta), Medium(albedo, 1.0 - albedo, eta, anisotropy)
    return cosines, reflectance_at(cosines, albedo, eta) / returned(medium, cosines)


@functools.lru_cache(maxsize=64)
def _forward_table(albedo: float, g: float, eta: float) -> tuple[Array, Array]:
    """Return cosines and what a half space returns over what it does by reduced coefficients, (COSINES,) each."""
    cosines, scattering = _entering(eta), albedo / (1.0 - g)
    unreduced = scattering / (scattering + 1.0 - albedo)
    return cosines, adding.reflectance_at(cosines, unreduced, g, eta) / reflectance_at(cosines, albedo, eta)


def _entering(eta: float) -> Array:
    """Return cosines to the normal inside of light that has entered, (COSINES,)."""
    critical = float(np.sqrt(max(0.0, 1.0 - 1.0 / eta**2)))
    return np.maximum(np.linspace(critical, 1.0, COSINES), LEAST_COSINE)
