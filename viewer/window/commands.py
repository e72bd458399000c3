"""The table of the window's commands: a new key, button or menu is one entry of it.

Keys, toolbar, panel, cheat sheet, README and recordings read this table; nothing is run that is not in it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from milkglass.viewer.files.images import PHOTO_SUFFIXES, PROBE_SUFFIXES
from milkglass.viewer.files.model import supported_suffixes
from milkglass.viewer.gui import command
from milkglass.viewer.gui.command import Argument, Button, Command
from milkglass.viewer.gui.file_dialog import Request
from milkglass.viewer.gui.toolkit import icons
from milkglass.viewer.live.photograph_work import CAMERA_FIXED
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.photograph.actions import PhotoActions
from milkglass.viewer.window.view.actions import PROFILE_SUFFIXES, SCENE_SUFFIXES, Actions

NO_PHOTO = "the window shows a model, not a photograph"
NO_MODEL = "the window shows a photograph, which has no model"
NO_ERROR = "the error is that of a model, not of a photograph"
NO_EXPOSURE = "a photograph is exposed as it was taken: change the key"
STEP_DEG = 5.0  # of an arrow key
MOUSE = (
    ("Left drag", "orbit"),
    ("Shift + left drag, middle drag", "pan"),
    ("Wheel", "zoom"),
    ("Right drag", "turn the lights and the probe"),
    ("Double click", "set the point that the camera orbits"),
    ("Drop a file", "mesh: load; .hdr, .exr: light with it; .csv: scatter by it; photograph: edit; .toml: open"),
    ("Ctrl + click on a slider", "type a number"),
    ("Right click on a control", "reset it"),
)


@dataclass(frozen=True)
class Workspace:
    """What the commands work on.

    Attributes
    ----------
    session : Session
    actions : Actions
    photo : PhotoActions or None
        Those of a photograph, where the window shows one.
    dismiss_messages : callable
        Returns whether there were any.
    cancel : callable
        Gives up what is computed, and goes back to the scene before.
    """

    session: Session
    actions: Actions
    photo: PhotoActions | None
    dismiss_messages: Callable[[], bool]
    cancel: Callable[[], object]

    def open(self, path: str | Path) -> None:
        """Open a file of any kind that fits what the window shows."""
        (self.photo or self.actions).open(Path(path))


Commands = command.Commands[Workspace]


def commands_of(workspace: Workspace) -> Commands:
    """Return the commands of the table, bound to a workspace."""
    return Commands(COMMANDS, workspace, workspace.session.say)


def cheat_sheet() -> list[tuple[str, command.Rows]]:
    """Return the groups of the cheat sheet: headings, and rows of keys and what they do."""
    return command.cheat_sheet(COMMANDS, MOUSE)


def keys_markdown() -> str:
    """Return mouse and keys as the Markdown table of viewer/README.md."""
    return command.keys_markdown(COMMANDS, MOUSE)


def _shows_model(space: Workspace) -> bool:
    return space.photo is None


def _shows_photo(space: Workspace) -> bool:
    return space.photo is not None


def _view_from(side: str, keys: str, where: str, azimuth_deg: float, elevation_deg: float) -> Command[Workspace]:
    def turn(space: Workspace) -> None:
        space.actions.see_from(azimuth_deg, elevation_deg)

    return Command(f"view_{side}", f"view from {where}", turn, "View", keys, _shows_model, CAMERA_FIXED)


def _turn(id: str, keys: str, where: str, right: float, up: float) -> Command[Workspace]:
    def run(space: Workspace) -> None:
        space.actions.orbit(STEP_DEG * right, STEP_DEG * up)

    return Command(id, f"move the camera {where}", run, "View", keys, _shows_model, CAMERA_FIXED, repeats=True)


def _zoom(id: str, keys: str, where: str, notches: float) -> Command[Workspace]:
    def run(space: Workspace) -> None:
        space.actions.zoom(notches)

    return Command(id, f"move the camera {where}", run, "View", keys, _shows_model, CAMERA_FIXED, repeats=True)


def _of_photo(id: str, title: str, callback: Callable[[PhotoActions], object]) -> Command[Workspace]:
    def run(space: Workspace) -> None:
        if space.photo is not None:
            callback(space.photo)

    return Command(id, title, run, enabled=_shows_photo, reason=NO_PHOTO)


def _reset_view(space: Workspace) -> None:
    if space.photo is None:
        space.actions.reset_view()
    else:
        space.photo.show_all()


def _capture_object(space: Workspace) -> None:
    if space.photo is None:
        space.actions.capture_object()
    else:
        space.photo.capture_picture()


def _dismiss(space: Workspace) -> None:
    """Close all that is open over the view; where nothing is, cancel what is computed."""
    had_tool = space.photo is not None and space.photo.lay_down_tool()
    had_help, space.actions.help_shown = space.actions.help_shown, False
    if not any((had_tool, had_help, space.dismiss_messages())):
        space.cancel()


def _ask_for_file(space: Workspace) -> None:
    suffixes = (*supported_suffixes(), *PROBE_SUFFIXES, *PROFILE_SUFFIXES, *PHOTO_SUFFIXES, *SCENE_SUFFIXES)
    space.actions.ask(Request("Open a model, a light probe, a profile, a photograph or a scene", suffixes, space.open))


def _ask_for_model(space: Workspace) -> None:
    space.actions.ask(Request("Open a model", supported_suffixes(), space.open))


def _ask_for_probe(space: Workspace) -> None:
    space.actions.ask(Request("Light with a probe", PROBE_SUFFIXES, space.open))


def _ask_for_profile(space: Workspace) -> None:
    space.actions.ask(Request("Scatter by a profile", PROFILE_SUFFIXES, space.open))


def _recent(space: Workspace) -> dict[str, str]:
    return {path: Path(path).name for path in space.actions.recent}


COMMANDS: tuple[Command[Workspace], ...] = (
    _view_from("front", "1", "the front", 0.0, 0.0),
    _view_from("back", "Ctrl+1", "the back", 180.0, 0.0),
    _view_from("right", "3", "the right", 90.0, 0.0),
    _view_from("left", "Ctrl+3", "the left", -90.0, 0.0),
    _view_from("top", "7", "above", 0.0, 90.0),
    _view_from("bottom", "Ctrl+7", "below", 0.0, -90.0),
    Command(
        "toggle_orthographic", "perspective or orthographic", lambda space: space.actions.toggle_orthographic(),
        "View", "5", _shows_model, CAMERA_FIXED,
    ),
    Command(
        "toggle_ground", "a ground to stand on, or none", lambda space: space.actions.toggle_ground(),
        "View", "G", _shows_model, NO_MODEL,
    ),
    Command(
        "frame_object", "frame the object", lambda space: space.actions.frame_object(),
        "View", "F", _shows_model, CAMERA_FIXED,
    ),
    Command("reset_view", "reset the view", _reset_view, "View", "Enter"),
    *(_turn(*turn) for turn in (
        ("orbit_left", "Left", "to the left", -1.0, 0.0), ("orbit_right", "Right", "to the right", 1.0, 0.0),
        ("orbit_up", "Up", "up", 0.0, 1.0), ("orbit_down", "Down", "down", 0.0, -1.0),
    )),
    _zoom("zoom_in", "Ctrl+Up", "closer", 1.0),
    _zoom("zoom_out", "Ctrl+Down", "away", -1.0),
    Command(
        "copy_view", "copy the view as text", lambda space: space.actions.copy_view(),
        "View", "Ctrl+C", _shows_model, CAMERA_FIXED,
    ),
    Command(
        "paste_view", "paste a view", lambda space: space.actions.paste_view(),
        "View", "Ctrl+V", _shows_model, CAMERA_FIXED,
    ),
    Command(
        "open_file", "open a model, probe or scene", _ask_for_file, "Files", "Ctrl+O",
        button=Button(icons.ICON_FA_FOLDER_OPEN),
    ),
    Command(
        "open", "recent files", argument=Argument("a path", lambda space, path: space.open(path), _recent),
        button=Button(icons.ICON_FA_CLOCK_ROTATE_LEFT),
    ),
    Command(
        "save", "save the scene", lambda space: space.actions.save(), "Files", "Ctrl+S",
        button=Button(icons.ICON_FA_FLOPPY_DISK),
    ),
    Command(
        "save_as", "save the scene under a new name", lambda space: space.actions.save_as(), "Files", "Ctrl+Shift+S"
    ),
    Command(
        "screenshot", "picture of the window", lambda space: space.actions.capture_window(), "Files", "F12",
        button=Button(
            icons.ICON_FA_CAMERA, "Picture of the window ({screenshot}); the object alone: {screenshot_object}"
        ),
    ),
    Command("screenshot_object", "picture of the object alone, transparent", _capture_object, "Files", "Ctrl+F12"),
    Command("quit", "quit", lambda space: space.actions.quit(), "Files", "Ctrl+Q"),
    Command(
        "undo", "undo", lambda space: space.session.undo(), "Edit", "Ctrl+Z",
        lambda space: space.session.can_undo, button=Button(icons.ICON_FA_ROTATE_LEFT),
    ),
    Command(
        "redo", "redo", lambda space: space.session.redo(), "Edit", "Ctrl+Shift+Z",
        lambda space: space.session.can_redo, button=Button(icons.ICON_FA_ROTATE_RIGHT),
    ),
    Command("keep", "keep this state as B", lambda space: space.session.keep(), "Edit", "K"),
    Command(
        "flip", "flip between A and B", lambda space: space.session.flip(), "Edit", "B",
        button=Button(icons.ICON_FA_RIGHT_LEFT, "Keep this state, then flip between the two ({keep}, {flip})"),
    ),
    Command(
        "toggle_split", "split the view between A and B", lambda space: space.session.toggle_split(), "Edit", "V",
        button=Button(
            icons.ICON_FA_TABLE_COLUMNS, "Split the view: this state and the kept one ({toggle_split})",
            lambda space: space.session.view.split is not None,
        ),
    ),
    Command(
        "toggle_exposure_lock", "lock the exposure", lambda space: space.actions.toggle_exposure_lock(),
        "Edit", "L", _shows_model, NO_EXPOSURE,
    ),
    Command(
        "toggle_measure", "measure the error of what is on screen", lambda space: space.actions.toggle_measure(),
        "Edit", "E", _shows_model, NO_ERROR,
    ),
    Command(
        "toggle_help", "this cheat sheet", lambda space: space.actions.toggle_help(), "Window", "H",
        button=Button(icons.ICON_FA_CIRCLE_QUESTION, "Mouse and keys ({toggle_help})", is_last=True),
    ),
    Command(
        "enter_panel", "into the panel: arrows, Space, Escape", lambda space: space.actions.enter_panel(),
        "Window", "F6",
    ),
    Command("toggle_panel", "show or hide the panel", lambda space: space.actions.toggle_panel(), "Window", "Tab"),
    Command(
        "toggle_profiles", "show or hide the curves of the profile", lambda space: space.actions.toggle_profiles(),
        "Window", "P",
        button=Button(
            icons.ICON_FA_CHART_LINE, "Curves of the profile, below the picture ({toggle_profiles})",
            lambda space: space.session.view.profiles,
        ),
    ),
    Command(
        "dismiss", "close what is open, dismiss messages; else cancel what is computed", _dismiss, "Window", "Escape"
    ),
    # what controls of the panel ask for
    Command("open_model", "open a model", _ask_for_model),
    Command("open_probe", "light with a probe", _ask_for_probe),
    Command("open_profile", "scatter by a profile", _ask_for_profile),
    Command(
        "open_texture", "open a texture", lambda space: space.actions.ask_for_map("texture"),
        enabled=_shows_model, reason=NO_MODEL,
    ),
    Command(
        "open_normal_map", "open a normal map", lambda space: space.actions.ask_for_map("normal_map"),
        enabled=_shows_model, reason=NO_MODEL,
    ),
    Command("import_materials", "add materials of a file", lambda space: space.actions.import_materials()),
    Command("export_materials", "write the materials kept", lambda space: space.actions.export_materials()),
    Command("reread_files", "read files that have changed again", lambda space: space.actions.reread_files()),
    Command(
        "export_profile", "write the profile's curves", lambda space: space.actions.ask_where_to_export_profile()
    ),
    _of_photo("open_depth", "open a depth map", PhotoActions.ask_for_depth),
    _of_photo("save_picture", "save the photograph", PhotoActions.ask_where_to_save_picture),
    _of_photo("save_mask", "save the mask", PhotoActions.ask_where_to_save_mask),
)  # fmt: skip
