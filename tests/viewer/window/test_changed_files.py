"""Files that other programs change while the window shows them, and places that cannot be read."""

import numpy as np
import pytest
import trimesh

from milkglass.viewer.files.images import write_exr
from milkglass.viewer.gui.events import Focused
from milkglass.viewer.scene.scene import Scene
from tests.support.driving import driven

SIZE = (320, 240)


@pytest.fixture
def driver(context, model, tmp_path):
    with driven(model, SIZE, tmp_path) as driver:
        yield driver


def return_to(driver):
    driver.send(Focused(True))
    driver.settle()
    return driver.picture()


def said(driver):
    return [str(message) for message in driver.app.messages]


def write_even_probe(path, level):
    write_exr(path, {name: np.full((8, 16), level, np.float32) for name in "RGB"})


@pytest.mark.slow
def test_a_model_that_was_exported_anew_is_shown(driver, tmp_path):
    path = tmp_path / "part.ply"
    trimesh.creation.box((1, 1, 1)).export(path)
    driver.drop(path)
    driver.settle()
    before = driver.picture()
    np.testing.assert_array_equal(return_to(driver), before)
    trimesh.creation.box((1, 0.3, 1)).export(path)
    after = return_to(driver)
    assert np.any(after != before)
    assert any("part.ply has changed and was read again" in message for message in said(driver))
    path.write_bytes(path.read_bytes()[:100])
    np.testing.assert_array_equal(return_to(driver), after)
    assert any("stays" in message for message in said(driver))
    path.unlink()
    np.testing.assert_array_equal(return_to(driver), after)


@pytest.mark.slow
def test_a_probe_that_was_painted_anew_lights_the_object(driver, tmp_path):
    path = tmp_path / "room.exr"
    write_even_probe(path, 1.0)
    driver.drop(path)
    driver.session.edit("display", background="environment")
    driver.settle()
    before = driver.picture()
    write_exr(path, {name: np.full((8, 16), level, np.float32) for name, level in zip("RGB", (1, 0, 0), strict=True)})
    assert np.any(return_to(driver) != before)


def test_a_scene_that_was_edited_elsewhere_is_offered_once(driver, tmp_path):
    path = tmp_path / "shared.toml"
    scene = driver.session.scene
    other = Scene(model=scene.model, transport=scene.transport, display=scene.display)
    other.save(path)
    driver.drop(path)
    driver.send(Focused(True))
    questions = driver.app.actions.questions
    assert questions.current is None
    text = path.read_text()
    path.write_text(text.replace("elevation_deg = 10.0", "elevation_deg = 20.0"))
    driver.send(Focused(True))
    assert "Another program has changed shared.toml" in questions.current.text
    driver.key("escape")
    driver.send(Focused(True))
    assert questions.current is None  # it was answered
    path.write_text(text.replace("elevation_deg = 10.0", "elevation_deg = 30.0"))
    driver.send(Focused(True))
    driver.key("o")
    assert driver.session.scene.camera.elevation_deg == 30.0


def test_what_was_saved_here_is_not_offered(driver, tmp_path):
    path = tmp_path / "kept.toml"
    assert driver.session.save(path, SIZE)
    driver.send(Focused(True))
    assert driver.app.actions.questions.current is None


def refuse(*_, **__):
    raise PermissionError(13, "Permission denied")


def test_a_folder_that_may_not_be_entered_is_told(driver, tmp_path, monkeypatch):
    """As the superuser, who may enter all, by the calls that then fail."""
    closed = tmp_path / "closed" / "a.ply"
    monkeypatch.setattr("pathlib.Path.stat", refuse)
    driver.app.actions.open(closed)
    assert driver.session.path is None
    assert list(driver.app.actions.recent) == []
    assert any("a.ply is not a file that can be read" in str(message.text) for message in driver.session.messages)


@pytest.mark.parametrize("text", ["x = " + 5000 * "9", "x = " + 100_000 * "[", "\ud800", "[camera]\nzoom = 1e999", ""])
def test_odd_text_is_no_view(driver, text):
    before = driver.session.scene
    driver.app.actions.clipboard.set(text)
    driver.app.actions.paste_view()
    driver.frames(1)
    assert driver.session.scene == before
