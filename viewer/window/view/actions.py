"""What keys, buttons and dropped files do, by name."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.core.profiles.names import TABLE
from milkglass.viewer.files.images import PICTURE_SUFFIXES, PROBE_SUFFIXES, write_png
from milkglass.viewer.files.model import supported_suffixes
from milkglass.viewer.gui.file_dialog import FileDialog, Request
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.scene.own_materials import Materials, export_to, import_from
from milkglass.viewer.scene.profile_export import write_profile
from milkglass.viewer.scene.scene import Change
from milkglass.viewer.scene.settings import CameraSettings
from milkglass.viewer.scene.tables import read_profile_table
from milkglass.viewer.session import navigation
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.view.area import ViewArea

SCENE_SUFFIXES = (".toml",)
PROFILE_SUFFIXES = (".csv",)
SIDES = {
    "view_front": (0.0, 0.0),
    "view_back": (180.0, 0.0),
    "view_right": (90.0, 0.0),
    "view_left": (-90.0, 0.0),
    "view_top": (0.0, 90.0),
    "view_bottom": (0.0, -90.0),
}


class Clipboard:
    """Text that is kept for pasting; the window's own where there is one."""

    text = ""

    def get(self) -> str:
        """Return the text, empty if there is none."""
        return self.text

    def set(self, text: str) -> None:
        """Take a text."""
        self.text = text


