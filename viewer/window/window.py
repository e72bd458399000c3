"""The window: GLFW's events to the app, the app's frames to the screen. It draws on demand."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from milkglass.viewer.gui import toolkit as toolkit  # first: it chooses the library of GLFW, for Wayland too

# isort: split
import glfw

from milkglass.core.errors import InputError
from milkglass.core.threads import one_blas_thread
from milkglass.viewer.gl.context import window_context
from milkglass.viewer.gui.events import (
    OUTSIDE,
    Closed,
    Drawn,
    Dropped,
    Event,
    Focused,
    Key,
    MouseButton,
    MouseMoved,
    Recorder,
    Resized,
    Scrolled,
    Typed,
)
from milkglass.viewer.live.worker import have_ended
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.session.autosave import Autosave
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.window.interrupts import interrupts
from milkglass.viewer.window.layout import view_and_panel
from milkglass.viewer.window.sketch import Sketch

if TYPE_CHECKING:
    from milkglass.viewer.live.photograph_work import PhotoWork

PATIENCE = 0.4  # seconds that workers may take to end with the window
SMALLEST_SIZE = (480, 320)  # window coordinates
FIRST_SIZE = (1440, 900)  # window coordinates on a display of 96 dpi
MOUSE_BUTTONS = {0: "left", 1: "right", 2: "middle"}  # GLFW's numbers
POINTERS = {
    "resize_ew": "HRESIZE_CURSOR",
    "resize_ns": "VRESIZE_CURSOR",
    "text_input": "IBEAM_CURSOR",
    "hand": "HAND_CURSOR",
}
_untyped: Any = glfw  # some of its annotations are those of the C functions that it wraps
DEFAULT_RATE = 60.0  # frames a second, where the display does not say


@one_blas_thread()
def run(scene: Scene, *, path: Path | None = None, record: Path | None = None, photo: "PhotoWork | None" = None) -> int:
    """Show a scene in a window until it is closed, and return the exit code: 128 and more where a signal closed it.

    What is still computed then is left behind, in threads that `viewer.live.worker.have_ended` knows.

    Parameters
    ----------
    scene : Scene
    path : Path, optional
        The scene file that it came from, which Ctrl+S writes.
    record : Path, optional
        File to record the interaction in.
    photo : PhotoWork, optional
        A photograph whose object is to be shown in the scene's material and light.

    Raises
    ------
    InputError
        No display or no OpenGL 3.3; the scene's files or values cannot be used at all.
    """
    window = Window(scene, path, record, photo)
    code = 1
    try:
        with interrupts(lambda: window.app.actions.close(), glfw.post_empty_event) as code_of_signal:
            window.loop()
            window.hide()
            code = code_of_signal()
    finally:
        window.close(is_done=code == 0)
    return code


class Window:
    """Shows an `App` in a GLFW window, and passes its events on.

    Attributes
    ----------
    handle : Any
        The window to GLFW.
    """

    def __init__(self, scene: Scene, path: Path | None, record: Path | None, photo: "PhotoWork | None" = None) -> None:
        self._preferences = Preferences.load()
        if path is not None:
            self._preferences.opened(path)
        self.handle = open_window(self._preferences.window_size)
        context = window_context()
        self._screen = context.detect_framebuffer(0)
        self._recorder = None if record is None else Recorder(record, scene.to_toml())
        sketch = Sketch.of(context, scene) if photo is None else None
        if sketch is not None:
            self._show_first(sketch, scene)
        from milkglass.viewer.window.app import App  # once there is something to look at: it takes a second

        self.app = App(
            context,
            scene,
            path=path,
            preferences=self._preferences,
            wake=glfw.post_empty_event,
            clipboard=_WindowClipboard(),
            photo=photo,
        )
        if sketch is not None:
            self.app.view.begin_with(sketch)
        if photo is None and record is None:  # a recording has all that happens in itself
            self.app.keep_in(Autosave())
        self._pointers: dict[str, Any] = {}
        self._pointer = ""
        self._title = ""
        self._size: tuple[int, int] = glfw.get_window_size(self.handle)
        self._interval = 1.0 / _refresh_rate()
        self._listen()
        self._resized()

    def loop(self) -> None:
        """Handle events and draw frames until the window is closed; sleep while there is nothing to do."""
        drawn = -1.0
        while not self.app.actions.closing:
            if self._is_hidden():
                glfw.wait_events()
                continue
            due = self.app.next_frame()
            if due is None:
                glfw.wait_events()
                self.app.wake()  # events draw by themselves; a finished volume comes as an empty one
            elif due > 0.0:
                glfw.wait_events_timeout(due)
                self.app.wake()
            else:
                glfw.poll_events()
            # Where the driver does not wait for the display, we do.
            while (ahead := drawn + self._interval - time.monotonic()) > 1e-3 and not self.app.actions.closing:
                glfw.wait_events_timeout(ahead)
            drawn = time.monotonic()
            self.draw()

    def hide(self) -> None:
        """Take the window off the screen."""
        glfw.hide_window(self.handle)

    def close(self, *, is_done: bool = True) -> None:
        """Keep the size in the preferences, give up what is computed and close the window.

        Workers that do not end soon are left behind. An autosave stays unless the person `is_done` with the scene.
        """
        if min(self._size) > 0 and not glfw.get_window_attrib(self.handle, glfw.MAXIMIZED):
            self._preferences.window_size = self._size
        self._preferences.save()
        if self._recorder is not None:
            self._recorder.close()
        self.app.leave(is_done=is_done)
        self.app.stop()
        if have_ended(PATIENCE if is_done else 0.0):
            self.app.close()
        glfw.destroy_window(self.handle)
        glfw.terminate()

    def draw(self) -> None:
        """Draw a frame and show it, unless the window is hidden."""
        if self._is_hidden():
            return
        self.app.frame(self._screen)
        if self._recorder is not None:
            final = self.app.at_rest() and self.app.next_frame() is None
            self._recorder.add(Drawn(self.app.clock(), final))
        glfw.swap_buffers(self.handle)
        if self.app.title != self._title:
            self._title = self.app.title
            glfw.set_window_title(self.handle, self._title)
        pointer = self.app.mouse_cursor()
        if pointer != self._pointer:
            self._pointer = pointer
            glfw.set_cursor(self.handle, self._cursor(pointer))

    def _show_first(self, sketch: Sketch, scene: Scene) -> None:
        """Show a sketch where the view is going to be."""
        size, pixels = glfw.get_window_size(self.handle), glfw.get_framebuffer_size(self.handle)
        if min(*size, *pixels) <= 0:
            return
        letter = toolkit.TEXT_SIZE * _text_scale(self.handle)
        (_, _, width, height), _ = view_and_panel(size, letter)
        scale = pixels[0] / size[0]
        self._screen.viewport = (0, 0, *pixels)
        self._screen.clear(*toolkit.BACKGROUND)
        sketch.draw(scene, self._screen, (round(scale * width), round(scale * height)))
        glfw.swap_buffers(self.handle)

    def _is_hidden(self) -> bool:
        """Whether it is minimised, or has no pixels."""
        iconified = bool(glfw.get_window_attrib(self.handle, glfw.ICONIFIED))
        return iconified or min(glfw.get_framebuffer_size(self.handle)) <= 0

    def _cursor(self, name: str) -> Any:
        if name not in POINTERS:
            return None
        if name not in self._pointers:
            self._pointers[name] = glfw.create_standard_cursor(getattr(glfw, POINTERS[name]))
        return self._pointers[name]

    # events

    def _take(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.add(event)
        self.app.handle(event)

    def _listen(self) -> None:
        handle, take = self.handle, self._take

        def dropped(_: Any, paths: Any) -> None:
            take(Dropped(tuple(map(str, paths))))

        def entered(_: Any, is_inside: int) -> None:
            if not is_inside and not any(glfw.get_mouse_button(handle, button) for button in MOUSE_BUTTONS):
                take(OUTSIDE)

        def pressed(_: Any, button: int, action: int, mods: int) -> None:
            if button in MOUSE_BUTTONS:
                take(MouseButton(MOUSE_BUTTONS[button], action == glfw.PRESS))

        def key(_: Any, code: int, scancode: int, action: int, mods: int) -> None:
            name = key_name(code)
            if name is not None and (action != glfw.REPEAT or name in REPEATED):
                take(Key(name, action != glfw.RELEASE))

        glfw.set_cursor_pos_callback(handle, lambda _, x, y: take(MouseMoved(x, y)))
        glfw.set_cursor_enter_callback(handle, entered)
        glfw.set_mouse_button_callback(handle, pressed)
        glfw.set_scroll_callback(handle, lambda _, x, y: take(Scrolled(x, y)))
        glfw.set_key_callback(handle, key)
        glfw.set_char_callback(handle, lambda _, code: take(Typed(chr(code))))
        _untyped.set_drop_callback(handle, dropped)
        glfw.set_window_focus_callback(handle, lambda _, focused: take(Focused(bool(focused))))
        glfw.set_window_iconify_callback(handle, lambda *_: self.app.wake())
        glfw.set_window_close_callback(handle, lambda _: take(Closed()))
        glfw.set_window_refresh_callback(handle, lambda _: self.app.wake())
        glfw.set_framebuffer_size_callback(handle, lambda *_: self._resized())
        glfw.set_window_content_scale_callback(handle, lambda *_: self._resized())

    def _resized(self) -> None:
        size = glfw.get_window_size(self.handle)
        pixels = glfw.get_framebuffer_size(self.handle)
        if min(pixels) > 0:
            self._size = (int(size[0]), int(size[1]))
            self._screen.viewport = (0, 0, int(pixels[0]), int(pixels[1]))
        text_scale = _text_scale(self.handle)
        self._take(Resized((int(size[0]), int(size[1])), (int(pixels[0]), int(pixels[1])), text_scale))


class _WindowClipboard:
    """The system's clipboard."""

    def get(self) -> str:
        text = _untyped.get_clipboard_string(None)
        return "" if text is None else str(text.decode("utf-8", "replace"))

    def set(self, text: str) -> None:
        _untyped.set_clipboard_string(None, text)


