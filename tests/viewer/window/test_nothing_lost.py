"""What a person has made is not lost: questions before it is, undo across files, files of others."""

from pathlib import Path

import pytest

from milkglass.viewer.gui.events import Closed
from milkglass.viewer.scene.scene import Scene
from tests.support.driving import Driver, driven

SIZE = (320, 240)


@pytest.fixture
def driver(context, model, tmp_path):
    with driven(model, SIZE, tmp_path) as driver:
        yield driver


def answer(driver: Driver, label: str) -> None:
    left, top, right, bottom = driver.app.actions.questions.boxes[label]
    driver.click_at((0.5 * (left + right), 0.5 * (top + bottom)))


def other_scene(driver: Driver, path: Path) -> Path:
    scene = driver.session.scene
    Scene(model=scene.model, transport=scene.transport, display=scene.display).save(path)
    return path


def test_quit_asks_for_edits_but_not_for_a_turned_object(driver, tmp_path):
    actions = driver.app.actions
    driver.drag((100.0, 100.0), (20.0, 10.0))
    driver.send(Closed())
    assert actions.closing
    actions.closing = False
    driver.session.edit("display", key=0.3)
    driver.key("left_ctrl", "q")
    assert not actions.closing
    assert "not saved" in actions.questions.current.text
    driver.key("escape")
    assert (actions.closing, actions.questions.current) == (False, None)
    driver.send(Closed())
    answer(driver, "Save")
    driver.app.actions.dialog.folder = tmp_path
    driver.type("kept.toml")
    driver.key("enter")
    assert actions.closing
    assert Scene.load(tmp_path / "kept.toml").display.key == 0.3


def test_discarding_closes_and_saves_nothing(driver, tmp_path):
    driver.session.edit("display", key=0.3)
    driver.key("left_ctrl", "q")
    driver.key("d")
    assert driver.app.actions.closing
    assert not list(tmp_path.glob("*.toml"))


def test_another_scene_waits_for_an_answer(driver, tmp_path):
    path = other_scene(driver, tmp_path / "other.toml")
    driver.session.edit("material", name="ketchup")
    driver.drop(path)
    assert driver.session.scene.material.name == "Ketchup"
    answer(driver, "Cancel")
    assert driver.session.path is None
    driver.drop(path)
    answer(driver, "Discard")
    assert (driver.session.path, driver.session.modified) == (path, False)


def test_undo_across_an_opened_scene_takes_its_path_along(driver, tmp_path):
    first, second = tmp_path / "first.toml", other_scene(driver, tmp_path / "second.toml")
    driver.app.actions.save_to(first)
    before = second.read_bytes()
    driver.drop(second)
    driver.key("left_ctrl", "z")
    assert (driver.session.path, driver.session.modified) == (first, False)
    driver.session.edit("display", key=0.3)
    driver.key("left_ctrl", "s")
    assert second.read_bytes() == before
    assert Scene.load(first).display.key == 0.3


def test_redo_opens_the_scene_again(driver, tmp_path):
    second = other_scene(driver, tmp_path / "second.toml")
    driver.drop(second)
    driver.key("left_ctrl", "z")
    assert driver.session.path is None
    driver.key("left_ctrl", "left_shift", "z")
    assert (driver.session.path, driver.session.modified) == (second, False)


def test_a_scene_whose_model_is_gone_leaves_the_path(driver, tmp_path):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    driver.app.actions.save_to(first)
    second.write_text('[model]\npath = "gone.ply"\n')
    driver.drop(second)
    assert (driver.session.path, driver.session.modified) == (first, False)


def test_a_file_of_somebody_else_is_replaced_only_if_so_answered(driver, tmp_path):
    precious = tmp_path / "precious.toml"
    precious.write_text("precious = 1\n")
    driver.key("left_ctrl", "left_shift", "s")
    assert driver.app.actions.dialog.name == "knot.toml"
    driver.app.actions.dialog.folder = tmp_path
    driver.type("precious.toml")
    driver.key("enter")
    assert driver.app.actions.questions.current is not None
    driver.key("escape")
    assert precious.read_text() == "precious = 1\n"
    assert driver.app.actions.dialog.is_open  # for another name
    driver.app.actions.dialog.folder = tmp_path
    driver.type("precious.toml")
    driver.key("enter")
    answer(driver, "Replace")
    assert driver.session.path == precious
    driver.session.edit("display", key=0.3)
    driver.key("left_ctrl", "s")  # ours by now
    assert Scene.load(precious).display.key == 0.3
