"""A photograph in the view: its object in another material, the brush and the box on it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.files.images import PixelsInt
from milkglass.viewer.gl.context import read_rgba
from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.gui.toolkit import ACCENT, imgui
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.live import Live
from milkglass.viewer.live.photograph import PhotographDeveloper, scaled
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.composite import Compositor
from milkglass.viewer.photograph.edit import Edited
from milkglass.viewer.photograph.gpu_composite import PhotoPass
from milkglass.viewer.photograph.object import shown_block
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.photograph.mouse import PhotoMouse
from milkglass.viewer.window.photograph.zoom import Zoom
from milkglass.viewer.window.view.area import SAMPLES
from milkglass.viewer.window.view.drawing import checkerboard
from milkglass.viewer.window.view.mouse import Point
from milkglass.viewer.window.view.subject import Size

MASK_COLOUR = (255, 90, 40)  # of the mask while it is painted
MASK_OPACITY = 0.45
TINT_SECONDS, FADE_SECONDS = 1.0, 0.4  # that the mask shows after a stroke, and goes away in


class PhotographSubject:
    """A photograph whose object has a session's material and light; the camera is the photograph's.

    Parameters
    ----------
    context : moderngl.Context
    painter : ImguiRenderer
    session : Session
    work : PhotoWork

    Attributes
    ----------
    work : PhotoWork
    zoom : Zoom
        What of the photograph the view shows.
    developers : dict
        Those of each `Live` that was made.
    """

    moves_camera = False

    def __init__(self, context: moderngl.Context, painter: ImguiRenderer, session: Session, work: PhotoWork) -> None:
        self.work, self.zoom = work, Zoom()
        self._context, self._painter, self._session = context, painter, session
        self._pass = PhotoPass(context, work.photo)
        self.developers: dict[Live, PhotographDeveloper] = {}
        self._mouse = PhotoMouse(session, work, self.in_photo, self._move_picture)
        self._box: Box = (0.0, 0.0, 1.0, 1.0)
        self._drawn_at: Box = (0.0, 0.0, 1.0, 1.0)
        self._size: Size = self._pass.photograph.size
        self._tint: moderngl.Texture | None = None
        self._tinted = -1  # which state of the mask
        self._painted: tuple[str | None, int] = (None, -1)  # tool and state of the mask that were seen last
        self._fades_at: float | None = None  # ImGui's time, s; None before a stroke of the tool
        self._opacity = 1.0

    @property
    def busy(self) -> bool:
        """Whether an object or a mask is being made."""
        return self.work.busy

    @property
    def state(self) -> object:
        """The newest object, and what shows behind its edges."""
        return self.work.object, self._session.scene.photo.behind

    def make_live(self, context: moderngl.Context, wake: Callable[[], object], assets: Assets | None) -> Live:
        """Return what draws the object and puts it into the photograph."""
        self.work.wake = wake
        developer = PhotographDeveloper(self.work, self._pass)
        live = Live(context, wake, assets, developer)
        self.developers[live] = developer
        return live

    def steer(self, box: Box, live: Live) -> Point | None:
        """Take the newest object, and do what the mouse does; no double click means anything."""
        self._box = box
        newest = self.work.object
        on_screen = None if live.finished is None else live.finished.lit.model.mesh
        try:
            # Another object follows when the last is on screen, or nothing is being done to get it there.
            can_make = not live.working or (newest is not None and newest.geometry.mesh is on_screen)
            self.work.update(self._session.scene, can_make=can_make)
        except InputError as error:
            self._session.fail(error)
        self._mouse.move(box)
        return None

    def size(self, pixels: Size) -> Size:
        """Return the size of the photograph as it is shown, or of the object's parts."""
        self._size = self._pass.photograph.size
        if self._session.view.show != "beauty" and self.work.object is not None:
            rows, columns = self.work.object.geometry.framing.size
            self._size = columns, rows
        return self._size

    def place(self, box: Box, size: Size) -> Box:
        """Return where the picture lies, larger than the box where it is zoomed."""
        if self._session.view.split is not None:
            self.zoom.reset()  # the divider is the window's
        self._drawn_at = self.zoom.placed(box, size)
        return self._drawn_at

    def scene(self, scene: Scene, size: Size) -> Scene | None:
        """Return the scene with the newest object, at the size that it is rendered with."""
        if self.work.object is None:
            return None
        placed = self.work.placed(scene)
        image_size = scaled(placed.display.image_size, size[0] / self._size[0])  # smaller while something moves
        return replace(placed, display=replace(placed.display, image_size=image_size))

    def draw_below(self, draw: Any, *, has_picture: bool) -> None:
        """Add the photograph as it is, where it has no object yet."""
        if has_picture:
            return
        left, top, right, bottom = self._drawn_at
        if self.work.photo.alpha is not None:
            checkerboard(draw, self._drawn_at)
        draw.add_image(self._painter.show(self._pass.photograph), (left, top), (right, bottom))

    def draw_above(self, draw: Any) -> None:
        """Add the mask and the tool while the mask is painted."""
        if self.work.tool is None or self._session.view.show != "beauty":
            return
        left, top, right, bottom = self._drawn_at
        self._opacity = self._tint_opacity()
        colour = imgui.get_color_u32((1.0, 1.0, 1.0, self._opacity))
        tint = self._painter.show(self._mask_tint())
        draw.add_image(tint, (left, top), (right, bottom), (0.0, 0.0), (1.0, 1.0), colour)
        self._mouse.draw(draw, self.in_window, imgui.get_color_u32((*ACCENT, 1.0)))

    def wait(self, timeout: float) -> None:
        """Wait for the object and the mask that are being made."""
        self.work.wait(timeout)

    def stop(self) -> None:
        """Begin nothing more, and wait for nothing."""
        self.work.stop()

    def close(self) -> None:
        """Let the worker finish and free it."""
        self.work.close()

    def still(self, live: Live) -> tuple[PixelsInt, bytes | None] | None:
        """Return the photograph with its object as `milkglass edit` writes it, and its ICC profile; None before."""
        scene = self.scene(self._session.scene, self._size)
        picture = None if scene is None else live.draw(scene, Detail(False, SAMPLES, True))
        developed = self.developers[live].developed
        if picture is None or developed is None:
            return None
        shown = developed.object
        rendered = read_rgba(picture.composite.textures["radiance"])
        coverage = np.minimum(rendered[..., 3], 1.0)
        radiance = np.ascontiguousarray(rendered[..., :3])
        exposed = developed.exposure, shown.request.white, shown.behind
        edited = Edited(shown.photo, shown.geometry, radiance, coverage, None, *exposed, {}, picture.warnings)
        behind = self._session.scene.photo.behind
        is_alone = behind == "transparent"
        compositor = Compositor(edited, "filled" if is_alone else behind)
        return compositor.picture(transparent=is_alone), shown.photo.profile

    def in_photo(self, place: Point) -> Point:
        """Return the place in the photograph, in its pixels, of one in the window."""
        (left, top, right, bottom), (h, w) = self._drawn_at, self.work.photo.size
        return (place[0] - left) / (right - left) * w, (place[1] - top) / (bottom - top) * h

    def in_window(self, place: Point) -> Point:
        """Return the place in the window of one in the photograph, in its pixels."""
        (left, top, right, bottom), (h, w) = self._drawn_at, self.work.photo.size
        return left + place[0] / w * (right - left), top + place[1] / h * (bottom - top)

    @property
    def fading(self) -> bool:
        """Whether the mask that shows goes away by itself."""
        return self.work.tool is not None and self._fades_at is not None and self._opacity > 0.0

    def _tint_opacity(self) -> float:
        """Return how much of the mask shows: all of it until a stroke, and for a moment after that."""
        now, seen = imgui.get_time(), (self.work.tool, self.work.mask.shown)
        if seen[0] != self._painted[0]:
            self._fades_at = None
        elif seen != self._painted or self._mouse.paints:
            self._fades_at = now + TINT_SECONDS
        self._painted = seen
        return 1.0 if self._fades_at is None else min(1.0, max(0.0, 1.0 - (now - self._fades_at) / FADE_SECONDS))

    def _mask_tint(self) -> moderngl.Texture:
        """Return the mask as a tint over the photograph, for people to see what they paint."""
        mask = self.work.mask
        if self._tint is None:
            self._tint = self._context.texture(self._pass.photograph.size, 4)
        if self._tinted != mask.shown:
            width, height = self._tint.size
            block = shown_block(self.work.photo)
            pixels = np.empty((height, width, 4), np.uint8)
            pixels[..., :3] = MASK_COLOUR
            pixels[..., 3] = np.rint(MASK_OPACITY * mask.pixels[::block, ::block])
            self._tint.write(pixels)
            self._tinted = mask.shown
        return self._tint

    def _move_picture(self, notches: float, by: Point) -> None:
        """Zoom at the pointer by notches of the wheel, and pan by pixels of the window."""
        pointer = imgui.get_io().mouse_pos
        if notches:
            self.zoom.zoom(notches, (pointer.x, pointer.y), self._box, self._size)
        if any(by):
            self.zoom.pan(by, self._box, self._size)
