"""What keys, buttons and dropped files do with a photograph in the window."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.files.images import PixelsInt, write_png
from milkglass.viewer.files.model import supported_suffixes
from milkglass.viewer.gui.file_dialog import Request
from milkglass.viewer.live.photograph_work import FIXED, PhotoWork
from milkglass.viewer.photograph.geometry import DEPTH_SUFFIXES, read_depth
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.photograph.view import PhotoView
from milkglass.viewer.window.view.actions import SCENE_SUFFIXES, SIDES, Actions, Clipboard

OF_CAMERA = (*SIDES, "toggle_orthographic", "copy_view", "paste_view")
# Answer -> what asks for it: none of these means anything to a photograph.
REFUSED = {
    FIXED: OF_CAMERA,
    "the error is that of a model, not of a photograph": ("toggle_measure",),
    "a photograph is exposed as it was taken: change the key": ("toggle_exposure_lock",),
}
PNG = (".png",)


class PhotoActions(Actions):
    """Runs actions by name, for the person who edits a photograph."""

    def __init__(
        self, session: Session, view: PhotoView, preferences: Preferences, clipboard: Clipboard, work: PhotoWork
    ) -> None:
        super().__init__(session, view, preferences, clipboard)
        self._photo_view, self._work = view, work

    def run(self, name: str) -> None:
        """Do what a name says; the last stroke is what is undone while the mask is painted."""
        reason = next((reason for reason, names in REFUSED.items() if name in names), None)
        if reason is not None:
            self._session.say(reason)
        elif name == "reset_view":
            self._photo_view.zoom.reset()
        elif name == "undo" and self._work.tool is not None and self._work.mask.can_undo:
            self._work.mask.undo()
        else:
            super().run(name)

    def open(self, path: Path) -> None:
        """Open a light probe, a profile or a scene, whose model and camera mean nothing here."""
        if path.suffix.lower() in supported_suffixes():
            self._session.fail(f"{path.name} is a model, and the window shows a photograph: `milkglass view` shows it")
            return
        super().open(path)
        if path.suffix.lower() in SCENE_SUFFIXES and self._session.scene.lights is None:
            # The default pair is for models: here is light all around.
            self._session.put(replace(self._session.scene, lights=()))

    def _open_depth(self) -> None:
        self._ask(Request("Open a depth map", DEPTH_SUFFIXES, self._take_depth))

    def _take_depth(self, path: Path) -> None:
        try:
            read_depth(path, self._work.photo)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.edit("photo", depth=str(path))

    def _save_picture(self) -> None:
        suggested = f"{self._work.photo.path.stem}-edited.png"
        self._ask(Request("Save the photograph", PNG, self._save_picture_to, suggested))

    def _save_mask(self) -> None:
        self._ask(Request("Save the mask", PNG, self._save_mask_to, f"{self._work.photo.path.stem}-mask.png"))

    def _screenshot_object(self) -> None:
        self._save_picture_to(self._free_name())

    def _save_picture_to(self, path: Path) -> None:
        try:
            still = self._photo_view.still()
        except InputError as error:
            self._session.fail(error)
            return
        if still is None:
            self._session.fail("there is no object yet: paint the mask first")
        else:
            self._put(path, *still)

    def _save_mask_to(self, path: Path) -> None:
        self._put(path, np.ascontiguousarray(self._work.mask.pixels[..., None]), None)

    def _put(self, path: Path, pixels: PixelsInt, profile: bytes | None) -> None:
        try:
            if path.resolve() == self._work.photo.path.resolve():
                raise InputError(f"{path.name} is the photograph itself: choose another name")
            write_png(path, pixels, profile)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.say(f"wrote {path}")

    def _dismiss(self) -> None:
        self._work.tool = None
        super()._dismiss()
