"""The scene's table of the material: by name, by coefficients or by colour and mean free path; and its profiles."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from core import materials
from core.errors import InputError
from core.profile_names import DIPOLE, PROFILES, TABLE
from viewer.declaration import check_fields, setting

if TYPE_CHECKING:
    from collections.abc import Callable

    from core.spectra import Profiles
    from viewer.profile_files import ProfileTable

# A setting reads as a paragraph: its value and range, then its reason.
# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

Vector = tuple[float, float, float]
# Ways to say what a material is: one of them, whole.
WAYS = (("name",), ("sigma_s_prime", "sigma_a"), ("diffuse_reflectance", "mean_free_path_mm"))


@dataclass(frozen=True)
class MaterialSettings:
    """A material of the library by name, coefficients of one's own, or a colour and a mean free path."""

    TABLE: ClassVar[str] = "material"
    DEFAULT_ETA: ClassVar[float] = 1.5

    name: str | None = setting(
        "text", None, optional=True, default_text="marble",
        why="material of the library (`milkglass materials`), however spaced and capitalised"
    )
    sigma_s_prime: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        why="reduced scattering coefficient of R, G, B; with sigma_a, instead of name"
    )
    sigma_a: Vector | None = setting(
        "number", None, optional=True, unit="1/mm", length=3, low=0, high=materials.MAX_COEFFICIENT,
        why="absorption coefficient of R, G, B; with sigma_s_prime, instead of name"
    )
    eta: float | None = setting(
        "number", None, optional=True, low=materials.MIN_ETA, high=materials.MAX_ETA,
        default_text="of the named material, else 1.5", why="relative index of refraction"
    )
    diffuse_reflectance: Vector | None = setting(
        "number", None, optional=True, length=3, low=0, high=1,
        why="colour: share of R, G, B that leaves again of what enters; with mean_free_path_mm, instead of name; the "
            "profile's own reflectance turns them into coefficients"
    )
    mean_free_path_mm: Vector | None = setting(
        "number", None, optional=True, unit="mm", length=3, low=1 / materials.MAX_COEFFICIENT, high=1e6,
        why="1 / sigma_t' of R, G, B; with diffuse_reflectance, instead of name"
    )
    profile: str = setting(
        "text", DIPOLE, choices=PROFILES,
        why="diffusion profile R_d that ewald and layered sum; diffusion has no profile"
    )
    profile_table: Path | None = setting(
        "path", None, optional=True, why="CSV of radius_mm, R, G, B (R_d in 1/mm^2) for the profile table"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        given = [(way, [key for key in way if getattr(self, key) is not None]) for way in WAYS]
        used = [(way, keys) for way, keys in given if keys]
        if len(used) > 1:
            raise InputError(f"material.{used[0][1][0]} and material.{used[1][1][0]} are both given; keep one of them")
        if not used:
            raise InputError(
                "material has neither name nor sigma_s_prime and sigma_a, nor diffuse_reflectance and "
                "mean_free_path_mm; give one of them"
            )
        way, keys = used[0]
        if len(keys) < len(way):
            missing = next(key for key in way if key not in keys)
            raise InputError(f"material.{keys[0]} is given without material.{missing}; add it")
        if self.name is not None:
            object.__setattr__(self, "name", materials.lookup(self.name).name)
        if self.profile == TABLE and self.profile_table is None:
            raise InputError('material.profile is "table" without material.profile_table; add the file')
        if self.diffuse_reflectance is not None:
            self.resolve()  # a colour out of reach is told at once

    def resolve(self) -> materials.Material:
        """Return the material these settings describe."""
        if self.name is not None:
            found = materials.lookup(self.name)
            return found if self.eta is None else replace(found, eta=self.eta)
        eta = self.DEFAULT_ETA if self.eta is None else self.eta
        if self.sigma_s_prime is not None and self.sigma_a is not None:
            return materials.Material("custom", self.sigma_s_prime, self.sigma_a, eta, "scene")
        assert self.diffuse_reflectance is not None  # __post_init__
        assert self.mean_free_path_mm is not None
        from core.profiles import material_of_colour  # numerics that what only reads settings need not load

        try:
            return material_of_colour(self.diffuse_reflectance, self.mean_free_path_mm, eta, self.profile)
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
            Takes the place of `viewer.profile_files.read_profile_table`, whose errors this may raise.
        """
        from core.profiles import profiles
        from viewer.profile_files import read_profile_table

        path = self.table_in_use
        table = None if path is None else (read or read_profile_table)(path)
        return profiles(self.resolve(), self.profile, table)
