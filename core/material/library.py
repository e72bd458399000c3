"""Library of translucent materials: scattering and absorption coefficients, measured or chosen.

Units are 1/mm; sigma_s_prime is the reduced scattering coefficient, already multiplied by (1 - g), with g the
mean cosine of the angle by which one scattering turns light: 0 where it is not known, or nothing scatters. Sources, as
the column `source` of library.csv names them:

JMLH01
    Jensen, Marschner, Levoy and Hanrahan, "A Practical Model for Subsurface Light Transport", SIGGRAPH 2001,
    figure 5, with eta = 1.3 (marble 1.5). The red sigma_a of Chicken1 and Chicken2 also circulates ten times
    too small; 0.015 and 0.018 are right. Spectralon has no absorption at all.
NGD06
    Narasimhan, Gupta, Donner, Ramamoorthi, Nayar and Jensen, "Acquiring Scattering Properties of
    Participating Media by Dilution", SIGGRAPH 2006. The undiluted media: sigma_s_prime =
    (sigma_t - sigma_a) (1 - g), scaled by the dilution; g is measured. eta = 1.33 (water) is assumed, not measured.
milkglass
    Chosen by us to look right on an object of 100 mm. Not measurements.
"""

import csv
import difflib
import functools
import importlib.resources
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError

MIN_ETA, MAX_ETA = 1.0, 3.0
MAX_G = 0.999  # mean cosine, beyond any measured one; at 1 scattering would turn nothing
MAX_COEFFICIENT = 1e6  # 1/mm, a mean free path of a nanometre: beyond any material, and safely squared
CHANNELS = ("r", "g", "b")
# Below this albedo most light is absorbed before it scatters twice, and diffusion does not describe it.
MIN_DIFFUSE_ALBEDO = 0.5
LONG_PATH = 10.0  # mm, a mean free path of which few objects hold many
DECIMETRE = 100.0  # mm


@dataclass(frozen=True)
class Material:
    """Scattering of a homogeneous material, one value a colour channel.

    Attributes
    ----------
    name : as published
    sigma_s_prime : (r, g, b) reduced scattering coefficient, 1/mm, in [0, MAX_COEFFICIENT]
    sigma_a : (r, g, b) absorption coefficient, 1/mm, in [0, MAX_COEFFICIENT]
    eta : relative index of refraction, in [1, 3]
    source : where the numbers come from: "JMLH01", "NGD06", "milkglass", or the caller's word
    g : (r, g, b) mean cosine of scattering, in [0, MAX_G]; 0 is isotropic
    """

    name: str
    sigma_s_prime: tuple[float, float, float]
    sigma_a: tuple[float, float, float]
    eta: float = 1.3
    source: str = "user"
    g: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for field, high, unit in (
            ("sigma_s_prime", MAX_COEFFICIENT, " (1/mm)"),
            ("sigma_a", MAX_COEFFICIENT, " (1/mm)"),
            ("g", MAX_G, ""),
        ):
            checked = _checked_vector(getattr(self, field), f"{self.name}: {field}", high, unit)
            object.__setattr__(self, field, checked)
        if not _is_number(self.eta) or not MIN_ETA <= self.eta <= MAX_ETA:
            raise InputError(f"{self.name}: eta must be a number from {MIN_ETA:g} to {MAX_ETA:g}, not {self.eta!r}")
        object.__setattr__(self, "eta", float(self.eta))

    @property
    def sigma_t_prime(self) -> Array:
        """(3,) reduced extinction coefficient sigma_s' + sigma_a, 1/mm."""
        sigma_t_prime: Array = np.asarray(self.sigma_s_prime) + np.asarray(self.sigma_a)
        return sigma_t_prime

    @property
    def alpha_prime(self) -> Array:
        """(3,) reduced albedo sigma_s' / sigma_t' in [0, 1]; 0 where there is no material to meet."""
        sigma_t_prime = self.sigma_t_prime
        return np.divide(self.sigma_s_prime, sigma_t_prime, out=np.zeros(3), where=sigma_t_prime > 0.0)

    @property
    def sigma_tr(self) -> Array:
        """(3,) effective transport coefficient sqrt(3 sigma_a sigma_t'), 1/mm."""
        sigma_tr: Array = np.sqrt(3.0 * np.asarray(self.sigma_a) * self.sigma_t_prime)
        return sigma_tr

    @property
    def mean_free_path(self) -> Array:
        """(3,) 1 / sigma_t', mm; inf where there is nothing to meet."""
        sigma_t_prime = self.sigma_t_prime
        nowhere: Array = np.full(3, math.inf)
        return np.divide(np.ones(3), sigma_t_prime, out=nowhere, where=sigma_t_prime > 0.0)


