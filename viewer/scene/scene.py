"""A scene: everything a picture depends on, as a TOML file, from the command line or from Python.

>>> import dataclasses
>>> scene = Scene(material=MaterialSettings(name="skim milk"))
>>> apply_set(scene, ["display.key=0.2", "material.name=jade"]).material.name
'jade'
>>> dataclasses.replace(scene, lights=()).effective_lights()
()
"""

import dataclasses
import html
import os
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from milkglass.core.errors import InputError
from milkglass.core.stages import Part
from milkglass.viewer.scene import own_materials, toml_files
from milkglass.viewer.scene.camera import view_rotation
from milkglass.viewer.scene.declaration import Setting, is_required, nearest, settings_of, shown
from milkglass.viewer.scene.given_file import given_bytes, reason_of
from milkglass.viewer.scene.keys import MATERIALS, Key, values_moving
from milkglass.viewer.scene.lights import LIGHT_KINDS, DirectionalLight, Light
from milkglass.viewer.scene.material_settings import COMBINATIONS, RIVALS
from milkglass.viewer.scene.settings import (
    DEFAULT_LIGHTS,
    TABLES,
    CameraSettings,
    DetailSettings,
    DisplaySettings,
    EnvironmentSettings,
    Gloss,
    GroundSettings,
    MaterialSettings,
    ModelSettings,
    PhotoSettings,
    SpecularSettings,
    TransportSettings,
)

__all__ = [
    "CameraSettings", "Change", "DetailSettings", "DisplaySettings", "EnvironmentSettings", "GroundSettings",
    "MaterialSettings", "ModelSettings", "PhotoSettings", "Scene", "SpecularSettings", "TransportSettings",
    "apply_set", "changed",
]  # fmt: skip

# A vessel is of glass, where nothing is said of its parts.
BUILTIN_MATERIALS = {vessel: {"glass": MaterialSettings.clear(1.52)} for vessel in ("tumbler", "bottle")}
# Keys that exclude each other: choosing one side drops the other, so "--material jade" works on any scene.
MOST_LIGHTS = 64  # each has shadow maps of some 25 MB
MOST_PARTS = 30  # one less than `core.paths.surface.MOST_MEDIA`, which needs numerics that reading a scene does without
CLEAR = {"sigma_s_prime": [0, 0, 0], "sigma_a": [0, 0, 0]}  # of a part, where its table does not say more
PartMaterials = tuple[tuple[str, MaterialSettings], ...]
_RIVALS = {
    "model": (({"path"}, {"builtin"}), ({"builtin"}, {"path"})),
    "environment": (({"path"}, {"builtin"}), ({"builtin"}, {"path"})),
    "material": RIVALS,
}


