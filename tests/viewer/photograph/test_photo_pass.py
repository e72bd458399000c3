"""The photograph in the window: the same picture as `milkglass edit` writes, and what a hand does to it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.photograph.depth import SMOOTHING
from milkglass.viewer.commands.cli import main
from milkglass.viewer.commands.photograph import work_and_scene
from milkglass.viewer.files import images
from milkglass.viewer.files.images import read_photo, write_png
from milkglass.viewer.files.photograph import Region, load_photo
from milkglass.viewer.gui.events import Key, MouseButton, MouseMoved
from milkglass.viewer.live.photograph import DevelopedObject
from milkglass.viewer.live.photograph_work import CAMERA_FIXED, PhotoWork
from milkglass.viewer.photograph.composite import Compositor
from milkglass.viewer.photograph.edit import edit
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import START, EnvironmentSettings, PhotoSettings, apply_set
from tests.support.driving import Driver, small_scene, write_knot
from tests.support.photographing import ball_photo, small_photo, write_photo

SCENE = replace(
    apply_set(START, ["transport.method=layered", "transport.layers=4", "transport.resolution=32"]), lights=()
)
WINDOW = (600, 420)
OPTIONS = {"scene": None, "set": None, "material": None, "model": None, "light": None, "photo": "photo.png"}


@pytest.fixture
def window(context, tmp_path: Path):
    """Return a window without a screen that shows the photograph of a ball."""
    windows = []

    def make(scene=SCENE, masked: bool = True) -> Driver:
        photo = small_photo(tmp_path)
        if not masked:
            photo = load_photo(photo.path, None)
        windows.append(Driver(scene, WINDOW, photo=PhotoWork(photo)))
        return windows[-1]

    yield make
    for each in windows:
        each.close()


def work_of(window: Driver) -> PhotoWork:
    return window.view.subject.work


def developed(window: Driver) -> DevelopedObject:
    """Return what the window shows of the session's own state."""
    shown = window.view.subject.developers[window.view.live].developed
    assert shown is not None
    return shown


def in_window(window: Driver, column: float, row: float) -> tuple[float, float]:
    return window.view.subject.in_window((column, row))


def close_to(picture: np.ndarray, other: np.ndarray) -> bool:
    """Whether two pictures are the same but for rounding, and for little where one fills gaps by another pyramid."""
    difference = np.abs(picture.astype(int) - other.astype(int)).max(axis=2)
    return bool(difference.max() <= 12 and (difference > 3).mean() < 0.01)


@pytest.mark.slow
def test_the_window_shows_what_edit_writes(window, context) -> None:
    shown = window()
    work, picture = work_of(shown), shown.picture()
    written = edit(work.photo, SCENE, context, samples=4, parts=False)
    assert close_to(picture, Compositor(written).picture())
    still, _ = shown.view.subject.still(shown.view.live)
    assert close_to(picture, still)
    assert close_to(still, Compositor(written).picture())
    shown.session.edit("photo", behind="transparent")
    alone = shown.picture()
    assert alone.shape[2] == 4
    there = alone[..., 3] > 250
    assert close_to(alone[there][None, :, :3], picture[there][None])
    assert not alone[work.photo.mask == 0][:20].any()


@pytest.mark.slow
def test_steep_parts_are_filled_without_steps(window, context) -> None:
    """Of a ball read four times as deep most is too steep to be trusted."""
    deep = replace(SCENE, photo=replace(SCENE.photo, depth_strength=4.0))
    shown = window(deep)
    picture = shown.picture().astype(int)
    work = work_of(shown)
    written = Compositor(edit(work.photo, deep, context, samples=4, parts=False)).picture().astype(int)
    inside = work.photo.coverage(Region(0, 0, *work.photo.size)) == 1.0
    for axis in (0, 1):
        pairs = np.minimum(inside, np.roll(inside, -1, axis)).astype(bool)
        steps, smooth = (np.abs(np.roll(each, -1, axis) - each).max(axis=2)[pairs] for each in (picture, written))
        assert np.percentile(steps, 99) <= np.percentile(smooth, 99) + 4
    assert np.abs(picture - written)[inside].mean() < 3.7


