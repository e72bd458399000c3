"""The state of an edited scene without a window: its history, its file, the state kept for comparison.

Every edit goes through `Session.edit` or `Session.put`. Bad values never get in: they become a message, and the scene
stays as it was.
"""

import contextlib
import os
import tomllib
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from milkglass.core.errors import InputError
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.keys import input_files
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Change, Scene, changed
from milkglass.viewer.scene.settings import CameraSettings
from milkglass.viewer.session.navigation import following

UNDO_STEPS = 200
DEFAULT_ERROR_POINTS = 300  # as `milkglass render --report`
# What is shown -> the output of the composite; the last two are maps of a layer.
SHOWN = {
    "beauty": "radiance",
    "irradiance": "irradiance",
    "exitance": "exitance",
    "subsurface": "subsurface",
    "highlight": "specular",
    "unscattered": "unscattered",
    "once": "once",
    "often": "often",
    "normal": "normal",
    "layer in": "",
    "layer out": "",
}


@dataclass(frozen=True)
class Message:
    """A sentence shown to the person; errors stay longer."""

    text: str
    is_error: bool = False


@dataclass
class View:
    """How the scene is looked at; no part of the scene, and not saved with it."""

    show: str = "beauty"
    layer: int = 0
    fixed_size: bool = False  # True: the scene's image size, fitted; False: the window's
    split: float | None = None  # share of the view's width that shows the current state, None for all
    measure: bool = False  # whether the error of what is shown is measured
    error_points: int = DEFAULT_ERROR_POINTS
    error_map: bool = True  # whether a measured error shows over the picture
    photograph: str | None = None  # its name, where one is what is shown
    profiles: bool = False  # whether the profile's curves show beside the picture


@dataclass(frozen=True)
class _File:
    """A scene file, None where there is none yet, and the scene as it stands there."""

    path: Path | None
    scene: Scene


@dataclass(frozen=True)
class _Step:
    before: Scene
    gesture: Hashable
    moves_camera: bool
    file: _File | None = None  # before, where the step opened another
    apart: tuple[Callable[[], bool], Callable[[], bool]] | None = None  # undoes and redoes what is no part of the scene