class Actions:
    """Runs actions by name: ``actions.run("undo")``.

    Attributes
    ----------
    closing : bool
        Whether the window should close.
    capture : Path or None
        Where the next frame is to be written, as it is seen.
    """

    def __init__(self, session: Session, view: ViewArea, preferences: Preferences, clipboard: Clipboard) -> None:
        self.dialog = FileDialog()
        self.closing = False
        self.capture: Path | None = None
        self.help_shown = False
        self.panel_shown = True
        self.on_dismiss: Callable[[], object] = lambda: None
        self._session, self._view = session, view
        self._preferences, self.clipboard = preferences, clipboard

    def run(self, name: str) -> None:
        """Do what a name of `viewer.gui.shortcuts` says, or "open PATH"."""
        if name in SIDES:
            self._session.look(navigation.seen_from(self._session.scene.camera, *SIDES[name]))
        elif name.startswith("open "):
            self.open(Path(name.removeprefix("open ")))
        elif hasattr(self, f"_{name}"):
            getattr(self, f"_{name}")()
        else:  # undo, redo, keep, flip, toggle_split
            getattr(self._session, name)()

    def open(self, path: Path) -> None:
        """Open a model, a light probe, a profile or a scene; a bad one leaves everything as it was."""
        suffix = path.suffix.lower()
        if not path.is_file():
            self._session.fail(f"{path} is not a file; it may have been moved or deleted")
            return
        self._session.gesture = None
        if suffix in SCENE_SUFFIXES:
            opened = self._session.open(path)
        elif suffix in PROBE_SUFFIXES:
            opened = self._light_by(path)
        elif suffix in PROFILE_SUFFIXES:
            opened = self._scatter_by(path)
        elif suffix in supported_suffixes():
            opened = self._session.edit("model", path=str(path), texture=None, normal_map=None)
        else:
            known = "a mesh, a light probe (.hdr, .exr), a profile (.csv) or a scene (.toml)"
            self._session.fail(f"{path.name} is none of {known} that can be opened here")
            return
        if opened:
            self._preferences.opened(path)

    def write_capture(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Write the window's picture that `capture` asked for."""
        path, self.capture = self.capture, None
        assert path is not None
        self._write(path, pixels)

    # view

    def _toggle_orthographic(self) -> None:
        camera = self._session.scene.camera
        self._session.look(replace(camera, orthographic=not camera.orthographic))

    def _reset_view(self) -> None:
        self._session.look(CameraSettings())

    def _copy_view(self) -> None:
        self.clipboard.set(self._session.view_text())
        self._session.say("copied the view as text")

    def _paste_view(self) -> None:
        self._session.paste_view(self.clipboard.get())

    def _toggle_exposure_lock(self) -> None:
        view, picture = self._session.view, self._view.picture
        locked = view.exposure_lock is not None or picture is None
        view.exposure_lock = None if locked or picture is None else picture.log_average

    def _toggle_measure(self) -> None:
        view = self._session.view
        view.measure = not view.measure

    # files

    def _open_file(self) -> None:
        suffixes = (*supported_suffixes(), *PROBE_SUFFIXES, *PROFILE_SUFFIXES, *SCENE_SUFFIXES)
        self._ask(Request("Open a model, a light probe, a profile or a scene", suffixes, self.open))

    def _open_model(self) -> None:
        self._ask(Request("Open a model", supported_suffixes(), self.open))

    def _open_probe(self) -> None:
        self._ask(Request("Light with a probe", PROBE_SUFFIXES, self.open))

    def _open_texture(self) -> None:
        self._ask_for("texture")

    def _open_normal_map(self) -> None:
        self._ask_for("normal_map")

    def _ask_for(self, key: str) -> None:
        """Ask for a picture on the model."""
        done = lambda path: self._session.edit("model", **{key: str(path)})  # noqa: E731
        self._ask(Request(f"Open a {key.replace('_', ' ')}", PICTURE_SUFFIXES, done))

    def _open_profile(self) -> None:
        self._ask(Request("Scatter by a profile", PROFILE_SUFFIXES, self.open))

    def _import_materials(self) -> None:
        self._ask(Request("Add a file's materials to your own", SCENE_SUFFIXES, self._exchange(import_from)))

    def _export_materials(self) -> None:
        request = Request("Write your own materials", SCENE_SUFFIXES, self._exchange(export_to), "materials.toml")
        self._ask(request)

    def _exchange(self, exchange: Callable[[Path], Materials]) -> Callable[[Path], None]:
        def done(path: Path) -> None:
            try:
                self._session.say(f"{path.name}: {', '.join(each.name for each in exchange(path))}")
            except InputError as error:
                self._session.fail(error)

        return done

    def _save(self) -> None:
        if self._session.path is None:
            self._save_as()
        else:
            self._save_to(self._session.path)

    def _save_as(self) -> None:
        suggested = "scene.toml" if self._session.path is None else self._session.path.name
        self._ask(Request("Save the scene", SCENE_SUFFIXES, self._save_to, suggested))

    def _save_to(self, path: Path) -> None:
        session = self._session
        if session.save(path, self._view.size, self._exposed_key()):
            self._preferences.opened(path)

    def _exposed_key(self) -> float:
        """Return the key that exposes by itself as the lock does now."""
        key, lock, picture = self._session.scene.display.key, self._session.view.exposure_lock, self._view.picture
        if lock is None or picture is None or lock <= 0.0 or picture.log_average <= 0.0:
            return key
        return min(100.0, max(1e-4, key * picture.log_average / lock))

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

    def _reread_profile(self) -> None:
        """Take a table that was edited meanwhile; one that has gone stays as it was read."""
        kept = self._session.kept
        scenes = (self._session.scene,) if kept is None else (self._session.scene, kept)
        for path in {scene.material.profile_table for scene in scenes}:
            try:
                if path is not None and path.is_file() and self._view.live.assets.reread_profile(path):
                    self._session.say(f"{path.name} has changed and was read again")
            except InputError as error:
                self._session.fail(f"{error}; the profile stays what it was")

    def _toggle_profiles(self) -> None:
        self._session.view.profiles = not self._session.view.profiles

    def _export_profile(self) -> None:
        material = self._session.scene.material
        suggested = f"{material.name or 'custom'}-{material.profile}.csv".replace(" ", "-").lower()
        self._ask(Request("Export the profile's curves", PROFILE_SUFFIXES, self._export_to, suggested))

    def _export_to(self, path: Path) -> None:
        try:
            note = write_profile(path, self._session.scene.material, self._view.live.assets.profile_table)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.say(f"wrote {path}{note}")

    def _screenshot(self) -> None:
        self.capture = self._free_name()

    def _screenshot_object(self) -> None:
        try:
            picture = self._view.transparent()
        except InputError as error:
            self._session.fail(error)
            return
        if picture is not None:
            self._write(self._free_name(), read_image(picture))

    def _write(self, path: Path, pixels: npt.NDArray[np.uint8]) -> None:
        try:
            write_png(path, pixels)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.say(f"wrote {path}")

    def _free_name(self) -> Path:
        """Return the first name that is not taken, in the last folder."""
        folder = self._preferences.start_folder()
        taken = {path.name for path in folder.glob("milkglass-*.png")}
        number = next(i for i in range(1, len(taken) + 2) if f"milkglass-{i:03d}.png" not in taken)
        return folder / f"milkglass-{number:03d}.png"

    def _ask(self, request: Request) -> None:
        self.dialog.open(request, self._preferences.start_folder())

    # window

    def _toggle_help(self) -> None:
        self.help_shown = not self.help_shown

    def _toggle_panel(self) -> None:
        self.panel_shown = not self.panel_shown

    def _dismiss(self) -> None:
        self.help_shown = False
        self.on_dismiss()

    def _quit(self) -> None:
        self.closing = True
