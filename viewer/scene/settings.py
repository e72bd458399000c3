"""The tables of a scene: frozen, hashable, checked when they are made. Lengths in mm, angles in degrees.

Each class is one table of the scene file and each field one key. Changing a value means making a new
table: ``dataclasses.replace(scene.camera, zoom=2.0)``.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from milkglass.core.errors import InputError
from milkglass.core.stages import Part
from milkglass.core.transport.methods import DEFAULT_METHOD, METHODS, Method
from milkglass.viewer.display.registry import TRANSFORMS
from milkglass.viewer.scene.declaration import check_fields, in_memory, setting
from milkglass.viewer.scene.light_paths import ALL, PATTERN, PATTERN_NAME, LightPaths, joined
from milkglass.viewer.scene.lights import DirectionalLight, Light
from milkglass.viewer.scene.material_settings import MaterialSettings as MaterialSettings  # one of the tables

if TYPE_CHECKING:
    from milkglass.core.geometry.mesh import Mesh
    from milkglass.core.light.probe import Probe

# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

SMOOTH_SHININESS = 300.0  # from which on highlights fall to half within 4 degrees
BUILTIN_PROBES = ("studio", "backlight", "window", "overcast")  # of core.light.presets
PROBE_PROJECTIONS = ("auto", "latlong", "angular", "mirrorball", "octahedral", "cross", "strip")  # of core.light.maps


@dataclass(frozen=True)
class Gloss:
    """What highlights are drawn with: `SpecularSettings` with nothing left open.

    Attributes
    ----------
    strength, shininess : float
    model : str
        A key of `GLOSS`.
    normalized : bool
        Whether the lobe has integral 1 and the weight of Fresnel's reflectance.
    """

    strength: float
    shininess: float
    model: str
    normalized: bool

    @property
    def is_smooth(self) -> bool:
        """Whether the surface mirrors as a smooth one does: discs with edges, and by rays where these are followed."""
        return self.normalized and self.strength > 0.0 and self.shininess >= SMOOTH_SHININESS


GLOSS = {gloss.model: gloss for gloss in (
    Gloss(0.3, 80.0, "phong", normalized=False),
    Gloss(1.0, 600.0, "normalized", normalized=True),
)}


@dataclass(frozen=True)
class SpecularSettings:
    """Phong highlights, added after the subsurface light."""

    TABLE: ClassVar[str] = "specular"

    strength: float | None = setting(
        "number", None, optional=True, low=0, high=100, default_text="1 if normalized, 0.3 if phong",
        moves=Part.LOOK, why="brightness of highlights; 0 turns them off"
    )
    shininess: float | None = setting(
        "number", None, optional=True, low=1, high=1e5, default_text="600 if normalized, 80 if phong",
        moves=Part.LOOK, why="Phong exponent: higher is a smaller highlight"
    )
    model: str | None = setting(
        "text", None, optional=True, choices=GLOSS.keys(), default_text="phong with layered, else normalized",
        moves=Part.LOOK,
        why="phong: the paper's, strength times irradiance times cos^n; normalized: a lobe of integral 1, (n + 1) / (2 "
            "pi) cos^n, times Fresnel's reflectance, where strength 1 is the material's own gloss"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    def resolve(self, method: Method) -> Gloss:
        """Return what highlights are drawn with beside a method of transport, which chooses what is left open."""
        usual = GLOSS[self.model or method.highlight_model]
        given = {key: value for key in ("strength", "shininess") if (value := getattr(self, key)) is not None}
        return replace(usual, **given)


@dataclass(frozen=True)
class EnvironmentSettings:
    """Light from all around; neither a path nor a builtin means none."""

    TABLE: ClassVar[str] = "environment"

    path: Path | None = setting(
        "path", None, optional=True, moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY),
        why="light probe, .hdr or .exr; instead of builtin"
    )
    rotation_deg: float = setting(
        "number", 0.0, unit="deg", low=-360, high=360, moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY),
        why="turn of the probe about the up axis"
    )
    intensity: float = setting(
        "number", 1.0, low=0, high=1e6, moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY),
        why="factor on the probe's radiance"
    )
    builtin: str | None = setting(
        "text", None, optional=True, choices=BUILTIN_PROBES,
        moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY),
        why="light that needs no file, made for the default camera; instead of path",
        tip="light that needs no file, made for the default camera"
    )
    extract: bool = setting(
        "boolean", True, moves=(Part.LIGHT, Part.OCCLUSION),
        why="whether small strong sources of the probe shine as lamps do, with shadows"
    )
    occluded: bool = setting(
        "boolean", True, moves=Part.OCCLUSION, why="whether the object is in the way of the light that reaches it"
    )
    projection: str = setting(
        "text", "auto", choices=PROBE_PROJECTIONS, moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY),
        why="how the probe's file maps directions; auto: latlong if 2:1, angular if square with dark corners"
    )
    probe: "Probe | None" = in_memory(moves=(Part.LIGHT, Part.OCCLUSION, Part.DISPLAY))  # instead of path and builtin

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        if self.path is not None and self.builtin is not None:
            raise InputError("environment.path and environment.builtin are both given; keep one of them")

    @property
    def source(self) -> "Probe | Path | str | None":
        """The probe in memory, else its file or the name of a builtin one; None without an environment."""
        return self.probe or self.path or self.builtin

    @property
    def given(self) -> bool:
        """Whether there is an environment."""
        return self.source is not None


# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

BEHIND = ("filled", "seen", "transparent")


@dataclass(frozen=True)
class PhotoSettings:
    """What a photograph's object has beside material and light; of no meaning to a model."""

    TABLE: ClassVar[str] = "photo"

    depth: Path | None = setting(
        "path", None, optional=True,
        moves=Part.OBJECT,
        why="depth map of a photograph in place of an estimate, larger is nearer: .png, or .exr, .npy in mm"
    )
    depth_strength: float = setting(
        "number", 1.0, low=0.05, high=5, moves=Part.OBJECT,
        why="factor on the depth of a photograph; 1 makes a disc a hemisphere"
    )
    depth_smoothing: float = setting(
        "number", 0.3, low=0.01, high=1, moves=Part.OBJECT,
        why="scale of light and dark that shapes it, in object radii"
    )
    behind: str = setting(
        "text", "filled", choices=BEHIND,
        moves=Part.PHOTOGRAPH,
        why="behind soft edges of the mask: the background filled in, or as seen; or no photograph at all"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


# fmt: off

# Powers of the colours on irradiance and on exitance.
POWERS = {"before": (1.0, 0.0), "half": (0.5, 0.5), "after": (0.0, 1.0), "off": (0.0, 0.0)}


@dataclass(frozen=True)
class DetailSettings:
    """Colours and relief of the model's surface, where it has them."""

    TABLE: ClassVar[str] = "detail"

    albedo: str = setting(
        "text", "half", choices=tuple(POWERS),
        moves=Part.SURFACE,
        why="where the model's colours act, white being the material as it is: before scattering, on light that "
            "enters, which blurs them; after, on light that leaves, sharp; half: their square roots on both"
    )
    normal_strength: float = setting(
        "number", 1.0, low=0, high=10, moves=Part.SURFACE, why="factor on the slopes of the normal map; 0 turns it off"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    @property
    def powers(self) -> tuple[float, float]:
        """Powers of the colours on irradiance and on exitance; they sum to 1, or to 0 where colours are off."""
        return POWERS[self.albedo]


# A setting reads as a paragraph: its value and range, then its reason.
# fmt: off
# ruff: noqa: RUF009  (setting() makes a dataclasses.field, fresh for each class)

Vector = tuple[float, float, float]
BUILTINS = ("sculpture", "tumbler", "bottle")


@dataclass(frozen=True)
class ModelSettings:
    """What is drawn. Neither a path nor a builtin given means the builtin sculpture."""

    TABLE: ClassVar[str] = "model"

    path: Path | None = setting(
        "path", None, optional=True, moves=Part.SHAPE, why="mesh file; instead of builtin"
    )
    builtin: str | None = setting(
        "text", None, optional=True, choices=BUILTINS, default_text="sculpture",
        moves=Part.SHAPE, why="a shape that needs no file; instead of path"
    )
    size_mm: float | str = setting(
        "number", 100.0, unit="mm", low=1e-3, high=1e6, choices=("file",),
        moves=(Part.OBJECT, Part.SHAPE),
        why="longest side of the model; a hand-sized object, since translucency depends on size; file: as the model's "
            "file has it"
    )
    up: str | None = setting(
        "text", None, optional=True, choices=("x", "y", "z", "-x", "-y", "-z"),
        default_text="of the file: z with STL and 3MF, COLLADA's own, else y",
        moves=Part.SHAPE, why="axis of the file that points up"
    )
    bodies: str | None = setting(
        "text", None, optional=True, choices=("joined", "separate"),
        default_text="separate with diffusion where there are up to 64, else joined",
        moves=Part.BODIES,
        why="joined: all of the surface together, so that light crosses the air between parts (diffusion: where they "
            "are within about four nodes of each other); or separate: each closed part alone"
    )
    nested: str = setting(
        "text", "hollow", choices=("hollow", "solid"),
        moves=Part.SHAPE,
        why="what a closed part of a file within another is, where the two look the same way: a cavity, or more of the "
            "same matter"
    )
    close_holes: bool = setting(
        "boolean", True, moves=Part.SHAPE,
        why="simple holes of a file's surface are closed, but for those of sheets"
    )
    texture: Path | None = setting(
        "path", None, optional=True,
        moves=Part.SURFACE,
        why="picture (.png, .jpg) over the model's texture coordinates, in place of the file's own colours"
    )
    normal_map: Path | None = setting(
        "path", None, optional=True,
        moves=Part.SURFACE,
        why="normals (.png, .jpg) over the model's texture coordinates, in place of the file's own; green points up"
    )
    mesh: "Mesh | None" = in_memory(moves=Part.SHAPE)  # in world space, instead of path and builtin
    # Clear parts and those that scatter, which have a material of their own; a scene knows these.
    parts: tuple[tuple[str, ...], tuple[str, ...]] | None = in_memory(moves=Part.SHAPE)

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        if self.path is not None and self.builtin is not None:
            raise InputError("model.path and model.builtin are both given; keep one of them")

    @property
    def length_mm(self) -> float:
        """The longest side in mm of what is no file's; raises `InputError` where that is said to be a file's."""
        if isinstance(self.size_mm, str):
            raise InputError(f'model.size_mm = "{self.size_mm}" needs a model of a file; give a number of mm')
        return self.size_mm

    @property
    def builtin_name(self) -> str | None:
        """Name of the builtin shape in use; None where a file or a mesh in memory is."""
        return (self.builtin or BUILTINS[0]) if self.path is None and self.mesh is None else None


@dataclass(frozen=True)
class CameraSettings:
    """Where the picture is taken from: orbit angles about a target, and a zoom, by default that of the silhouette."""

    TABLE: ClassVar[str] = "camera"

    azimuth_deg: float = setting(
        "number", 30.0, unit="deg", low=-360, high=360,
        moves=(Part.TRANSPORT, Part.VIEW), why="turn about the up axis, 0 looks along -z; a three-quarter view"
    )
    elevation_deg: float = setting(
        "number", 10.0, unit="deg", low=-90, high=90, moves=(Part.TRANSPORT, Part.VIEW),
        why="height of the view; slightly from above"
    )
    roll_deg: float = setting(
        "number", 0.0, unit="deg", low=-360, high=360, moves=(Part.TRANSPORT, Part.VIEW),
        why="turn about the line of sight"
    )
    view_angle_deg: float = setting(
        "number", 35.0, unit="deg", low=1, high=120,
        moves=Part.VIEW, why="full vertical view angle; a portrait lens, little distortion"
    )
    zoom: float | None = setting(
        "number", None, optional=True, low=0.01, high=100, default_text="the silhouette's box fills the picture",
        moves=Part.VIEW, why="magnification; 1 frames the bounding sphere from every side"
    )
    orthographic: bool = setting("boolean", False, moves=Part.VIEW, why="parallel projection instead of perspective")
    target_mm: Vector | None = setting(
        "number", None, optional=True, unit="mm", length=3, low=-1e6, high=1e6,
        default_text="0, the model's centre; without a zoom, behind the middle of the silhouette",
        moves=Part.VIEW, why="point the camera orbits and looks at; the model is centred at 0"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


# Lit from behind first: what shines through is what tells a translucent object from a painted one.
DEFAULT_LIGHTS: tuple[Light, ...] = (
    DirectionalLight((-0.6, 0.45, -0.65), (7.0, 5.6, 4.0), angle_deg=12.0),
    DirectionalLight((0.95, 0.45, 0.1), (1.9, 1.85, 1.8), angle_deg=20.0),
)


@dataclass(frozen=True)
class TransportSettings:
    """How light travels inside the object."""

    TABLE: ClassVar[str] = "transport"

    method: str = setting(
        "text", DEFAULT_METHOD, choices=METHODS.keys(),
        moves=(Part.BODIES, Part.SAMPLES, Part.OCCLUSION),
        why="diffusion: solved in the object itself, close to transport; ewald: close to the dipole integral, (1); "
            "layered: the paper's parallel layers"
    )
    layers: int | None = setting(
        "integer", None, optional=True, low=1, high=128, default_text="8 if layered, else as dense as the nodes",
        moves=Part.TRANSPORT, why="layers over the object's depth (layered) or its z extent (the others)"
    )
    resolution: int | None = setting(
        "integer", None, optional=True, unit="nodes", low=16, high=1024,
        default_text="128 if layered, else from the error target",
        moves=Part.SAMPLES,
        why="nodes along the longer side of a layer (layered), or along the longest side of the object (the others)"
    )
    error_target: float | None = setting(
        "number", None, optional=True, low=1e-3, high=0.5, default_text="0.02, as far as a slider can wait",
        moves=Part.SAMPLES,
        why="wanted rms error of exitance; chooses the resolution of ewald, and in proportion of diffusion, 62 nodes "
            "at 0.02; if given, it may take longer"
    )
    assignment: str | None = setting(
        "text", None, optional=True, choices=("tent", "tsc"), default_text="from the error target",
        moves=Part.TRANSPORT,
        why="how ewald spreads light over nodes and reads it back: tent over 8, faster; tsc over 27, smoother"
    )
    exchange: str | None = setting(
        "text", None, optional=True, choices=("on", "off"), default_text="on with diffusion, else off",
        moves=Part.OCCLUSION,
        why="light between parts: what leaves the object and meets it again enters, through the air; once with ewald "
            "and layered"
    )
    light_paths: str = setting(
        "text", ALL, choices=(ALL,), pattern=PATTERN, pattern_name=PATTERN_NAME, moves=Part.LOOK,
        why="auto: all the light that leaves the object; or parts of it to look at, with diffusion: what the surface "
            "mirrors, what is seen through the object, what has scattered once inside, and more often"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)
        if self.light_paths == ALL:
            return
        object.__setattr__(self, "light_paths", joined(self.light_paths.split("+")))
        if not self.facts.follows_sight:
            raise InputError(
                f'transport.light_paths is "{self.light_paths}", and transport {self.method} does not tell these parts '
                f'of light apart; leave it at "{ALL}", or choose transport diffusion'
            )

    @property
    def shown_paths(self) -> LightPaths:
        """Return the parts of light that pictures show."""
        return LightPaths.of(self.light_paths)

    @property
    def facts(self) -> Method:
        """Return the method's row of the registry of transports."""
        return METHODS[self.method]

    @property
    def exchanges(self) -> bool:
        """Whether light that leaves the object meets it again and enters."""
        return self.facts.exchanges if self.exchange is None else self.exchange == "on"


@dataclass(frozen=True)
class DisplaySettings:
    """How radiance becomes a picture: exposure, display transform, background."""

    TABLE: ClassVar[str] = "display"

    image_size: tuple[int, int] = setting(
        "integer", (1024, 1024), unit="px", length=2, low=16, high=16384, moves=Part.VIEW, why="width and height"
    )
    key: float = setting(
        "number", 0.55, low=1e-4, high=100, moves=(Part.DISPLAY, Part.PHOTOGRAPH),
        why="exposure: where the average of what is lit lands; by this, white marble looks white"
    )
    exposure: float = setting(
        "number", 0.0, unit="stops", low=-20, high=20, moves=(Part.DISPLAY, Part.PHOTOGRAPH),
        why="exposure beside the key: each stop doubles the light"
    )
    transform: str = setting(
        "text", "neutral", choices=tuple(TRANSFORMS), moves=Part.DISPLAY,
        why="what light looks like on a display; photographic: the paper's (Reinhard et al. 2002); neutral: Khronos "
            "PBR Neutral, colours of materials as they are; agx: highlights as on film; aces: ACES 2.0, as in cinema"
    )
    white: float = setting(
        "number", 3.0, low=1e-2, high=1e6, moves=(Part.OBJECT, Part.DISPLAY),
        why="exposed luminance that becomes pure white, with photographic and in photographs"
    )
    background: str = setting(
        "text", "black", choices=("black", "transparent", "environment"),
        pattern="#[0-9a-fA-F]{6}", pattern_name="#rrggbb", moves=Part.DISPLAY, why="what shows behind the object"
    )
    background_blur_deg: float = setting(
        "number", 0.0, unit="deg", low=0, high=90,
        moves=Part.DISPLAY, why="blur of the environment behind the object; the light it casts stays"
    )
    average: float | None = setting(
        "number", None, optional=True, low=1e-9, high=1e9, moves=Part.DISPLAY, default_text="that of the object",
        why="radiance that lands at the key, in place of the log-average of each picture: those of a series compare"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    @property
    def exposed_key(self) -> float:
        """Where the average of what is lit lands, stops of exposure included."""
        return float(self.key * 2.0**self.exposure)


@dataclass(frozen=True)
class GroundSettings:
    """A plane that the object stands on: it catches its shadow and the light that leaves it, and gives light back."""

    TABLE: ClassVar[str] = "ground"

    on: bool = setting(
        "boolean", False, moves=(Part.LIGHT, Part.OCCLUSION, Part.GROUND),
        why="whether the object stands on a plane, which catches its shadow and gives light back"
    )
    gap_mm: float = setting(
        "number", 0.0, unit="mm", low=0, high=1e6, moves=(Part.LIGHT, Part.OCCLUSION, Part.GROUND),
        why="from the plane up to the object's lowest point; the object floats above 0"
    )
    color: Vector = setting(
        "number", (1.0, 1.0, 1.0), length=3, low=0, high=1, moves=(Part.LIGHT, Part.OCCLUSION, Part.GROUND),
        why="R, G, B of its colour, linear"
    )
    reflectance: float = setting(
        "number", 0.5, low=0, high=1, moves=(Part.LIGHT, Part.OCCLUSION, Part.GROUND),
        why="share of the light on it that it returns, of a white one; evenly all around"
    )
    shown: str = setting(
        "text", "plane", choices=("plane", "shadow"), moves=Part.GROUND,
        why="plane: it fades into the background far away; shadow: what the object does to its light alone, over a "
            "background that stands for it"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

    @property
    def albedo(self) -> Vector:
        """R, G, B of the share of light that the plane returns."""
        red, green, blue = (self.reflectance * channel for channel in self.color)
        return red, green, blue


TABLES = {
    table.TABLE: table
    for table in (
        ModelSettings, CameraSettings, MaterialSettings, DetailSettings, SpecularSettings, EnvironmentSettings,
        TransportSettings, GroundSettings, DisplaySettings, PhotoSettings
    )
}
