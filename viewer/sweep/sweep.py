"""Sweep files: a base scene, what varies, and what is written of each picture.

    scene = "base.toml"                       # without one, the default settings
    table = "conditions.csv"                  # a row a picture

    [grid]                                    # a product of all
    "material.name" = ["jade", "marble"]

    [random]                                  # seeded draws
    count = 100
    "model.size_mm" = {low = 10, high = 100, scale = "log"}

    [turntable]
    frames = 60

    [output]
    files = ["png", "depth"]

All that varies multiplies: the grid's first key changes slowest, the turntable's frames fastest.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from milkglass.core.errors import InputError
from milkglass.viewer.scene import toml_files
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.declaration import check_fields, nearest, setting, settings_of, shown
from milkglass.viewer.scene.given_file import given_bytes
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.sweep.axes import (
    LABEL,
    SEQUENCES,
    TURN,
    Axis,
    Drawn,
    Listed,
    Turntable,
    Values,
    read_draw,
    read_table,
    with_values,
)

# fmt: off


MOST_PICTURES = 1_000_000  # that are made without being asked for twice
KINDS = ("png", "exr", "mask", "depth", "normal")
ANIMATIONS = ("gif", "webp", "mp4")
TURNS = ("camera", "object")
VIEW_ONLY = ("camera.", "display.")  # keys that leave the light inside the object as it is
_TABLES = ("scene", "table", "grid", "random", "turntable", "output")
_DRAW = {"low", "high", "choices"}  # keys by which a table of `[random]` is a draw, not a group of keys
_FIELD = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")


@dataclass(frozen=True)
class OutputSettings:
    """What is written of each picture, and of all."""

    TABLE: ClassVar[str] = "output"

    name: str = setting(
        "text", "{index:05d}", moves=(),
        why="names of files, without suffix: {index}, {turn_deg}, a table's {name} or any swept {key}, with a format"
    )
    samples: int = setting("integer", 4, low=1, high=256, moves=(), why="antialiasing samples a pixel")
    seed: int = setting("integer", 0, low=0, high=2**32 - 1, moves=(), why="of the pattern of samples")
    measured: bool = setting(
        "boolean", False, moves=(), why="whether the error of each picture is measured, as by `render --report`"
    )
    sheet: bool = setting("boolean", True, moves=(), why="whether a contact sheet with labels is made")
    animation: str | None = setting(
        "text", None, optional=True, choices=ANIMATIONS, moves=(), why="film of each turntable"
    )
    frames_per_second: float = setting("number", 20.0, low=1, high=60, moves=(), why="of the films")

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)


@dataclass(frozen=True)
class TurntableSettings:
    """A full turn, frame by frame."""

    TABLE: ClassVar[str] = "turntable"

    frames: int = setting("integer", 60, low=1, high=100_000, moves=(), why="pictures of a turn")
    elevation_deg: float | None = setting(
        "number", None, optional=True, unit="deg", low=-90, high=90, moves=(), why="height of the view"
    )
    turns: str = setting(
        "text", "camera", choices=TURNS, moves=(), why="what turns: the camera, or the object in fixed light"
    )

    def __post_init__(self) -> None:
        check_fields(self, self.TABLE)

# fmt: on


@dataclass(frozen=True)
class Row:
    """One picture of a sweep.

    Attributes
    ----------
    index : int
        From 0.
    values : dict
        Of the swept keys, as the sweep gives them.
    scene : Scene
    name : str
        Of its files, without suffixes, relative to the output folder.
    series : Series, optional
        That it is a frame of.
    """

    index: int
    values: Values
    scene: Scene
    name: str
    series: "Series | None" = None


@dataclass(frozen=True)
class Series:
    """A turn of a scene: its frames have one zoom, and the exposure of the first."""

    scene: Scene
    table: Turntable

    def frames(self) -> Iterator[Scene]:
        """Yield all frames."""
        return (self.frame(i) for i in range(self.table.frames))

    def frame(self, i: int) -> Scene:
        """Return one frame."""
        return turned(self.scene, self.table, self.table.values(i)["turn_deg"])


@dataclass(frozen=True)
class Sweep:
    """A base scene and what varies.

    Attributes
    ----------
    title : str
        Of messages and the contact sheet.
    base : Scene
    axes : tuple of Axis
        The first changes slowest.
    files : tuple of str
        Of `KINDS`.
    output : OutputSettings
    folder : Path
        That paths of swept keys are relative to.
    """

    title: str
    base: Scene
    axes: tuple[Axis, ...]
    files: tuple[str, ...] = ("png",)
    output: OutputSettings = OutputSettings()
    folder: Path = Path()

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Sweep":
        """Read a sweep file; paths in it are relative to it.

        Raises
        ------
        InputError
            Naming the file, the key, the problem and the fix.
        """
        path = Path(path)
        document = toml_files.parse(given_bytes(path, "the sweep file"), path)
        try:
            return _from_document(document, path.absolute())
        except InputError as error:
            raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error

    @property
    def count(self) -> int:
        """Number of pictures."""
        return math.prod(axis.count for axis in self.axes)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of all that varies, as columns of the index."""
        return tuple(key for axis in self.axes for key in axis.keys)

    @property
    def turntable(self) -> Turntable | None:
        """The turn that all pictures are frames of, if they are."""
        last = self.axes[-1] if self.axes else None
        return last if isinstance(last, Turntable) else None

    def row(self, index: int) -> Row:
        """Return one picture; raise `InputError` where its values cannot be together."""
        values: Values = {}
        for axis, step in zip(self.axes, self._steps(index), strict=True):
            values |= axis.values(step)
        of_scene = {key: value for key, value in values.items() if key not in (LABEL, TURN)}
        try:
            scene = with_values(self.base, of_scene, "", self.folder)
        except InputError as error:
            raise InputError(f"picture {index} of the sweep: {error}") from error
        series = None if self.turntable is None else Series(scene, self.turntable)
        if series is not None:
            scene = series.frame(self._steps(index)[-1])
        return Row(index, values, scene, self._name(index, values), series)

    def rows(self) -> Iterator[Row]:
        """Yield all pictures."""
        return map(self.row, range(self.count))

    @property
    def groups_count(self) -> int:
        """Number of `groups`."""
        return math.prod(axis.count for axis in self.axes if not _is_of_view(axis))

    def groups(self) -> Iterator[tuple[int, ...]]:
        """Yield the indices of pictures of one state of light and material each: those that share its solution."""
        strides = [math.prod(axis.count for axis in self.axes[i + 1 :]) for i in range(len(self.axes))]
        of_view = [i for i, axis in enumerate(self.axes) if _is_of_view(axis)]
        within = [0]
        for i in of_view:
            within = [at + step * strides[i] for at in within for step in range(self.axes[i].count)]
        for number in range(self.groups_count):
            start = 0
            for i in reversed([i for i in range(len(self.axes)) if i not in of_view]):
                number, step = divmod(number, self.axes[i].count)
                start += step * strides[i]
            yield tuple(start + at for at in within)

    def _steps(self, index: int) -> list[int]:
        steps = []
        for axis in reversed(self.axes):
            index, step = divmod(index, axis.count)
            steps.append(step)
        return steps[::-1]

    def _name(self, index: int, values: Values) -> str:
        fields: dict[str, Any] = {"index": index} | values

        def filled(match: re.Match[str]) -> str:
            key, form = match[1], match[2] or ""
            if key not in fields:
                raise InputError(f"output.name: {{{key}}} is nothing that varies; {nearest(key, fields)}")
            try:
                text = format(fields[key], form)
            except (TypeError, ValueError):
                raise InputError(f"output.name: {match[0]} cannot be written so; leave the format out") from None
            return re.sub(r"[^\w.+-]+", "-", text).strip("-.") or "-"

        return _FIELD.sub(filled, self.output.name)