class Session:
    """Holds the edited scene, its history, and the state kept for comparison.

    Parameters
    ----------
    scene : Scene
    path : Path, optional
        The scene file that it came from.

    Attributes
    ----------
    gesture : hashable
        The drag, click or key press going on; edits of one gesture are undone together.
    kept : Scene or None
        The other state of an A/B comparison.
    origin : str or None
        The library's material that own coefficients started from.
    files : set of Path
        Scene files that were opened or written in this session, without links.
    unusable : set of Path
        Files that a scene was given up for.
    messages : list of Message
        New ones, for the window to take and show.
    """

    def __init__(self, scene: Scene, path: Path | None = None) -> None:
        self.scene = scene
        self.path = path
        self.view = View()
        self.kept: Scene | None = None
        self.origin = scene.material.name
        self.messages: list[Message] = []
        self.gesture: Hashable = None
        self.unusable: set[Path] = set()
        self.files = set() if path is None else {real(path)}
        self._on_disk: dict[Path, Scene] = {}  # what scene files held when they were read or written last
        self._note_file(path)
        self._saved = scene
        self._nodes: dict[str, tuple[int | None, int | None]] = {}  # layers and resolution asked of other methods
        self._settled: Scene | None = None  # the last scene that was seen at its best
        self._working: Scene | None = None  # the last scene that could be drawn
        self._undo: list[_Step] = []
        self._redo: list[_Step] = []

    @property
    def model_name(self) -> str:
        """Name of the model or the photograph that is shown."""
        model = self.scene.model
        return self.view.photograph or (str(model.builtin_name) if model.path is None else model.path.name)

    @property
    def file_name(self) -> str:
        """Name of the scene's file, or of the model while it has none."""
        return self.model_name if self.path is None else self.path.name

    # edits

    def edit(self, table: str, **values: Any) -> bool:
        """Change keys of one table of the scene; a value that is not possible gives a message and False."""
        changes = [Change(table, key, value, f"{table}.{key}") for key, value in values.items()]
        return self.change(changes)

    def change(self, changes: Iterable[Change]) -> bool:
        """Make changes together as one step; an impossible value gives a message and False."""
        try:
            scene = changed(self.scene, changes)
        except InputError as error:
            self.fail(error)
            return False
        self.put(following(self.scene, self._with_its_nodes(scene)))
        return True

    def _with_its_nodes(self, scene: Scene) -> Scene:
        """Return a scene whose method of transport has changed with the layers and nodes that this one had before."""
        old, new = self.scene.transport, scene.transport
        if new.method == old.method or (new.layers, new.resolution) != (old.layers, old.resolution):
            return scene
        self._nodes[old.method] = old.layers, old.resolution
        layers, resolution = self._nodes.get(new.method, (None, None))
        return replace(scene, transport=replace(new, layers=layers, resolution=resolution))

    def edit_lights(self, lights: Sequence[Light]) -> None:
        """Replace the lights of the scene."""
        self.put(replace(self.scene, lights=tuple(lights)))

    def put(self, scene: Scene) -> None:
        """Replace the scene, as one step of the history; changes of one gesture are one step."""
        if scene == self.scene:
            return
        goes_on = bool(self._undo) and self.gesture is not None and self._undo[-1].gesture == self.gesture
        if not goes_on:
            moves_camera = scene.camera != self.scene.camera
            self._undo.append(_Step(self.scene, self.gesture, moves_camera))
            del self._undo[:-UNDO_STEPS]
        self._redo.clear()
        self._set(scene)

    def note(self, undo: Callable[[], bool], redo: Callable[[], bool]) -> None:
        """Note a step that was made beside the scene; `undo` and `redo` return False where they cannot any more."""
        step = _Step(self.scene, None, moves_camera=False, apart=(undo, redo))
        self._undo = [*self._undo, step][-UNDO_STEPS:]
        self._redo.clear()

    def frame(self, camera: CameraSettings) -> None:
        """Take the zoom and the target that frame the model, which is no change of the scene."""
        if self._saved.camera == self.scene.camera:
            self._saved = replace(self._saved, camera=camera)
        self.look(camera)

    def look(self, camera: CameraSettings) -> None:
        """Move the camera, which is not an edit: undoing a colour must not turn the object back."""
        self.scene = replace(self.scene, camera=camera)

    # history

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to undo."""
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        """Whether there is a step to redo."""
        return bool(self._redo)

    @property
    def modified(self) -> bool:
        """Whether the scene differs from its file."""
        return self.scene != self._saved

    @property
    def unsaved(self) -> bool:
        """Whether closing would lose more than where the camera stands."""
        return _without_look(self.scene) != _without_look(self._saved)

    def undo(self) -> None:
        """Go back one step of the history; the camera stays unless the step moved it."""
        self._travel(self._undo, self._redo)

    def redo(self) -> None:
        """Go forward one step of the history again."""
        self._travel(self._redo, self._undo)

    def _travel(self, source: list[_Step], target: list[_Step]) -> None:
        if not source:
            return
        step = source.pop()
        if step.apart is not None:
            target.append(step)
            if not step.apart[source is self._redo]():
                self._travel(source, target)
            return
        file = None if step.file is None else _File(self.path, self._saved)
        target.append(_Step(self.scene, None, step.moves_camera, file))
        if step.file is not None:
            self.path, self._saved = step.file.path, step.file.scene
        self._set(step.before if step.moves_camera else replace(step.before, camera=self.scene.camera))

    def _set(self, scene: Scene) -> None:
        self.scene = scene
        if scene.material.name is not None:
            self.origin = scene.material.name

    # what cannot be drawn

    @property
    def has_worked(self) -> bool:
        """Whether a scene has been drawn, to which one that cannot be drawn goes back."""
        return self._working is not None

    def works(self, scene: Scene) -> None:
        """Note that a scene could be drawn."""
        self._working = scene

    def reject(self, error: Exception) -> bool:
        """Go back to the last scene that could be drawn and show the error; return False if there has been none."""
        if self._working is None:
            return False
        self.fail(error)
        if self.scene != self._working:
            failed, working = files_of(self.scene), files_of(self._working)
            self.unusable |= failed - working
            self._back_to(self._working)
        return True

    def settles(self) -> None:
        """Note that the scene is seen at its best."""
        self._settled = self.scene

    @property
    def can_cancel(self) -> bool:
        """Whether the scene differs from the last one that was seen at its best, but for its camera."""
        return self._settled is not None and not _is_same(self._settled, self.scene)

    def cancel(self) -> None:
        """Go back to the last scene that was seen at its best; the camera stays."""
        if self._settled is not None:
            self._back_to(self._settled)

    def _back_to(self, scene: Scene) -> None:
        """Take back the steps since a scene, and what they opened."""
        for i in reversed(range(len(self._undo))):
            if self._undo[i].apart is None and _is_same(self._undo[i].before, scene):
                file = next((step.file for step in self._undo[i:] if step.file is not None), None)
                if file is not None:
                    self.path, self._saved = file.path, file.scene
                del self._undo[i:]
                break
        self._redo.clear()
        self._set(replace(scene, camera=self.scene.camera))

    def say(self, text: str) -> None:
        """Show a sentence."""
        self.messages.append(Message(text))

    def fail(self, error: Exception | str) -> None:
        """Show an error as a sentence."""
        text = " ".join(str(error).split()) or type(error).__name__
        self.messages.append(Message(text, is_error=True))

    # files

    def open(self, path: Path, adapt: Callable[[Scene], Scene] = lambda scene: scene) -> bool:
        """Replace the scene by that of a file, adapted; one that cannot be read gives a message and False."""
        try:
            scene = adapt(Scene.load(path))
        except InputError as error:
            self.fail(error)
            return False
        self._take(scene, _File(path, scene))
        return True

    def restore(self, scene: Scene, path: Path | None) -> None:
        """Replace the scene by an unsaved one that was edited before, of a file; the file may be gone by now."""
        try:
            saved = self._saved if path is None else Scene.load(path)
        except InputError:
            path, saved = None, self._saved
        self._take(scene, _File(path, saved))

    def _take(self, scene: Scene, file: _File) -> None:
        """Replace the scene and its file, as one step of the history."""
        step = _Step(self.scene, None, moves_camera=True, file=_File(self.path, self._saved))
        self._undo = [*self._undo, step][-UNDO_STEPS:]
        self._redo.clear()
        self.gesture, self.path, self._saved = None, file.path, file.scene
        if file.path is not None:
            self.files.add(real(file.path))
            self._note_file(file.path)
        self._set(scene)

    def save(self, path: Path, image_size: tuple[int, int]) -> bool:
        """Write the scene so that `milkglass render` makes the picture seen, of `image_size`."""
        try:
            scene = replace(self.scene, display=replace(self.scene.display, image_size=image_size))
            scene.save(path)
        except InputError as error:
            self.fail(error)
            return False
        self.path, self._saved = path, self.scene
        self.files.add(real(path))
        self._on_disk[path] = scene
        self.say(f"saved {path.name}")
        return True

    def changed_on_disk(self) -> bool:
        """Tell whether another program has changed the scene's file, once for each change."""
        before = None if self.path is None else self._on_disk.get(self.path)
        return before is not None and self._note_file(self.path) != before

    def _note_file(self, path: Path | None) -> Scene | None:
        """Remember what a scene file holds, and return it; what it held before where it cannot be read."""
        if path is None:
            return None
        with contextlib.suppress(InputError):
            self._on_disk[path] = Scene.load(path)
        return self._on_disk.get(path)

    # A/B

    def keep(self) -> None:
        """Keep the scene as B, for comparison."""
        self.kept = self.scene
        self.say(f"kept {self.scene.material.resolve().name} as B: press B to flip, V to split the view")

    def flip(self) -> None:
        """Exchange the scene and the kept one; the camera stays."""
        if self.kept is None:
            self.keep()
            return
        kept, camera = self.kept, self.scene.camera
        self.kept = self.scene
        self.gesture = None
        self.put(replace(kept, camera=camera))

    def toggle_split(self) -> None:
        """Split the view between the scene (left) and the kept one (right), or show the scene alone again."""
        if self.view.split is not None:
            self.view.split = None
            return
        if self.kept is None:
            self.kept = self.scene
            self.say("the right half keeps this state; change the left one")
        self.view.split = 0.5

    # the view as text

    def view_text(self) -> str:
        """Return the camera as text, the table of a scene file."""
        camera = self.scene.camera
        values = {key: value for key in settings_of(camera) if (value := getattr(camera, key)) is not None}
        return tomli_w.dumps({"camera": values})

    def paste_view(self, text: str) -> None:
        """Replace the camera by that of a scene file's text."""
        try:
            table = tomllib.loads(text).get("camera")
        except (ValueError, RecursionError):  # numbers of thousands of digits, brackets in brackets
            table = None
        known = settings_of(CameraSettings)
        if not isinstance(table, dict) or not set(table) <= set(known):
            self.fail("the clipboard holds no view: copy one with Ctrl+C first, or a [camera] table")
            return
        self.edit("camera", **table)


def real(path: Path) -> Path:
    """Return a path without links; where it cannot be followed, as far as it can."""
    return Path(os.path.realpath(path))


def files_of(scene: Scene) -> set[Path]:
    """Return the model with what lies on it, the probe and the table of a scene, as far as they are files."""
    return set(input_files(scene).values())


def _is_same(one: Scene, other: Scene) -> bool:
    """Tell whether two scenes differ by no more than their cameras."""
    return replace(one, camera=other.camera) == other


def _without_look(scene: Scene) -> Scene:
    """Return a scene with its camera where every camera stands at first."""
    return replace(scene, camera=CameraSettings(view_angle_deg=scene.camera.view_angle_deg))
