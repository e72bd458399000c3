"""What a part of the pipeline depends on: the values of the settings that declare to move it."""

import functools
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from milkglass.core.stages import Part
from milkglass.viewer.scene.declaration import moves_of, settings_of
from milkglass.viewer.scene.settings import TABLES

if TYPE_CHECKING:
    from milkglass.viewer.scene.scene import Scene

Key = tuple[object, ...]
LIGHTS = "lights"
MATERIALS = "materials"

_versions: Counter[Path] = Counter()


def version(path: Path | None) -> int:
    """Return how often a file in use has been taken anew: what a picture depends on beside the path; 0 without one."""
    return 0 if path is None else _versions[path]


def taken_anew(path: Path) -> None:
    """Tell that a file in use has changed and been read."""
    _versions[path] += 1


def values_moving(scene: "Scene", parts: Collection[Part], without: Collection[str] = ()) -> Key:
    """Return the values, hashable, of all settings that move one of some parts themselves; lights are those that shine.

    Tables, `LIGHTS` and `MATERIALS` may be left out (`without`, their names). A file is its name and its `version`.
    """
    moving = frozenset(parts)
    clear = (
        () if MATERIALS in without else tuple((name, *_values(material, moving)) for name, material in scene.materials)
    )
    of_lights = tuple((light.KIND, *_values(light, moving)) for light in scene.effective_lights())
    lit = () if LIGHTS in without or all(len(light) == 1 for light in of_lights) else of_lights
    return (
        *(value for name in TABLES if name not in without for value in _values(getattr(scene, name), moving)),
        lit,
        clear,
    )


def input_files(scene: "Scene") -> dict[str, Path]:
    """Return the files that a model's picture is made of, by what sentences call them."""
    model = scene.model
    named = {
        "model": model.path,
        "texture": model.texture,
        "normal map": model.normal_map,
        "environment": scene.environment.path,
        "profile": scene.material.profile_table,
    }
    return {role: path for role, path in named.items() if path is not None}


def paths(scene: "Scene") -> Key:
    """Return every file that a scene names, its lights' none, with how often each has been taken anew."""
    tables = [getattr(scene, name) for name in TABLES]
    keys = [(table, key) for table in tables for key, declared in settings_of(table).items() if declared.kind == "path"]
    return tuple(_told_apart(getattr(table, key)) for table, key in keys)


def _values(table: Any, parts: frozenset[Part]) -> Key:
    keys = _keys(type(table), parts)  # type: ignore[arg-type]  # mypy: a class is not hashable
    return tuple(_told_apart(getattr(table, key)) for key in keys)


@functools.cache
def _keys(table: type[object], parts: frozenset[Part]) -> tuple[str, ...]:
    """Return the keys of a table whose values move one of the parts."""
    return tuple(key for key, moved in moves_of(table).items() if not parts.isdisjoint(moved))


def _told_apart(value: object) -> object:
    return (value, version(value)) if isinstance(value, Path) else value
