"""What the commands of the window do to a session, its view and its files; `viewer.window.commands` has their table."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.core.profiles.registry import TABLE
from milkglass.viewer.files.images import PHOTO_SUFFIXES, PICTURE_SUFFIXES, PROBE_SUFFIXES, write_png
from milkglass.viewer.files.model import supported_suffixes
from milkglass.viewer.files.record import Record
from milkglass.viewer.gui.file_dialog import FileDialog, Request
from milkglass.viewer.gui.question import Answer, Question, Questions
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.scene.own_materials import Materials, export_to, import_from
from milkglass.viewer.scene.profile_export import write_profile
from milkglass.viewer.scene.scene import Change, Scene
from milkglass.viewer.scene.settings import CameraSettings
from milkglass.viewer.scene.tables import read_profile_table
from milkglass.viewer.session import navigation
from milkglass.viewer.session.autosave import Autosave, LeftBehind
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session, files_of, real
from milkglass.viewer.window.view.area import SAMPLES, ViewArea

SCENE_SUFFIXES = (".toml",)
PROFILE_SUFFIXES = (".csv",)


class Clipboard(Protocol):
    """Keeps a text for pasting."""

    def get(self) -> str:
        """Return the text, empty if there is none."""

    def set(self, text: str) -> None:
        """Take a text."""


class MemoryClipboard:
    """The clipboard of contents without a window."""

    def __init__(self) -> None:
        self.text = ""

    def get(self) -> str:
        """Return the text, empty if there is none."""
        return self.text

    def set(self, text: str) -> None:
        """Replace the text."""
        self.text = text


@dataclass(frozen=True)
class Work:
    """Work of the person at the window that closing it would lose.

    Attributes
    ----------
    noun : callable
        Returns what has changed, the beginning of a sentence.
    unsaved : callable
        Whether it has changed since it was saved.
    save : callable
        Saves it, asking for a name where it has none, and then runs what it is given.
    """

    noun: Callable[[], str]
    unsaved: Callable[[], bool]
    save: Callable[[Callable[[], object]], object]


class Actions:
    """Opens, saves, exports and toggles for a window.

    Attributes
    ----------
    dialog : FileDialog
    questions : Questions
    work : list of Work
        What is asked about before it is lost, the scene first.
    show_photograph : callable
        Shows a photograph in place of what there is; raises InputError where it cannot be read.
    adapt : callable
        Returns what is shown of the scene of a file.
    clipboard : Clipboard
    closing : bool
        Whether the window should close.
    capture : Path or None
        Where the next frame is to be written, as it is seen.
    help_shown, panel_shown : bool
        Whether the cheat sheet and the panel show.
    panel_entered : bool
        Whether the keyboard moves in the panel, until Escape or a click on the view.
    """

    def __init__(self, session: Session, view: ViewArea, preferences: Preferences, clipboard: Clipboard) -> None:
        self.dialog, self.questions = FileDialog(), Questions()
        self.show_photograph: Callable[[Path], object] = lambda _: None
        self.adapt: Callable[[Scene], Scene] = lambda scene: scene
        self.clipboard = clipboard
        self.closing = False
        self.capture: Path | None = None
        self.help_shown = False
        self.panel_shown = True
        self.panel_entered = False
        self._session, self._view, self._preferences = session, view, preferences
        self.work = [Work(lambda: session.file_name, lambda: session.unsaved, self._save_then)]

    @property
    def recent(self) -> list[str]:
        """Paths of the files opened last that can be used, the newest first."""
        unusable = self._session.unusable
        return [path for path in self._preferences.recent if Path(path) not in unusable and os.path.isfile(path)]

    def ask(self, request: Request) -> None:
        """Open the file dialog in the last folder; before another's file is replaced, there is a question."""
        checked = request if not request.save_as else replace(request, done=lambda path: self._check(request, path))
        self.dialog.open(checked, request.folder or self._preferences.start_folder())

    def _check(self, request: Request, path: Path) -> None:
        """Write what was asked for, after a question where that would replace a file of somebody else."""
        if not os.path.exists(path) or real(path) in self._session.files:
            request.done(path)
            return
        answers = Answer("Replace", lambda: request.done(path)), Answer("Keep it", lambda: self.ask(request))
        self.questions.ask(Question(f"{path.name} exists already. Replace it?", answers))

    def _ask_about(self, work: list[Work], then: Callable[[], object]) -> None:
        """Do something that loses work, after a question for what is unsaved: save it, discard it, or cancel."""
        while work and not work[0].unsaved():
            work = work[1:]
        if not work:
            then()
            return
        first, rest = work[0], work[1:]
        answers = (
            Answer("Save", lambda: first.save(lambda: self._ask_about(rest, then))),
            Answer("Discard", lambda: self._ask_about(rest, then)),
            Answer("Cancel"),
        )
        self.questions.ask(Question(f"{first.noun()} has changes that are not saved.", answers))

    def open(self, path: Path) -> None:
        """Open a model, a light probe, a profile, a photograph or a scene; a bad one leaves everything as it was."""
        suffix = path.suffix.lower()
        if not os.path.isfile(path):  # where a folder may not be entered too
            self._session.fail(f"{path} is not a file that can be read; it may have been moved or deleted")
            return
        self._session.gesture = None
        self._session.unusable.discard(path)
        if suffix in SCENE_SUFFIXES:
            self._ask_about(self.work[:1], lambda: self._open_scene(path))
            return
        if suffix in PHOTO_SUFFIXES:
            self._ask_about(self.work, lambda: self._open_photograph(path))
            return
        if suffix in PROBE_SUFFIXES:
            opened = self._light_by(path)
        elif suffix in PROFILE_SUFFIXES:
            opened = self._scatter_by(path)
        elif suffix in supported_suffixes():
            values = {"path": str(path), "texture": None, "normal_map": None}
            changes = [Change("model", key, value, f"model.{key}") for key, value in values.items()]
            opened = self._session.change([Change("materials", "", (), "materials"), *changes])
        else:
            known = "a mesh, a light probe (.hdr, .exr), a profile (.csv), a photograph or a scene (.toml)"
            self._session.fail(f"{path.name} is none of {known} that can be opened here")
            return
        if opened:
            self._preferences.opened(path)

    def _open_scene(self, path: Path) -> None:
        if self._session.open(path, self.adapt):
            self._preferences.opened(path)

    def _open_photograph(self, path: Path) -> None:
        try:
            self.show_photograph(path)
        except InputError as error:
            self._session.fail(error)
        else:
            self._preferences.opened(path)

    def write_capture(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Write the window's picture that `capture` asked for."""
        path, self.capture = self.capture, None
        assert path is not None
        self._write(path, pixels, self._view.scene if self._view.subject.moves_camera else None)

    # view

    def see_from(self, azimuth_deg: float, elevation_deg: float) -> None:
        """Turn the camera to a side."""
        self._session.look(navigation.seen_from(self._session.scene.camera, azimuth_deg, elevation_deg))

    def orbit(self, right_deg: float, up_deg: float) -> None:
        """Move the camera around the object, degrees to the right and up."""
        camera = self._session.scene.camera
        elevation = min(90.0, max(-90.0, camera.elevation_deg + up_deg))
        azimuth = navigation.wrapped(camera.azimuth_deg + right_deg)
        self._session.look(replace(camera, azimuth_deg=azimuth, elevation_deg=elevation))

    def zoom(self, notches: float) -> None:
        """Move the camera closer by notches of the wheel."""
        self._session.look(navigation.zoomed(self._session.scene.camera, notches))

    def toggle_orthographic(self) -> None:
        """Change between perspective and orthographic projection."""
        camera = self._session.scene.camera
        self._session.look(replace(camera, orthographic=not camera.orthographic))

    def toggle_ground(self) -> None:
        """Put the object on a plane, or take the plane away."""
        self._session.edit("ground", on=not self._session.scene.ground.on)

    def frame_object(self) -> None:
        """Have the object fill the view, seen from where it is seen now."""
        self._session.look(replace(self._session.scene.camera, zoom=None, target_mm=None))

    def reset_view(self) -> None:
        """Put the camera back to where it stands at first."""
        self._session.look(CameraSettings())

    def copy_view(self) -> None:
        """Put the camera into the clipboard, as the table of a scene file."""
        self.clipboard.set(self._session.view_text())
        self._session.say("copied the view as text")

    def paste_view(self) -> None:
        """Take the camera from the clipboard."""
        self._session.paste_view(self.clipboard.get())

    def toggle_exposure_lock(self) -> None:
        """Hold the exposure at what it is now, or let it follow the picture again."""
        picture, locked = self._view.picture, self._session.scene.display.average is not None
        if locked or (picture is not None and picture.log_average > 0.0):
            self._session.edit("display", average=None if locked or picture is None else picture.log_average)

    def toggle_measure(self) -> None:
        """Start or stop measuring the error of what is on screen."""
        view = self._session.view
        view.measure = not view.measure

    def toggle_profiles(self) -> None:
        """Show or hide the curves of the profile."""
        self._session.view.profiles = not self._session.view.profiles

    # files

    def ask_for_map(self, key: str) -> None:
        """Ask for a picture that lies on the model, its `texture` or its `normal_map`."""
        done = lambda path: self._session.edit("model", **{key: str(path)})  # noqa: E731
        self.ask(Request(f"Open a {key.replace('_', ' ')}", PICTURE_SUFFIXES, done))

    def import_materials(self) -> None:
        """Ask for a file whose materials the user's library takes in."""
        self.ask(Request("Add a file's materials to your own", SCENE_SUFFIXES, self._exchange(import_from)))

    def export_materials(self) -> None:
        """Ask where to write the materials of the user's library."""
        request = Request("Write your own materials", SCENE_SUFFIXES, self._exchange(export_to), "materials.toml")
        self.ask(request)

    def _exchange(self, exchange: Callable[[Path], Materials]) -> Callable[[Path], None]:
        def done(path: Path) -> None:
            try:
                self._session.say(f"{path.name}: {', '.join(material.name for material in exchange(path))}")
            except InputError as error:
                self._session.fail(error)

        return done

    def save(self) -> None:
        """Write the scene to its file; ask for one where it has none."""
        self._save_then(lambda: None)

    def save_as(self) -> None:
        """Ask where to write the scene."""
        self._ask_where_to_save(lambda: None)

    def _save_then(self, then: Callable[[], object]) -> None:
        """Write the scene to its file, or where the person says, and do something after it is written."""
        if self._session.path is None:
            self._ask_where_to_save(then)
        elif self.save_to(self._session.path):
            then()

    def _ask_where_to_save(self, then: Callable[[], object]) -> None:
        path = self._session.path
        suggested = f"{Path(self._session.model_name).stem}.toml" if path is None else path.name
        done = lambda path: self.save_to(path) and then()  # noqa: E731
        beside = path or self._session.scene.model.path
        folder = None if beside is None else beside.parent
        self.ask(Request("Save the scene", SCENE_SUFFIXES, done, suggested, folder))

    def save_to(self, path: Path) -> bool:
        """Write the scene to a file that `milkglass render` makes the picture on screen from; False if that fails."""
        if not self._session.save(path, self._view.size):
            return False
        self._preferences.opened(path)
        return True

    def _light_by(self, path: Path) -> bool:
        changes = [Change("environment", "path", str(path), "environment.path")]
        if self._session.scene.display.background == "black":
            changes.append(Change("display", "background", "environment", "display.background"))
        return self._session.change(changes)

    def _scatter_by(self, path: Path) -> bool:
        try:
            read_profile_table(path)
        except InputError as error:
            self._session.fail(error)
            return False
        return self._session.edit("material", profile=TABLE, profile_table=str(path))

    def reread_files(self) -> None:
        """Take files that other programs have changed, and offer a scene's; one that has gone stays as it was read."""
        kept = self._session.kept
        for path in files_of(self._session.scene) | (set() if kept is None else files_of(kept)):
            try:
                if self._view.live.assets.reread(path):
                    self._session.say(f"{path.name} has changed and was read again")
            except InputError as error:
                self._session.fail(f"{error}; what was read before stays")
        scene_file = self._session.path
        if scene_file is not None and self._session.changed_on_disk():
            answers = Answer("Open it", lambda: self._open_scene(scene_file)), Answer("Keep what is here")
            self.questions.ask(Question(f"Another program has changed {scene_file.name}.", answers))

    def ask_where_to_export_profile(self) -> None:
        """Ask where to write the curves of the scene's profile."""
        material = self._session.scene.material
        suggested = f"{material.name or 'custom'}-{material.profile}.csv".replace(" ", "-").lower()
        self.ask(Request("Export the profile's curves", PROFILE_SUFFIXES, self.export_profile, suggested))

    def export_profile(self, path: Path) -> None:
        """Write the curves of the scene's profile as CSV."""
        try:
            note = write_profile(path, self._session.scene.material, self._view.live.assets.profile_table)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.say(f"wrote {path}{note}")

    def capture_window(self) -> None:
        """Have the next frame of the window written as a picture."""
        self.capture = self.free_name()

    def capture_object(self) -> None:
        """Write a picture of the object alone, on transparent ground."""
        try:
            found = self._view.transparent()
        except InputError as error:
            self._session.fail(error)
            return
        if found is not None:
            scene, picture = found
            self._write(self.free_name(), read_image(picture), scene)

    def _write(self, path: Path, pixels: npt.NDArray[np.uint8], scene: Scene | None) -> None:
        """Write a picture that says which scene it shows, where that is known."""
        try:
            write_png(path, pixels, texts={} if scene is None else Record.of(scene, SAMPLES, 0).texts())
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.say(f"wrote {path}")

    def free_name(self) -> Path:
        """Return the first path of a picture that is not taken, in the last folder."""
        folder = self._preferences.start_folder()
        taken = {path.name for path in folder.glob("milkglass-*.png")}
        number = next(i for i in range(1, len(taken) + 2) if f"milkglass-{i:03d}.png" not in taken)
        return folder / f"milkglass-{number:03d}.png"

    # window

    def toggle_help(self) -> None:
        """Show or hide the cheat sheet."""
        self.help_shown = not self.help_shown

    def enter_panel(self) -> None:
        """Have the keyboard move in the panel."""
        self.panel_shown = self.panel_entered = True

    def toggle_panel(self) -> None:
        """Show or hide the panel."""
        self.panel_shown = not self.panel_shown

    def offer(self, left: LeftBehind, autosave: Autosave) -> None:
        """Ask whether to go on with what a process that ended by itself had not saved."""
        name = (left.path or left.scene.model.path or Path(str(left.scene.model.builtin_name))).name
        when = time.strftime("%d %B, %H:%M", time.localtime(left.seconds)).lstrip("0")
        answers = (
            Answer("Restore", lambda: self._restore(left, autosave)),
            Answer("Discard", lambda: autosave.discard(left)),
            Answer("Later"),
        )
        text = f"Milkglass ended before changes to {name} were saved ({when}). Restore them?"
        self.questions.ask(Question(text, answers))

    def _restore(self, left: LeftBehind, autosave: Autosave) -> None:
        if autosave.take(left):
            self._session.restore(left.scene, left.path)

    def quit(self) -> None:
        """Have the window closed, after questions about work that is not saved."""
        self._ask_about(self.work, self.close)

    def close(self) -> None:
        """Have the window closed."""
        self.closing = True
