"""The view: mouse, keys, screenshots, comparison, sizes, recordings."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from milkglass.viewer.files.images import read_image
from milkglass.viewer.files.record import read_record
from milkglass.viewer.gui.events import Focused, Key, MouseButton, MouseMoved, Resized, Typed
from milkglass.viewer.scene.camera import framed
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DEFAULT_LIGHTS, CameraSettings
from milkglass.viewer.session import navigation
from tests.support.driving import Driver, headless_picture, small_scene, write_knot

SIZE = (640, 360)
CENTRE = (130.0, 180.0)


@pytest.fixture
def driver(context, model, tmp_path):
    driver = Driver(small_scene(model), SIZE, fixed_size=False)
    driver.app.preferences.folder = str(tmp_path)
    yield driver
    driver.close()


def test_left_drag_orbits_by_the_distance_and_not_by_the_jump_of_the_press(driver):
    start = driver.session.scene.camera
    driver.drag(CENTRE, (20.0, 10.0))
    camera = driver.session.scene.camera
    step = navigation.DEGREES_A_PIXEL * 1000.0 / SIZE[1]
    assert camera.azimuth_deg == pytest.approx(start.azimuth_deg - 20.0 * step)
    assert camera.elevation_deg == pytest.approx(start.elevation_deg + 10.0 * step)
    assert not driver.session.can_undo


def test_shift_drag_and_middle_drag_move_the_point_under_the_pointer_along(driver):
    start = np.array(driver.session.scene.camera.target_mm)
    before = driver.view.live.renderer.pick((130, 180))
    driver.send(Key("left_shift", True))
    driver.drag(CENTRE, (15.0, -8.0))
    driver.send(Key("left_shift", False))
    driver.settle()
    after = driver.view.live.renderer.pick((145, 172))
    assert np.linalg.norm(np.subtract(before, after)) < 6.0  # mm of an object of 100: it is not at the target's depth
    once = np.array(driver.session.scene.camera.target_mm)
    driver.drag(CENTRE, (15.0, -8.0), button="middle")
    assert driver.session.scene.camera.target_mm == pytest.approx(2.0 * once - start, rel=1e-6)


def test_wheel_zooms_and_stays_in_range(driver):
    start = driver.session.scene.camera.zoom
    driver.scroll(CENTRE, 2.0)
    assert driver.session.scene.camera.zoom == pytest.approx(start * navigation.ZOOM_A_NOTCH**2)
    driver.scroll(CENTRE, -1000.0)
    assert driver.session.scene.camera.zoom == 0.01


def test_right_drag_turns_the_lights_as_one_step(driver):
    start = driver.session.scene.lights
    driver.drag(CENTRE, (30.0, 0.0), button="right")
    turned = driver.session.scene.lights
    assert [light.irradiance for light in turned] == [light.irradiance for light in DEFAULT_LIGHTS]
    assert all(a.direction != b.direction for a, b in zip(turned, DEFAULT_LIGHTS, strict=True))
    assert turned[0].direction[1] == pytest.approx(DEFAULT_LIGHTS[0].direction[1])  # about the up axis
    driver.key("left_ctrl", "z")
    assert driver.session.scene.lights == start


def test_double_click_sets_the_orbit_centre_on_the_surface(driver):
    left, right = MouseButton("left", True), MouseButton("left", False)
    driver.send(MouseMoved(*CENTRE), left, right, left, right, frames=1)
    driver.frames(3)
    target = np.array(driver.session.scene.camera.target_mm)
    assert 10.0 < np.linalg.norm(target) < 80.0


def test_losing_the_focus_ends_a_drag(driver):
    driver.send(MouseMoved(*CENTRE), MouseButton("left", True), MouseMoved(140.0, 180.0))
    camera = driver.session.scene.camera
    driver.send(Focused(False), MouseMoved(200.0, 100.0), MouseMoved(100.0, 100.0))
    assert driver.session.scene.camera == camera


def framed_now(driver):
    """The zoom and the target that frame the model as it is seen now."""
    camera = replace(driver.session.scene.camera, zoom=None, target_mm=None)
    return framed(camera, driver.view.live.lit.model.mesh, driver.view.size)


def test_the_model_is_framed_when_it_comes_and_keeps_its_distance_in_an_orbit(driver):
    start = driver.session.scene.camera
    assert start == framed_now(driver)
    assert not driver.session.modified
    assert not driver.session.can_undo
    driver.drag(CENTRE, (60.0, 10.0))
    camera = driver.session.scene.camera
    assert (camera.zoom, camera.target_mm) == (start.zoom, start.target_mm)
    assert camera != framed_now(driver)
    driver.key("f")
    assert driver.session.scene.camera == framed_now(driver)
    assert driver.session.scene.camera.azimuth_deg == camera.azimuth_deg


@pytest.mark.slow
def test_another_size_is_seen_as_before_and_another_model_is_framed(driver, tmp_path):
    driver.scroll(CENTRE, 1.0)
    before = driver.session.scene.camera
    driver.session.edit("model", size_mm=10.0)
    driver.settle()
    camera = driver.session.scene.camera
    assert camera.zoom == before.zoom
    assert camera.target_mm == pytest.approx(np.array(before.target_mm) / 10.0)
    driver.session.edit("model", path=write_knot(tmp_path / "another.ply"))
    driver.settle()
    assert driver.session.scene.camera == framed_now(driver)
    driver.session.undo()
    assert driver.session.scene.camera == camera


@pytest.mark.slow
def test_keys_look_from_the_sides_and_reset(driver):
    for keys, expected in (
        (("_1",), (0.0, 0.0)),
        (("left_ctrl", "_1"), (180.0, 0.0)),
        (("keypad3",), (90.0, 0.0)),
        (("_7",), (0.0, 90.0)),
    ):
        driver.key(*keys)
        camera = driver.session.scene.camera
        assert (camera.azimuth_deg, camera.elevation_deg) == expected
    driver.key("_5")
    assert driver.session.scene.camera.orthographic
    driver.key("enter")
    assert driver.session.scene.camera == framed(CameraSettings(), driver.view.live.lit.model.mesh, driver.view.size)


def test_keys_typed_into_a_field_are_no_shortcuts(driver):
    start = driver.session.scene.camera
    driver.click("material.name")
    driver.send(Key("_7", True), Key("_7", False))
    assert driver.session.scene.camera == start


def test_keys_that_come_all_at_once_are_a_shortcut(driver):
    for event in (Key("left_ctrl", True), Key("_3", True), Key("left_ctrl", False), Key("_3", False)):
        driver.app.handle(event)
    driver.frames(4)
    assert driver.session.scene.camera.azimuth_deg == -90.0


def test_a_drag_that_comes_all_at_once_is_not_lost(driver):
    start = driver.session.scene.camera
    place = (MouseMoved(*CENTRE), MouseButton("left", True), MouseMoved(150.0, 180.0), MouseButton("left", False))
    for event in place:
        driver.app.handle(event)
    driver.frames(5)
    step = navigation.DEGREES_A_PIXEL * 1000.0 / SIZE[1]
    assert driver.session.scene.camera.azimuth_deg == pytest.approx(start.azimuth_deg - 20.0 * step)


def test_view_is_copied_and_pasted_as_text(driver):
    driver.drag(CENTRE, (20.0, 10.0))
    camera = driver.session.scene.camera
    driver.key("left_ctrl", "c")
    driver.key("enter")
    driver.key("left_ctrl", "v")
    assert driver.session.scene.camera == camera


def test_cheat_sheet_and_dialog_open_and_close(driver):
    driver.key("h")
    assert driver.app.actions.help_shown
    driver.key("escape")
    assert not driver.app.actions.help_shown
    driver.key("left_ctrl", "o")
    assert driver.app.actions.dialog.is_open
    driver.key("escape")
    assert not driver.app.actions.dialog.is_open


@pytest.mark.slow
def test_saved_scene_renders_to_the_very_pixels_seen(driver, tmp_path):
    driver.session.edit("material", name="ketchup")
    driver.drag(CENTRE, (20.0, 10.0))
    driver.key("left_ctrl", "s")
    assert driver.app.actions.dialog.is_open  # the scene has no file yet
    driver.app.actions.dialog.folder = tmp_path
    driver.type("seen.toml")
    driver.key("enter")
    assert not driver.session.modified
    seen = driver.picture()
    saved = Scene.load(tmp_path / "seen.toml")
    assert saved.display.image_size == driver.view.size
    assert np.array_equal(headless_picture(saved, saved.display.image_size), seen)


def test_saved_scene_keeps_a_locked_exposure(driver, tmp_path):
    driver.key("l")
    driver.session.edit("material", name="ketchup")
    seen = driver.picture()
    driver.session.path = tmp_path / "locked.toml"
    driver.key("left_ctrl", "s")
    saved = Scene.load(tmp_path / "locked.toml")
    assert saved.display.average is not None
    assert saved.display == replace(driver.session.scene.display, image_size=driver.view.size)
    difference = headless_picture(saved, saved.display.image_size).astype(int) - seen
    assert np.abs(difference).max() <= 1


def test_screenshots_show_the_window_or_the_object_alone(driver, tmp_path):
    driver.settle()
    driver.key("f12")
    window = read_image(tmp_path / "milkglass-001.png")
    assert window.shape == (SIZE[1], SIZE[0], 3)
    driver.key("left_ctrl", "f12")
    alone = read_image(tmp_path / "milkglass-002.png")
    assert alone.shape == (driver.view.size[1], driver.view.size[0], 4)
    assert set(np.unique(alone[..., 3])) >= {0, 255}
    assert any("milkglass-002.png" in text for text in driver.app.messages)
    shown = replace(driver.session.scene.display, image_size=driver.view.size)
    for number, background in ((1, shown.background), (2, "transparent")):  # each says what it shows, for `render`
        recorded, _, _ = read_record(tmp_path / f"milkglass-00{number}.png")
        assert recorded == replace(driver.session.scene, display=replace(shown, background=background))


@pytest.mark.slow
def test_split_shows_both_states_at_one_exposure(driver):
    driver.key("k")
    driver.session.edit("material", name="ketchup")
    driver.key("v")
    driver.settle()
    kept, current = driver.view.lives()[1].picture, driver.view.picture
    assert kept is not None
    assert current is not None
    assert driver.view.live.finished.lit.profiles != driver.view.lives()[1].finished.lit.profiles
    left, top, right, bottom = driver.view.drawn_at
    driver.drag((0.5 * (left + right), 0.5 * (top + bottom)), (60.0, 0.0))
    assert driver.session.view.split == pytest.approx(0.5 + 60.0 / (right - left), abs=0.03)
    driver.key("v")
    assert driver.session.view.split is None


def test_a_double_click_on_a_folder_opens_no_file_in_it(driver, tmp_path):
    inside = tmp_path / "meshes" / "many"
    inside.mkdir(parents=True)
    for i in range(12):
        write_knot(inside.parent / f"{i:02}.ply")
    before = driver.session.scene
    driver.key("left_ctrl", "o")
    press, release = MouseButton("left", True), MouseButton("left", False)
    places = driver.app.actions.dialog.boxes
    left, top, _, bottom = places["meshes"]
    driver.send(MouseMoved(left + 20.0, 0.5 * (top + bottom)), press, release, press, release, frames=2)
    assert driver.app.actions.dialog.folder == inside.parent
    assert driver.app.actions.dialog.is_open
    assert driver.session.scene == before
    left, top, _, bottom = places["03.ply"]
    driver.now += 1.0
    driver.send(MouseMoved(left + 20.0, 0.5 * (top + bottom)), press, release, press, release, frames=2)
    assert driver.session.scene.model.path == inside.parent / "03.ply"


@pytest.mark.parametrize(("size", "scale"), [((1280, 800), 1.0), ((640, 480), 1.0), ((1440, 900), 2.0)])
def test_the_cheat_sheet_lies_in_the_window_and_scrolls(driver, size, scale):
    driver.send(Resized(size, size, scale))
    driver.key("h")
    left, top, right, bottom = driver.app.help_boxes[0]
    assert min(left, top) >= 0.0
    assert right <= size[0]
    assert bottom <= size[1]
    driver.scroll((0.5 * (left + right), 0.5 * (top + bottom)), -200.0)
    driver.frames(2)
    content = driver.app.help_boxes[1]
    assert content[3] <= bottom  # the last row can be read
    assert content[2] <= right


def test_what_is_typed_faster_than_frames_come_arrives(driver, tmp_path):
    other = write_knot(tmp_path / "other.ply")
    driver.key("left_ctrl", "o")
    for letter in other.name:
        name = "period" if letter == "." else letter
        for event in (Key(name, True), Typed(letter), Key(name, False)):
            driver.app.handle(event)
    for event in (Key("enter", True), Key("enter", False)):
        driver.app.handle(event)
    driver.settle()
    assert driver.session.scene.model.path == other


def test_a_file_that_cannot_be_read_is_not_offered_again(driver, tmp_path):
    bad = tmp_path / "bad.ply"
    bad.write_text("ply\nnonsense\n")
    driver.drop(bad)
    assert any("bad.ply" in text for text in driver.app.messages)
    assert driver.app.actions.recent == []
    write_knot(bad)
    driver.drop(bad)
    assert driver.app.actions.recent == [str(bad)]


def test_a_model_that_is_framed_late_is_no_rest(driver):
    """Where frames take long, a picture is antialiased before it is framed; the next frame draws with the new zoom."""
    scene, view = driver.session.scene, driver.view
    with patch.object(view, "_frame", lambda: None):
        driver.session.put(replace(scene, camera=replace(scene.camera, zoom=None, target_mm=None)))
        driver.settle()
    driver.frame()
    assert driver.session.scene.camera.zoom is not None
    assert not view.at_rest()
    assert driver.app.next_frame() == 0.0
    driver.settle()
    driver.frames(2)
    assert view.detail.samples == 4


@pytest.mark.slow
def test_sizes_of_all_kinds(driver, context):
    for size, pixels, scale in (
        ((0, 0), (0, 0), 1.0),
        ((1, 1), (1, 1), 1.0),
        ((500, 320), (1000, 640), 1.0),
        ((700, 400), (700, 400), 1.5),
        (SIZE, SIZE, 1.0),
    ):
        driver.send(Resized(size, pixels, scale))
        if pixels == (1000, 640):
            assert driver.view.size[1] == 640
    assert driver.picture().shape[0] == SIZE[1]


@pytest.mark.slow
def test_recent_files_are_offered_and_opened_again(driver, model, tmp_path):
    other = write_knot(tmp_path / "again.ply")
    driver.drop(other)
    driver.session.undo()
    driver.settle()
    assert driver.app.preferences.recent == [str(other)]
    driver.app.commands.run("open", str(other))
    driver.settle()
    assert driver.session.scene.model.path == other


def test_at_rest_no_frame_is_due(driver):
    driver.settle()
    driver.now += 10.0
    driver.frames(5)
    assert driver.app.next_frame() is None
    driver.send(MouseMoved(*CENTRE), frames=0)
    assert driver.app.next_frame() == 0.0


def test_an_orbit_is_drawn_at_full_size_however_slow_pixels_are(driver):
    """From light at the vertices; where that does not serve, the picture of a drag is smaller."""
    driver.settle()
    view, sizes = driver.view, {}
    middle = 0.4 * view.size[0], 0.5 * view.size[1]
    for serves in (True, False):
        view._per_pixel = 1.0
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr("milkglass.viewer.render.vertices.LONGEST_EDGE", 30.0 if serves else 0.0)  # pixels
            driver.send(MouseMoved(*middle), MouseButton("left", True))
            driver.send(MouseMoved(middle[0] + 20.0, middle[1]), MouseMoved(middle[0] + 30.0, middle[1]), frames=1)
            sizes[serves] = view.picture.image.size
            assert ("at full size" in view.live.on_a_move) == serves
            driver.send(MouseButton("left", False))
        driver.settle()
    assert sizes[True] == view.size
    assert sizes[False] < view.size
