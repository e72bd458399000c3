"""The tables of a scene for what is all around the object, and how it shines in the highlights."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from milkglass.core.errors import InputError
from milkglass.viewer.scene.declaration import check_fields, setting

# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

BUILTIN_PROBES = ("studio", "backlight", "window", "overcast")  # of core.light.presets


@dataclass(frozen=True)
class SpecularSettings:
    """Phong highlights, added after the subsurface light."""

    TABLE: ClassVar[str] = "specular"

    strength: float = setting(
        "number", 0.3, low=0, high=100, why="brightness of highlights; 0 turns them off"
    )
    shininess: float = setting(
        "number", 80.0, low=1, high=1e5, why="Phong exponent: higher is a smaller highlight"
    )
    model: str = setting(
        "text", "phong", choices=("phong", "normalized"),
        why="phong: the paper's, strength times irradiance times cos^n; normalized: a lobe of integral 1, (n + 1) / (2 "
            "pi) cos^n, times Fresnel's reflectance, where strength 1 is the material's own gloss"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


@dataclass(frozen=True)
class EnvironmentSettings:
    """Light from all around; neither a path nor a builtin means none."""

    TABLE: ClassVar[str] = "environment"

    path: Path | None = setting(
        "path", None, optional=True, why="light probe, .hdr or .exr; instead of builtin"
    )
    rotation_deg: float = setting(
        "number", 0.0, unit="deg", low=-360, high=360, why="turn of the probe about the up axis"
    )
    intensity: float = setting(
        "number", 1.0, low=0, high=1e6, why="factor on the probe's radiance"
    )
    builtin: str | None = setting(
        "text", None, optional=True, choices=BUILTIN_PROBES,
        why="light that needs no file, made for the default camera; instead of path"
    )
    extract: bool = setting(
        "boolean", True, why="whether small strong sources of the probe shine as lamps do, with shadows"
    )
    occluded: bool = setting("boolean", True, why="whether the object is in the way of the light that reaches it")

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        if self.path is not None and self.builtin is not None:
            raise InputError("environment.path and environment.builtin are both given; keep one of them")

    @property
    def source(self) -> Path | str | None:
        """The file, else the name of the builtin probe; None without an environment."""
        return self.path or self.builtin

    @property
    def given(self) -> bool:
        """Whether there is an environment."""
        return self.source is not None
