"""What the commands of the window do where it shows a photograph."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.files.depth import DEPTH_FORMATS
from milkglass.viewer.files.images import PixelsInt, write_png
from milkglass.viewer.files.model import supported_suffixes
from milkglass.viewer.gui.file_dialog import Request
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.geometry import read_depth
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.photograph.subject import PhotographSubject
from milkglass.viewer.window.view.actions import Actions, Work
from milkglass.viewer.window.view.area import ViewArea

PNG = (".png",)


class PhotoActions:
    """Opens, saves and undoes for the person who edits a photograph.

    Parameters
    ----------
    session, view, work
    subject : PhotographSubject
        What the view shows.
    actions : Actions
        Those of the window, for its dialog and its folder.
    """

    def __init__(
        self, session: Session, view: ViewArea, subject: PhotographSubject, work: PhotoWork, actions: Actions
    ) -> None:
        self._session, self._view, self._subject = session, view, subject
        self._work, self._actions = work, actions
        actions.adapt = lit_around
        mask = work.mask
        mask.noted = lambda: session.note(mask.undo, mask.redo)
        self._saved_mask = mask.state
        is_unsaved = lambda: mask.state != self._saved_mask  # noqa: E731
        actions.work.append(Work(lambda: "The mask", is_unsaved, self._ask_where_to_save_mask))

    def open(self, path: Path) -> None:
        """Open a light probe, a profile or a scene, whose model and camera mean nothing here."""
        if path.suffix.lower() in supported_suffixes():
            self._session.fail(f"{path.name} is a model, and the window shows a photograph: `milkglass view` shows it")
            return
        self._actions.open(path)

    def show_all(self) -> None:
        """Zoom out until the whole photograph shows."""
        self._subject.zoom.reset()

    def lay_down_tool(self) -> bool:
        """Stop painting the mask, and return whether it was painted."""
        tool, self._work.tool = self._work.tool, None
        return tool is not None

    def ask_for_depth(self) -> None:
        """Ask for a depth map."""
        self._actions.ask(Request("Open a depth map", tuple(DEPTH_FORMATS), self.take_depth))

    def take_depth(self, path: Path) -> None:
        """Read the object's depth from a file."""
        try:
            read_depth(path, self._work.photo)
        except InputError as error:
            self._session.fail(error)
        else:
            self._session.edit("photo", depth=str(path))

    def ask_where_to_save_picture(self) -> None:
        """Ask where to write the photograph with its object."""
        suggested = f"{self._work.photo.path.stem}-edited.png"
        self._actions.ask(Request("Save the photograph", PNG, self.save_picture, suggested))

    def ask_where_to_save_mask(self) -> None:
        """Ask where to write the mask."""
        self._ask_where_to_save_mask(lambda: None)

    def _ask_where_to_save_mask(self, then: Callable[[], object]) -> None:
        suggested = f"{self._work.photo.path.stem}-mask.png"
        self._actions.ask(Request("Save the mask", PNG, lambda path: self.save_mask(path) and then(), suggested))

    def capture_picture(self) -> None:
        """Write the photograph with its object to the next free name."""
        self.save_picture(self._actions.free_name())

    def save_picture(self, path: Path) -> None:
        """Write the photograph with its object as PNG."""
        try:
            still = self._subject.still(self._view.live)
        except InputError as error:
            self._session.fail(error)
            return
        if still is None:
            self._session.fail("there is no object yet: paint the mask first")
        else:
            self._put(path, *still)

    def save_mask(self, path: Path) -> bool:
        """Write the mask as PNG; False if that fails."""
        mask = self._work.mask
        if not self._put(path, np.ascontiguousarray(mask.pixels[..., None]), None):
            return False
        self._saved_mask = mask.state
        return True

    def _put(self, path: Path, pixels: PixelsInt, profile: bytes | None) -> bool:
        try:
            if path.resolve() == self._work.photo.path.resolve():
                raise InputError(f"{path.name} is the photograph itself: choose another name")
            write_png(path, pixels, profile)
        except InputError as error:
            self._session.fail(error)
            return False
        self._session.say(f"wrote {path}")
        return True


def lit_around(scene: Scene) -> Scene:
    """Return a scene without the default pair of lights, which is for models: a photograph has light all around."""
    return replace(scene, lights=()) if scene.lights is None else scene
