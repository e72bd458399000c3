"""The kinds of light of a scene: frozen, hashable, checked when they are made. Lengths in mm, angles in degrees.

Each class is a kind of `[[lights]]`, each field one of its keys, as in `viewer.scene.settings`.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, get_args

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.stages import Part
from milkglass.viewer.scene.declaration import check_fields, plain, setting, settings_of

# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

Vector = tuple[float, float, float]


def _position() -> Any:
    return setting("number", unit="mm", length=3, low=-1e9, high=1e9, moves=Part.LIGHT, why="place of its centre")


def _intensity(why: str) -> Any:
    return setting(
        "number", (1.2e5, 1.2e5, 1.2e5), length=3, low=0, high=1e15,
        moves=Part.LIGHT, why=f"R, G, B radiant intensity{why}; the default gives irradiance 3 at 200 mm"
    )


def _on() -> Any:
    return setting("boolean", True, moves=Part.LIGHT, why="whether the light shines; off keeps it for later")


def _fixed_to() -> Any:
    return setting(
        "text", "world", choices=("world", "camera"),
        moves=Part.LIGHT,
        why="what it turns with; camera: x is right, y up and z towards the viewer, about the model's centre"
    )


def _target() -> Any:
    return setting(
        "number", (0.0, 0.0, 0.0), unit="mm", length=3, low=-1e9, high=1e9,
        moves=Part.LIGHT, why="point that it faces; the model is centred at 0"
    )


@dataclass(frozen=True)
class DirectionalLight:
    """A distant light: a direction, or a disc of even radiance."""

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str] = "directional"

    direction: Vector = setting(
        "number", length=3, low=-1e6, high=1e6, nonzero=True, moves=Part.LIGHT, why="towards the light; any length"
    )
    irradiance: Vector = setting(
        "number", (3.0, 3.0, 3.0), length=3, low=0, high=1e9,
        moves=Part.LIGHT, why="R, G, B irradiance at normal incidence; about pi makes a white surface radiance 1"
    )
    on: bool = _on()
    angle_deg: float = setting(
        "number", 0.0, unit="deg", low=0, high=90,
        moves=Part.LIGHT, why="angular diameter: shadows are as soft; the sun has 0.5, 0 is sharp"
    )
    fixed_to: str = _fixed_to()

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


@dataclass(frozen=True)
class PointLight:
    """A near light: E = I cos / d^2."""

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str] = "point"

    position_mm: Vector = _position()
    intensity: Vector = _intensity("")
    on: bool = _on()
    fixed_to: str = _fixed_to()

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


@dataclass(frozen=True)
class SphereLight:
    """A ball of even radiance: a point light with a size."""

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str] = "sphere"

    position_mm: Vector = _position()
    intensity: Vector = _intensity("")
    on: bool = _on()
    radius_mm: float = setting(
        "number", 40.0, unit="mm", low=1e-3, high=1e9, moves=Part.LIGHT,
        why="radius: the larger, the softer are shadows"
    )
    fixed_to: str = _fixed_to()

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


@dataclass(frozen=True)
class RectangleLight:
    """A panel that shines from its front, by the cosine to its normal."""

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str] = "rectangle"

    position_mm: Vector = _position()
    intensity: Vector = _intensity(" along its normal")
    on: bool = _on()
    target_mm: Vector = _target()
    size_mm: tuple[float, float] = setting(
        "number", (120.0, 120.0), unit="mm", length=2, low=1e-3, high=1e9, moves=Part.LIGHT, why="width and height"
    )
    roll_deg: float = setting(
        "number", 0.0, unit="deg", low=-360, high=360, moves=Part.LIGHT, why="turn about its normal"
    )
    fixed_to: str = _fixed_to()

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        _check_aim(self.position_mm, self.target_mm)


@dataclass(frozen=True)
class SpotLight:
    """A point light that shines into a cone only."""

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str] = "spot"

    position_mm: Vector = _position()
    intensity: Vector = _intensity(" along its axis")
    on: bool = _on()
    target_mm: Vector = _target()
    cone_deg: float = setting(
        "number", 30.0, unit="deg", low=0.1, high=170, moves=Part.LIGHT, why="full angle of the cone, where it is dark"
    )
    softness: float = setting(
        "number", 0.2, low=0, high=1, moves=Part.LIGHT,
        why="share of that angle over which light fades; 0 is a sharp edge"
    )
    fixed_to: str = _fixed_to()

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        _check_aim(self.position_mm, self.target_mm)


# fmt: on

Light = DirectionalLight | PointLight | SphereLight | RectangleLight | SpotLight
LIGHT_KINDS: dict[str, type[Light]] = {light.KIND: light for light in get_args(Light)}
NAMES = ", ".join(kind.__name__ for kind in LIGHT_KINDS.values())


def _check_aim(position: Vector, target: Vector) -> None:
    if position == target:
        raise InputError("lights.target_mm is where the light is; give it another point to face")


def brightness(light: Light) -> Vector:
    """Irradiance or intensity, R, G and B."""
    return light.irradiance if isinstance(light, DirectionalLight) else light.intensity


def brightened(light: Light, value: Vector) -> Light:
    """Return the light with another irradiance or intensity."""
    if isinstance(light, DirectionalLight):
        return replace(light, irradiance=value)
    return replace(light, intensity=value)


def is_sharp(light: Light) -> bool:
    """Whether it shines from one point or direction, alike all around."""
    return isinstance(light, PointLight) or (isinstance(light, DirectionalLight) and light.angle_deg == 0.0)


def turned(light: Light, turn: Array) -> Light:
    """Turn a light about the origin: vectors v become v @ turn, (3, 3)."""

    def vector(v: Vector) -> Vector:
        x, y, z = (np.array(v) @ turn).tolist()
        return x, y, z

    if isinstance(light, DirectionalLight):
        return replace(light, direction=vector(light.direction))
    if isinstance(light, RectangleLight):
        light = replace(light, roll_deg=_turned_roll(light, turn))
    if isinstance(light, RectangleLight | SpotLight):
        return replace(light, position_mm=vector(light.position_mm), target_mm=vector(light.target_mm))
    return replace(light, position_mm=vector(light.position_mm))


def in_world(light: Light, rotation: Array) -> Light:
    """Return a light fixed to the camera as it is in the world; `rotation` as `viewer.scene.camera.Camera.rotation`."""
    return light if light.fixed_to == "world" else replace(turned(light, rotation.T), fixed_to="world")


def axes(light: RectangleLight | SpotLight, upright: bool = False) -> Array:
    """(3, 3): rows are its width, its height and the way it shines, unit, right-handed; `upright`: without its roll."""
    way = np.asarray(light.target_mm, np.float64) - np.asarray(light.position_mm, np.float64)
    way /= np.linalg.norm(way)
    up = np.array([0.0, 1.0, 0.0]) if abs(way[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    width = np.cross(up, way)
    width /= np.linalg.norm(width)
    height = np.cross(way, width)
    roll = 0.0 if upright or isinstance(light, SpotLight) else np.radians(light.roll_deg)
    turned_width = np.cos(roll) * width + np.sin(roll) * height
    return np.stack([turned_width, np.cross(way, turned_width), way])


def _turned_roll(light: RectangleLight, turn: Array) -> float:
    """Roll about the new normal that keeps the sides where the turn takes them."""
    width = axes(light)[0] @ turn
    x, y, z = (np.array(light.position_mm) @ turn).tolist()
    u, v, w = (np.array(light.target_mm) @ turn).tolist()
    frame = axes(replace(light, position_mm=(x, y, z), target_mm=(u, v, w)), upright=True)
    return float(np.degrees(np.arctan2(width @ frame[1], width @ frame[0])))


DISTANCE = 200.0  # mm, of a light that had none; two of a hand-sized object


def as_kind(light: Light, kind: str) -> Any:
    """Return a light of another kind; what both kinds have stays."""
    if kind == light.KIND:
        return light
    chosen = LIGHT_KINDS[kind]
    values = {key: getattr(light, key) for key in settings_of(light) if key in settings_of(chosen)}
    if isinstance(light, DirectionalLight):
        x, y, z = (DISTANCE * np.array(light.direction) / np.linalg.norm(light.direction)).tolist()
        values["position_mm"] = plain(x), plain(y), plain(z)
        values["intensity"] = tuple(channel * DISTANCE**2 for channel in light.irradiance)
    elif chosen is DirectionalLight:
        distance = max(float(np.linalg.norm(light.position_mm)), 1.0)
        values["direction"] = light.position_mm if any(light.position_mm) else (0.0, 1.0, 0.0)
        values["irradiance"] = tuple(channel / distance**2 for channel in brightness(light))
    if "target_mm" in settings_of(chosen) and values["position_mm"] == values.get("target_mm", (0.0, 0.0, 0.0)):
        values["position_mm"] = (0.0, DISTANCE, 0.0)  # it was where it is to face now
    return chosen(**values)


def as_fixed(light: Light, to: str, rotation: npt.NDArray[np.float64]) -> Light:
    """Return a light fixed to the world or the camera, whose rotation it is, that stays where it is for now."""
    moved = in_world(light, rotation)
    if to == "camera":
        moved = replace(turned(moved, rotation), fixed_to=to)
    vectors = {
        key: tuple(map(plain, getattr(moved, key)))
        for key in ("direction", "position_mm", "target_mm")
        if key in settings_of(moved)
    }
    return replace(moved, **vectors)  # type: ignore[arg-type]
