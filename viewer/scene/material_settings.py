"""The scene's table of the material: by name, coefficients or colour, what is added to it, and its profiles.

A name is the library's. Materials of a person's own (`viewer.scene.own_materials`) are here as their coefficients, so
that a scene says everything itself: where a scene file, an option or the panel names one, `spelled_out` writes them.
"""

import functools
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.mixtures import LEAST_WATER, dilute, mix
from milkglass.core.profiles.registry import DIPOLE, PROFILES, TABLE
from milkglass.core.stages import Part
from milkglass.viewer.scene.declaration import check_fields, setting

if TYPE_CHECKING:
    from collections.abc import Callable

    from milkglass.core.profiles.base import Profiles
    from milkglass.viewer.scene.tables import ProfileTable

# A setting reads as a paragraph: its value and range, then its reason.
# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

Vector = tuple[float, float, float]
ISOTROPIC = (0.0, 0.0, 0.0)
# Combinations of keys that define a material: exactly one of them, with all its keys.
COMBINATIONS = (
    ("name",),
    ("sigma_s_prime", "sigma_a"),
    ("diffuse_reflectance", "mean_free_path_mm"),
    ("diffuse_reflectance", "diffuse_mean_free_path_mm"),
)
MIX_COEFFICIENTS = ("mix_sigma_s_prime", "mix_sigma_a", "mix_eta", "mix_g")  # in the place of mix_with
ADDED = ("mix_with", *MIX_COEFFICIENTS, "mix_share", "water")
# Keys that exclude each other: choosing one side sets the other to its default. A new material starts pure.
_NAME, _COEFFICIENTS, _LENGTH, _DIFFUSE_LENGTH = map(set, COMBINATIONS)
_COLOUR = _LENGTH | _DIFFUSE_LENGTH
RIVALS = (
    (_NAME, _COEFFICIENTS | _COLOUR | {"eta", "g", *ADDED}),
    (_COEFFICIENTS, _NAME | _COLOUR),
    (_COLOUR, _NAME | _COEFFICIENTS),
    ({"mean_free_path_mm"}, {"diffuse_mean_free_path_mm"}),
    ({"diffuse_mean_free_path_mm"}, {"mean_free_path_mm"}),
    ({"mix_with"}, {*MIX_COEFFICIENTS}),
    ({*MIX_COEFFICIENTS}, {"mix_with"}),
)