@dataclass(frozen=True)
class Scene:
    """Frozen and hashable; every table checks its own values.

    ``lights`` None means not given: a default pair then lights the object unless an environment does. ``materials``
    are pairs of a part's name and its material, or a mapping: parts of other matter, as glass around a liquid;
    ``material`` is what all others are of.
    """

    model: ModelSettings = field(default_factory=ModelSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    material: MaterialSettings = field(default_factory=lambda: MaterialSettings(name="marble"))
    detail: DetailSettings = field(default_factory=DetailSettings)
    specular: SpecularSettings = field(default_factory=SpecularSettings)
    lights: tuple[Light, ...] | None = None
    environment: EnvironmentSettings = field(default_factory=EnvironmentSettings)
    transport: TransportSettings = field(default_factory=TransportSettings)
    ground: GroundSettings = field(default_factory=GroundSettings)
    display: DisplaySettings = field(default_factory=DisplaySettings)
    photo: PhotoSettings = field(default_factory=PhotoSettings)
    materials: PartMaterials = ()

    def __post_init__(self) -> None:
        for name, table in TABLES.items():
            value = getattr(self, name)
            if not isinstance(value, table):
                raise InputError(f"{name} must be a {table.__name__}, not a {type(value).__name__}")
        if self.lights is not None:
            lights: object = self.lights
            if not isinstance(lights, list | tuple) or not all(isinstance(light, Light) for light in lights):
                names = ", ".join(kind.__name__ for kind in LIGHT_KINDS.values())
                raise InputError(f"lights must be a tuple of {names}, or None")
            _check_count(lights)
            object.__setattr__(self, "lights", tuple(lights))
        materials = self.materials or BUILTIN_MATERIALS.get(self.model.builtin_name or "", ())
        object.__setattr__(self, "materials", _checked_materials(materials))
        parts = None
        if self.materials:
            parts = tuple(name for name, _ in self.clear_parts), tuple(name for name, _ in self.scattering_parts)
        if self.model.parts != parts:
            object.__setattr__(self, "model", replace(self.model, parts=parts))
        if self.display.background == "environment" and not self.environment.given:
            fix = "set environment.path or environment.builtin too"
            raise InputError(f'display.background is "environment" but there is none; {fix}')

    @property
    def clear_parts(self) -> PartMaterials:
        """Parts with a material of their own that does not scatter light."""
        return tuple(part for part in self.materials if not any(part[1].resolve().sigma_s_prime))

    @property
    def scattering_parts(self) -> PartMaterials:
        """Parts with a material of their own that scatters light."""
        return tuple(part for part in self.materials if any(part[1].resolve().sigma_s_prime))

    def effective_lights(self) -> tuple[Light, ...]:
        """Return the lights that shine, as they are in the world: on, and not black."""
        shining = tuple(light for light in self.all_lights() if light.on and any(light.brightness))
        if all(light.fixed_to == "world" for light in shining):
            return shining
        return tuple(light.in_world(view_rotation(self.camera)) for light in shining)

    def key(self, part: Part, *, without: Collection[str] = ()) -> Key:
        """Return what a part of the pipeline depends on, hashable: all settings that move it or what it reads.

        Tables and lights may be left out (`without`, their names); the lights that stay are as they are in the world.
        """
        return values_moving(self, part.upstream, without)

    def moving(self, *parts: Part) -> Key:
        """Return the values of the settings that move one of some parts themselves, hashable."""
        return values_moving(self, parts)

    def floating(self) -> "Scene":
        """Return the scene without its ground."""
        return replace(self, ground=replace(self.ground, on=False))

    @property
    def gloss(self) -> Gloss:
        """What highlights are drawn with."""
        gloss = self.specular.resolve(self.transport.facts)
        return gloss if self.transport.shown_paths.mirror else replace(gloss, strength=0.0)

    @property
    def separate(self) -> bool:
        """Whether bodies scatter light each alone, where there are not too many."""
        bodies = self.model.bodies
        return bodies == "separate" or (bodies is None and self.transport.facts.separates_bodies)

    def all_lights(self) -> tuple[Light, ...]:
        """Return the lights given, off or on, else the default pair where there is no environment."""
        if self.lights is not None:
            return self.lights
        return () if self.environment.given else DEFAULT_LIGHTS

    @classmethod
    def load(cls, path: str | Path) -> "Scene":
        """Read a scene file; paths in it are relative to it.

        Raises
        ------
        InputError
            Naming the file, the table and key, the problem and the fix.
        """
        path = Path(path)
        document = toml_files.parse(given_bytes(path, "the scene file"), path)
        try:
            return _from_document(document, path.parent)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    def to_toml(self) -> str:
        """Return the text of a scene file; paths in it stay absolute."""
        return _to_toml(self, Path(os.path.sep))

    def _repr_html_(self) -> str:
        return _settings_html(_document(self, Path.cwd()))

    @classmethod
    def from_toml(cls, text: str) -> "Scene":
        """Read what `to_toml` returned; raise `InputError` for anything else."""
        try:
            document = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f"not a scene ({reason_of(error)})") from error
        return _from_document(document, Path(os.path.sep))

    def save(self, path: str | Path) -> None:
        """Write a scene file, whole or not at all; paths in it become relative to it where possible."""
        toml_files.write(path, _to_toml(self, Path(os.path.abspath(path)).parent), "the scene file")


