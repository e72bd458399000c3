"""The mouse on a photograph: the brush, the box, and the lights; there is no camera to move."""

from collections.abc import Callable
from typing import Any

from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.photograph_work import CAMERA_FIXED, LARGEST_BRUSH, SMALLEST_BRUSH, PhotoWork
from milkglass.viewer.photograph.mask import Point
from milkglass.viewer.session import navigation
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.view.mouse import drag_divider

BRUSH_STEP = 1.15  # factor on the brush for a key or a notch of the wheel


class PhotoMouse:
    """Paints a photograph's mask, draws a box on it, moves what is shown of it, turns a session's lights.

    Parameters
    ----------
    session, work
    to_photo : callable
        Turns a place in the window into one in the photograph.
    move_picture : callable
        Zooms in by notches of the wheel, and pans by pixels of the window.
    """

    def __init__(
        self,
        session: Session,
        work: PhotoWork,
        to_photo: Callable[[Point], Point],
        move_picture: Callable[[float, Point], object],
    ) -> None:
        self._session, self._work = session, work
        self._to_photo, self._move_picture = to_photo, move_picture
        self._last: Point | None = None  # where the brush was, or the box began
        self._said_fixed = False  # that the camera does not move

    def move(self, box: Box) -> None:
        """Do what the mouse does in a box of the window, inside an ImGui window that fills the box."""
        io, work = imgui.get_io(), self._work
        imgui.set_cursor_screen_pos((box[0], box[1]))
        flags = imgui.ButtonFlags_
        buttons = flags.mouse_button_left.value | flags.mouse_button_right.value | flags.mouse_button_middle.value
        imgui.set_next_item_allow_overlap()
        imgui.invisible_button("##view", (box[2] - box[0], box[3] - box[1]), buttons)
        hovered, active, started = imgui.is_item_hovered(), imgui.is_item_active(), imgui.is_item_activated()
        if self._session.view.split is not None:
            drag_divider(box, self._session)
        if hovered:
            self._wheel()
        place = self._to_photo((io.mouse_pos.x, io.mouse_pos.y))
        if work.tool is not None and (self._last is not None or (started and io.mouse_down[0])):
            self._use_tool(place, pressed=io.mouse_down[0])
        elif active and not started and (io.mouse_delta.x or io.mouse_delta.y):
            self._move(box[3] - box[1])

    @property
    def paints(self) -> bool:
        """Whether a stroke or a box is on its way."""
        return self._last is not None

    def draw(self, draw: Any, to_window: Callable[[Point], Point], colour: int) -> None:
        """Draw the brush at the pointer, or the box on its way."""
        pointer = imgui.get_io().mouse_pos
        if self._work.tool == "brush":
            (x0, _), (x1, _) = to_window((0.0, 0.0)), to_window((self._work.brush, 0.0))
            draw.add_circle((pointer.x, pointer.y), max(1.5, x1 - x0), colour, 0, 1.5)
        elif self._last is not None:
            draw.add_rect(to_window(self._last), (pointer.x, pointer.y), colour, 0.0, 1.5)

    def _use_tool(self, place: Point, *, pressed: bool) -> None:
        work, start = self._work, self._last
        self._last = (start or place) if work.tool == "box" else place
        if work.tool == "brush":
            if start is None:
                work.mask.begin()
            if start is None or place != start:
                work.mask.paint(start or place, place, work.brush, erases=work.erases or imgui.get_io().key_alt)
            if not pressed:
                work.mask.end()
        elif not pressed and start is not None:
            (x0, y0), (x1, y1) = start, place
            work.cut((min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))
        if not pressed:
            self._last = None

    def _move(self, height: float) -> None:
        io, session = imgui.get_io(), self._session
        if io.mouse_down[2] or io.key_shift:
            self._move_picture(0.0, (io.mouse_delta.x, io.mouse_delta.y))
        elif io.mouse_down[1]:
            session.put(navigation.lights_turned(session.scene, io.mouse_delta.x, io.mouse_delta.y, height))
        elif not self._said_fixed:
            session.say(CAMERA_FIXED)
            self._said_fixed = True

    def _wheel(self) -> None:
        io = imgui.get_io()
        paints, notches = self._work.tool == "brush", io.mouse_wheel
        if notches and not (paints and io.key_ctrl):
            self._move_picture(notches, (0.0, 0.0))
            notches = 0.0
        if paints:
            self._resize(notches)

    def _resize(self, notches: float) -> None:
        steps = notches + imgui.is_key_pressed(imgui.Key.right_bracket) - imgui.is_key_pressed(imgui.Key.left_bracket)
        if steps:
            largest = LARGEST_BRUSH * max(self._work.photo.size)
            self._work.brush = min(largest, max(SMALLEST_BRUSH, self._work.brush * BRUSH_STEP**steps))
