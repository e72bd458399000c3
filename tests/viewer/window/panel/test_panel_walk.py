"""One walk over every control of the panel: each changes what it says, and no setting is without one."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from milkglass.core.material import library as materials
from milkglass.viewer.files.gltf_medium import medium_of
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.gui.controls import default_of
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS, PointLight
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import (
    TABLES,
    GroundSettings,
    MaterialSettings,
    PhotoSettings,
    TransportSettings,
)
from milkglass.viewer.session.session import SHOWN
from milkglass.viewer.window.curves.view import PER_RADIUS
from milkglass.viewer.window.panel.parts import CLEAR, SCATTERS
from milkglass.viewer.window.panel.profile import COEFFICIENTS, COLOUR, DIFFUSE, given_by
from tests.support.driving import small_scene, write_knot, write_pair
from tests.support.skins import picture, write_ball
from tests.support.solids import ball
from tests.support.walking import CONTROLS, SIZED, Control, Walker, choose, open_file, search, slide
from tests.viewer.files.test_gltf_medium import told

SECTIONS = ("Environment", "Ground", "Highlights", "Tone mapping", "Error", "Model", "Camera")
WITHOUT_CONTROL = {
    "material.mix_sigma_s_prime": "comes with mix_eta",
    "material.mix_sigma_a": "comes with mix_eta",
    "material.mix_g": "comes with mix_eta",
    **{f"photo.{key}": "of a photograph (test_photo_pass.py)" for key in settings_of(PhotoSettings)},
}


# Of the open library and of the picker of colours: test_panel_library.py, test_panel_profile.py.
INSIDE = re.compile(r"own\.|(material|mix)\.filter|import_|export_|material\.(swatch|colour)|##material\.picker")


def settings_without_control(tables: Iterable[Any], controlled: set[str]) -> set[str]:
    """Settings of the tables that nothing sets, but for those that need no control."""
    names = set()
    for table in tables:
        prefix = getattr(table, "KIND", table.TABLE)
        names |= {f"{prefix}.{each.name}" for each in fields(table) if "setting" in each.metadata}
    return names - controlled - WITHOUT_CONTROL.keys()


def value_of(scene: Scene, name: str) -> Any:
    table, key = name.split(".")
    return getattr(scene.all_lights()[0] if table in LIGHT_KINDS else getattr(scene, table), key)


def states_of(scene: Scene, probe: Path) -> dict[str, Scene]:
    environment = replace(scene.environment, path=probe)
    pair = replace(scene.model, path=write_pair(probe.with_name("pair.ply")))
    holed, cut = replace(scene.model, path=probe.with_name("holed.ply")), ball(1.0)
    cut.update_faces(cut.triangles_center[:, 2] < 0.8)
    cut.export(holed.path)
    lamp = PointLight((-90.0, 70.0, 120.0), (2e5, 1e5, 3e5))
    return {
        "plain": scene,
        "probe": replace(  # with lights of its own: if the probe were all, exposure would make up for its intensity
            scene, environment=environment, display=replace(scene.display, background="environment")
        ),
        "ewald": replace(  # small, so that its error takes few nodes
            scene, transport=TransportSettings(method="ewald", layers=4), model=replace(scene.model, size_mm=12.0)
        ),
        "solved": replace(scene, transport=TransportSettings(resolution=24)),
        "coloured": replace(scene, display=replace(scene.display, background="#3a3d42")),
        "pair": replace(scene, model=pair),
        "holed": replace(scene, model=holed),
        "square probe": replace(scene, environment=replace(environment, path=probe.with_name("square.exr"))),
        "skin": replace(scene, model=replace(scene.model, path=probe.with_name("skin.glb"))),
        "pair in probe": replace(scene, model=pair, environment=environment),
        "colour": replace(scene, material=MaterialSettings(**given_by(scene.material, COLOUR))),
        "diffuse colour": replace(scene, material=MaterialSettings(**given_by(scene.material, DIFFUSE))),
        "ground": replace(scene, ground=GroundSettings(on=True)),
        "murky": replace(
            scene, material=MaterialSettings(sigma_s_prime=(9e-4,) * 3, sigma_a=(0.05,) * 3),  # solves no equation
            transport=TransportSettings(method="diffusion", resolution=16),
        ),
        "mixed": replace(scene, material=replace(scene.material, mix_with="ketchup")),
        "table": replace(
            scene, material=replace(scene.material, profile="table", profile_table=probe.with_name("table.csv"))
        ),
        "point": replace(scene, lights=(lamp, scene.lights[1])),
        **{
            kind: replace(scene, lights=(LIGHT_KINDS[kind](lamp.position_mm, lamp.intensity), scene.lights[1]))
            for kind in SIZED
        },
    }  # fmt: skip


def differ(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape != other.shape or bool(np.any(one != other))


@pytest.fixture
def walker(context, few_rays, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    own_materials.save("candle", materials.lookup("wax"))
    planes = {c: np.random.default_rng(4).random((16, 32), np.float32) for c in "RGB"}
    for plane in planes.values():
        plane[4, 20] = 200.0  # a source to extract
    write_exr(tmp_path / "probe.exr", planes)
    u, v = np.meshgrid(*[np.linspace(-1.0, 1.0, 32)] * 2)
    disc = np.where(np.hypot(u, v) < 1.0, np.where(v + u < -0.3, 4.0, 0.1), 0.0).astype(np.float32)
    write_exr(tmp_path / "square.exr", dict.fromkeys("RGB", disc))
    for name, value in (("table", 0.05), ("other", 0.01)):
        (tmp_path / f"{name}.csv").write_text(f"0,{value},0.02,0.01\n1,0.005,0.004,0.001\n4,0.001,0.001,0\n")
    trimesh.creation.torus(1.0, 0.4, 24, 12).export(tmp_path / "other.ply")
    rng = np.random.default_rng(5)
    spots = picture(rng.integers(0, 255, (16, 16, 3)))
    write_ball(tmp_path / "skin.glb", spots, picture((200, 100, 200)))
    spots.transpose(2).save(tmp_path / "texture.png")
    picture((60, 160, 210)).save(tmp_path / "bumps.png")
    walker = Walker(small_scene(write_knot(tmp_path / "knot.ply")))
    walker.app.preferences.folder = str(tmp_path)
    for section in SECTIONS:
        walker.click(f"section.{section}", 0.3)
    yield walker
    walker.close()


def test_a_setting_without_a_control_is_found():
    tables = [*TABLES.values(), *LIGHT_KINDS.values()]
    controlled = {control.setting for control in CONTROLS}
    assert not settings_without_control(tables, controlled)
    assert not WITHOUT_CONTROL.keys() & controlled

    @dataclass(frozen=True)
    class Display(TABLES["display"]):
        gamma: float = field(default=2.2, metadata={"setting": None})

    assert settings_without_control([*tables, Display], controlled) == {"display.gamma"}
    assert settings_without_control(tables, controlled - {"point.on"}) == {"point.on"}


def try_setting(walker: Walker, control: Control, picture: np.ndarray) -> None:
    """Use a control, see that exactly its setting and the picture of the scene change, and reset it."""
    session, label = walker.session, f"{control.setting} by {control.box}"
    before = session.scene
    control.use(walker)
    after, table = session.scene, control.setting.split(".")[0]
    value = value_of(before, control.setting)
    if control.setting == "directional.KIND":
        assert after.all_lights()[0].KIND == "point"
    else:
        assert value_of(after, control.setting) != value, label
    free = {"lights" if table in LIGHT_KINDS else table, *control.also}
    for each in fields(Scene):
        assert each.name in free or getattr(after, each.name) == getattr(before, each.name), (label, each.name)
    # What is fixed to something else stays where it is for now.
    assert differ(walker.picture(), picture) or control.setting.endswith(".fixed_to"), label
    if control.has_reset:
        walker.click(f"{control.box}.reset")
        walker.frames(2)
        assert session.scene != after, label
        assert not walker.shows(f"{control.box}.reset"), label
        if table in TABLES and table != "material":
            assert value_of(session.scene, control.setting) == default_of(*control.setting.split(".")), label
    session.put(before)
    walker.frames(3)  # rows are where they were


def try_what_is_shown(walker: Walker) -> None:
    """What is shown, layers, exposure lock, size: of the window, not of the scene."""
    view, scene = walker.session.view, walker.session.scene
    shown = {"": walker.view_pixels()}
    for name in SHOWN:
        choose("show", name)(walker)
        assert view.show == name
        shown[name] = walker.view_pixels()
    assert not differ(shown.pop(""), shown["beauty"])
    for part, same in (("often", "subsurface"), ("once", "unscattered")):  # which a transport does not tell apart
        assert not differ(shown.pop(part), shown[same])
    assert len({pixels.tobytes() for pixels in shown.values()}) == len(shown)
    walker.click("layer", 0.99)
    assert view.layer == 3
    assert differ(walker.view_pixels(), shown["layer out"])
    walker.click("layer.reset")
    walker.click("show.reset")
    assert (view.layer, view.show) == (0, "beauty")

    start = walker.picture()
    walker.click("exposure_lock")
    walker.session.edit_lights([replace(light, irradiance=(9.0, 9.0, 9.0)) for light in scene.lights])
    assert walker.picture().mean() > 1.2 * start.mean()
    walker.click("exposure_lock")
    assert walker.picture().mean() < 1.2 * start.mean()
    walker.session.put(scene)
    walker.click("fixed_size")
    assert not walker.shows("display.image_size")
    assert walker.picture().shape[0] == walker.target.size[1]
    walker.click("fixed_size")
    assert not differ(walker.picture(), start)


def try_nested(walker):
    """What is inside shows where light is solved in the object, which starts from what it solved before."""
    session, start = walker.session, walker.session.scene
    path = Path(walker.app.preferences.folder) / "nested.ply"
    trimesh.util.concatenate([ball(1.0), ball(0.7)]).export(path)
    session.put(replace(start, model=replace(start.model, path=path), transport=TransportSettings(resolution=24)))
    walker.settle()
    hollow = walker.picture()
    choose("model.nested", "solid")(walker)
    assert session.scene.model.nested == "solid"
    walker.settle()
    assert differ(walker.picture(), hollow)
    walker.click("model.nested.reset")
    assert session.scene.model.nested == "hollow"
    walker.click("model.size_mm.file")
    assert session.scene.model.size_mm == "file"
    session.put(start)
    walker.settle()


def try_medium(walker: Walker) -> None:
    """What a file says of its matter, which is taken where somebody asks for it."""
    session, start = walker.session, walker.session.scene
    path = told(Path(walker.app.preferences.folder) / "milk.glb")
    session.put(replace(start, model=replace(start.model, path=path), transport=TransportSettings(resolution=16)))
    walker.settle()
    plain = walker.picture()
    walker.click("material.file")
    walker.settle()
    assert session.scene.material == MaterialSettings.of(medium_of(path).material)
    assert differ(walker.picture(), plain)
    session.put(start)
    walker.settle()


def try_way(walker: Walker) -> None:
    """What the material is given by, which is the same material and picture."""
    start = walker.picture()
    choose("material.way", COLOUR)(walker)
    assert walker.session.scene.material.diffuse_reflectance is not None
    assert np.abs(walker.picture().astype(int) - start).max() <= 1
    choose("material.way", DIFFUSE)(walker)
    assert walker.session.scene.material.diffuse_mean_free_path_mm is not None
    assert np.abs(walker.picture().astype(int) - start).max() <= 1
    choose("material.way", COEFFICIENTS)(walker)
    assert walker.session.scene.material.sigma_a is not None
    assert np.abs(walker.picture().astype(int) - start).max() <= 1
    for _ in range(3):
        walker.session.undo()


def try_lights(walker: Walker) -> None:
    """The list of lights."""
    session = walker.session
    start = session.scene
    session.put(replace(start, lights=None))
    pictures = [walker.picture()]
    for box, count in (("lights.add", 3), ("lights.0.duplicate", 4), ("lights.2.remove", 3)):
        walker.click(box)
        assert len(session.scene.lights) == count, box
        pictures.append(walker.picture())
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    walker.click("lights.default")
    assert session.scene.lights is None
    assert not differ(walker.picture(), pictures[0])
    walker.click("lights.0", 0.2)
    assert not walker.shows("lights.0.sphere")
    walker.click("lights.0", 0.2)
    assert walker.shows("lights.0.sphere")
    session.put(start)


def try_toolbar(walker: Walker) -> None:
    """The buttons at the top, each by what it shows or writes."""
    session, folder = walker.session, Path(walker.app.preferences.folder)
    start, before = session.scene, walker.view_pixels()
    search("material.name", "ketch", "Ketchup")(walker)
    changed = walker.view_pixels()
    walker.click("undo")
    assert not differ(walker.view_pixels(), before)
    walker.click("redo")
    assert not differ(walker.view_pixels(), changed)
    walker.click("undo")
    walker.click("flip")  # keeps
    session.edit("material", name="ketchup")
    walker.click("flip")
    assert not differ(walker.view_pixels(), before)
    walker.click("toggle_split")
    assert differ(walker.view_pixels(), before)
    walker.click("toggle_split")
    assert not differ(walker.view_pixels(), before)
    walker.click("toggle_help")
    assert differ(walker.view_pixels(), before)
    walker.click("toggle_help")
    walker.click("screenshot")
    assert (folder / "milkglass-001.png").is_file()
    open_file("save", "walk.toml")(walker)
    assert Scene.load(folder / "walk.toml").material == start.material
    open_file("open_file", "other.ply")(walker)
    assert session.scene.model.path == folder / "other.ply"
    session.undo()
    walker.settle()
    walker.click("open")  # lists recent files, the newest first, where the pointer is
    x, y = walker.place("open")
    walker.press((x + 20.0, y + 18.0))
    walker.settle()
    assert session.scene.model.path == folder / "other.ply"
    session.put(start)


def try_error(walker: Walker) -> None:
    """The measurement of the error, which shows over the picture."""
    view, start = walker.session.view, walker.view_pixels()
    walker.click("error.points", 0.01)
    assert view.error_points == 50
    walker.click("error.measure")
    dotted = walker.view_pixels()
    assert len(walker.app.error.result.error.reference) == 50
    walker.click("error.map")
    assert np.mean(walker.view_pixels() != dotted) > 0.01
    walker.click("error.map")
    assert not differ(walker.view_pixels(), dotted)
    walker.click("error.points.reset")
    walker.settle()
    assert len(walker.app.error.result.error.reference) == 300
    walker.click("error.measure")
    assert not differ(walker.view_pixels(), start)


def try_sections(walker: Walker) -> None:
    """Each heading folds the rows below it."""
    for box in sorted(name for name in walker.app.panel.controls.boxes if name.startswith("section.")):
        rows = len(walker.app.panel.controls.boxes)
        walker.click(box, 0.3)
        folded = len(walker.app.panel.controls.boxes)
        assert folded < rows or box == "section.Performance", box
        walker.click(box, 0.3)
        assert len(walker.app.panel.controls.boxes) == rows, box


def try_profiles(walker: Walker) -> None:
    """The curves below the picture, each control by what it shows or writes, and a table that is read anew."""
    start, before, view = walker.session.scene, walker.view_pixels(), walker.app.profiles
    table = Path(walker.app.preferences.folder) / "curves.csv"
    walker.click("toggle_profiles")
    assert differ(walker.view_pixels(), before)
    choose("profiles.other", "burley")(walker)
    choose("profiles.quantity", PER_RADIUS)(walker)
    walker.click("profiles.log")
    assert (view.second, view.quantity, view.log_radius) == ("burley", PER_RADIUS, False)
    edge = walker.place("profiles.edge")
    walker.drag(edge, (0.0, -90.0))
    assert walker.place("profiles.edge")[1] < edge[1] - 60.0
    open_file("profiles.export", table.name)(walker)
    assert table.read_text().splitlines()[1] == "radius_mm,R,G,B"
    walker.click("profiles.close")
    assert not differ(walker.view_pixels(), before)
    walker.session.edit("material", profile="table", profile_table=str(table))
    read = walker.picture()
    table.write_text((table.with_name("other.csv")).read_text())
    walker.click("material.profile_table.reread")
    assert differ(walker.picture(), read)
    walker.session.put(start)


def try_zoom(walker: Walker) -> None:
    """The reset of the zoom is always there: it frames the object, whose zoom the window has at once."""
    framed = walker.session.scene.camera.zoom
    slide("camera.zoom", 0.7)(walker)
    assert walker.session.scene.camera.zoom != framed
    walker.click("camera.zoom.reset")
    walker.frames(2)
    assert walker.session.scene.camera.zoom == pytest.approx(framed)


def try_parts(walker: Walker) -> None:
    """The parts of a model, each of the material or clear, of an index and an absorption of its own."""
    session, start = walker.session, walker.session.scene
    pair = replace(start.model, path=Path(walker.app.preferences.folder) / "pair.ply")
    session.put(replace(start, model=pair, transport=TransportSettings(resolution=24)))
    walker.settle()
    choose("materials.1", CLEAR)(walker)
    walker.settle()
    clear = dict(session.scene.materials)
    assert clear["1"].resolve().sigma_a == (0.0, 0.0, 0.0)
    pictures = [walker.picture()]
    for box in ("materials.1.eta", *(f"materials.1.sigma_a.{letter}" for letter in "RGB")):
        before = session.scene.materials
        walker.click(box, 0.7)
        assert session.scene.materials != before
        pictures.append(walker.picture())
        assert differ(pictures[-1], pictures[-2]), box
    for box in ("materials.1.eta", *(f"materials.1.sigma_a.{letter}" for letter in "RGB")):
        walker.click(f"{box}.reset")
        walker.frames(2)
    assert not differ(walker.picture(), pictures[0])
    choose("materials.1", SCATTERS)(walker)
    assert session.scene.materials == ()
    walker.settle()
    choose("materials.2", CLEAR)(walker)
    walker.settle()
    for _ in range(2):
        session.undo()
    assert dict(session.scene.materials) == clear
    session.put(start)
    walker.settle()


def kind_of(box: str) -> str:
    """Which kind of control a name is: one entry of a list stands for all, and one light for another."""
    named = re.sub(r"^lights\.\d+", "lights.N", re.sub(r"=.*", "=", box))
    return re.sub(r"^materials\.\d+", "materials.N", named)


@pytest.mark.slow
def test_every_control_changes_what_it_says(walker):
    scene, probe = walker.session.scene, Path(walker.app.preferences.folder) / "probe.exr"
    for name, state in states_of(scene, probe).items():
        walker.session.put(state)
        picture = walker.picture()
        for control in CONTROLS:
            if control.state == name:
                try_setting(walker, control, picture)
        assert not differ(walker.picture(), picture), name
    walker.session.put(scene)
    walker.settle()
    for walk in (
        try_zoom,
        try_nested,
        try_medium,
        try_what_is_shown,
        try_way,
        try_lights,
        try_toolbar,
        try_profiles,
        try_error,
        try_parts,
        try_sections,
    ):
        walk(walker)
    seen, used = ({kind_of(box) for box in boxes if not INSIDE.match(box)} for boxes in (walker.seen, walker.used))
    assert seen - used == set()