def _settings_html(document: Mapping[str, Any]) -> str:
    """Return a scene file's content as a compact table for a notebook, a line for each of its tables."""
    lines = []
    for name, content in document.items():
        for table in content if isinstance(content, list) else [content]:
            values = html.escape(", ".join(filter(None, toml_files.dumps(table).splitlines())))
            cells = f"<th>{html.escape(name)}</th><td style='text-align: left'>{values}</td>"
            lines += [f"<tr>{cells}</tr>"] if values else []
    return f"<table>{''.join(lines)}</table>"


def _check_count(lights: Collection[object]) -> None:
    if len(lights) > MOST_LIGHTS:
        raise InputError(
            f"lights has {len(lights):,} entries, at most {MOST_LIGHTS} are drawn; make several one, "
            "or a light probe of them (environment.path)"
        )


def _checked_materials(given: PartMaterials | Mapping[str, MaterialSettings]) -> PartMaterials:
    """Return the materials of parts as pairs; raise `InputError` where one is none."""
    pairs = tuple(given.items()) if isinstance(given, Mapping) else tuple(given)
    if len(pairs) > MOST_PARTS:
        raise InputError(f"materials has {len(pairs)} parts; at most {MOST_PARTS} may have a material of their own")
    for name, settings in pairs:
        if not isinstance(settings, MaterialSettings):
            raise InputError(f"materials.{name} must be MaterialSettings, not a {type(settings).__name__}")
    return pairs


def first_look() -> Scene:
    """Return what a window shows a model in at first: jade, on a dark ground, under the lights where none are given."""
    return Scene(
        material=MaterialSettings(name="jade"),
        ground=GroundSettings(on=True, color=(0.8, 0.9, 1.0), reflectance=0.15),
        display=DisplaySettings(key=0.5, background="#2a2d30"),
    )


def default_scene() -> Scene:
    """Return what a newcomer sees: the sculpture in its first look, a warm key behind it, a cool fill beside."""
    fill = DirectionalLight((0.9, 0.5, 0.3), (1.6, 1.8, 2.0), angle_deg=20.0)
    return replace(first_look(), lights=(DEFAULT_LIGHTS[0], fill))


class Change(NamedTuple):
    """One value that replaces a scene's."""

    table: str
    key: str  # empty for all lights, and for the materials of all parts
    value: Any
    label: str  # what messages call it


def changed(scene: Scene, changes: Iterable[Change]) -> Scene:
    """Return the scene with all changes made together, a later one winning over an earlier one."""
    new: dict[str, dict[str, Any]] = {}
    materials = dict(scene.materials)
    for change in changes:
        if change.table == "lights":
            scene = replace(scene, lights=change.value)
            continue
        if change.table == MATERIALS:
            materials = dict(change.value)
            continue
        declared = MaterialSettings if _part_of(change.table) else TABLES[change.table]
        value = settings_of(declared)[change.key].checked(change.value, change.label)
        new.setdefault(change.table, {})[change.key] = value
    tables = {}
    for table, values in new.items():
        part = _part_of(table)
        kind = MaterialSettings.TABLE if part else table
        dropped = {key for chosen, rivals in _RIVALS.get(kind, ()) if chosen & values.keys() for key in rivals}
        values = {key: _default(kind, key) for key in dropped - values.keys()} | _spelled_out(kind, values)
        if part:
            materials[part] = replace(materials.get(part, MaterialSettings.clear()), **values)
        else:
            tables[table] = replace(getattr(scene, table), **values)
    return replace(scene, **tables, materials=tuple(materials.items()))


def _part_of(table: str) -> str:
    """Return the part whose material a table is, "materials.NAME"; empty where it is another one."""
    return table.removeprefix("materials.") if table.startswith("materials.") else ""


