"""Drives the window's contents without a display: injected mouse, keys and files, frames in a framebuffer."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.viewer.gui.events import Dropped, Event, Key, MouseButton, MouseMoved, Scrolled, Typed
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import (
    DEFAULT_LIGHTS,
    DisplaySettings,
    MaterialSettings,
    ModelSettings,
    TransportSettings,
)
from milkglass.viewer.window.replay import Headless

STEP = 0.02  # seconds between frames
SIZE = (900, 2560)  # window: tall, so that the whole panel shows; the picture itself is small
PICTURE = (72, 64)


def write_knot(path: Path) -> Path:
    """Write a small mesh without symmetry, so that every light and view makes another picture."""
    shape = trimesh.creation.capsule(height=2.0, radius=1.0, count=(24, 24))
    shape.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1.0, 0.3, 0.2)))
    shape.vertices[:, 0] *= 1.0 + 0.2 * shape.vertices[:, 1]
    shape.export(path)
    return path


def write_pair(path: Path) -> Path:
    """Write the mesh of `write_knot` and a ball beside it, a gap apart."""
    write_knot(path)
    ball = trimesh.creation.icosphere(3, 1.0)
    ball.apply_translation([2.4, 0.3, 0.0])
    trimesh.util.concatenate([trimesh.load_mesh(path), ball]).export(path)
    return path


def small_scene(model: Path) -> Scene:
    """A scene that a frame of takes milliseconds."""
    return Scene(
        model=ModelSettings(path=model),
        material=MaterialSettings(name="jade"),
        transport=TransportSettings(method="layered", layers=4, resolution=32),
        display=DisplaySettings(image_size=PICTURE, transform="photographic"),
        lights=tuple(replace(light, angle_deg=0.0) for light in DEFAULT_LIGHTS),  # sharp: one shadow map each
    )


class Driver(Headless):
    """A person at the window."""

    def __init__(
        self, scene: Scene, size: tuple[int, int] = SIZE, *, fixed_size: bool = True, photo: PhotoWork | None = None
    ) -> None:
        super().__init__(scene, size, photo)
        self.app.session.view.fixed_size = fixed_size
        self.session, self.view = self.app.session, self.app.view
        self.settle()

    def send(self, *events: Event, frames: int = 3) -> None:
        """Pass events on, each followed by frames."""
        for event in events:
            self.app.handle(event)
            self.frames(frames)

    def frames(self, count: int) -> None:
        """Draw frames, of which only the last one reaches the framebuffer: painting a tall panel takes longest."""
        for left in reversed(range(count)):
            self.now += STEP
            with self._unpainted() if left else nullcontext():
                self.frame()

    def settle(self) -> None:
        """Draw until nothing changes any more; the last frame reaches the framebuffer."""
        with self._unpainted():
            super().settle()
        self.frame()

    def _unpainted(self) -> AbstractContextManager[object]:
        """Keep what frames lay out from the framebuffer."""
        painter = self.app._painter

        def keep_textures(*_: object) -> None:
            painter._update_textures()
            painter._shown.clear()

        return patch.object(painter, "draw", keep_textures)

    def key(self, *names: str) -> None:
        """Press keys together."""
        self.send(*(Key(name, True) for name in names), frames=1)
        self.frames(2)
        self.send(*(Key(name, False) for name in reversed(names)), frames=1)
        self.frames(2)

    def type(self, text: str) -> None:
        self.send(*(Typed(letter) for letter in text), frames=2)

    def place(self, name: str, share: float = 0.5) -> tuple[float, float]:
        """Where a control is, `share` of its width from the left."""
        left, top, right, bottom = self.app.panel.controls.boxes[name]
        return left + share * (right - left), 0.5 * (top + bottom)

    def click(self, name: str, share: float = 0.5, button: str = "left") -> None:
        self.click_at(self.place(name, share), button)

    def click_at(self, place: tuple[float, float], button: str = "left") -> None:
        self.send(MouseMoved(*place), MouseButton(button, True), MouseButton(button, False))

    def drag(self, start: tuple[float, float], by: tuple[float, float], button: str = "left", steps: int = 4) -> None:
        self.send(MouseMoved(*start), MouseButton(button, True))
        for i in range(1, steps + 1):
            self.send(MouseMoved(start[0] + by[0] * i / steps, start[1] + by[1] * i / steps), frames=1)
        self.send(MouseButton(button, False))

    def scroll(self, at: tuple[float, float], notches: float) -> None:
        self.send(MouseMoved(*at), Scrolled(0.0, notches))

    def drop(self, *paths: Path) -> None:
        self.send(Dropped(tuple(map(str, paths))))
        self.settle()

    def picture(self) -> npt.NDArray[np.uint8]:
        """The settled picture, without the panel."""
        self.settle()
        assert self.view.picture is not None
        return read_image(self.view.picture)

    def stages(self) -> set[str]:
        """Which stages a settled change ran, from its first frame on."""
        ran: set[str] = set()
        live = self.view.live
        for _ in range(200):
            self.frame()
            ran |= set(live.renderer.stages.timings)
            live.wait()
            self.now += 0.1
            if self.view.at_rest() and self.app.next_frame() != 0.0:
                break
        return ran


@contextmanager
def driven(model: Path, size: tuple[int, int], folder: Path) -> Iterator[Driver]:
    """Give a window that shows a model and saves into a folder, until the block ends."""
    driver = Driver(small_scene(model), size)
    driver.app.preferences.folder = str(folder)
    yield driver
    driver.close()


def headless_picture(scene: Scene, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """What `milkglass render` makes of a scene."""
    from milkglass.viewer.render.renderer import render

    return render(replace(scene, display=replace(scene.display, image_size=size)), samples=4).image