REPEATED = ("backspace", "delete", "left_arrow", "right_arrow", "up_arrow", "down_arrow")
_NAMED_KEYS = {
    "SPACE": "space", "ENTER": "enter", "KP_ENTER": "keypad_enter", "ESCAPE": "escape", "TAB": "tab",
    "BACKSPACE": "backspace", "INSERT": "insert", "DELETE": "delete", "LEFT": "left_arrow", "RIGHT": "right_arrow",
    "UP": "up_arrow", "DOWN": "down_arrow", "HOME": "home", "END": "end", "PAGE_UP": "page_up",
    "PAGE_DOWN": "page_down", "MINUS": "minus", "EQUAL": "equal", "PERIOD": "period", "COMMA": "comma",
    "SLASH": "slash", "LEFT_BRACKET": "left_bracket", "RIGHT_BRACKET": "right_bracket",
    "LEFT_CONTROL": "left_ctrl", "RIGHT_CONTROL": "right_ctrl", "LEFT_SHIFT": "left_shift",
    "RIGHT_SHIFT": "right_shift", "LEFT_ALT": "left_alt", "RIGHT_ALT": "right_alt", "LEFT_SUPER": "left_super",
    "RIGHT_SUPER": "right_super",
    **{chr(code): chr(code).lower() for code in range(ord("A"), ord("Z") + 1)},
    **{str(digit): f"_{digit}" for digit in range(10)},
    **{f"KP_{digit}": f"keypad{digit}" for digit in range(10)},
    **{f"F{number}": f"f{number}" for number in range(1, 13)},
}  # fmt: skip
_KEYS: dict[int, str] = {getattr(glfw, f"KEY_{glfw_name}"): name for glfw_name, name in _NAMED_KEYS.items()}