def _default(table: str, key: str) -> Any:
    return next(field.default for field in dataclasses.fields(TABLES[table]) if field.name == key)


def apply_set(scene: Scene, assignments: Sequence[str]) -> Scene:
    """Return the scene with assignments such as "display.key=0.2" or "lights=[]" made, in order.

    Values are TOML; text may stand without quotes. Relative paths are relative to the working directory.
    """
    return changed(scene, parse_set(assignments))


def parse_set(assignments: Sequence[str]) -> list[Change]:
    """Return the changes that assignments such as "display.key=0.2" make."""
    return [_parse_assignment(assignment) for assignment in assignments]


def _parse_assignment(assignment: str) -> Change:
    name, equals, text = (part.strip() for part in assignment.partition("="))
    label = f"--set {name}"
    if not equals:
        raise InputError(f"--set {assignment!r} is not an assignment; write table.key=value")
    if name in ("lights", MATERIALS):
        return change_to(name, _toml_value(text), label)
    kind = setting_at(name, label)[2].kind
    value = _toml_value(text)
    # A file called 7 or a material called nan is still text.
    if kind in ("text", "path") and not isinstance(value, str):
        value = text
    return change_to(name, value, label)


def change_to(name: str, value: Any, label: str, base: Path = Path()) -> Change:
    """Return the change of a key to a value as a scene file has it: "display.key", "materials.NAME.eta", "lights".

    `label` is what messages call it; `base` is what relative paths are relative to.

    Raises
    ------
    InputError
        For a name that is no key; the value is checked by `changed`.
    """
    if name == "lights":
        return Change(name, "", _lights(value, label), label)
    if name == MATERIALS:
        return Change(name, "", _materials(value, base), label)
    table, key, declared = setting_at(name, label)
    return Change(table, key, _placed(declared, value, base), label)


def setting_at(name: str, label: str) -> tuple[str, str, Setting]:
    """Return the table, the key and the declaration of a setting, "table.key"."""
    keys = {f"{table}.{key}": (table, key) for table in TABLES for key in settings_of(TABLES[table])}
    of_part = name.rpartition(".")[0]
    if _part_of(of_part):
        keys = {f"{of_part}.{key}": (of_part, key) for key in settings_of(MaterialSettings)}
    if name not in keys:
        raise InputError(f"{label} is unknown; {nearest(name, [*keys, 'lights'])}")
    table, key = keys[name]
    return table, key, settings_of(TABLES.get(table, MaterialSettings))[key]


def _placed(declared: Setting, value: Any, base: Path) -> Any:
    """Return a value, where it is a path as of a file in the folder `base`."""
    is_path = declared.kind == "path" and isinstance(value, str) and value
    return os.path.join(base, os.path.expanduser(value)) if is_path else value


def _toml_value(text: str) -> Any:
    try:
        document = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return document["value"] if document.keys() == {"value"} else text


def _from_document(document: Mapping[str, Any], base: Path) -> Scene:
    tables: dict[str, Any] = {}
    for name, content in document.items():
        if name == "lights":
            tables[name] = _lights(content, name)
        elif name == MATERIALS:
            tables[name] = _materials(content, base)
        elif name not in TABLES:
            raise InputError(f'unknown table "{name}"; {nearest(name, [*TABLES, "lights", MATERIALS])}')
        elif not isinstance(content, dict):
            raise InputError(f"{name} must be a table; write [{name}] on a line and its keys below")
        else:
            tables[name] = _table(TABLES[name], content, name, base)
    return Scene(**tables)


def _materials(content: Any, base: Path) -> PartMaterials:
    """Make the materials of parts; what a table does not say is of clear glass."""
    if not isinstance(content, dict) or not all(isinstance(table, dict) for table in content.values()):
        raise InputError("materials must be tables; write [materials.NAME] for each part, and its keys below")
    materials = {}
    for name, table in content.items():
        defines = {key for keys in COMBINATIONS for key in keys} & set(table)
        given = table if defines - set(CLEAR) else CLEAR | table
        try:
            materials[name] = _table(MaterialSettings, given, f"materials.{name}", base)
        except InputError as error:
            message = str(error)
            raise InputError(message if f"materials.{name}" in message else f"materials.{name}: {message}") from None
    return tuple(materials.items())


