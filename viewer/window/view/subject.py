"""What a view shows of a session, and what the mouse does to it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import moderngl

from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.gui.controls import Box
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.view.drawing import fitted
from milkglass.viewer.window.view.mouse import Point, ViewMouse

Size = tuple[int, int]  # width and height


class Subject(Protocol):
    """What a view shows."""

    @property
    def busy(self) -> bool:
        """Whether a worker is at something that will change the picture, beside those of `Live`."""

    @property
    def fading(self) -> bool:
        """Whether something drawn on the picture changes by itself."""

    @property
    def moves_camera(self) -> bool:
        """Whether the session's camera is what sees the subject."""

    @property
    def state(self) -> object:
        """What pictures depend on beside the session, compared by equality."""

    def make_live(self, context: moderngl.Context, wake: Callable[[], object], assets: Assets | None) -> Live:
        """Return what draws scenes of the subject; parameters as of `viewer.live.live.Live`."""

    def steer(self, box: Box, live: Live) -> Point | None:
        """Take what workers have finished, and do what the mouse does in a box of the window.

        Returns where the mouse asks for the camera's target, inside an ImGui window that fills the box.
        """

    def size(self, pixels: Size) -> Size:
        """Return the size of the picture where the view has some pixels."""

    def place(self, box: Box, size: Size) -> Box:
        """Return where a picture of a size lies in a box of the window."""

    def scene(self, scene: Scene, size: Size) -> Scene | None:
        """Return the scene to draw for one of the session's, at a size; None while there is nothing to draw."""

    def draw_below(self, draw: Any, *, has_picture: bool) -> None:
        """Add to an ImGui draw list what lies below the picture, or in its place where there is none."""

    def draw_above(self, draw: Any) -> None:
        """Add to an ImGui draw list what lies on the picture."""

    def wait(self, timeout: float) -> None:
        """Wait for the workers, at most so many seconds for each of their tasks; for tests and replays."""

    def stop(self) -> None:
        """Give up what the workers do, and wait for nothing."""

    def close(self) -> None:
        """Let the workers finish and free them."""


class ModelSubject:
    """A session's model, seen by the camera that the mouse moves."""

    busy, fading, moves_camera, state = False, False, True, None

    def __init__(self, session: Session) -> None:
        self._session, self._mouse = session, ViewMouse(session)

    def make_live(self, context: moderngl.Context, wake: Callable[[], object], assets: Assets | None) -> Live:
        """Return what draws the model."""
        return Live(context, wake, assets)

    def steer(self, box: Box, live: Live) -> Point | None:
        """Do what the mouse does; returns where it was double-clicked."""
        return self._mouse.move(box, live)

    def size(self, pixels: Size) -> Size:
        """Return all pixels of the view, or the scene's own size where that is fixed."""
        return self._session.scene.display.image_size if self._session.view.fixed_size else pixels

    def place(self, box: Box, size: Size) -> Box:
        """Return the largest box of the picture's proportions in the middle of the view."""
        return fitted(box, size)

    def scene(self, scene: Scene, size: Size) -> Scene:
        """Return the scene at a size."""
        return replace(scene, display=replace(scene.display, image_size=size))

    def draw_below(self, draw: Any, *, has_picture: bool) -> None:
        """Add nothing: the picture is all there is."""

    def draw_above(self, draw: Any) -> None:
        """Add nothing."""

    def wait(self, timeout: float) -> None:
        """Return at once: a model has no workers but those of `Live`."""

    def stop(self) -> None:
        """Stop nothing."""

    def close(self) -> None:
        """Free nothing."""
