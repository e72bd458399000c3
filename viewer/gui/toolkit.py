"""Dear ImGui and ImPlot, and the only module that imports them: `from milkglass.viewer.gui.toolkit import imgui`.

Context, fonts, colours and the translation of events are here too.
"""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imgui_bundle
from imgui_bundle import icons_fontawesome_6 as icons, imgui, implot

from milkglass.viewer.gui.events import (
    BUTTONS,
    Event,
    Focused,
    Key,
    MouseButton,
    MouseMoved,
    Resized,
    Scrolled,
    Typed,
)

__all__ = ["Gui", "icons", "imgui", "implot"]

FONTS = Path(imgui_bundle.__file__).parent / "assets" / "fonts"
TEXT = FONTS / "Roboto" / "Roboto-Regular.ttf"
BOLD = FONTS / "Roboto" / "Roboto-Bold.ttf"
ICONS = FONTS / "Font_Awesome_6_Free-Solid-900.otf"
TEXT_SIZE = 15.0  # px at a text scale of 1

BACKGROUND = (0.085, 0.09, 0.095)  # of the window
ACCENT = (0.40, 0.72, 0.62)  # jade
ERROR = (0.96, 0.45, 0.40)
WARNING = (0.95, 0.72, 0.30)
GOOD = ACCENT
MUTED = (0.60, 0.62, 0.65)
MODIFIERS = {"ctrl": "mod_ctrl", "shift": "mod_shift", "alt": "mod_alt", "super": "mod_super"}


class Gui:
    """Holds an ImGui context, which events are fed to; it has no window of its own.

    Attributes
    ----------
    size : (width, height) of the window, window coordinates
    pixels : (width, height) of its framebuffer
    """

    def __init__(self) -> None:
        self._context = imgui.create_context()
        imgui.set_current_context(self._context)
        io = imgui.get_io()
        io.set_ini_filename("")  # we remember what is worth remembering
        io.config_input_text_cursor_blink = False  # blinking would redraw an idle window
        io.config_error_recovery_enable_assert = False
        io.backend_flags |= imgui.BackendFlags_.renderer_has_textures.value
        io.backend_flags |= imgui.BackendFlags_.has_mouse_cursors.value
        self._held: set[str] = set()
        self._queue: deque[Event] = deque()
        self._time: float | None = None
        self._text_scale = 0.0
        self.size, self.pixels = (1, 1), (1, 1)
        self.text = _font(TEXT)
        self.bold = _font(BOLD)

    def feed(self, event: Event) -> None:
        """Queue an event for the next frames."""
        if isinstance(event, Resized):
            self.size, self.pixels = event.size, event.pixels
            imgui.set_current_context(self._context)
            self._scale(event.text_scale)
        else:
            self._queue.append(event)

    @property
    def has_events(self) -> bool:
        """Whether events wait for another frame, here or in ImGui, which takes a letter and a key one after another."""
        return bool(self._queue) or len(self._context.input_events_queue) > 0

    def _feed_frame(self) -> None:
        """Pass events on to ImGui, as many as one frame may see.

        ImGui looks at keys once a frame: a Ctrl that is let go in the frame in which S went down would not be seen,
        nor would the end of a drag whose button goes up in the same frame.
        """
        pressed = moved = False
        while self._queue:
            event = self._queue[0]
            if isinstance(event, Key):
                is_modifier = event.name.partition("_")[2] in MODIFIERS
                if is_modifier and pressed:
                    return
                pressed = pressed or (event.pressed and not is_modifier)
            if isinstance(event, MouseButton) and moved:
                return
            moved = moved or isinstance(event, MouseMoved)
            self._pass_on(self._queue.popleft())
            if isinstance(event, MouseButton):
                return

    def _pass_on(self, event: Event) -> None:
        io = imgui.get_io()
        if isinstance(event, MouseMoved):
            io.add_mouse_pos_event(event.x, event.y)
        elif isinstance(event, MouseButton):
            io.add_mouse_button_event(BUTTONS.index(event.button), event.pressed)
        elif isinstance(event, Scrolled):
            io.add_mouse_wheel_event(event.x, event.y)
        elif isinstance(event, Key):
            self._key(event)
        elif isinstance(event, Typed):
            io.add_input_characters_utf8(event.text)
        elif isinstance(event, Focused):
            self._focus(focused=event.focused)

    def begin(self, now: float) -> None:
        """Start a frame; `now` in seconds, from any start."""
        imgui.set_current_context(self._context)
        self._feed_frame()
        io = imgui.get_io()
        io.display_size = imgui.ImVec2(*map(float, self.size))
        width, height = (max(1, side) for side in self.size)
        io.display_framebuffer_scale = imgui.ImVec2(self.pixels[0] / width, self.pixels[1] / height)
        # ImGui wants time to pass; a very long step would hold a key's repeat or a double click apart.
        io.delta_time = min(max(1e-4, now - self._time), 10.0) if self._time is not None else 1.0 / 60.0
        self._time = now
        imgui.new_frame()

    def navigate(self, *, on: bool) -> None:
        """Have keys move from control to control, from the next frame on, or no longer."""
        io, keys = imgui.get_io(), imgui.ConfigFlags_.nav_enable_keyboard.value
        io.config_flags = io.config_flags | keys if on else io.config_flags & ~keys

    def share_clipboard(self, get: Callable[[], str], put: Callable[[str], object]) -> None:
        """Let text fields copy and paste through a clipboard."""
        platform: Any = imgui.get_platform_io()
        platform.platform_get_clipboard_text_fn = lambda _: get()
        platform.platform_set_clipboard_text_fn = lambda _, text: put(text)

    def end(self) -> Any:
        """Finish the frame and return its draw data."""
        imgui.render()
        return imgui.get_draw_data()

    def close(self) -> None:
        """Free the context."""
        imgui.destroy_context(self._context)

    def _key(self, event: Key) -> None:
        key = getattr(imgui.Key, event.name, None)
        if key is None:
            return
        (self._held.add if event.pressed else self._held.discard)(event.name)
        io = imgui.get_io()
        for name, modifier in MODIFIERS.items():
            if event.name in (f"left_{name}", f"right_{name}"):
                down = {f"left_{name}", f"right_{name}"} & self._held
                io.add_key_event(getattr(imgui.Key, modifier), bool(down))
        io.add_key_event(key, event.pressed)

    def _focus(self, *, focused: bool) -> None:
        io = imgui.get_io()
        io.add_focus_event(focused)
        if not focused:  # what is released elsewhere is never reported here
            self._held.clear()
            for button in range(len(BUTTONS)):
                io.add_mouse_button_event(button, False)

    def _scale(self, text_scale: float) -> None:
        if text_scale == self._text_scale:
            return
        self._text_scale = text_scale
        style = imgui.get_style()
        _set_style(style)
        style.scale_all_sizes(text_scale)
        style.font_size_base = TEXT_SIZE
        style.font_scale_dpi = text_scale


