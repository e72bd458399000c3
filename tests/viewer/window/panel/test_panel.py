"""The panel, drawn into a framebuffer and used with an injected mouse and keyboard."""

import dataclasses
from unittest.mock import patch

import numpy as np
import pytest

from milkglass.viewer.gui.controls import default_of, explained
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS, DirectionalLight, PointLight, as_kind
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DEFAULT_LIGHTS
from milkglass.viewer.session.session import SHOWN
from milkglass.viewer.window.panel.transport import chosen
from tests.support.ring_light import RingLight

SECTIONS = ("Environment", "Highlights", "Tone mapping", "Model", "Camera")


def value_of(scene: Scene, name: str):
    table, key = name.split(".")[:2]
    return getattr(getattr(scene, table), key)


SLIDERS = {
    "material.sigma_a.G": 0.9,
    "model.size_mm": 0.3,
    "transport.layers": 0.1,
    "specular.shininess": 0.3,
    "display.white": 0.05,
    "camera.elevation_deg": 0.8,
    "camera.zoom": 0.7,
}


@pytest.mark.slow
def test_the_right_button_resets_a_slider_of_each_table(driver):
    """All sliders, and their buttons that reset: `test_panel_walk.py`."""
    for section in SECTIONS:
        driver.click(f"section.{section}", 0.3)
    driver.frames(2)
    for name, share in SLIDERS.items():
        before, picture = driver.session.scene, driver.picture()
        driver.click(name, share)
        after = driver.session.scene
        assert value_of(after, name) != value_of(before, name), name
        table = name.split(".")[0]
        follows = {"camera"} if name == "model.size_mm" else set()  # keeps to the model
        others = [f.name for f in dataclasses.fields(Scene) if f.name not in {table} | follows]
        assert all(getattr(after, other) == getattr(before, other) for other in others), name
        assert np.any(driver.picture() != picture), name
        driver.click(name, 0.5, button="right")
        reset = value_of(driver.session.scene, name)
        if table == "material":
            assert driver.session.scene.material == before.material, name
        elif name == "camera.zoom":  # the silhouette's, which the window has at once
            assert reset == pytest.approx(before.camera.zoom), name
        else:
            assert reset == default_of(*name.split(".")), name
        driver.session.put(before)


@pytest.mark.slow
def test_boolean_and_choices_change_the_picture(driver):
    for section in SECTIONS:
        driver.click(f"section.{section}", 0.3)
    pictures = [driver.picture()]
    driver.click("camera.orthographic", 0.05)
    assert driver.session.scene.camera.orthographic
    pictures.append(driver.picture())
    for control, choice, table, key in (
        ("model.up", "z", "model", "up"),
        ("transport.method", "ewald", "transport", "method"),
        ("display.background", "transparent", "display", "background"),
    ):
        driver.click(control)
        driver.click(f"{control}={choice}", 0.3)
        assert getattr(getattr(driver.session.scene, table), key) == choice
        pictures.append(driver.picture())
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)


def test_every_choice_of_the_transport_method_that_is_built_is_offered(driver):
    driver.click("transport.method")
    offered = {name.split("=")[1] for name in driver.app.panel.controls.boxes if name.startswith("transport.method=")}
    assert offered == set(settings_of(driver.session.scene.transport)["method"].choices)


def test_ctrl_click_types_a_number_beyond_the_slider(driver):
    from milkglass.viewer.gui.events import Key

    driver.send(Key("left_ctrl", True), frames=1)
    driver.click("model.size_mm")
    driver.send(Key("left_ctrl", False), frames=1)
    driver.type("1234.5")
    driver.key("enter")
    assert driver.session.scene.model.size_mm == pytest.approx(1234.5)


def test_typing_an_impossible_number_is_a_message(driver):
    from milkglass.viewer.gui.events import Key

    driver.send(Key("left_ctrl", True), frames=1)
    driver.click("material.eta")
    driver.send(Key("left_ctrl", False), frames=1)
    driver.type("9")
    driver.key("enter")
    assert driver.session.scene.material.eta is None
    assert any("material.eta must be a number from 1 to 3" in text for text in driver.app.messages)


