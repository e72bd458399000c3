"""The part of the window that shows a photograph: its object in another material, the brush and the box on it."""

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
from milkglass.viewer.gui.toolkit import ACCENT, Gui, imgui
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.photograph import PhotoLive, scaled
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.composite import Compositor
from milkglass.viewer.photograph.edit import Edited
from milkglass.viewer.photograph.gpu_composite import PhotoPass
from milkglass.viewer.photograph.made import shown_block
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.photograph.mouse import PhotoMouse
from milkglass.viewer.window.photograph.zoom import Zoom
from milkglass.viewer.window.view.area import SAMPLES, ViewArea
from milkglass.viewer.window.view.drawing import checkerboard

TINT = (255, 90, 40)  # of the mask while it is painted
TINTED = 0.45


class PhotoView(ViewArea):
    """Draws a session's material and light on the object of a photograph; the camera is the photograph's."""

    live: PhotoLive

    def __init__(
        self, context: moderngl.Context, gui: Gui, painter: ImguiRenderer, session: Session,
        wake: Callable[[], object], work: PhotoWork,
    ) -> None:  # fmt: skip
        work.wake = wake
        self._work, self._pass = work, PhotoPass(context, work.photo)
        super().__init__(context, gui, painter, session, wake)
        self._mouse = self._tools = PhotoMouse(session, work, self._in_photo, self._move_picture)
        self.zoom = Zoom()
        self._box: Box = (0.0, 0.0, 1.0, 1.0)
        self._shown_for: object = None
        self._tint: moderngl.Texture | None = None
        self._tinted = -1  # which state of the mask

    def _live(self, context: moderngl.Context, wake: Callable[[], object], assets: Assets | None) -> PhotoLive:
        return PhotoLive(context, self._work, self._pass)

    def steer(self, box: Box, now: float) -> None:
        """Do what the mouse does in a box of the window, inside an ImGui window that fills the box."""
        work, self._box = self._work, box
        try:
            work.update(self._session.scene, can_make=self.live.caught_up)
        except InputError as error:
            self._session.fail(error)
        if self._shown_for != (shown_for := (work.made, self._session.scene.photo.behind)):
            self._shown_for, self._key = shown_for, ()  # another picture, by a drag if there is one
        if work.made is None:
            self.picture = None
        super().steer(box, now)
        self.size = self._pass.photograph.size
        if self._session.view.show != "beauty" and work.made is not None:
            rows, columns = work.made.geometry.framing.size
            self.size = columns, rows
        if self._session.view.split is not None:
            self.zoom.reset()  # the divider is the window's
        self._drawn_at = self.zoom.placed(box, self.size)

    def at_rest(self) -> bool:
        """Whether the picture is at its best, with nothing more to come."""
        return not self._work.busy if self._work.made is None else super().at_rest()

    def still(self) -> tuple[PixelsInt, bytes | None] | None:
        """Return the photograph with its object as `milkglass edit` writes it, and its ICC profile; None before."""
        live = self.live
        if self._work.made is None or live.draw(self._sized(self._session.scene), Detail(False, SAMPLES, True)) is None:
            return None
        assert live.shown is not None
        assert live.picture is not None
        made = live.shown[0]
        rendered = read_rgba(live.picture.composite.textures["radiance"])
        coverage = np.minimum(rendered[..., 3], 1.0)
        radiance = np.ascontiguousarray(rendered[..., :3])
        exposed = live.exposure(), made.wanted.white, made.behind
        edited = Edited(made.photo, made.geometry, radiance, coverage, None, *exposed, {}, live.picture.warnings)
        behind = self._session.scene.photo.behind
        is_alone = behind == "transparent"
        compositor = Compositor(edited, "filled" if is_alone else behind)
        return compositor.picture(transparent=is_alone), made.photo.profile

    def close(self) -> None:
        """Stop the workers."""
        super().close()
        self._work.close()

    def _sized(self, scene: Scene) -> Scene:
        sized = super()._sized(scene)
        if self._work.made is None:
            return sized
        placed = self._work.placed(sized)
        scale = sized.display.image_size[0] / self.size[0]  # less than 1 while something moves
        size = scaled(placed.display.image_size, scale)
        return replace(placed, display=replace(placed.display, image_size=size))

    def _draw_scene(self) -> None:
        if self._work.made is not None:
            super()._draw_scene()

    def _put_picture(self) -> None:
        draw: Any = imgui.get_window_draw_list()
        left, top, right, bottom = self._drawn_at
        if self.picture is None:
            if self._work.photo.alpha is not None:
                checkerboard(draw, self._drawn_at)
            draw.add_image(self._painter.show(self._pass.photograph), (left, top), (right, bottom))
        super()._put_picture()
        if self._work.tool is not None and self._session.view.show == "beauty":
            draw.add_image(self._painter.show(self._mask_tint()), (left, top), (right, bottom))
            self._tools.draw(draw, self._in_window, imgui.get_color_u32((*ACCENT, 1.0)))

    def _mask_tint(self) -> moderngl.Texture:
        """The mask as a tint over the photograph, for people to see what they paint."""
        mask = self._work.mask
        if self._tint is None:
            self._tint = self._context.texture(self._pass.photograph.size, 4)
        if self._tinted != mask.shown:
            width, height = self._tint.size
            block = shown_block(self._work.photo)
            pixels = np.empty((height, width, 4), np.uint8)
            pixels[..., :3] = TINT
            pixels[..., 3] = np.rint(TINTED * mask.pixels[::block, ::block])
            self._tint.write(pixels)
            self._tinted = mask.shown
        return self._tint

    def _move_picture(self, notches: float, by: tuple[float, float]) -> None:
        """Zoom at the pointer, and pan by pixels of the window."""
        pointer = imgui.get_io().mouse_pos
        if notches:
            self.zoom.zoom(notches, (pointer.x, pointer.y), self._box, self.size)
        if any(by):
            self.zoom.pan(by, self._box, self.size)

    def _in_photo(self, place: tuple[float, float]) -> tuple[float, float]:
        """Turn a place in the window into one in the photograph, pixels."""
        (left, top, right, bottom), (h, w) = self._drawn_at, self._work.photo.size
        return (place[0] - left) / (right - left) * w, (place[1] - top) / (bottom - top) * h

    def _in_window(self, place: tuple[float, float]) -> tuple[float, float]:
        (left, top, right, bottom), (h, w) = self._drawn_at, self._work.photo.size
        return left + place[0] / w * (right - left), top + place[1] / h * (bottom - top)
