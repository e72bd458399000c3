"""The real window, on a real X display, with a real mouse and keyboard: xdotool's."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.viewer.error.map import colours, scale_end
from milkglass.viewer.files.images import read_image
from milkglass.viewer.gui.events import Closed, Drawn, Dropped, Key, Recorder, Resized
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.commands import COMMANDS
from milkglass.viewer.window.replay import play
from tests.support.display import missing
from tests.support.driving import Driver, headless_picture, small_scene, write_knot
from tests.support.paths import ROOT
from tests.support.waiting import DEADLINE, wait_until

pytestmark = pytest.mark.window

SIZE = (640, 560)
FRAMES = 2  # that show what an event did: ImGui lays out in the first what the second draws
STATUS = 40  # rows at the foot of the view that hold its line of text
NAMES = {"Ctrl": "ctrl", "Shift": "shift", "Enter": "Return"}  # xdotool's
VIEW = ("-m", "milkglass.viewer.commands.cli", "view")


@pytest.fixture(autouse=True)
def needs_xdotool() -> None:
    if shutil.which("xdotool") is None:
        missing("xdotool")


def environment_of(display: str, folder: Path) -> dict[str, str]:
    """For a process with a window that remembers things in a folder of its own."""
    return os.environ | {
        "DISPLAY": display, "XDG_CONFIG_HOME": str(folder / "config"), "PYTHONPATH": f"{ROOT / '.package'}:{ROOT}",
    }  # fmt: skip


class RealWindow:
    """`milkglass view` in a process of its own, and a person's hands.

    The window records what it sees: each thing that the hands do waits until it was seen, and drawn.
    """

    def __init__(self, display: str, folder: Path, *options: str, program: tuple[str, ...] = VIEW) -> None:
        self.folder, self.recording = folder, folder / "record.jsonl"
        self._events: list[dict[str, dict[str, object]]] = []
        self._read = 0  # bytes of the recording
        self.environment = environment_of(display, folder)
        command = [sys.executable, *program, *options]
        if "--play" not in options:
            command += ["--record", str(self.recording)]
        self.process = subprocess.Popen(command, cwd=folder, env=self.environment, stderr=subprocess.PIPE, text=True)

    def hands(self, *words: object) -> str:
        done = subprocess.run(["xdotool", *map(str, words)], env=self.environment, capture_output=True, text=True)
        return done.stdout.strip()

    def until(self, found: Callable[[], object]):
        def alive() -> object:
            result = found()
            assert result or self.process.poll() is None, self.process.stderr.read() if self.process.stderr else ""
            return result

        return wait_until(alive, lambda: time.sleep(0.02))

    def opened(self) -> str:
        """Wait for the window and put it into the corner; returns its number."""
        named = ("search", "--onlyvisible", "--pid", self.process.pid, "--name", "milkglass")
        number = str(self.until(lambda: self.hands(*named))).splitlines()[0]
        self.hands("windowmove", "--sync", number, 0, 0)
        self.hands("windowfocus", "--sync", number)
        self.until(lambda: {"Focused": {"focused": True}} in self.events())
        return number

    def events(self) -> list[dict[str, dict[str, object]]]:
        """What the window has seen and drawn so far, by line of the recording."""
        if self.recording.exists():
            with self.recording.open("rb") as file:
                file.seek(self._read)
                whole = file.read().rpartition(b"\n")[0].splitlines(keepends=True)
            self._events += map(json.loads, whole[self._read == 0 :])  # the first line is no event
            self._read += sum(map(len, whole)) + bool(whole)
        return self._events

    def act(self, *words: object, seen: Callable[[list[dict[str, dict[str, object]]]], bool]) -> None:
        """Do something, and wait until the window has seen it and drawn what comes of it.

        `seen` says whether events that came since then tell of it.
        """
        before = len(self.events())
        self.hands(*words)

        def drawn() -> bool:
            new = self.events()[before:]
            numbers = (i for i in range(len(new) + 1) if seen(new[:i]))
            first = next(numbers, None)
            return first is not None and sum("Drawn" in event for event in new[first:]) >= FRAMES

        self.until(drawn)

    def press(self, *keys: str) -> None:
        """Press keys one after another, such as "ctrl+s"."""
        for key in keys:
            count = key.count("+") + 1
            self.act("key", key, seen=lambda new, n=count: sum(_is_release(event) for event in new) >= n)

    def write(self, text: str) -> None:
        """Type text."""
        self.act("type", text, seen=lambda new: sum("Typed" in event for event in new) >= len(text))

    def point(self, place: tuple[float, float]) -> None:
        """Move the pointer to a place in the window."""
        x, y = map(int, place)
        self.act("mousemove", x, y, seen=lambda _: self._pointer() == (x, y))

    def button(self, pressed: bool) -> None:
        """Press the left button or let it go."""
        event = {"MouseButton": {"button": "left", "pressed": pressed}}
        self.act("mousedown" if pressed else "mouseup", 1, seen=lambda new: event in new)

    def drag(self, start: tuple[float, float], by: tuple[int, int]) -> None:
        self.point(start)
        self.button(True)
        for i in range(1, 6):
            self.point((int(start[0]) + by[0] // 5 * i, int(start[1]) + by[1] // 5 * i))
        self.button(False)

    def click(self, place: tuple[float, float]) -> None:
        self.point(place)
        self.button(True)
        self.button(False)

    def _pointer(self) -> tuple[float, float] | None:
        """Where the window last saw the pointer."""
        moved = [event["MouseMoved"] for event in self.events() if "MouseMoved" in event]
        return (moved[-1]["x"], moved[-1]["y"]) if moved else None

    def screenshot(self, number: int) -> np.ndarray:
        path = self.folder / f"milkglass-{number:03d}.png"
        self.press("F12")
        self.until(path.is_file)
        return np.asarray(read_image(path))

    def wakes(self) -> int:
        """How often threads of the process went to sleep so far, or had to wait: not at all while it is idle."""
        status = [file.read_text() for file in Path(f"/proc/{self.process.pid}/task").glob("*/status")]
        return sum(int(n) for text in status for n in re.findall(r"voluntary_ctxt_switches:\s+(\d+)", text))

    def rest(self) -> None:
        """Wait until the window has drawn what it will not draw again."""

        def resting() -> bool:
            events = self.events()
            return bool(events) and events[-1].get("Drawn", {}).get("final", False) is True

        self.until(resting)

    def sleep(self) -> None:
        """Wait until no thread of the process wakes for a while: a window that nobody touches costs nothing."""

        def sleeping() -> bool:
            before = self.wakes()
            time.sleep(2.0)
            return self.wakes() == before

        self.until(sleeping)

    def stop(self) -> None:
        """End it, whatever state it is in."""
        self.process.kill()
        self.process.communicate()

    def quit(self) -> int:
        self.hands("key", "ctrl+q")
        _, errors = self.process.communicate(timeout=DEADLINE)
        assert errors == ""
        return self.process.returncode


def _is_release(event: dict[str, dict[str, object]]) -> bool:
    return "Key" in event and not event["Key"]["pressed"]


@pytest.fixture
def model(tmp_path) -> Path:
    return write_knot(tmp_path / "knot.ply")


@pytest.fixture
def scene_file(tmp_path, model) -> Path:
    small_scene(model).save(tmp_path / "scene.toml")
    return tmp_path / "scene.toml"


@pytest.fixture
def remembered(tmp_path) -> Path:
    """Preferences with a small window, so that software rendering is quick."""
    path = tmp_path / "config" / "milkglass" / "window.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({"window_size": SIZE, "folder": str(tmp_path), "recent": []}))
    return path


@pytest.mark.slow
def test_open_orbit_slide_save_screenshot_quit_replay(display, context, tmp_path, scene_file, remembered, monkeypatch):
    twin = Driver(Scene.load(scene_file), SIZE)  # knows where the panel's controls are
    slider, view = twin.place("material.sigma_a.G", 0.3), (0.5 * twin.app.boxes()[0][2], 0.5 * SIZE[1])
    twin.close()

    window = RealWindow(display, tmp_path, "--scene", str(scene_file))
    try:
        number = window.opened()
        window.rest()
        window.drag(view, (60, 20))
        window.drag(slider, (40, 0))
        window.point(view)
        window.press("ctrl+s")
        window.until(lambda: Scene.load(scene_file).material.name is None)
        window.press("Escape")  # "saved scene.toml" would lie over the picture
        window.rest()
        window.sleep()
        seen = window.screenshot(1)
        window.act("windowsize", number, SIZE[0] + 90, SIZE[1] - 70, seen=lambda new: any("Resized" in e for e in new))
        window.rest()
        assert window.screenshot(2).shape == (SIZE[1] - 70, SIZE[0] + 90, 3)
        assert window.quit() == 0
    finally:
        window.stop()

    saved, before = Scene.load(scene_file), small_scene(tmp_path / "knot.ply")
    step = 0.35 * 1000.0 / SIZE[1]
    assert saved.camera.azimuth_deg == pytest.approx(before.camera.azimuth_deg - 60 * step, abs=0.01)
    assert saved.material.sigma_a[1] > before.material.resolve().sigma_a[1]
    assert seen.shape == (SIZE[1], SIZE[0], 3)
    width, height = saved.display.image_size
    assert height == SIZE[1]
    picture = headless_picture(saved, (width, height))[: height - STATUS]
    assert np.mean(np.abs(picture.astype(int) - seen[: height - STATUS, :width]).max(axis=-1) > 1) < 1e-3
    content = json.loads(remembered.read_text())
    assert content["window_size"] == [SIZE[0] + 90, SIZE[1] - 70]
    assert content["recent"] == [str(scene_file)]

    monkeypatch.chdir(tmp_path)  # the replay's F12 writes there
    replayed = play(window.recording, in_window=False)
    assert (replayed.material, replayed.camera) == (saved.material, saved.camera)


@pytest.mark.slow
def test_recorded_drop_of_a_mesh_and_a_probe_is_replayed_in_the_window(display, tmp_path, model, remembered):
    from milkglass.viewer.files.images import write_exr

    other = write_knot(tmp_path / "other.stl")
    rng = np.random.default_rng(2)
    write_exr(tmp_path / "probe.exr", {name: rng.random((8, 16), np.float32) for name in "RGB"})
    recorder = Recorder(tmp_path / "play.jsonl", small_scene(model).to_toml())
    recorder.add(Resized(SIZE, SIZE))
    clock = 0.0
    for event in (
        Drawn(0.0), Dropped((str(other),)), Dropped((str(tmp_path / "probe.exr"),)), Dropped(("/none.ply",)),
        Key("f12", True), Key("f12", False),
    ):  # fmt: skip
        recorder.add(event)
        for _ in range(25):
            clock += 0.02
            recorder.add(Drawn(clock))
    recorder.add(Closed())
    recorder.close()
    window = RealWindow(display, tmp_path, "--play", str(tmp_path / "play.jsonl"), "--into", str(tmp_path))
    try:
        _, errors = window.process.communicate(timeout=DEADLINE)
        assert (window.process.returncode, errors) == (0, "")
    finally:
        window.stop()
    shot = read_image(tmp_path / "milkglass-001.png")
    assert np.ptp(shot[: SIZE[1] // 4, : SIZE[0] // 4].astype(int)) > 20  # the probe shows beside the object
    assert json.loads(remembered.read_text())["recent"][:2] == [str(tmp_path / "probe.exr"), str(other)]


@pytest.mark.slow
def test_drops_reopening_and_minimising_through_glfws_own_callbacks(display, context, tmp_path, scene_file, remembered):
    from milkglass.viewer.files.images import write_exr

    trimesh.creation.torus(1.0, 0.4, 24, 12).export(tmp_path / "öther.stl")
    rng = np.random.default_rng(5)
    write_exr(tmp_path / "probe.exr", {name: rng.random((8, 16), np.float32) for name in "RGB"})
    command = [sys.executable, str(ROOT / "tests" / "support" / "in_window.py"), str(tmp_path)]
    environment = environment_of(display, tmp_path)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=4 * DEADLINE)
    assert (done.returncode, done.stderr) == (0, "")

    shots = {}
    for name in ("start", "mesh", "probe", "changed", "reopened", "restored", "with pixels"):
        scene = Scene.load(tmp_path / f"{name}.toml")
        width, height = scene.display.image_size
        shots[name] = np.asarray(read_image(tmp_path / f"{name}.png"))[: height - STATUS, :width].astype(int)
        if name in ("start", "mesh", "probe", "changed"):  # the others are the same as one of these
            rendered = headless_picture(scene, (width, height))[: height - STATUS]
            assert np.mean(np.abs(rendered - shots[name]).max(axis=-1) > 1) < 1e-3, name
    for one, two in pairwise(("start", "mesh", "probe", "changed", "reopened")):
        assert np.mean(np.abs(shots[one] - shots[two]).max(axis=-1) > 5) > 0.05, (one, two)
    for same in ("reopened", "restored", "with pixels"):
        assert np.array_equal(shots[same], shots["probe"]), same
    for name, found in json.loads((tmp_path / "found.json").read_text()).items():
        assert found["drawn"] == 0, name
        assert found["turns"] <= found["events"] + 10, name  # it waits for events, and does not go round in circles


@pytest.mark.slow
def test_a_saved_scene_is_reopened_with_the_dialog(display, tmp_path, scene_file, remembered):
    window = RealWindow(display, tmp_path, "--scene", str(scene_file))
    try:
        window.opened()
        window.rest()
        start = window.screenshot(1)
        window.press("Escape", "7")  # from above
        window.rest()
        changed = window.screenshot(2)
        window.press("ctrl+o")
        window.write(scene_file.name)
        window.press("Return", "Escape")
        window.rest()
        reopened = window.screenshot(3)
        assert window.quit() == 0
    finally:
        window.stop()
    region = np.s_[: SIZE[1] - STATUS, : SIZE[0] // 3]  # of the view
    assert np.any(start[region] != changed[region])
    assert np.array_equal(start[region], reopened[region])


@pytest.mark.slow
def test_the_error_is_measured_with_a_key_and_hidden_with_the_mouse(display, context, tmp_path, scene_file, remembered):
    twin = Driver(Scene.load(scene_file), SIZE, fixed_size=False)
    twin.key("e")  # unfolds the section and scrolls to it
    twin.settle()
    places = {name: tuple(map(int, twin.place(name, 0.1))) for name in ("error.map", "error.measure")}
    measured = twin.app.error.result
    twin.close()

    window = RealWindow(display, tmp_path, "--scene", str(scene_file))
    try:
        window.opened()
        window.rest()
        window.point((20, 20))
        start = window.screenshot(1)
        window.press("Escape", "e")
        window.rest()
        window.sleep()  # what has been measured is not measured again
        dotted = window.screenshot(2)
        for name in ("error.map", "error.measure"):
            window.press("Escape")
            window.click(places[name])
            window.rest()
        hidden = window.screenshot(3)
        window.press("e")  # and closes while it measures
        assert window.quit() == 0
    finally:
        window.stop()
    region = np.s_[: SIZE[1] - STATUS, : SIZE[0] // 3]  # of the view
    assert np.array_equal(hidden[region], start[region])
    values = measured.error.at_points
    painted = colours(values / scale_end(values))
    height, width = SIZE[1], SIZE[0] - 375
    seen = measured.error.points
    places = (np.stack([seen.columns, seen.rows], axis=1) + 0.5) / measured.size * [width, height]
    found = dotted[tuple(places.astype(int).T[::-1])]
    assert np.mean(np.abs(found - painted).max(axis=1) <= 3) > 0.5  # small and close together: many lie under others


@pytest.mark.slow
def test_a_missing_model_is_one_sentence_and_no_window(display, tmp_path):
    window = RealWindow(display, tmp_path, str(tmp_path / "none.ply"))
    _, errors = window.process.communicate(timeout=DEADLINE)
    assert window.process.returncode == 2
    assert "none.ply" in errors
    assert errors.count("\n") == 1


@pytest.mark.slow
def test_every_key_of_the_cheat_sheet_runs_its_command(display, tmp_path, scene_file, remembered):
    noted = tmp_path / "noted"
    program = (str(ROOT / "tests" / "support" / "noted_window.py"), str(scene_file), str(noted))
    window = RealWindow(display, tmp_path, program=program)
    commands = [command for command in COMMANDS if command.keys and command.id not in ("dismiss", "quit")]
    expected: list[str] = []

    def ran() -> list[str]:
        return [name for name in noted.read_text().split() if name != "reread_files"]  # which the focus asks for

    try:
        window.opened()
        for command in commands:
            names = [name.lower() if len(name) == 1 else NAMES.get(name, name) for name in command.keys.split("+")]
            window.press("+".join(names))
            if command.id in ("toggle_ground", "undo", "redo"):
                window.rest()  # Escape cancels what is computed
            window.press("Escape")
            takes_escape = command.id in ("open_file", "save_as", "enter_panel")
            expected.append(command.id)  # undo and redo too: the ground's switch came before them
            expected += [] if takes_escape else ["dismiss"]
            assert ran() == expected
        window.press("l")  # the lock of the exposure is an edit of the scene, which would be asked about
        expected.append("toggle_exposure_lock")
        assert window.quit() == 0
    finally:
        window.stop()
    assert ran() == [*expected, "quit"]
