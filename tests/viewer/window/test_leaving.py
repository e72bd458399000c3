"""The end of a window, by the person or by a signal, whatever is computed; what was not saved is offered again."""

import json
import shutil
import signal
import subprocess
import sys

import pytest

from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.autosave import Autosave
from tests.support.driving import Driver, small_scene
from tests.support.paths import ROOT
from tests.support.waiting import DEADLINE
from tests.viewer.window.test_window import RealWindow, environment_of

PROGRAM = str(ROOT / "tests" / "support" / "ended_window.py")
pytestmark = pytest.mark.window


@pytest.fixture
def scene_file(tmp_path, model):
    small_scene(model).save(tmp_path / "scene.toml")
    return tmp_path / "scene.toml"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xdotool") is None, reason="needs xdotool")
def test_ctrl_q_ends_the_program_while_a_worker_never_ends(display, tmp_path, scene_file, monkeypatch):
    monkeypatch.setenv("XDG_SESSION_TYPE", "wayland")  # whose X server serves too
    window = RealWindow(display, tmp_path, program=(PROGRAM, "stuck", str(scene_file)))
    try:
        window.opened()
        assert window.quit() == 0
    finally:
        window.stop()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_a_signal_ends_a_sleeping_window_and_its_edits_are_offered(display, tmp_path, context, scene_file, name):
    environment = environment_of(display, tmp_path) | {"XDG_STATE_HOME": str(tmp_path / "state")}
    command = [sys.executable, PROGRAM, name, str(scene_file)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=DEADLINE)
    number = signal.Signals[name]
    assert (done.returncode, done.stderr) == (-number if name == "SIGKILL" else 128 + number, "")

    driver = Driver(Scene.load(scene_file), (320, 240))
    autosave = Autosave(tmp_path / "state" / "milkglass" / "autosave")
    driver.app.keep_in(autosave)
    driver.frames(3)
    assert "scene.toml" in driver.app.actions.questions.current.text
    driver.key("enter")
    session = driver.session
    assert (session.scene.display.key, session.path, session.unsaved) == (0.3, scene_file, True)
    assert autosave.left_behind().scene == session.scene  # until it is saved
    driver.key("left_ctrl", "s")
    assert autosave.left_behind() is None
    driver.close()


def test_edits_are_kept_while_they_are_unsaved_and_few_times(driver_with_autosave, tmp_path):
    driver, autosave = driver_with_autosave
    driver.session.edit("display", key=0.3)
    driver.frame()
    assert autosave.left_behind().scene.display.key == 0.3
    driver.session.edit("display", key=0.4)
    driver.frame()
    assert autosave.left_behind().scene.display.key == 0.3
    assert 0.0 < driver.app.next_frame() <= 2.0
    driver.now += 2.0
    driver.frame()
    assert autosave.left_behind().scene.display.key == 0.4
    driver.session.undo()
    driver.session.undo()
    driver.frame()
    assert autosave.left_behind() is None


def test_edits_of_a_process_that_runs_are_not_offered(driver_with_autosave, tmp_path):
    _, autosave = driver_with_autosave
    folder = tmp_path / "autosave"
    folder.mkdir(exist_ok=True)
    other = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    content = {"path": None, "scene": Scene().to_toml()}
    (folder / f"{other.pid}.json").write_text(json.dumps(content))
    (folder / "bad.json").write_text("{}")
    assert autosave.left_behind() is None
    other.communicate(b"\n")
    left = autosave.left_behind()
    assert left.scene == Scene()
    autosave.discard(left)
    assert autosave.left_behind() is None


@pytest.fixture
def driver_with_autosave(context, model, tmp_path):
    driver, autosave = Driver(small_scene(model), (320, 240)), Autosave(tmp_path / "autosave")
    driver.app.keep_in(autosave)
    yield driver, autosave
    driver.close()
