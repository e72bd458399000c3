"""Every setting, changed, runs again exactly the parts of the pipeline that it declares to move.

Those that move a photograph or its object are asked of a photograph, too: `tests/viewer/live/test_photograph_moves.py`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from milkglass.core.stages import Part
from milkglass.viewer.assets import sources
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.declaration import Setting, settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS
from milkglass.viewer.scene.scene import Change, Scene, apply_set, changed
from milkglass.viewer.scene.settings import TABLES, PhotoSettings
from tests.support.shapes import cube
from tests.support.skies import SPOTS, sky
from tests.support.skins import picture, write_ball
from tests.support.solids import ball

PHOTOGRAPHS = {Part.OBJECT, Part.PHOTOGRAPH}  # of a model there are none
SETTINGS = {
    f"{name}.{key}": declared
    for name, table in TABLES.items()
    if table is not PhotoSettings
    for key, declared in settings_of(table).items()
}
LIGHT_SETTINGS = {
    (kind, key): declared for kind, light in LIGHT_KINDS.items() for key, declared in settings_of(light).items()
}
BASE = (
    "display.image_size=[24, 20]", "camera.azimuth_deg=20", "model.path={ball}", "model.size_mm=20",
    "material.name=jade", "transport.method=ewald", "environment.path={probe}", "ground.on=true",
    'lights=[{kind="directional", direction=[0.3, 0.4, 1.0]}]',
)  # fmt: skip
OWN = ("material.sigma_s_prime=[1, 2, 3]", "material.sigma_a=[0.01, 0.02, 0.03]")
COLOUR = ("material.diffuse_reflectance=[0.5, 0.6, 0.7]", "material.mean_free_path_mm=[1, 1, 2]")
DIFFUSE_COLOUR = (COLOUR[0], "material.diffuse_mean_free_path_mm=[1, 1, 2]")
SECOND = ("material.mix_sigma_s_prime=[3, 2, 1]", "material.mix_sigma_a=[0.1, 0.1, 0.1]", "material.mix_eta=1.2")
SOLVED = ("model.path={pair}", "transport.method=diffusion")  # body by body
MURKY = (
    *SOLVED, "transport.exchange=off", "ground.on=false", "material.sigma_s_prime=[0.05, 0.1, 0.1]",
    "material.sigma_a=[0.01, 0.01, 0.02]",
)  # fmt: skip
LAYERED = ("transport.method=layered", "transport.layers=4")
OCCLUDED_BY_NOTHING = ("environment.occluded=false", "ground.on=false")
# What a setting needs to have any effect; some mean nothing to the method above, or where others are given.
NEEDED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("material.sigma_s_prime", "material.sigma_a"), OWN),
    **dict.fromkeys(("material.diffuse_reflectance", "material.mean_free_path_mm"), COLOUR),
    "material.diffuse_mean_free_path_mm": DIFFUSE_COLOUR,
    **{f"material.mix_{key}": SECOND for key in ("sigma_s_prime", "sigma_a", "eta", "share")},
    "material.profile_table": ("material.profile=table", "material.profile_table={table}"),
    **{f"camera.{angle}_deg": LAYERED for angle in ("azimuth", "elevation", "roll")},
    **{f"model.{key}": SOLVED for key in ("path", "builtin", "size_mm", "close_holes")},
    "model.up": (*SOLVED, "model.up=y"),
    "model.nested": ("model.path={nested}", "transport.method=diffusion"),
    "model.bodies": ("model.path={pair}", "model.bodies=joined"),
    "transport.method": ("model.path={pair}", *LAYERED),
    "transport.exchange": ("transport.exchange=off", "model.path={pair}", *OCCLUDED_BY_NOTHING),
    "transport.light_paths": SOLVED,
    "material.g": MURKY,
    "material.mix_g": (*MURKY, *SECOND),
    "transport.assignment": ("transport.assignment=tent",),
    "ground.on": ("ground.on=false",),  # what is taken away runs nothing
    "environment.occluded": OCCLUDED_BY_NOTHING,
    "specular.shininess": ("environment.occluded=false",),  # else highlights are occluded, in the G-buffer
    "specular.model": ("environment.occluded=false", "specular.model=phong"),  # likewise: each has a shininess
    "transport.error_target": ("transport.error_target=0.3", "model.size_mm=200"),
    "display.background_blur_deg": ("display.background=environment",),
}
# Names, of which no declaration tells another.
OTHER = {
    "material.name": "skim milk", "material.mix_with": "skim milk", "material.profile_table": "{other_table}",
    "model.path": "{other}", "model.builtin": "sculpture", "model.texture": "{texture}",
    "model.normal_map": "{normals}", "environment.path": "{other_probe}", "environment.builtin": "studio",
    "transport.light_paths": "mirror",
}  # fmt: skip


@pytest.fixture(scope="module")
def renderer(context):
    return Renderer(context)


@pytest.fixture(scope="module")
def named(tmp_path_factory) -> Callable[[str], str]:
    """Puts the names of files into a text."""
    folder = tmp_path_factory.mktemp("moved")
    slopes = np.full((8, 8, 3), 128, np.uint8)
    slopes[..., 2], slopes[:4, :, 0] = 255, 160
    paths = {name: folder / f"{name}.png" for name in ("texture", "normals")}
    picture((90, 200, 120)).save(paths["texture"])
    picture(slopes).save(paths["normals"])
    paths["ball"] = write_ball(folder / "ball.glb", picture((200, 150, 90)), picture(slopes))
    paths["other"] = write_ball(folder / "other.glb", picture((150, 200, 90)), picture(slopes))
    paths["pair"] = folder / "pair.ply"
    trimesh.util.concatenate([ball(1.0, subdivisions=1), ball(0.6, (2.0, 0.3, 0.0), 1)]).export(paths["pair"])
    paths["nested"] = folder / "nested.ply"
    trimesh.util.concatenate([ball(1.0, subdivisions=1), ball(0.5, subdivisions=1)]).export(paths["nested"])
    for name, spot in (("probe", SPOTS[0]), ("other_probe", SPOTS[1])):
        paths[name] = folder / f"{name}.exr"
        write_exr(paths[name], dict(zip("RGB", np.moveaxis(sky(spot, height=128), -1, 0), strict=True)))
    for name, scale in (("table", 1.0), ("other_table", 0.8)):
        paths[name] = folder / f"{name}.csv"
        radii = np.linspace(0.0, 12.0, 40)
        paths[name].write_text("\n".join(f"{r},{','.join([str(scale * 0.05 * np.exp(-r))] * 3)}" for r in radii))
    return lambda text: text.format_map(paths) if text.startswith("{") or "={" in text else text


def another(declared: Setting, value: Any) -> Any:
    """Another value that a setting may have."""
    if value is None and declared.length is not None:
        return (8.0 if declared.high is None else min(8.0, 0.5 * declared.high),) * declared.length
    if isinstance(value, tuple):
        return (another(declared, value[0]), *value[1:])
    if declared.kind == "boolean":
        return not value
    if declared.choices and not declared.is_number:
        choices = [*declared.choices]
        return choices[(choices.index(value) + 1) % len(choices)]
    low, high = declared.low, declared.high
    candidates = [8, 0.5, 2.0] if value is None else [1.25 * value + 1, 0.8 * value, 0.5 * value + 0.1]
    kind = int if declared.kind == "integer" else float
    return next(kind(x) for x in candidates if x != value and (low is None or x >= low) and (high is None or x <= high))


def parts_run(renderer: Renderer, before: Scene, after: Scene) -> list[Part]:
    """The parts that a change ran again."""
    assert before != after
    renderer.draw(before)
    renderer.draw(after)
    return sorted({stage.part for stage in renderer.timings})


def reached(declared: Setting, scene: Scene) -> list[Part]:
    without = PHOTOGRAPHS if scene.ground.on else PHOTOGRAPHS | {Part.GROUND}
    return sorted(set().union(*(part.downstream for part in declared.moves)) - without)


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_runs_again_what_it_moves(renderer, named, few_rays, monkeypatch, name):
    monkeypatch.setattr(sources, "builtin_model", lambda size_mm, up: cube(size_mm))
    coarse = () if name == "transport.error_target" else ("transport.resolution=16",)
    scene = apply_set(Scene(), list(map(named, (*BASE, *coarse))))
    scene = apply_set(scene, list(map(named, NEEDED.get(name, ()))))
    table, key = name.split(".")
    value = named(OTHER[name]) if name in OTHER else another(SETTINGS[name], getattr(getattr(scene, table), key))
    after = changed(scene, [Change(table, key, value, name)])
    assert parts_run(renderer, scene, after) == reached(SETTINGS[name], after), sorted(renderer.timings)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "key"), LIGHT_SETTINGS)
def test_a_setting_of_a_light_runs_again_what_it_moves(renderer, named, few_rays, kind, key):
    declared = settings_of(LIGHT_KINDS[kind])
    place = "direction" if "direction" in declared else "position_mm"
    more: dict[str, Any] = {"roll_deg": {"size_mm": (20.0, 40.0)}, "on": {"on": False}}.get(key, {})
    light = LIGHT_KINDS[kind](**{place: (40.0, 50.0, 60.0)}, **more)
    other = replace(light, **{key: another(declared[key], getattr(light, key))})
    scene = apply_set(Scene(), list(map(named, (*BASE, "transport.resolution=16"))))
    before, after = (changed(scene, [Change("lights", "", (each,), "lights")]) for each in (light, other))
    assert parts_run(renderer, before, after) == reached(declared[key], after), sorted(renderer.timings)