def turned(scene: Scene, table: Turntable, turn_deg: float) -> Scene:
    """Return a scene as a turntable shows it: seen from another side, lit as before, or as if its object had turned."""
    camera = replace(
        scene.camera,
        elevation_deg=scene.camera.elevation_deg if table.elevation_deg is None else table.elevation_deg,
        target_mm=scene.camera.target_mm or (0.0, 0.0, 0.0),
    )
    if table.turns == "camera":
        return replace(scene, camera=replace(camera, azimuth_deg=_wrapped(camera.azimuth_deg + turn_deg)))
    # An object turned by an angle, in light that stays, is the camera and the light turned the other way.
    rotation = world_to_probe(turn_deg)
    lights = tuple(light.turned(rotation) if light.fixed_to == "world" else light for light in scene.all_lights())
    around = replace(scene.environment, rotation_deg=_wrapped(scene.environment.rotation_deg - turn_deg))
    camera = replace(camera, azimuth_deg=_wrapped(camera.azimuth_deg - turn_deg))
    return replace(scene, camera=camera, lights=lights, environment=around)


def _wrapped(degrees: float) -> float:
    return math.remainder(degrees, 360.0)


def _is_of_view(axis: Axis) -> bool:
    """Tell whether an axis leaves light and material as they are, or turns."""
    return all(key == TURN or key.startswith(VIEW_ONLY) for key in axis.keys)


