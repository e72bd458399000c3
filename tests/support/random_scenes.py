"""Random valid scenes over the whole ranges of every setting, seeded."""

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.material.library import library
from milkglass.viewer.scene.declaration import Setting, is_required, settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS, Light
from milkglass.viewer.scene.material_settings import COMBINATIONS, MaterialSettings
from milkglass.viewer.scene.scene import TABLES, Scene
from tests.support.solids import ball, block

# What costs time alone is kept small; everything else goes over its whole range.
SMALL = {("display", "image_size"): (16, 40), ("transport", "resolution"): (16, 24), ("transport", "layers"): (1, 6)}
LEFT_OUT = {"path", "texture", "normal_map", "depth", "profile_table", "error_target", "profile"}
KEPT = 0.6  # share of the keys that stay as they are in a scene: faults come of a few at once
FARTHEST = 1e4  # mm of places drawn without a range


def write_models(folder: Path) -> list[Path]:
    """Write the meshes that random scenes show: one body, several, a hollow one, an open one, one without inside."""
    open_ball = ball(subdivisions=2)
    open_ball.update_faces(open_ball.triangles_center[:, 2] < 0.6)
    models = {
        "ball": ball(subdivisions=2),
        "block": block((2.0, 1.0, 0.2)),
        "torus": trimesh.creation.torus(1.0, 0.4, major_sections=16, minor_sections=8),
        "two": trimesh.util.concatenate([ball(subdivisions=1), ball(at=(2.5, 0.0, 0.0), subdivisions=1)]),
        "hollow": trimesh.util.concatenate([ball(subdivisions=2), ball(0.7, subdivisions=2, inverted=True)]),
        "open": open_ball,
        "triangle": trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False),
    }
    for name, mesh in models.items():
        mesh.export(folder / f"{name}.ply")
    return sorted(folder.glob("*.ply"))


def random_scene(rng: np.random.Generator, models: list[Path], method: str) -> Scene:
    """Return a scene of a transport that its settings accept."""
    while True:
        try:
            tables = {name: _random(rng, name, table) for name, table in TABLES.items() if name != "material"}
            tables["material"] = _material(rng)
            tables["model"] = replace(tables["model"], path=models[rng.integers(len(models))], builtin=None)
            tables["transport"] = replace(tables["transport"], method=method, light_paths="auto")
            lights = None if rng.random() < 0.1 else tuple(_light(rng) for _ in range(rng.integers(0, 4)))
            return Scene(lights=lights, **tables)
        except InputError:  # of settings that exclude each other
            continue


def _material(rng: np.random.Generator) -> MaterialSettings:
    values = {key: value for key, value in _values(rng, "material", MaterialSettings).items() if key[:3] != "mix"}
    (*keys,) = COMBINATIONS[rng.integers(len(COMBINATIONS))]
    for key in {key for keys in COMBINATIONS for key in keys} | ({"eta", "g"} if "name" in keys else set()):
        values.pop(key, None)
    declared = settings_of(MaterialSettings)
    for key in keys:
        names = [material.name for material in library()]
        values[key] = names[rng.integers(len(names))] if key == "name" else _value(rng, "material", key, declared[key])
    return MaterialSettings(**values)


def _random(rng: np.random.Generator, name: str, table: Any) -> Any:
    return table(**_values(rng, name, table))


def _light(rng: np.random.Generator) -> Light:
    kinds = list(LIGHT_KINDS.values())
    kind = kinds[rng.integers(len(kinds))]
    required = {declared.name for declared in dataclasses.fields(kind) if is_required(declared)}
    drawn = {
        key: _value(rng, "lights", key, declared) for key, declared in settings_of(kind).items() if key in required
    }
    light: Light = kind(**(_values(rng, "lights", kind) | drawn))
    return light


def _values(rng: np.random.Generator, name: str, table: Any) -> dict[str, Any]:
    return {
        key: _value(rng, name, key, declared)
        for key, declared in settings_of(table).items()
        if key not in LEFT_OUT and ((name, key) in SMALL or rng.random() > KEPT)
    }


def _value(rng: np.random.Generator, name: str, key: str, declared: Setting) -> Any:
    if declared.kind == "boolean":
        return bool(rng.integers(2))
    if declared.kind in ("text", "path"):
        choices = [*declared.choices, *(["#3a7f00"] if key == "background" else [])]
        return choices[rng.integers(len(choices))] if choices else None
    low, high = SMALL.get((name, key), (declared.low, declared.high))
    numbers = [_number(rng, low, high) for _ in range(declared.length or 1)]
    if declared.kind == "integer":
        numbers = [round(number) for number in numbers]
    return tuple(numbers) if declared.length is not None else numbers[0]


def _number(rng: np.random.Generator, low: float | None, high: float | None) -> float:
    """Draw from a range: its ends, 0 and the middle often, else over all magnitudes."""
    low, high = -FARTHEST if low is None else low, FARTHEST if high is None else high
    if rng.random() < 0.15:
        return float(low if rng.random() < 0.5 else high)
    if low > 0.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if low == 0.0 and rng.random() < 0.1:
        return 0.0
    size = min(high, 10.0 ** rng.uniform(-4, np.log10(high)))
    return float(size if low >= 0.0 or rng.random() < 0.5 else max(low, -size))
