"""Options shared by `view` and `render`, and the scene that they describe: scene file < --set < named options."""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from milkglass.core.errors import InputError
from milkglass.viewer.files.record import is_picture, read_record
from milkglass.viewer.scene.declaration import Setting, nearest, settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS, Light
from milkglass.viewer.scene.material_settings import ADDED, MaterialSettings
from milkglass.viewer.scene.scene import Change, Scene, apply_set, changed, parse_set
from milkglass.viewer.scene.settings import BUILTIN_PROBES, TABLES


class Flag(NamedTuple):
    """A named option for one key of the scene."""

    option: str
    table: str
    key: str
    panel: str

    @property
    def parameter(self) -> str:
        """Name of the Python parameter."""
        return self.option.removeprefix("--").replace("-", "_")

    @property
    def setting(self) -> Setting:
        """Declaration of the key."""
        return settings_of(TABLES[self.table])[self.key]


FLAGS = (
    Flag("--size-mm", "model", "size_mm", "Object"),
    Flag("--up", "model", "up", "Object"),
    Flag("--material", "material", "name", "Object"),
    Flag("--profile", "material", "profile", "Transport"),
    Flag("--transport", "transport", "method", "Transport"),
    Flag("--layers", "transport", "layers", "Transport"),
    Flag("--resolution", "transport", "resolution", "Transport"),
    Flag("--error-target", "transport", "error_target", "Transport"),
    Flag("--environment", "environment", "path", "Light"),
    Flag("--environment-rotation", "environment", "rotation_deg", "Light"),
    Flag("--environment-intensity", "environment", "intensity", "Light"),
    Flag("--camera-azimuth", "camera", "azimuth_deg", "Camera"),
    Flag("--camera-elevation", "camera", "elevation_deg", "Camera"),
    Flag("--camera-view-angle", "camera", "view_angle_deg", "Camera"),
    Flag("--camera-zoom", "camera", "zoom", "Camera"),
    Flag("--orthographic", "camera", "orthographic", "Camera"),
    Flag("--image-size", "display", "image_size", "Picture"),
    Flag("--exposure", "display", "exposure", "Picture"),
    Flag("--exposure-average", "display", "average", "Picture"),
    Flag("--display-transform", "display", "transform", "Picture"),
    Flag("--background", "display", "background", "Picture"),
)
# Options of commands that take a photograph.
PHOTO_FLAGS = (
    Flag("--depth", "photo", "depth", "Photograph"),
    Flag("--depth-strength", "photo", "depth_strength", "Photograph"),
    Flag("--depth-smoothing", "photo", "depth_smoothing", "Photograph"),
)
_METAVARS = {"number": "NUMBER", "integer": "N", "text": "NAME", "path": "FILE"}


def scene_options(
    command: Callable[..., None],
    excluded: Collection[str] = (),
    start: Scene | None = None,
    extra_flags: Sequence[Flag] = (),
) -> Callable[..., None]:
    """Return a command with all shared options, which receives the scene that they describe as its first argument.

    `excluded` names parameters of shared options that it does not have, `extra_flags` are further options. `start` is
    the scene that options change where no scene file is given.
    """
    specific = list(inspect.signature(command).parameters.values())[1:]
    shared = [parameter for parameter in _parameters(extra_flags) if parameter.name not in excluded]

    def with_scene(**values: Any) -> None:
        given = {parameter.name: values.pop(parameter.name) for parameter in shared}
        scene, heard = with_medium(scene_from_options(given, start), given)
        if heard is not None:
            typer.echo(f"milkglass: {heard}.", err=True)
        command(scene, **values)

    with_scene.__name__, with_scene.__doc__ = command.__name__, command.__doc__
    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters = [parameter.replace(kind=keyword) for parameter in [*shared, *specific]]
    with_scene.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    with_scene.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return with_scene


def scene_from_options(values: Mapping[str, Any], start: Scene | None = None) -> Scene:
    """Return the scene that option values by parameter name describe; None, empty or absent means not given.

    `start` is the scene that they change where they name no scene file.

    Raises
    ------
    InputError
        Naming the option or the scene file's key, the problem and the fix.
    """
    scene = start or Scene() if values["scene"] is None else load_scene(values["scene"])
    # Two steps, so that --material replaces coefficients given by --set instead of conflicting with them; additions of
    # --set to a material apply to the named one.
    scene = apply_set(scene, values["set"] or [])
    added = [change for change in parse_set(values["set"] or []) if change.key in ADDED]
    changes = added if values["material"] is not None else []
    changes += [
        _environment(value) if flag.option == "--environment" else Change(flag.table, flag.key, value, flag.option)
        for flag, value in ((flag, _parsed(flag, values.get(flag.parameter))) for flag in (*FLAGS, *PHOTO_FLAGS))
        if value is not None
    ]
    if values.get("model") is not None:
        if Path(values["model"]).suffix.lower() == ".toml":
            raise InputError(f"{values['model']} is a scene file, not a model; write --scene before it")
        changes.append(Change("model", "path", values["model"], "MODEL"))
    if values["light"]:
        changes.append(Change("lights", "", tuple(map(parse_light, values["light"])), "--light"))
    return changed(scene, changes)


def load_scene(path: str) -> Scene:
    """Read a scene file, or the scene that a picture was made of."""
    return read_record(path)[0] if is_picture(path) else Scene.load(path)