def _font(path: Path) -> Any:
    """Load a font with our icons merged in; glyphs are drawn as they come into use."""
    fonts = imgui.get_io().fonts
    font = fonts.add_font_from_file_ttf(str(path), TEXT_SIZE)
    merged = imgui.ImFontConfig()
    merged.merge_mode = True
    merged.glyph_offset = imgui.ImVec2(0.0, 1.0)
    merged.glyph_min_advance_x = TEXT_SIZE
    fonts.add_font_from_file_ttf(str(ICONS), TEXT_SIZE * 0.86, merged)
    return font


def _set_style(style: Any) -> None:
    """Dark and quiet, so that the picture's colours are judged on neutral grey; one accent."""
    imgui.style_colors_dark(style)
    style.window_padding = (12, 10)
    style.frame_padding = (7, 4)
    style.item_spacing = (7, 6)
    style.item_inner_spacing = (6, 4)
    style.indent_spacing = 14
    style.scrollbar_size = 11
    style.grab_min_size = 5
    style.window_rounding = 6
    style.child_rounding = 4
    style.frame_rounding = 4
    style.popup_rounding = 6
    style.grab_rounding = 3
    style.scrollbar_rounding = 6
    style.window_border_size = 0
    style.popup_border_size = 1
    style.hover_stationary_delay = 0.25
    style.hover_delay_normal = 0.45
    style.disabled_alpha = 0.4
    red, green, blue = ACCENT
    palette = {
        "text": (0.88, 0.89, 0.90, 1.0),
        "text_disabled": (*MUTED, 1.0),
        "window_bg": (0.125, 0.13, 0.14, 1.0),
        "popup_bg": (0.15, 0.155, 0.165, 0.98),
        "border": (0.27, 0.28, 0.30, 1.0),
        "frame_bg": (0.20, 0.207, 0.22, 1.0),
        "frame_bg_hovered": (0.255, 0.265, 0.28, 1.0),
        "frame_bg_active": (0.29, 0.30, 0.32, 1.0),
        "header": (0.175, 0.18, 0.192, 1.0),
        "header_hovered": (0.23, 0.24, 0.255, 1.0),
        "header_active": (0.26, 0.27, 0.285, 1.0),
        "button": (0.215, 0.222, 0.235, 1.0),
        "button_hovered": (0.28, 0.29, 0.31, 1.0),
        "button_active": (red * 0.6, green * 0.6, blue * 0.6, 1.0),
        "slider_grab": (red * 0.7, green * 0.7, blue * 0.7, 1.0),
        "slider_grab_active": (red * 0.85, green * 0.85, blue * 0.85, 1.0),
        "check_mark": (red, green, blue, 1.0),
        "text_selected_bg": (red, green, blue, 0.35),
        "nav_cursor": (red, green, blue, 1.0),
        "separator": (0.24, 0.25, 0.265, 1.0),
        "scrollbar_bg": (0.0, 0.0, 0.0, 0.0),
        "modal_window_dim_bg": (0.0, 0.0, 0.0, 0.45),
        "title_bg": (0.15, 0.155, 0.165, 1.0),
        "title_bg_active": (0.17, 0.175, 0.187, 1.0),
        "plot_histogram": (red, green, blue, 1.0),
    }
    for name, colour in palette.items():
        style.set_color_(getattr(imgui.Col_, name), colour)
