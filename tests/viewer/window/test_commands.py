"""The table of commands, and all that reads it: keys, toolbar, cheat sheet, README, recordings."""

from pathlib import Path

import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.gui.command import Argument, Button, Command, chords
from milkglass.viewer.gui.events import Closed, Invoked, Recorder, Resized
from milkglass.viewer.gui.toolkit import icons
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.window import commands
from milkglass.viewer.window.commands import COMMANDS, NO_ERROR, NO_PHOTO, cheat_sheet, keys_markdown
from milkglass.viewer.window.replay import play
from milkglass.viewer.window.view.overlays import draw_help
from tests.support.driving import Driver, driven, small_scene, write_knot
from tests.support.paths import ROOT
from tests.support.photographing import small_photo

SIZE = (640, 360)
# Recordings and scripts hold these.
IDS = {
    "view_front", "view_back", "view_right", "view_left", "view_top", "view_bottom", "toggle_orthographic",
    "reset_view", "copy_view", "paste_view", "open_file", "save", "save_as", "screenshot", "screenshot_object", "quit",
    "undo", "redo", "keep", "flip", "toggle_split", "toggle_exposure_lock", "toggle_measure", "toggle_help",
    "toggle_panel", "toggle_profiles", "dismiss", "open", "open_model", "open_probe", "open_profile", "open_texture",
    "open_normal_map", "import_materials", "export_materials", "reread_files", "export_profile", "open_depth",
    "save_picture", "save_mask",
}  # fmt: skip


@pytest.fixture
def driver(context, model, tmp_path):
    with driven(model, SIZE, tmp_path) as driver:
        yield driver


def test_ids_stay_and_neither_ids_nor_keys_are_taken_twice():
    assert {command.id for command in COMMANDS} >= IDS
    assert len({command.id for command in COMMANDS}) == len(COMMANDS)
    pressed = [chord for command in COMMANDS if command.keys for chord in chords(command.keys)]
    assert len(set(pressed)) == len(pressed)


def test_a_page_holds_the_table_of_keys():
    assert keys_markdown() in (ROOT / "viewer" / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.id)
def test_every_command_runs_on_a_model_or_says_why_not(driver, tmp_path, command):
    scene = driver.session.scene
    argument = str(write_knot(tmp_path / "other.ply")) if command.argument is not None else ""
    driver.app.commands.run(command.id, argument)
    driver.frames(2)
    asked = driver.app.actions.dialog.is_open
    driver.app.actions.dialog.close()
    driver.frames(1)
    if command.id in ("open_depth", "save_picture", "save_mask"):
        assert driver.app.messages == [NO_PHOTO]
    elif command.id.startswith(("open_", "import_", "export_", "save")):
        assert asked
    else:
        assert not asked
    assert driver.app.actions.closing == (command.id == "quit")
    assert (driver.session.scene.model != scene.model) == (command.id == "open")


@pytest.mark.slow
def test_what_means_nothing_to_a_photograph_is_said(context, few_rays, tmp_path):
    driver = Driver(small_scene(tmp_path), SIZE, photo=PhotoWork(small_photo(tmp_path)))
    driver.app.commands.run("toggle_measure")
    driver.frames(2)
    assert driver.app.messages[-1] == NO_ERROR
    assert not driver.session.view.measure
    driver.app.commands.run("open_depth")
    assert driver.app.actions.dialog.is_open
    driver.close()


def test_a_command_is_one_entry_of_the_table(context, model, monkeypatch):
    ran: list[str] = []
    greet = Command(
        "greet", "greet the model", lambda space: ran.append(space.session.model_name), "Window", "G",
        lambda space: not ran, "it was greeted before", button=Button(icons.ICON_FA_HAND),
    )  # fmt: skip
    name = Command(
        "name", "call it", argument=Argument("a name", lambda _, name: ran.append(name), lambda _: {"a": "A"})
    )
    monkeypatch.setattr(commands, "COMMANDS", (*COMMANDS, greet, name))
    drawn: list[object] = []
    monkeypatch.setattr("milkglass.viewer.window.app.draw_help", lambda *a: (drawn.append(a[1]), draw_help(*a)))
    driver = Driver(small_scene(model), SIZE)
    try:
        driver.key("g")
        assert ran == ["knot.ply"]
        driver.key("g")  # not enabled any more
        assert (ran, driver.app.messages) == (["knot.ply"], ["it was greeted before"])
        ran.clear()
        driver.click("greet")
        assert ran == ["knot.ply"]
        driver.send(Invoked("name", "a"))
        assert ran == ["knot.ply", "a"]
        driver.key("h")
        assert ("G", "greet the model") in dict(drawn[-1])["Window"]
        assert "| G | greet the model |" in keys_markdown()
        assert driver.app.commands.tip(greet, greet.button) == "Greet the model (G)"
        assert dict(cheat_sheet())["Window"][-1] == ("G", "greet the model")
    finally:
        driver.close()


@pytest.mark.parametrize(
    ("id", "argument", "said"),
    [
        ("dance", "", 'there is no command "dance"'),
        ("_undo", "", 'there is no command "_undo"'),
        ("look", "", 'there is no command "look"'),  # a method of the session is none
        ("open", "", 'the command "open" needs a path'),
        ("undo", "twice", 'the command "undo" takes no argument, but was given "twice"'),
    ],
)
def test_a_recording_runs_commands_by_their_ids_and_refuses_others_before_it_starts(tmp_path, id, argument, said):
    path = recording(tmp_path, Invoked("view_top"), Invoked(id, argument))
    with pytest.raises(InputError) as refused:
        play(path, in_window=False)
    assert str(refused.value) == f"{path}: {said}"


def test_a_recording_opens_a_path_and_looks_from_a_side(context, tmp_path):
    other = write_knot(tmp_path / "other.ply")
    end = play(recording(tmp_path, Invoked("view_top"), Invoked("open", str(other))), in_window=False)
    assert (end.camera.elevation_deg, end.model.path) == (90.0, other)


def recording(folder: Path, *events: Invoked) -> Path:
    recorder = Recorder(folder / "played.jsonl", small_scene(write_knot(folder / "knot.ply")).to_toml())
    for event in (Resized(SIZE, SIZE), *events, Closed()):
        recorder.add(event)
    recorder.close()
    return folder / "played.jsonl"