def with_medium(scene: Scene, values: Mapping[str, Any]) -> tuple[Scene, str | None]:
    """Return a scene in the medium of the model's file, and a sentence on it, where options name that and no other.

    A scene file's material is its own: it names one, or means the default.
    """
    path, assigned = values.get("model"), parse_set(values["set"] or [])
    named = values["material"] is not None or any(change.table == MaterialSettings.TABLE for change in assigned)
    if path is None or values["scene"] is not None or named:
        return scene, None
    from milkglass.viewer.files.gltf_medium import medium_of  # which few commands need

    medium = medium_of(Path(path))
    if medium is None:
        return scene, None
    return replace(scene, material=MaterialSettings.of(medium.material)), medium.sentence(Path(path))


def parse_light(text: str) -> Light:
    """Return the light of "KIND:x,y,z[:r,g,b][:key=value ...]", such as "sphere:90,120,80:radius_mm=40"."""
    label = f"--light {text}"
    kind, *parts = text.split(":")
    if kind not in LIGHT_KINDS:
        raise InputError(f"{label}: unknown kind of light; {nearest(kind, LIGHT_KINDS)}")
    vectors = [part for part in parts if "=" not in part]
    named = [part for part in parts if "=" in part]
    if not 1 <= len(vectors) <= 2 or parts != vectors + named:
        raise InputError(f"{label}: write {kind}:x,y,z or {kind}:x,y,z:r,g,b, then :key=value for more")
    declared = settings_of(LIGHT_KINDS[kind])
    # Checked here first, with the option's name in the message.
    values = {
        key: declared[key].checked(_numbers(vector, ",", label, "write numbers as 0.4,0.5,1"), f"{label}: {key}")
        for key, vector in zip(declared, vectors, strict=False)
    }
    for part in named:
        key, _, value = (word.strip() for word in part.partition("="))
        if key not in declared:
            raise InputError(f"{label}: unknown key {key}; {nearest(key, declared)}")
        if key in values:
            raise InputError(f"{label}: {key} is given twice; leave one out")
        values[key] = declared[key].checked(_light_value(declared[key], value, label), f"{label}: {key}")
    try:
        return LIGHT_KINDS[kind](**values)
    except InputError as error:  # conflicting keys
        raise InputError(f"{label}: {error}") from None


def _light_value(declared: Setting, text: str, label: str) -> Any:
    """Return a light's value in the type of its setting; invalid text is returned for the setting to refuse."""
    if declared.length is not None:
        return _numbers(text, ",", label, "write numbers as 0.4,0.5,1")
    if declared.kind == "boolean":
        return {"true": True, "false": False}.get(text, text)
    return _numbers(text, ",", label, "write a number")[0] if declared.kind == "number" else text


def _environment(name: str) -> Change:
    """Return the change to a builtin environment or a file; a file called "studio" is ./studio."""
    if name in BUILTIN_PROBES:
        return Change("environment", "builtin", name, "--environment")
    if name.isalpha() and not Path(name).exists():
        raise InputError(f"--environment {name} is neither a file nor builtin; {nearest(name, BUILTIN_PROBES)}")
    return Change("environment", "path", name, "--environment")


def _parsed(flag: Flag, value: Any) -> Any:
    """Return an option's value in the type of its setting; invalid text is returned for the setting to refuse."""
    if value is None:
        return None
    if flag.setting.length is not None:
        fix = "write WIDTHxHEIGHT such as 1024x768"
        return _numbers(value.lower(), "x", f"{flag.option} {value}", fix, int)
    kind = {"number": float, "integer": int}.get(flag.setting.kind)
    try:
        return value if kind is None or value in flag.setting.choices else kind(value)
    except ValueError:
        return value


def _numbers(text: str, separator: str, label: str, fix: str, kind: type = float) -> list[Any]:
    try:
        return [kind(part) for part in text.split(separator)]
    except ValueError:
        raise InputError(f"{label}: {text!r} is not a list of numbers; {fix}") from None


def _parameters(extra_flags: Sequence[Flag]) -> list[inspect.Parameter]:
    flags = *FLAGS, *extra_flags
    named = [_parameter(flag.parameter, *_declaration(flag)) for flag in flags]
    # Help shows panels in the order of their first option.
    first_of_light = [flag.panel for flag in flags].index("Light")
    model = typer.Argument(metavar="MODEL", help="Mesh file; without one, the scene's or the sculpture.")
    scene = typer.Option("--scene", metavar="FILE.toml", help="Scene file to start from.")
    assign = typer.Option(
        "--set", metavar="table.key=value", help="Change one key of the scene, as TOML; may be repeated."
    )
    light = typer.Option(
        "--light", metavar="KIND:x,y,z...", rich_help_panel="Light",
        help=f"KIND:x,y,z[:r,g,b][:key=value]; {_kinds(distant=True)} (towards the light; irradiance), or "
        f"{_kinds(distant=False)} (position in mm; intensity); then keys of the scene file, such as radius_mm=40. May "
        "be repeated, replaces the scene's lights.",
    )  # fmt: skip
    return [
        _parameter("model", str, model),
        _parameter("scene", str, scene),
        _parameter("set", list[str], assign),
        *named[:first_of_light],
        _parameter("light", list[str], light),
        *named[first_of_light:],
    ]


def _kinds(*, distant: bool) -> str:
    return ", ".join(name for name, kind in LIGHT_KINDS.items() if distant == kind.DISTANT)


def _declaration(flag: Flag) -> tuple[type, Any]:
    declared = flag.setting
    is_vector = declared.length is not None
    builtin = f" ({'|'.join(BUILTIN_PROBES)}, or a file)" if flag.option == "--environment" else ""
    option = typer.Option(
        flag.option,
        metavar="WxH" if is_vector else _METAVARS.get(declared.kind),
        help=declared.help() + builtin,
        rich_help_panel=flag.panel,
    )
    return (bool if declared.kind == "boolean" else str), option


def _parameter(name: str, kind: Any, option: Any) -> inspect.Parameter:
    annotation = Annotated[kind | None, option]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