@pytest.mark.slow
def test_light_by_hand_is_as_bright_as_edit_makes_it(window, context) -> None:
    lamp = DirectionalLight((0.0, 0.6, 0.8), (40.0, 40.0, 40.0))
    by_hand = replace(SCENE, lights=(lamp,), environment=replace(EnvironmentSettings(), intensity=0.0))
    shown = window(by_hand)
    shown.settle()
    written = edit(work_of(shown).photo, by_hand, context, samples=4)
    assert developed(shown).exposure == pytest.approx(written.exposure, rel=0.1)


@pytest.mark.slow
def test_material_and_depth_change_the_object_alone(window) -> None:
    shown = window()
    before, made = shown.picture(), work_of(shown).object
    shown.session.edit("material", name="ketchup")
    assert "sample buffers" not in shown.stages()
    red = shown.picture()
    far = made.edges.max(axis=2) == 0
    np.testing.assert_array_equal(red[far], before[far])
    np.testing.assert_array_equal(red[far], made.photo.pixels[far])
    assert red[~far].astype(int)[:, 0].mean() > red[~far][:, 1].mean() + 30
    left, top, right, _ = shown.app.panel.controls.boxes["photo.depth_strength"]
    shown.drag((0.6 * left + 0.4 * right, top + 5.0), (-40.0, 0.0))
    shown.settle()
    deeper = work_of(shown).object
    assert deeper is not made
    assert shown.session.scene.photo.depth_strength != 1.0
    assert deeper.light is made.light  # how deep it is read does not change what it is lit by
    assert developed(shown).object is deeper
    np.testing.assert_array_equal(shown.picture()[far], before[far])


@pytest.mark.slow
def test_how_depth_is_read_is_undone_saved_and_opened(window, tmp_path: Path) -> None:
    assert PhotoSettings().depth_smoothing == SMOOTHING
    shown = window()
    first = work_of(shown).object
    shown.session.edit("photo", depth_strength=0.4, behind="seen")
    shown.settle()
    flat = work_of(shown).object
    assert flat.geometry.height.max() < 0.5 * first.geometry.height.max()
    shown.app.actions.save_to(tmp_path / "photo.toml")
    shown.key("left_ctrl", "z")
    shown.settle()
    assert shown.session.scene.photo == PhotoSettings()
    np.testing.assert_array_equal(work_of(shown).object.geometry.height, first.geometry.height)
    shown.app.workspace.open(tmp_path / "photo.toml")
    shown.frames(2)
    shown.key("d")  # discard what has changed since it was saved
    assert shown.session.scene.photo == PhotoSettings(depth_strength=0.4, behind="seen")
    shown.settle()
    shown.click("photo.behind.reset")
    assert shown.session.scene.photo.behind == "filled"


def test_a_depth_map_takes_the_place_of_the_estimate(window, tmp_path: Path) -> None:
    shown = window()
    rows = work_of(shown).photo.size[0]
    ramp = np.linspace(0.0, 30.0, rows)[:, None] * np.ones(work_of(shown).photo.size)
    np.save(tmp_path / "ramp.npy", ramp)
    np.save(tmp_path / "small.npy", ramp[:5])
    shown.app.workspace.photo.take_depth(tmp_path / "small.npy")
    shown.frames(1)
    assert "measures" in shown.app.messages[-1]
    assert shown.session.scene.photo.depth is None
    shown.app.workspace.photo.take_depth(tmp_path / "ramp.npy")
    shown.settle()
    height, inner = work_of(shown).object.geometry.height, work_of(shown).object.geometry.share == 1.0
    assert np.all(np.diff(height, axis=0)[inner[1:] & inner[:-1]] > 0.0)
    shown.click("photo.depth.reset")
    assert shown.session.scene.photo.depth is None


@pytest.mark.slow
def test_a_split_view_shows_the_photograph_twice(window) -> None:
    shown = window()
    before = shown.picture()
    shown.key("v")
    shown.session.edit("material", name="ketchup")
    shown.settle()
    after, kept = (read_image(live.picture) for live in shown.view.lives())
    assert close_to(kept, before)
    assert not close_to(after, before)


def test_the_camera_is_the_photographs(window) -> None:
    shown = window()
    camera = shown.session.scene.camera
    shown.drag(in_window(shown, 50.0, 50.0), (60.0, 20.0))
    shown.scroll(in_window(shown, 50.0, 50.0), 2.0)
    shown.key("_7")
    assert shown.session.scene.camera == camera
    assert CAMERA_FIXED in shown.app.messages
    assert not work_of(shown).mask.can_undo
    shown.app.commands.run("toggle_measure")
    assert not shown.session.view.measure