@dataclass(frozen=True)
class MaterialSettings:
    """A material of the library by name, coefficients of one's own, or a colour and a mean free path."""

    TABLE: ClassVar[str] = "material"
    DEFAULT_ETA: ClassVar[float] = 1.5

    name: str | None = setting(
        "text", None, optional=True, default_text="marble",
        moves=Part.IRRADIANCE,
        why="material of the library (`milkglass materials`), however spaced and capitalised; or one of your own: the "
            "scene then keeps its coefficients"
    )
    sigma_s_prime: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        moves=Part.TRANSPORT, why="reduced scattering coefficient of R, G, B; with sigma_a, instead of name",
        tip="reduced scattering coefficient: how often light turns, a mm"
    )
    sigma_a: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        moves=Part.TRANSPORT, why="absorption coefficient of R, G, B; with sigma_s_prime, instead of name",
        tip="absorption coefficient: how often light is lost, a mm"
    )
    eta: float | None = setting(
        "number", None, optional=True, low=materials.MIN_ETA, high=materials.MAX_ETA,
        default_text="of the named material, else 1.5", moves=Part.IRRADIANCE,
        why="relative index of refraction, before anything is added"
    )
    g: Vector | None = setting(
        "number", None, optional=True, length=3, low=0, high=materials.MAX_G,
        default_text="of the named material, else 0", moves=Part.TRANSPORT,
        why="mean cosine of the angle by which one scattering turns light of R, G, B: 0 all ways alike, near 1 almost "
            "straight on; sigma_s_prime stays, and of clear and murky matter the look changes",
        tip="mean cosine of the angle by which one scattering turns light: 0 all ways alike, near 1 almost straight "
            "on; changes the look of clear and murky matter"
    )
    diffuse_reflectance: Vector | None = setting(
        "number", None, optional=True, length=3, low=0, high=1,
        moves=Part.TRANSPORT,
        why="colour: share of R, G, B that leaves again of what enters; with mean_free_path_mm, instead of name; the "
            "profile's own reflectance turns them into coefficients",
        tip="colour: share of light that leaves again of what enters"
    )
    mean_free_path_mm: Vector | None = setting(
        "number", None, optional=True, unit="mm", length=3, low=1 / materials.MAX_COEFFICIENT, high=1e6,
        moves=Part.TRANSPORT, why="1 / sigma_t' of R, G, B; with diffuse_reflectance, instead of name",
        tip="mean free path: how far light goes before it scatters or is lost"
    )
    diffuse_mean_free_path_mm: Vector | None = setting(
        "number", None, optional=True, unit="mm", length=3, low=1 / materials.MAX_COEFFICIENT, high=1e6,
        moves=Part.TRANSPORT,
        why="1 / sigma_tr of R, G, B, how far light gets before it is absorbed; with diffuse_reflectance, instead of "
            "mean_free_path_mm",
        tip="how far light gets before it is absorbed"
    )
    mix_with: str | None = setting(
        "text", None, optional=True,
        moves=Part.IRRADIANCE, why="a second material, by name as above; coefficients and index are weighted by volume"
    )
    mix_sigma_s_prime: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        moves=Part.TRANSPORT, why="reduced scattering of the second material; with mix_sigma_a, instead of mix_with"
    )
    mix_sigma_a: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        moves=Part.TRANSPORT, why="absorption of the second material; with mix_sigma_s_prime, instead of mix_with"
    )
    mix_eta: float | None = setting(
        "number", None, optional=True, low=materials.MIN_ETA, high=materials.MAX_ETA,
        default_text="that of the first material", moves=Part.IRRADIANCE,
        why="index of refraction of a second material by coefficients"
    )
    mix_g: Vector | None = setting(
        "number", None, optional=True, length=3, low=0, high=materials.MAX_G, default_text="0", moves=Part.TRANSPORT,
        why="mean cosine of scattering of a second material by coefficients"
    )
    mix_share: float = setting(
        "number", 0.5, low=0, high=1, moves=Part.IRRADIANCE, why="share of the volume that the second material has"
    )
    water: float = setting(
        "number", 0.0, low=LEAST_WATER, high=1,
        moves=Part.IRRADIANCE,
        why="share of the volume that is water, which absorbs too: 0.9 is one part in ten; below 0 water is taken "
            "out, -1 is twice as strong"
    )
    profile: str = setting(
        "text", DIPOLE, choices=tuple(PROFILES),
        moves=Part.TRANSPORT, why="diffusion profile R_d that ewald and layered sum; diffusion has no profile"
    )
    profile_table: Path | None = setting(
        "path", None, optional=True, moves=Part.TRANSPORT,
        why="CSV of radius_mm, R, G, B (R_d in 1/mm^2) for the profile table",
        tip="a profile of your own: a CSV file of radii in mm and R_d of R, G, B in 1/mm²"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        for key in ("name", "mix_with"):
            if getattr(self, key) is not None:  # in the library's own spelling
                object.__setattr__(self, key, materials.lookup(getattr(self, key)).name)
        self._check_combination()
        if (self.mix_sigma_s_prime is None) != (self.mix_sigma_a is None):
            keys = MIX_COEFFICIENTS[:2] if self.mix_sigma_a is None else MIX_COEFFICIENTS[1::-1]
            raise InputError(f"material.{keys[0]} is given without material.{keys[1]}; add it")
        if self.mix_with is not None and self.mix_sigma_a is not None:
            raise InputError("material.mix_with and material.mix_sigma_a are both given; keep one of them")
        if self.profile == TABLE and self.profile_table is None:
            raise InputError('material.profile is "table" without material.profile_table; add the file')
        if self.diffuse_reflectance is not None:
            self.base()  # a colour out of reach is told at once
        if self.water < 0.0:
            self.resolve()  # and a concentration

    def _check_combination(self) -> None:
        """Check that exactly one combination of keys defines the material, with all its keys."""
        used = [key for key in dict.fromkeys(itertools.chain(*COMBINATIONS)) if getattr(self, key) is not None]
        if not used:
            raise InputError(
                "material has neither name nor sigma_s_prime and sigma_a, nor diffuse_reflectance and "
                "mean_free_path_mm; give one of them"
            )
        for pair in itertools.combinations(used, 2):
            if not any({*pair} <= {*combination} for combination in COMBINATIONS):
                raise InputError(f"material.{pair[0]} and material.{pair[1]} are both given; keep one of them")
        combination = next(combination for combination in COMBINATIONS if {*used} <= {*combination})
        if len(used) < len(combination):
            missing = next(key for key in combination if key not in used)
            raise InputError(f"material.{used[0]} is given without material.{missing}; add it")

    @classmethod
    def of(cls, material: materials.Material, **values: Any) -> "MaterialSettings":
        """Return settings of a material: its name if the library has it, else its coefficients, and other values."""
        if material in materials.library():
            return cls(name=material.name, **values)
        coefficients = {key: getattr(material, key) for key in ("sigma_s_prime", "sigma_a", "eta", "g")}
        return cls(**coefficients, **values)

    @classmethod
    def clear(cls, eta: float = DEFAULT_ETA, sigma_a: Vector = (0.0, 0.0, 0.0)) -> "MaterialSettings":
        """Return settings of a material that does not scatter, as glass, which may absorb."""
        return cls(sigma_s_prime=(0.0, 0.0, 0.0), sigma_a=sigma_a, eta=eta)

    def isotropic(self) -> "MaterialSettings":
        """Return settings of the same coefficients, mixed and diluted, that scatter all ways alike."""
        material = replace(self.resolve(), g=ISOTROPIC)
        return MaterialSettings.of(material, profile=self.profile, profile_table=self.profile_table)

    def resolve(self) -> materials.Material:
        """Return the material that light meets: `base`, mixed and diluted."""
        return _resolved(self)

    def admixture(self) -> materials.Material | None:
        """Return the material that is mixed in, if any."""
        if self.mix_with is not None:
            return materials.lookup(self.mix_with)
        if self.mix_sigma_s_prime is None or self.mix_sigma_a is None:
            return None
        eta = self.base().eta if self.mix_eta is None else self.mix_eta
        g = self.mix_g or ISOTROPIC
        return materials.Material("custom", self.mix_sigma_s_prime, self.mix_sigma_a, eta, "scene", g)

    def base(self) -> materials.Material:
        """Return the material before anything is added."""
        found = self._base()
        return found if self.g is None else replace(found, g=self.g)

    def _base(self) -> materials.Material:
        if self.name is not None:
            found = materials.lookup(self.name)
            return found if self.eta is None else replace(found, eta=self.eta)
        eta = self.DEFAULT_ETA if self.eta is None else self.eta
        if self.sigma_s_prime is not None and self.sigma_a is not None:
            return materials.Material("custom", self.sigma_s_prime, self.sigma_a, eta, "scene")
        assert self.diffuse_reflectance is not None  # _check_combination
        from milkglass.core.profiles import choose as profiles  # numerics that what only reads settings need not load

        colour, lengths = self.diffuse_reflectance, self.mean_free_path_mm
        try:
            if lengths is None:
                assert self.diffuse_mean_free_path_mm is not None
                lengths = profiles.mean_free_paths(colour, self.diffuse_mean_free_path_mm, eta, self.profile)
            return profiles.material_of_colour(colour, lengths, eta, self.profile)
        except InputError as error:
            raise InputError(f"material.diffuse_reflectance, {error}") from None

    @property
    def table_in_use(self) -> Path | None:
        """The file that the profile is read from, if it is."""
        return self.profile_table if self.profile == TABLE else None

    def profiles(self, read: "Callable[[Path], ProfileTable] | None" = None) -> "Profiles":
        """Return the R, G and B profiles of the material.

        Parameters
        ----------
        read : callable, optional
            Takes the place of `viewer.scene.tables.read_profile_table`, whose errors this may raise.
        """
        from milkglass.core.profiles.choose import profiles
        from milkglass.viewer.scene.tables import read_profile_table

        path = self.table_in_use
        table = None if path is None else (read or read_profile_table)(path)
        return profiles(self.resolve(), self.profile, table)


@functools.lru_cache(maxsize=64)  # a window asks many times a frame
def _resolved(settings: MaterialSettings) -> materials.Material:
    material, admixture = settings.base(), settings.admixture()
    if admixture is not None:
        material = mix(material, admixture, settings.mix_share)
    try:
        return material if settings.water == 0.0 else dilute(material, settings.water)
    except InputError as error:
        raise InputError(f"material.water = {settings.water:g} is too strong: {error}") from None