def test_library_is_searched_and_chosen_with_the_keyboard(driver):
    picture = driver.picture()
    driver.click("material.name")
    driver.type("soy reg")
    listed = [name for name in driver.app.panel.controls.boxes if name.startswith("material=")]
    assert listed == ["material=Regular Soy Milk"]
    driver.key("enter")
    assert driver.session.scene.material.name == "Regular Soy Milk"
    assert np.any(driver.picture() != picture)


def test_text_fields_use_the_clipboard(driver):
    driver.app.actions.clipboard.set("skim")
    driver.click("material.name")
    driver.key("left_ctrl", "v")
    assert "material=Skimmilk" in driver.app.panel.controls.boxes
    assert "material=jade" not in driver.app.panel.controls.boxes
    driver.key("left_ctrl", "a")
    driver.type("x")
    driver.key("left_ctrl", "a")
    driver.key("left_ctrl", "c")
    assert driver.app.actions.clipboard.get() == "x"


def test_moved_coefficient_makes_an_own_material_and_its_reset_the_librarys_again(driver):
    driver.click("material.sigma_a.G", 0.8)
    own = driver.session.scene.material
    assert (own.name, driver.session.origin) == (None, "jade")
    assert own.sigma_s_prime == pytest.approx((1.2, 1.1, 1.2))
    driver.click("material.sigma_a.G", button="right")
    assert driver.session.scene.material.name == "jade"


def test_a_drag_is_one_step_to_undo(driver):
    start = driver.session.scene
    left = driver.place("material.sigma_s_prime.R", 0.4)
    driver.drag(left, (60.0, 0.0), steps=10)
    assert driver.session.scene != start
    driver.key("left_ctrl", "z")
    assert driver.session.scene == start
    driver.key("left_ctrl", "left_shift", "z")
    assert driver.session.scene != start


@pytest.mark.slow
def test_lights_are_added_duplicated_switched_and_removed(driver):
    pictures = [driver.picture()]
    driver.click("lights.add")
    assert len(driver.session.scene.lights) == len(DEFAULT_LIGHTS) + 1
    pictures.append(driver.picture())
    driver.click("lights.0.duplicate")
    assert driver.session.scene.lights[0] == driver.session.scene.lights[1]
    pictures.append(driver.picture())
    driver.click("lights.2.toggle")
    assert [light.on for light in driver.session.scene.lights] == [True, True, False, True]
    pictures.append(driver.picture())
    driver.click("lights.0.remove")
    assert len(driver.session.scene.lights) == 3
    pictures.append(driver.picture())
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    driver.click("lights.default")
    assert driver.session.scene.lights is None


@pytest.mark.slow
def test_light_is_turned_on_the_sphere_and_by_angles_and_brightened(driver):
    pictures = [driver.picture()]
    centre = driver.place("lights.0.sphere")
    driver.drag(centre, (25.0, 10.0))
    direction = driver.session.scene.lights[0].direction
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-3)
    pictures.append(driver.picture())
    for name, share in (("azimuth", 0.8), ("elevation", 0.3), ("irradiance", 0.9)):
        before = driver.session.scene.lights
        driver.click(f"lights.0.{name}", share)
        assert driver.session.scene.lights != before, name
        pictures.append(driver.picture())
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    assert all(isinstance(light, DirectionalLight) for light in driver.session.scene.lights)


@pytest.mark.slow
def test_a_kind_in_the_registry_is_chosen_and_edited_in_the_panel(driver, monkeypatch):
    monkeypatch.setitem(LIGHT_KINDS, RingLight.KIND, RingLight)
    driver.click("lights.0.kind")
    driver.click("lights.0.kind=ring", 0.3)
    assert driver.session.scene.lights[0] == as_kind(DEFAULT_LIGHTS[0], "ring")
    for key in ("radius_mm", "tube_mm"):
        light, picture = driver.session.scene.lights[0], driver.picture()
        driver.click(f"lights.0.{key}", 0.4)
        assert getattr(driver.session.scene.lights[0], key) != getattr(light, key)
        assert np.any(driver.picture() != picture), key