@pytest.mark.slow
def test_a_mask_is_painted_erased_and_taken_back(window) -> None:
    shown = window(masked=False)
    work = work_of(shown)
    assert work.tool == "brush"
    assert work.object is None
    work.brush = 20.0
    shown.drag(in_window(shown, 40.0, 50.0), (20.0, 0.0))
    shown.settle()
    assert work.mask.pixels[50, 40] == 255
    assert work.object is not None
    first = work.object
    middle = in_window(shown, 50.0, 50.0)
    shown.send(Key("left_alt", True), MouseMoved(*middle), MouseButton("left", True), MouseButton("left", False))
    shown.send(Key("left_alt", False))
    assert work.mask.pixels[50, 50] == 0
    shown.key("left_ctrl", "z")
    shown.settle()
    assert work.mask.pixels[50, 50] == 255
    assert work.object is not first
    shown.send(MouseMoved(*middle))
    shown.key("right_bracket")
    assert work.brush == pytest.approx(23.0)
    shown.key("left_ctrl", "z")
    shown.settle()
    assert work.object is None
    assert not work.trouble
    shown.key("escape")
    assert work.tool is None


@pytest.mark.slow
def test_a_photograph_dropped_on_a_model_is_edited_in_its_material(context, tmp_path) -> None:
    photo = small_photo(tmp_path)
    driver = Driver(small_scene(write_knot(tmp_path / "knot.ply")), WINDOW)
    driver.session.edit("material", name="ketchup")
    (tmp_path / "bad.png").write_bytes(b"no picture")
    driver.drop(tmp_path / "bad.png")
    driver.key("d")
    assert "bad.png" in driver.app.messages[-1]
    assert driver.app.session is driver.session
    driver.drop(photo.path)
    driver.key("d")  # discard the material's change to the model
    driver.settle()
    app = driver.app
    assert app.session is not driver.session
    assert app.title == "photo.png - milkglass"
    driver.view, work = app.view, app.view.subject.work
    work.brush = 20.0
    driver.send(MouseMoved(*in_window(driver, 50.0, 50.0)), MouseButton("left", True), MouseButton("left", False))
    driver.settle()
    assert work.object is not None
    assert app.session.scene.material.name == "Ketchup"
    driver.close()


@pytest.mark.slow
def test_strokes_are_undone_in_their_order_marked_in_the_title_and_asked_about(window, tmp_path) -> None:
    shown = window(masked=False)
    shown.app.preferences.folder = str(tmp_path)
    mask, middle = work_of(shown).mask, in_window(shown, 50.0, 50.0)
    assert "*" not in shown.app.title
    shown.send(MouseMoved(*middle), MouseButton("left", True), MouseButton("left", False))
    assert "*" in shown.app.title
    assert shown.view.subject.fading
    assert shown.app.next_frame() <= 0.05
    shown.settle()
    shown.now += 2.0
    shown.frame()
    assert not shown.view.subject.fading  # the result is seen, not the mask
    shown.key("escape")  # lays down the brush
    shown.session.edit("material", name="ketchup")
    shown.key("left_ctrl", "z")
    assert (shown.session.scene.material.name, mask.pixels[50, 50]) == (SCENE.material.name, 255)
    shown.key("left_ctrl", "z")
    assert mask.pixels[50, 50] == 0
    assert "*" not in shown.app.title
    shown.key("left_ctrl", "left_shift", "z")
    assert mask.pixels[50, 50] == 255
    shown.key("left_ctrl", "q")
    assert "mask" in shown.app.actions.questions.current.text
    shown.key("enter")
    shown.key("enter")  # the name that is suggested
    assert shown.app.actions.closing
    assert images.read_image(tmp_path / "photo-mask.png")[50, 50].max() == 255


