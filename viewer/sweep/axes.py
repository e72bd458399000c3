"""Axes of a sweep: what varies, and which values its keys have in each of its steps.

Values are those of a scene file (numbers, texts, lists, tables), by names of keys: "material.sigma_a", "lights", or
"lights.0.irradiance" for a key of one light.
"""

import csv
import functools
import io
import re
import tomllib
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.viewer.scene.declaration import Setting, nearest, settings_of, shown
from milkglass.viewer.scene.given_file import given_bytes
from milkglass.viewer.scene.scene import Scene, change_to, changed, setting_at

Values = dict[str, Any]
SEQUENCES = ("random", "sobol")
SCALES = ("linear", "log")
CHANNELS = ("each", "together")
LABEL = "name"  # column of a table by which its pictures may be called
TURN = "turn_deg"  # what a turntable has turned by
_OF_LIGHT = re.compile(r"lights\.(\d+)\.(\w+)")


class Axis(Protocol):
    """What varies in a sweep, step by step."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the keys that it gives values."""

    @property
    def count(self) -> int:
        """Number of its steps, >= 1."""

    def values(self, step: int) -> Values:
        """Return the values of a step, by key."""


@dataclass(frozen=True)
class Listed:
    """One key and its values, of a `[grid]`."""

    key: str
    listed: tuple[Any, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """See `Axis`."""
        return (self.key,)

    @property
    def count(self) -> int:
        """See `Axis`."""
        return len(self.listed)

    def values(self, step: int) -> Values:
        """See `Axis`."""
        return {self.key: self.listed[step]}


@dataclass(frozen=True)
class Draw:
    """How a key is drawn.

    Attributes
    ----------
    low, high : float or tuple of float
        Range, of each element of a vector where they are many.
    is_log : bool
        Whether logarithms are even in it.
    length : int, optional
        Of a vector.
    together : bool
        Whether one number places all elements in their ranges.
    is_whole : bool
        Whether values are rounded.
    choices : tuple
        What is drawn from in place of a range.
    """

    low: float | tuple[float, ...] = 0.0
    high: float | tuple[float, ...] = 1.0
    is_log: bool = False
    length: int | None = None
    together: bool = False
    is_whole: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def dimensions(self) -> int:
        """Numbers in [0, 1) that a value is drawn by."""
        return 1 if self.together or self.choices else self.length or 1

    def value(self, places: Array) -> Any:
        """Return the value at places in [0, 1), (dimensions,)."""
        if self.choices:
            return self.choices[int(places[0] * len(self.choices))]
        low, high = (np.broadcast_to(np.asarray(end, np.float64), self.length or 1) for end in (self.low, self.high))
        found = low * (high / low) ** places if self.is_log else low + (high - low) * places
        numbers = [round(x) if self.is_whole else float(f"{x:.9g}") for x in np.clip(found, low, high).tolist()]
        return numbers if self.length is not None else numbers[0]


@dataclass(frozen=True)
class Drawn:
    """Keys that are drawn together, of `[random]`: step i is the same whatever the number of steps.

    Independent numbers of a key are also the same whatever other keys there are; those of Sobol's sequence, which cover
    all dimensions evenly together, are where the keys and their order are.
    """

    draws: tuple[tuple[str, Draw], ...]
    count: int
    seed: int
    sequence: str

    @property
    def keys(self) -> tuple[str, ...]:
        """See `Axis`."""
        return tuple(key for key, _ in self.draws)

    def values(self, step: int) -> Values:
        """See `Axis`."""
        if self.sequence == "random":
            return {
                key: draw.value(
                    np.random.default_rng([self.seed, zlib.crc32(key.encode()), step]).random(draw.dimensions)
                )
                for key, draw in self.draws
            }
        ends = np.cumsum([draw.dimensions for _, draw in self.draws])
        places = _sobol(self.count, int(ends[-1]), self.seed)[step]
        return {
            key: draw.value(places[end - draw.dimensions : end])
            for (key, draw), end in zip(self.draws, ends, strict=True)
        }


@functools.lru_cache(2)
def _sobol(count: int, dimensions: int, seed: int) -> Array:
    """Return the first points of Sobol's sequence, (count, dimensions), shifted as a torus by a seed."""
    from scipy.stats.qmc import Sobol  # half a second that other sweeps do without

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that only powers of two are balanced
        points = Sobol(dimensions, scramble=False).random(count)
    return np.asarray((points + np.random.default_rng(seed).random(dimensions)) % 1.0)


@dataclass(frozen=True)
class Table:
    """Keys with values row by row, of a file."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]  # None where the base scene's value stays

    @property
    def keys(self) -> tuple[str, ...]:
        """See `Axis`; the label of a row is none of a scene."""
        return self.columns

    @property
    def count(self) -> int:
        """See `Axis`."""
        return len(self.rows)

    def values(self, step: int) -> Values:
        """See `Axis`."""
        return {column: value for column, value in zip(self.columns, self.rows[step], strict=True) if value is not None}


@dataclass(frozen=True)
class Turntable:
    """A full turn of the camera about the object, or of the object in light and camera that stay."""

    frames: int
    elevation_deg: float | None
    turns: str

    @property
    def keys(self) -> tuple[str, ...]:
        """See `Axis`."""
        return (TURN,)

    @property
    def count(self) -> int:
        """See `Axis`."""
        return self.frames

    def values(self, step: int) -> Values:
        """See `Axis`."""
        return {TURN: 360.0 * step / self.frames}


def with_values(scene: Scene, values: Mapping[str, Any], label: str, base: Path) -> Scene:
    """Return a scene with the values of keys, all of them taken together.

    `label` is what messages say before a key; `base` is the folder that relative paths are relative to.

    Raises
    ------
    InputError
        For a key that there is not, and for values that cannot be, alone or together.
    """
    of_lights = {key: value for key, value in values.items() if _OF_LIGHT.fullmatch(key)}
    changes = [change_to(key, value, f"{label}{key}", base) for key, value in values.items() if key not in of_lights]
    scene = changed(scene, changes)
    for key, value in of_lights.items():
        i, name, declared = _of_light(scene, key, label)
        lights = list(scene.all_lights())
        lights[i] = lights[i].with_values(**{name: declared.checked(value, f"{label}{key}")})
        scene = replace(scene, lights=tuple(lights))
    return scene


def declared_at(scene: Scene, key: str, label: str) -> Setting | None:
    """Return the declaration of a key; None for "lights", whose values are lists of tables."""
    if key == "lights":
        return None
    if _OF_LIGHT.fullmatch(key):
        return _of_light(scene, key, label)[2]
    return setting_at(key, f"{label}{key}")[2]


def _of_light(scene: Scene, key: str, label: str) -> tuple[int, str, Setting]:
    """Return the number of a light, the name of one of its keys, and the declaration."""
    found = _OF_LIGHT.fullmatch(key)
    assert found is not None
    i, name, lights = int(found[1]), found[2], scene.all_lights()
    if i >= len(lights):
        raise InputError(f"{label}{key}: the base scene has {len(lights)} lights, the first is lights.0")
    declared = settings_of(lights[i])
    if name not in declared:
        raise InputError(f"{label}{key} is unknown; {nearest(name, declared)}")
    return i, name, declared[name]


def read_table(path: Path, scene: Scene) -> Table:
    """Read a CSV file: the first line names keys, and each other line is a row.

    An empty cell leaves the base scene's value; a column "name" labels the rows. Cells are TOML, and texts may stand
    without quotes.

    Raises
    ------
    InputError
        Naming the file, and the line or column that is wrong.
    """
    try:
        text = given_bytes(path, "the table").decode("utf-8-sig")
        lines = list(csv.reader(io.StringIO(text), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of comma-separated values in UTF-8 ({error})") from error
    if not lines or not any(lines[0]):
        raise InputError(f"{path} is empty; its first line names keys, such as material.name")
    columns = tuple(cell.strip() for cell in lines[0])
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{path}: the column {shown(column)} is there twice")
        if column != LABEL:
            try:
                declared_at(scene, column, "")
            except InputError as error:
                raise InputError(f"{path}: column {error}") from error
    rows = []
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(columns):
            raise InputError(f"{path}, line {number}: {len(cells)} cells, but there are {len(columns)} columns")
        rows.append(tuple(_cell(scene, column, cell.strip()) for column, cell in zip(columns, cells, strict=True)))
        given = {column: value for column, value in zip(columns, rows[-1], strict=True) if value is not None}
        try:
            with_values(scene, {key: value for key, value in given.items() if key != LABEL}, "", path.parent)
        except InputError as error:
            raise InputError(f"{path}, line {number}: {error}") from error
    if not rows:
        raise InputError(f"{path} has no rows below its first line; write one a picture")
    return Table(columns, tuple(rows))


def _cell(scene: Scene, column: str, text: str) -> Any:
    if not text:
        return None
    if column == LABEL:
        return text
    declared = declared_at(scene, column, "")
    if declared is not None and declared.length is None and declared.kind in ("text", "path"):
        return text.strip('"')
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, KeyError):
        return text  # which the setting refuses


def read_draw(scene: Scene, key: str, given: Mapping[str, Any], label: str) -> Draw:
    """Return how a key is drawn; raise `InputError` for what cannot be drawn."""
    declared = declared_at(scene, key, label)
    known = ("low", "high", "scale", "channels", "choices")
    for name in given:
        if name not in known:
            raise InputError(f"{label}{key}.{name} is unknown; {nearest(name, known)}")
    if "choices" in given:
        choices = given["choices"]
        if not isinstance(choices, list) or not choices or len(given) > 1:
            raise InputError(f"{label}{key} needs choices = [...], at least one and nothing else")
        return Draw(choices=tuple(choices))
    if declared is None or declared.kind not in ("number", "integer"):
        raise InputError(f"{label}{key} is no number; give choices = [...]")
    ends = []
    for name in ("low", "high"):
        if name not in given:
            raise InputError(f"{label}{key}.{name} is missing; give low and high, or choices")
        ends.append(_end(declared, given[name], f"{label}{key}.{name}"))
    is_log = _choice(given, "scale", SCALES, f"{label}{key}") == "log"
    low, high = (np.asarray(end, np.float64) for end in ends)
    if not (low <= high).all():
        raise InputError(f"{label}{key}: low must not be above high")
    if is_log and not (low > 0.0).all():
        raise InputError(f'{label}{key}: scale = "log" needs a low above 0')
    together = _choice(given, "channels", CHANNELS, f"{label}{key}") == "together"
    return Draw(ends[0], ends[1], is_log, declared.length, together, declared.kind == "integer")


def _end(declared: Setting, value: Any, label: str) -> Any:
    """Return an end of a range, checked: a number for all elements, or a vector."""
    is_vector = isinstance(value, list)
    full = value if is_vector or declared.length is None else [value] * declared.length
    checked = declared.checked(full, label)
    return checked if is_vector or declared.length is None else checked[0]


def _choice(given: Mapping[str, Any], name: str, choices: Sequence[str], label: str) -> str:
    value = given.get(name, choices[0])
    if value not in choices:
        raise InputError(f"{label}.{name} must be one of {', '.join(choices)}, not {shown(value)}")
    return str(value)