def _table(table: Any, content: Mapping[str, Any], label: str, base: Path) -> Any:
    """Make one table; `base` is what its relative paths are relative to."""
    declared: dict[str, Setting] = settings_of(table)
    values = {}
    for key, value in content.items():
        if key not in declared:
            raise InputError(f'unknown key {label}."{key}"; {nearest(key, declared)}')
        values[key] = declared[key].checked(_placed(declared[key], value, base), f"{label}.{key}")
    for missing in (f.name for f in dataclasses.fields(table) if is_required(f) and f.name not in values):
        raise InputError(f"{label}.{missing} is missing; it must be {declared[missing].expected()}")
    return table(**_spelled_out(table.TABLE, values))


def _spelled_out(table: str, values: dict[str, Any]) -> dict[str, Any]:
    return own_materials.spelled_out(values) if table == MaterialSettings.TABLE else values


def _lights(content: Any, label: str) -> tuple[Light, ...]:
    if not isinstance(content, list) or not all(isinstance(light, dict) for light in content):
        raise InputError(f"{label} must be a list of tables; write [[lights]] for each, or lights = [] for none")
    _check_count(content)
    return tuple(_light(light, f"{label}[{i}]") for i, light in enumerate(content))


def _light(content: dict[str, Any], label: str) -> Light:
    kind = content.get("kind")
    if not isinstance(kind, str) or kind not in LIGHT_KINDS:
        raise InputError(f"{label}.kind must be one of {', '.join(LIGHT_KINDS)}, not {shown(kind)}")
    rest = {key: value for key, value in content.items() if key != "kind"}
    light: Light = _table(LIGHT_KINDS[kind], rest, label, Path())
    return light


def _to_toml(scene: Scene, base: Path) -> str:
    if scene.model.mesh is not None or scene.environment.probe is not None:
        raise InputError("a scene file cannot hold a mesh or a light probe in memory: write it to a file and name that")
    return toml_files.dumps(_document(scene, base))


def _document(scene: Scene, base: Path) -> dict[str, Any]:
    """Return what a scene file holds, without a mesh or a light probe in memory."""
    document: dict[str, Any] = {}
    for name in (f.name for f in dataclasses.fields(scene)):
        content = getattr(scene, name)
        if content in (PhotoSettings(), ()) and name != "lights":
            continue  # most scenes have no photograph, and one material
        if name == MATERIALS:
            usual = _content(MaterialSettings.clear(), base)
            document[name] = {
                part: {
                    key: value
                    for key, value in _content(material, base).items()
                    if key in {*CLEAR, "eta"} or value != usual.get(key)
                }
                for part, material in content
            }
            continue
        if name != "lights":
            document[name] = _content(content, base)
        elif content is not None:
            document[name] = [{"kind": light.KIND} | _content(light, base) for light in content]
    return document


def _content(table: Any, base: Path) -> dict[str, Any]:
    values = {key: value for key in settings_of(table) if (value := getattr(table, key)) is not None}
    return {key: _relative(value, base) if isinstance(value, Path) else value for key, value in values.items()}


def _relative(path: Path, base: Path) -> str:
    try:
        relative = Path(os.path.relpath(path, base))
    except ValueError:  # another drive
        return path.as_posix()
    # ".." leaves a linked folder through another parent than the one we counted from.
    leaves_link = relative.parts[:1] == ("..",) and os.path.realpath(base) != str(base)
    return (path if leaves_link else relative).as_posix()


START = Scene(
    environment=EnvironmentSettings(occluded=False),
    specular=SpecularSettings(1.0, 80.0, "normalized"),
)