@pytest.mark.slow
def test_what_is_under_the_pointer_stays_there_when_the_mask_is_painted_from_close_by(window) -> None:
    shown = window()
    work, brush = work_of(shown), work_of(shown).brush
    shown.click("photo.brush")
    place = in_window(shown, 20.0, 30.0)
    shown.scroll(place, 6.0)
    assert in_window(shown, 20.0, 30.0) == pytest.approx(place)
    assert shown.view.subject.zoom.scale == pytest.approx(1.25**6)
    assert work.brush == brush
    work.brush = 2.0
    shown.drag(place, (0.0, 0.0))
    assert work.mask.pixels[30, 20] == 255
    assert work.mask.pixels[:, :16].max() == 0
    shown.drag(place, (40.0, -25.0), button="middle")
    assert in_window(shown, 20.0, 30.0) == pytest.approx((place[0] + 40.0, place[1] - 25.0))
    shown.send(Key("left_ctrl", True))
    shown.scroll(place, 1.0)
    shown.send(Key("left_ctrl", False))
    assert work.brush == pytest.approx(2.3)
    shown.key("enter")
    assert shown.view.subject.zoom.scale == 1.0


def test_a_mask_that_is_no_object_is_said_and_survived(window) -> None:
    shown = window(masked=False)
    work_of(shown).brush = 1.0
    shown.drag(in_window(shown, 10.0, 50.0), (3.0, 0.0))
    shown.settle()
    assert work_of(shown).object is None
    assert "pixels" in work_of(shown).trouble
    assert work_of(shown).trouble in shown.app.messages


def test_a_box_makes_a_mask(window) -> None:
    pytest.importorskip("cv2", reason="the extra `photo` is not installed")
    shown = window(masked=False)
    work = work_of(shown)
    shown.click("photo.box")
    assert work.tool == "box"
    (x0, y0), (x1, y1) = in_window(shown, 3.0, 3.0), in_window(shown, 94.0, 94.0)
    shown.drag((x0, y0), (x1 - x0, y1 - y0))
    shown.settle()
    assert work.mask.pixels[48, 48] == 255
    assert work.object is not None


def test_pictures_and_masks_are_saved(window, tmp_path: Path) -> None:
    shown = window()
    shown.app.preferences.folder = str(tmp_path)
    shown.key("left_ctrl", "f12")
    np.testing.assert_array_equal(
        read_photo(tmp_path / "milkglass-001.png")[0], shown.view.subject.still(shown.view.live)[0]
    )
    shown.app.workspace.photo.save_mask(tmp_path / "painted.png")
    np.testing.assert_array_equal(load_photo(tmp_path / "photo.png", tmp_path / "painted.png").mask, 255 * (
        work_of(shown).photo.mask > 0
    ))  # fmt: skip
    before = (tmp_path / "photo.png").read_bytes()
    shown.app.workspace.photo.save_picture(tmp_path / "photo.png")
    shown.frames(1)
    assert "is the photograph itself" in shown.app.messages[-1]
    assert (tmp_path / "photo.png").read_bytes() == before


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"photo": None, "mask": "mask.png"}, "with --photo"),
        ({"mask": "empty.png"}, "empty.png is empty"),
        ({"mask": "nowhere.png"}, "nowhere.png"),
        ({"camera_azimuth": 3.0}, "--camera-azimuth and --photo"),
        ({"model": "dragon.ply"}, "MODEL and --photo"),
        ({"photo": None, "depth": "depth.npy"}, "--depth says something of no photograph"),
        ({"depth": "nowhere.npy"}, "nowhere.npy"),
        ({"depth_strength": "9"}, "--depth-strength must be a number from 0.05 to 5"),
        ({"record": "events"}, "--record and --photo"),
        ({"play": "events"}, "--play and --photo"),
        ({"material": "jad"}, "jade"),
    ],
)
def test_bad_options_are_one_sentence(given, said, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    picture, mask, _ = ball_photo(64)
    write_photo(tmp_path, picture, mask)
    write_png("empty.png", np.zeros((64, 64, 1), np.uint8))
    with pytest.raises(InputError, match=said) as raised:
        work_and_scene(OPTIONS | {"mask": None} | given)
    assert "\n" not in str(raised.value)


def test_options_describe_the_scene_of_edit(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    small_photo(tmp_path)
    monkeypatch.setattr("milkglass.viewer.commands.cli.has_display", lambda: False)
    assert main(["view", "--photo", "photo.png", "--mask", "mask.png"]) == 2
    assert "milkglass edit PHOTO" in capsys.readouterr().err
    work, scene = work_and_scene(OPTIONS | {"mask": "mask.png", "material": "jade"})
    assert work.tool is None
    assert scene.material.name == "jade"
    assert scene.specular == START.specular
    assert not scene.all_lights()
    work.close()