def key_name(code: int) -> str | None:
    """Return the name of a key by GLFW's code: a letter as it is printed on the key (Ctrl+Z is where Z is)."""
    if glfw.KEY_A <= code <= glfw.KEY_Z:
        printed = glfw.get_key_name(code, 0)
        text = printed.decode("utf-8", "replace") if isinstance(printed, bytes) else printed
        if text and len(text) == 1 and "a" <= text.lower() <= "z":
            return text.lower()
    return _KEYS.get(code)


def open_window(size: tuple[int, int] | None) -> Any:
    """Open a window of a size, or of that for who has none yet, with an OpenGL 3.3 context that is current.

    It is smaller if the display is.
    """
    glfw.ERROR_REPORTING = "ignore"
    if not glfw.init():
        raise InputError("cannot open a window: there is no display; write a picture with `milkglass render`")
    monitor = glfw.get_primary_monitor()
    if size is None:
        scale = glfw.get_monitor_content_scale(monitor)[0] if monitor and _counts_pixels() else 1.0
        size = round(scale * FIRST_SIZE[0]), round(scale * FIRST_SIZE[1])
    if monitor:
        _, _, width, height = glfw.get_monitor_workarea(monitor)
        size = (min(size[0], width or size[0]), min(size[1], height or size[1]))
    glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, 3)
    glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, 3)
    glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
    glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, sys.platform == "darwin")
    glfw.window_hint_string(glfw.X11_CLASS_NAME, "milkglass")
    handle = glfw.create_window(*size, "milkglass", None, None)
    if not handle:
        glfw.terminate()
        raise InputError("cannot open a window with OpenGL 3.3: the graphics driver has none; install or update it")
    glfw.set_window_size_limits(handle, *SMALLEST_SIZE, glfw.DONT_CARE, glfw.DONT_CARE)
    glfw.make_context_current(handle)
    glfw.swap_interval(1)
    return handle


def _text_scale(handle: Any) -> float:
    """Return how many window coordinates a letter takes, over those on a display of 96 dpi."""
    # On macOS and Wayland window coordinates are scaled already, on X11 and Windows they are pixels.
    width, pixels = glfw.get_window_size(handle)[0], glfw.get_framebuffer_size(handle)[0]
    scaled = pixels / width if width else 1.0
    content: float = glfw.get_window_content_scale(handle)[0]
    return content / max(scaled, 1e-3)


def _counts_pixels() -> bool:
    """Whether window coordinates are pixels, so that a window on a dense display needs more of them."""
    return glfw.get_platform() in (glfw.PLATFORM_X11, glfw.PLATFORM_WIN32)


def _refresh_rate() -> float:
    monitor = glfw.get_primary_monitor()
    mode = glfw.get_video_mode(monitor) if monitor else None
    return float(mode.refresh_rate) if mode is not None and mode.refresh_rate >= 24 else DEFAULT_RATE
