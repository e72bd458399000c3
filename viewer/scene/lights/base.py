"""What every kind of light has: its keys' checks, brightness, turns, sub-lights, and its like of another kind.

A kind is a frozen dataclass whose fields are the keys of its `[[lights]]` table, in their order there. Lengths are in
mm, angles in degrees, vectors (3,) in world space or in the camera's (`Light.fixed_to`).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.paths.lamps import BALL, LEAST_ANGLE_DEG, Lamp
from milkglass.core.stages import Part
from milkglass.viewer.scene.declaration import check_fields, plain, setting, settings_of
from milkglass.viewer.scene.lights.sub_lights import PARTS, SubLights, Vector

# fmt: off
# ruff: noqa: RUF009  (light_setting() makes a dataclasses.field, fresh for each class)

light_setting = partial(setting, moves=(Part.LIGHT, Part.OCCLUSION))  # of a ground that lamps shine on, which is around

DEFAULT_DISTANCE = 200.0  # mm, of a near light that was distant; two radii of a hand-sized object
MAX_SUB_LIGHTS, MAX_DRAFT_SUB_LIGHTS = 96, 8
SMALL_DEG = 1.0  # apparent diameter of a light that one shadow map and its filter do for
DEGREES_A_SUB_LIGHT = 2.0  # of the diameter: mean absolute errors of irradiance are then 1 to 3.5 %


def on_setting() -> Any:
    """Declare the key that switches a light on and off."""
    return light_setting("boolean", default=True, why="whether the light shines; off keeps it for later")


def fixed_to_setting() -> Any:
    """Declare the key that names the frame in which a light stays."""
    return light_setting(
        "text", "world", choices=("world", "camera"),
        why="what it turns with; camera: x is right, y up and z towards the viewer, about the model's centre"
    )


def intensity_setting(why: str = "") -> Any:
    """Declare the radiant intensity of a near light; `why` adds the direction in which it is meant."""
    return light_setting(
        "number", (1.2e5, 1.2e5, 1.2e5), length=3, low=0, high=1e15,
        why=f"R, G, B radiant intensity{why}; the default gives irradiance 3 at 200 mm"
    )


@dataclass(frozen=True)
class Light(ABC):
    """A light of a scene, of any kind; immutable, and equal to one of equal values.

    Attributes
    ----------
    TABLE, KIND : str
        Name of the scene file's list of lights, and of the kind in it.
    DISTANT : bool
        Whether its rays come from directions (`vector` is one) instead of from places (`vector` is one, mm).
    BRIGHTNESS : str
        Key of its irradiance at normal incidence, or of its radiant intensity.
    VECTORS : tuple of str
        Keys of its directions and places, the one of `vector` first: they turn with the light.
    """

    TABLE: ClassVar[str] = "lights"
    KIND: ClassVar[str]
    DISTANT: ClassVar[bool]
    BRIGHTNESS: ClassVar[str]
    VECTORS: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    @property
    @abstractmethod
    def on(self) -> bool:
        """Whether the light shines in the scene."""

    @property
    @abstractmethod
    def fixed_to(self) -> str:
        """Frame in which it stays: "world" or "camera"."""

    @property
    def vector(self) -> Vector:
        """Direction towards a distant light, of any length; place of the centre of a near one, mm."""
        vector: Vector = getattr(self, self.VECTORS[0])
        return vector

    @property
    def brightness(self) -> Vector:
        """Irradiance at normal incidence of a distant light, radiant intensity of a near one; R, G and B."""
        brightness: Vector = getattr(self, self.BRIGHTNESS)
        return brightness

    def with_values(self, **values: Any) -> Self:
        """Return the light with other values of some keys."""
        return replace(self, **values)

    def brightened(self, brightness: Vector) -> Self:
        """Return the light with another `brightness`."""
        return self.with_values(**{self.BRIGHTNESS: brightness})

    def turned(self, turn: Array) -> Self:
        """Return the light turned about the origin: vectors v become v @ turn, (3, 3)."""
        vectors = {key: turned_vector(getattr(self, key), turn) for key in self.VECTORS}
        return self.with_values(**{key: self._in_range(key, vector) for key, vector in vectors.items()})

    def _in_range(self, key: str, vector: Vector) -> Vector:
        """Return a vector shortened to what its key may be, as no turn keeps a box: of directions nothing is lost.

        A place is at 1000 km then, from where no light matters.
        """
        high = settings_of(self)[key].high
        longest = max(map(abs, vector))
        if high is None or longest <= high:
            return vector
        x, y, z = (high * (component / longest) for component in vector)
        return x, y, z

    def in_world(self, rotation: Array) -> Self:
        """Return the light fixed to the world where it is now; `rotation` as `viewer.scene.camera.Camera.rotation`."""
        return self if self.fixed_to == "world" else self.turned(rotation.T).with_values(fixed_to="world")

    def refixed(self, frame: str, rotation: Array) -> Self:
        """Return the light fixed to "world" or "camera", where it is now; `rotation` is the camera's."""
        moved = self.in_world(rotation)
        if frame == "camera":
            moved = moved.turned(rotation).with_values(fixed_to=frame)
        return moved.with_values(**{key: tuple(map(plain, getattr(moved, key))) for key in self.VECTORS})

    @property
    @abstractmethod
    def is_sharp(self) -> bool:
        """Whether it shines from one point or direction, alike all around: one shadow map does for it."""

    def widened(self, angle_deg: float) -> "Light":
        """Return the light with at least so large a disc in the sky, degrees, where it has one."""
        return self

    @abstractmethod
    def apparent_deg(self, mesh_radius: float) -> float:
        """Return its angular diameter, degrees, seen from the side of the object next to it; of the larger side.

        `mesh_radius` is of the object's bounding sphere about the origin, mm.
        """

    def sub_light_count(self, mesh_radius: float, *, draft: bool = False) -> int:
        """Return how many sub-lights it needs: few where the filter of a shadow is about right, or for a draft."""
        angle = self.apparent_deg(mesh_radius)
        if angle <= SMALL_DEG:
            return 1
        # Across a flat light: what it is beside the object for counts as well, and a panel that nearly touches needs
        # many.
        across = float(np.degrees(2.0 * np.tan(0.5 * np.radians(min(angle, 170.0)))))
        count = min(MAX_SUB_LIGHTS, PARTS * int(np.ceil(across / DEGREES_A_SUB_LIGHT / PARTS)))
        if draft:
            return 1 if count == PARTS else min(1 + count // 8, MAX_DRAFT_SUB_LIGHTS)
        return count

    @abstractmethod
    def sub_lights(self, count: int, far: float = np.inf) -> SubLights:
        """Divide the light, in world space, into `count` sub-lights; one farther away than `far` mm as directions."""

    @abstractmethod
    def seen(self) -> Lamp:
        """Return the lamp that rays of sight meet, in world space; one without a size has `LEAST_ANGLE_DEG`."""

    @classmethod
    def like(cls, light: "Light") -> Self:
        """Return a light of this kind that lights the origin as another one does; keys that both kinds have stay."""
        return cls(**cls._values_like(light))

    @classmethod
    def _values_like(cls, light: "Light") -> dict[str, Any]:
        return {key: getattr(light, key) for key in settings_of(light) if key in settings_of(cls)}

    @abstractmethod
    def as_near(self) -> tuple[Vector, Vector]:
        """Return the place (mm) and radiant intensity of a point light that lights the origin as this light does."""

    @abstractmethod
    def as_distant(self) -> tuple[Vector, Vector]:
        """Return the direction and irradiance of a distant light that lights the origin as this light does."""


@dataclass(frozen=True)
class NearLight(Light):
    """A light at a place, whose irradiance falls with the square of the distance."""

    DISTANT: ClassVar[bool] = False
    BRIGHTNESS: ClassVar[str] = "intensity"
    VECTORS: ClassVar[tuple[str, ...]] = ("position_mm",)

    position_mm: Vector = light_setting("number", unit="mm", length=3, low=-1e9, high=1e9, why="place of its centre")
    intensity: Vector = intensity_setting()
    on: bool = on_setting()

    @property
    def half_extent(self) -> float:
        """Half of its longest side, mm; 0 of a point."""
        return 0.0

    @property
    def is_sharp(self) -> bool:
        """See `Light.is_sharp`."""
        return False

    def apparent_deg(self, mesh_radius: float) -> float:
        """See `Light.apparent_deg`."""
        distance = float(np.linalg.norm(self.position_mm))
        nearest = max(distance - mesh_radius, 0.25 * distance, 1e-9)
        return 2.0 * float(np.degrees(np.arctan(self.half_extent / nearest)))

    def sub_lights(self, count: int, far: float = np.inf) -> SubLights:
        """See `Light.sub_lights`."""
        parts = self._divided(count)
        return parts if np.linalg.norm(self.position_mm) <= far else parts.as_directions()

    @abstractmethod
    def _divided(self, count: int) -> SubLights:
        """Divide the light into sub-lights at their places."""

    def seen(self) -> Lamp:
        """See `Light.seen`."""
        return self._ball(self.half_extent)

    def _ball(self, radius: float) -> Lamp:
        """Return a ball of even radiance, of no less than the least angular diameter."""
        least = float(np.linalg.norm(self.position_mm) * np.tan(0.5 * np.radians(LEAST_ANGLE_DEG)))
        radius = max(radius, least, 1e-6)
        red, green, blue = (channel / (np.pi * radius**2) for channel in self.intensity)
        return Lamp(BALL, self.position_mm, (red, green, blue), radius)

    @classmethod
    def _values_like(cls, light: Light) -> dict[str, Any]:
        position, intensity = light.as_near()
        return super()._values_like(light) | {"position_mm": position, "intensity": intensity}

    def as_near(self) -> tuple[Vector, Vector]:
        """See `Light.as_near`."""
        return self.position_mm, self.intensity

    def as_distant(self) -> tuple[Vector, Vector]:
        """See `Light.as_distant`."""
        distance = max(float(np.linalg.norm(self.position_mm)), 1.0)
        red, green, blue = (channel / distance**2 for channel in self.intensity)
        return self.position_mm if any(self.position_mm) else (0.0, 1.0, 0.0), (red, green, blue)


@dataclass(frozen=True)
class AimedLight(NearLight):
    """A near light that faces a target."""

    VECTORS: ClassVar[tuple[str, ...]] = ("position_mm", "target_mm")

    target_mm: Vector = light_setting(
        "number", (0.0, 0.0, 0.0), unit="mm", length=3, low=-1e9, high=1e9,
        why="point that it faces; the model is centred at 0"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.position_mm == self.target_mm:
            raise InputError("lights.target_mm is where the light is; give it another point to face")

    @property
    def axes(self) -> Array:
        """Unit rows (3, 3), right-handed: along its width, along its height, and from it towards the target."""
        forward = np.asarray(self.target_mm, np.float64) - np.asarray(self.position_mm, np.float64)
        forward /= np.linalg.norm(forward)
        up = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
        width = np.cross(up, forward)
        width /= np.linalg.norm(width)
        return np.stack([width, np.cross(forward, width), forward])

    @classmethod
    def _values_like(cls, light: Light) -> dict[str, Any]:
        values = super()._values_like(light)
        if values["position_mm"] == values.get("target_mm", (0.0, 0.0, 0.0)):  # it was where it is to face now
            values["position_mm"] = 0.0, DEFAULT_DISTANCE, 0.0
        return values


def turned_vector(vector: Vector, turn: Array) -> Vector:
    """Return vector @ turn, (3, 3), as floats."""
    x, y, z = (np.array(vector) @ turn).tolist()
    return x, y, z