@functools.cache
def library() -> tuple[Material, ...]:
    """Return every material of the library, ours last."""
    table = importlib.resources.files(__package__).joinpath("library.csv").read_text(encoding="utf-8")

    def vector(row: dict[str, str], field: str) -> tuple[float, float, float]:
        r, g, b = (float(row[f"{field}_{channel}"] or 0.0) for channel in CHANNELS)
        return r, g, b

    def material(row: dict[str, str]) -> Material:
        scattering, absorption = vector(row, "sigma_s_prime"), vector(row, "sigma_a")
        return Material(row["name"], scattering, absorption, float(row["eta"]), row["source"], vector(row, "g"))

    return tuple(material(row) for row in csv.DictReader(table.splitlines()))


def names() -> tuple[str, ...]:
    """Return the names of the library in its order."""
    return tuple(material.name for material in library())


def lookup(name: str, additional: Sequence[Material] = ()) -> Material:
    """Return a material by name, ignoring case, spaces, hyphens and underscores: of the library, else `additional`.

    Raises
    ------
    InputError
        Naming the nearest materials, where there is none of that name.
    """
    by_key = {key_of(material.name): material for material in additional} | _by_key()
    found = by_key.get(key_of(name))
    if found is not None:
        return found
    # Substrings first: "milk" means any of the milks.
    near = [key for key in by_key if key_of(name) and key_of(name) in key]
    near += [key for key in difflib.get_close_matches(key_of(name), by_key, n=3, cutoff=0.5) if key not in near]
    listed = ", ".join(by_key[key].name for key in near[:6])
    fix = f"the nearest are {listed}" if near else "the library has none like it"
    shown = name if len(name) <= 60 else name[:57] + "..."
    raise InputError(f"unknown material {shown!r}: {fix} (`milkglass materials` lists all)")


def diffusion_holds(material: Material) -> bool:
    """Return whether all channels scatter, with an albedo of at least 1/2, and none `is_thin`."""
    scatters = np.asarray(material.sigma_s_prime) > 0.0
    return bool((scatters & (material.alpha_prime >= MIN_DIFFUSE_ALBEDO)).all()) and not is_thin(material)


def is_thin(material: Material) -> bool:
    """Return whether an object in the hand is optically thin in a channel: a mean free path >= `LONG_PATH`."""
    return bool((material.mean_free_path >= LONG_PATH).any())


def validity_notes(material: Material, *, of_profile: bool = True) -> list[str]:
    """Return short phrases on where values are assumed, and a diffusion profile is doubtful; empty where all is fine.

    Pictures that are made `of_profile` have no light that scatters once or never.
    """
    assumed = ["eta assumed"] if material.source == "NGD06" else []
    if not of_profile:
        return assumed
    scattering, absorption = np.asarray(material.sigma_s_prime), np.asarray(material.sigma_a)
    scatters = scattering > 0.0
    far = scatters & (material.mean_free_path >= DECIMETRE)
    findings = [
        (~scatters, "no scattering in {}: black"),
        (scatters & (absorption == 0.0), "no absorption in {}: sigma_tr = 0, 1/rho^3 tail"),
        (scatters & (material.alpha_prime < MIN_DIFFUSE_ALBEDO), "alpha' < 0.5 in {}: diffusion doubtful"),
        (far, "mean free path of decimetres in {}: nearly clear"),
        (scatters & ~far & (material.mean_free_path >= LONG_PATH), "mean free path above 10 mm in {}"),
    ]
    notes = [phrase.format(_named(channels)) for channels, phrase in findings if channels.any()]
    return [*notes, *assumed]


@functools.cache
def _by_key() -> dict[str, Material]:
    return {key_of(material.name): material for material in library()}


def _named(channels: npt.NDArray[np.bool_]) -> str:
    chosen = [name for name, is_chosen in zip(CHANNELS, channels, strict=True) if is_chosen]
    return ", ".join(chosen[:-1]) + (" and " if chosen[1:] else "") + chosen[-1]


def key_of(name: str) -> str:
    """Return the key of a name: lower case, without spaces, hyphens and underscores."""
    return re.sub(r"[\s_-]+", "", name).casefold()


def _is_number(value: object) -> bool:
    if isinstance(value, bool):  # True is a Real
        return False
    try:
        return isinstance(value, Real) and math.isfinite(value)
    except OverflowError:  # an integer beyond 1e308
        return False


def _checked_vector(value: object, label: str, high: float, unit: str) -> tuple[float, float, float]:
    elements = list(value) if isinstance(value, tuple | list | np.ndarray) else []
    if len(elements) != 3 or not all(_is_number(element) and 0.0 <= element <= high for element in elements):
        raise InputError(f"{label} must be 3 numbers from 0 to {high:g}{unit}, not {value!r}")
    r, g, b = (float(element) for element in elements)
    return r, g, b