def _from_document(document: Mapping[str, Any], path: Path) -> Sweep:
    for name in document:
        if name not in _TABLES:
            raise InputError(f'unknown key "{name}"; {nearest(name, _TABLES)}')
    for name in _TABLES[2:]:
        if not isinstance(document.get(name, {}), dict):
            raise InputError(f"{name} must be a table; write [{name}] on a line and its keys below")
    base = Scene.load(_named(document, "scene", path)) if "scene" in document else Scene()
    axes: list[Axis] = []
    for key, listed in _flat(document.get("grid", {}), lambda value: isinstance(value, list)).items():
        if not isinstance(listed, list) or not listed:
            raise InputError(f"grid.{key} must be a list of at least one value, such as [1, 2]")
        for value in listed:
            with_values(base, {key: value}, "grid.", path.parent)
        axes.append(Listed(key, tuple(listed)))
    if "random" in document:
        axes.append(_drawn(base, document["random"]))
    if "table" in document:
        axes.append(read_table(_named(document, "table", path), base))
    if "turntable" in document:
        settings = _declared(TurntableSettings, document["turntable"], "turntable")
        axes.append(Turntable(settings.frames, settings.elevation_deg, settings.turns))
    keys = [key for axis in axes for key in axis.keys]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"{key} varies twice; keep it in one of grid, random and table")
    if not axes:
        raise InputError("nothing varies; add [grid], [random], [turntable], or table = a file")
    given = dict(document.get("output", {}))
    files = _files(given.pop("files", ["png"]))
    sweep = Sweep(path.stem, base, tuple(axes), files, _declared(OutputSettings, given, "output"), path.parent)
    _check_names(sweep)
    return sweep


def _named(document: Mapping[str, Any], key: str, path: Path) -> Path:
    value = document[key]
    if not isinstance(value, str) or not value:
        raise InputError(f"{key} must be a file name, not {shown(value)}")
    return path.parent / Path(value).expanduser()


def _flat(content: Mapping[str, Any], is_value: Callable[[Any], bool], before: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their whole names: `material.name = [..]` is a table in a table."""
    flat: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict) and not is_value(value):
            flat |= _flat(value, is_value, f"{before}{key}.")
        else:
            flat[f"{before}{key}"] = value
    return flat


def _drawn(base: Scene, content: Mapping[str, Any]) -> Drawn:
    of_axis = {"count", "seed", "sequence"}
    draws = _flat(
        {key: value for key, value in content.items() if key not in of_axis}, lambda value: not _DRAW.isdisjoint(value)
    )
    for key, draw in draws.items():
        if not isinstance(draw, dict):
            raise InputError(f"random.{key} must say how it is drawn, such as {{low = 1, high = 10}}")
    if not draws:
        raise InputError('random draws nothing; add a key, such as "model.size_mm" = {low = 10, high = 100}')
    if "count" not in content:
        raise InputError("random.count is missing; it says how many draws are made")
    numbers = {}
    for name, low, default in (("count", 1, 1), ("seed", 0, 0)):
        value = content.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < low:
            raise InputError(f"random.{name} must be a whole number of at least {low}, not {shown(value)}")
        numbers[name] = value
    sequence = content.get("sequence", SEQUENCES[0])
    if sequence not in SEQUENCES:
        raise InputError(f"random.sequence must be one of {', '.join(SEQUENCES)}, not {shown(sequence)}")
    read = tuple((key, read_draw(base, key, draw, "random.")) for key, draw in draws.items())
    return Drawn(read, numbers["count"], numbers["seed"], sequence)


def _declared(table: Any, content: Mapping[str, Any], label: str) -> Any:
    declared = settings_of(table)
    for key in content:
        if key not in declared:
            raise InputError(
                f"{label}.{key} is unknown; {nearest(key, [*declared, *(['files'] if label == 'output' else [])])}"
            )
    return table(**content)


def _files(given: Any) -> tuple[str, ...]:
    if not isinstance(given, list) or not given:
        raise InputError(f"output.files must be a list of {', '.join(KINDS)}")
    for kind in given:
        if kind not in KINDS:
            raise InputError(f"output.files: {shown(kind)} is none of {', '.join(KINDS)}")
    return tuple(kind for kind in KINDS if kind in given)


def _check_names(sweep: Sweep) -> None:
    """Raise `InputError` where two pictures would have the same name, or one lie outside the folder."""
    first = sweep.row(0).name
    if Path(first).is_absolute() or ".." in Path(first).parts:
        raise InputError(f"output.name makes {first}, which is outside the output folder")
    if "{index" in sweep.output.name:
        return
    known: dict[str, int] = {}
    for row in sweep.rows():
        if row.name in known:
            fix = "add {index} or what tells them apart"
            raise InputError(f"output.name: pictures {known[row.name]} and {row.index} would both be {row.name}; {fix}")
        known[row.name] = row.index
