"""The mouse on the view: orbit, pan, zoom, turn the lights, move the divider."""

from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.live import Live
from milkglass.viewer.session import navigation
from milkglass.viewer.session.session import Session

Point = tuple[float, float]


class ViewMouse:
    """Moves the camera and the lights of a session by the mouse."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def move(self, box: Box, live: Live) -> Point | None:
        """Apply what the mouse does in a box of the window; returns the place of a double click, None without one."""
        session, io = self._session, imgui.get_io()
        imgui.set_cursor_screen_pos((box[0], box[1]))
        flags = imgui.ButtonFlags_
        buttons = flags.mouse_button_left.value | flags.mouse_button_right.value | flags.mouse_button_middle.value
        imgui.set_next_item_allow_overlap()
        imgui.invisible_button("##view", (box[2] - box[0], box[3] - box[1]), buttons)
        hovered, active = imgui.is_item_hovered(), imgui.is_item_active() and not imgui.is_item_activated()
        if session.view.split is not None:
            drag_divider(box, session)
        if hovered and io.mouse_wheel != 0.0:
            session.look(navigation.zoomed(session.scene.camera, io.mouse_wheel))
        if hovered and imgui.is_mouse_double_clicked(imgui.MouseButton_.left.value):
            return io.mouse_pos.x, io.mouse_pos.y
        if active and (io.mouse_delta.x or io.mouse_delta.y):
            # not in the frame of the press itself: the pointer came from elsewhere
            self._drag(io.mouse_delta.x, io.mouse_delta.y, (box[2] - box[0], box[3] - box[1]), live)
        return None

    def _drag(self, dx: float, dy: float, size: tuple[float, float], live: Live) -> None:
        session = self._session
        camera = session.scene.camera
        down = imgui.get_io().mouse_down
        if down[1]:
            session.put(navigation.lights_turned(session.scene, dx, dy, size[1]))
        elif down[2] or imgui.get_io().key_shift:
            if live.finished is not None:
                radius = live.finished.lit.model.whole.radius
                session.look(navigation.panned(camera, radius, dx, dy, (max(1, int(size[0])), max(1, int(size[1])))))
        elif down[0]:
            session.look(navigation.orbited(camera, dx, dy, size[1]))


def drag_divider(box: Box, session: Session) -> None:
    """Let the mouse drag the divider of a split view, which fills a box of the window."""
    view = session.view
    assert view.split is not None
    width = box[2] - box[0]
    imgui.set_cursor_screen_pos((box[0] + view.split * width - 5.0, box[1]))
    imgui.invisible_button("##divider", (10.0, box[3] - box[1]))
    if imgui.is_item_hovered() or imgui.is_item_active():
        imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew.value)
    if imgui.is_item_active():
        view.split = min(0.98, max(0.02, (imgui.get_io().mouse_pos.x - box[0]) / max(1.0, width)))