def test_point_light_shines_about_as_the_directional_one_did(driver):
    mean = driver.picture().mean()
    driver.session.edit("display", average=driver.view.picture.log_average)
    driver.click("lights.0.kind")
    driver.click("lights.0.kind=point", 0.3)
    light = driver.session.scene.lights[0]
    assert isinstance(light, PointLight)
    assert driver.picture().mean() == pytest.approx(mean, rel=0.3)
    before = driver.picture()
    driver.drag(driver.place("lights.0.X"), (-40.0, 0.0))
    assert driver.session.scene.lights[0].position_mm[0] < light.position_mm[0]
    assert np.any(driver.picture() != before)


@pytest.mark.parametrize("show", SHOWN)
def test_everything_that_can_be_shown_is_shown(driver, show):
    beauty = driver.picture()
    driver.click("show")
    driver.click(f"show={show}", 0.3)
    assert driver.session.view.show == show
    if SHOWN[show]:
        assert np.any(driver.picture() != beauty) == (show != "beauty")
    else:
        driver.settle()
        driver.click("layer", 0.99)
        assert driver.session.view.layer == 3


def test_exposure_lock_holds_the_exposure(driver):
    driver.click("section.Tone mapping", 0.3)
    driver.click("exposure_lock")
    before = driver.picture()
    driver.session.edit_lights([dataclasses.replace(light, irradiance=(9.0, 9.0, 9.0)) for light in DEFAULT_LIGHTS])
    brighter = driver.picture()
    assert brighter.mean() > 1.3 * before.mean()
    driver.click("exposure_lock")
    assert driver.picture().mean() < 0.8 * brighter.mean()


@pytest.mark.slow
def test_probe_lights_and_shows_and_is_removed(driver, few_rays, tmp_path):
    from milkglass.viewer.files.images import write_exr

    rng = np.random.default_rng(4)
    planes = {name: rng.random((16, 32), np.float32) for name in "RGB"}
    write_exr(tmp_path / "probe.exr", planes)
    pictures = [driver.picture()]
    driver.drop(tmp_path / "probe.exr")
    assert driver.session.scene.display.background == "environment"
    pictures.append(driver.picture())
    driver.click("section.Environment", 0.3)
    for name, share in (
        ("environment.rotation_deg", 0.8),
        ("environment.intensity", 0.9),
        ("display.background_blur_deg", 0.5),
    ):
        before = value_of(driver.session.scene, name)
        driver.click(name, share)
        assert value_of(driver.session.scene, name) != before
        if name != "environment.intensity":  # exposure follows it
            pictures.append(driver.picture())
    driver.click("environment.shown", 0.05)
    assert driver.session.scene.display.background == "black"
    pictures.append(driver.picture())
    driver.click("environment.remove")
    assert driver.session.scene.environment.path is None
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)


def test_rows_stay_where_they_are_when_the_text_on_transport_gets_shorter(driver):
    words = "milkglass.viewer.window.panel.transport.chosen"
    with patch(words, lambda *_: "many words " * 30):
        driver.frames(2)
        before = driver.app.panel.controls.boxes["section.Camera"]
    with patch(words, lambda *_: "one"):
        driver.frames(2)
        assert driver.app.panel.controls.boxes["section.Camera"] == pytest.approx(before)


def test_tooltip_says_unit_range_and_default(driver):
    declared = settings_of(driver.session.scene.model)["size_mm"]
    text = explained(declared, 100.0)
    assert "unit mm" in text
    assert "from 0.001 to 1e6" in text
    assert "default 100" in text


def test_panel_text_is_drawn_and_only_where_the_panel_is(driver):
    from milkglass.viewer.window.app import read_pixels

    shown = read_pixels(driver.target, driver.target.size)
    driver.key("tab")
    hidden = read_pixels(driver.target, driver.target.size)
    assert not driver.app.actions.panel_shown
    panel = shown[:, -370:].astype(int)
    assert np.ptp(panel) > 180  # letters are light, the ground is dark
    assert np.abs(panel - hidden[:, -370:]).mean() > 5.0


def test_the_grid_that_was_chosen_and_its_cost_are_told(driver):
    finished = driver.view.live.finished
    told = chosen(finished, driver.view.live.stage_times)
    assert f"{finished.lit.grid.width} x " in told
    assert "new light in" in told
    assert "a new material in" in told
    assert "new light" not in chosen(finished, {})
