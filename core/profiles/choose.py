"""The profiles of a material by name, and materials by colour and mean free path.

A colour and a mean free path, which artists think in, become coefficients by a profile's own diffuse reflectance: it
rises with the albedo, whatever the mean free path, and is inverted by root finding.
"""

import functools
import math

import numpy as np
from scipy.optimize import brentq

from milkglass.core.errors import InputError
from milkglass.core.material.library import MAX_COEFFICIENT, Material
from milkglass.core.profiles.base import Profile
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.profiles.registry import DIPOLE, TABLE, family

CHANNELS = ("red", "green", "blue")

Three = tuple[Profile, Profile, Profile]


def profiles(material: Material, name: str = DIPOLE, table: Three | None = None) -> Three:
    """Return the R, G and B profiles of a material; in a channel that does not scatter, a black dipole.

    Parameters
    ----------
    material : Material
        Of a `table` it changes nothing, and of `gaussians` the reflectance alone.
    name : one of `core.profiles.registry.PROFILES`
    table : from `core.profiles.table.parse_table`
        Where `name` is `table`.
    """
    if name == TABLE:
        if table is None:
            raise InputError("the profile table needs a file of radii and values")
        return table
    channel = family(name).channel
    red, green, blue = (
        standard if standard.is_black else channel(material, i) for i, standard in enumerate(dipoles(material))
    )
    return red, green, blue


@functools.lru_cache(maxsize=4096)
def reflectance(albedo: float, eta: float, name: str = DIPOLE) -> float:
    """Return the diffuse reflectance T(0) for a reduced albedo in [0, 1]; the standard dipole's where it is given.

    `burley` and `gaussians` are normalised, so theirs is given to them; a `table` has its own, whatever the material.
    """
    chosen = family(name)
    if chosen.reflectance is not None:
        return chosen.reflectance(albedo, eta)
    material = Material("", (albedo,) * 3, (1.0 - albedo,) * 3, eta)
    return float(profiles(material, DIPOLE if chosen.has_given_total else name)[0].total(0.0))


@functools.lru_cache(maxsize=4096)
def albedo_for(target: float, eta: float, name: str = DIPOLE) -> float:
    """Return the reduced albedo whose `reflectance` is the wanted one, to 1e-9.

    Raises
    ------
    InputError
        If no albedo reaches it.
    """
    highest = reflectance(1.0, eta, name)
    if not 0.0 <= target <= highest + 1e-9:
        raise InputError(f"a diffuse reflectance of {target:g} is out of reach of {name}: from 0 to {highest:.4g}")
    if target == 0.0:
        return 0.0
    if target >= highest:
        return 1.0
    # Near a' = 1 reflectance falls with sqrt(1 - a'), in which it is smooth.
    root = brentq(lambda t: reflectance(1.0 - t * t, eta, name) - target, 0.0, 1.0, xtol=1e-13, rtol=1e-12)
    return float(1.0 - root * root)


def material_of_colour(
    colour: tuple[float, float, float], length: tuple[float, float, float], eta: float, name: str = DIPOLE
) -> Material:
    """Return the material of a diffuse reflectance and a mean free path.

    Parameters
    ----------
    colour : R, G, B in [0, 1]
        Share of the entered light that leaves again.
    length : R, G, B in mm, > 0
        Mean free path 1 / s_t'.
    eta : float
    name : profile whose reflectance is inverted, one of `PROFILES`

    Raises
    ------
    InputError
        Naming the channel, if its reflectance is out of reach.
    """
    albedos = []
    for channel, target in zip(CHANNELS, colour, strict=True):
        try:
            albedos.append(albedo_for(float(target), eta, name))
        except InputError as error:
            raise InputError(f"{channel}: {error}") from None
    scattering, absorption = np.array(albedos) / length, (1.0 - np.array(albedos)) / length
    return Material("custom", tuple(scattering.tolist()), tuple(absorption.tolist()), eta, "colour")


def mean_free_paths(
    colour: tuple[float, float, float], diffuse: tuple[float, float, float], eta: float, name: str = DIPOLE
) -> tuple[float, float, float]:
    """Return 1 / s_t' (mm) of a diffuse reflectance and a diffuse mean free path 1 / s_tr, R, G and B, mm, > 0.

    s_tr = s_t' sqrt(3 (1 - a')), so 1 / s_t' = sqrt(3 (1 - a')) / s_tr. Other arguments as of `material_of_colour`.

    Raises
    ------
    InputError
        Naming the channel, if its reflectance is out of reach, or that of a material without absorption.
    """
    lengths = []
    for channel, target, length in zip(CHANNELS, colour, diffuse, strict=True):
        try:
            path = length * math.sqrt(3.0 * (1.0 - albedo_for(float(target), eta, name)))
        except InputError as error:
            raise InputError(f"{channel}: {error}") from None
        if path * MAX_COEFFICIENT < 1.0:
            raise InputError(
                f"{channel}: with a diffuse reflectance of {target:g} hardly anything is absorbed, and no scattering "
                f"makes the diffuse mean free path {length:g} mm; lower the colour or give mean_free_path_mm"
            )
        lengths.append(path)
    red, green, blue = lengths
    return red, green, blue
