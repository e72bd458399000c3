"""Sliders drawn as a bar that fills up to the value, with the value over it.

Dear ImGui's own does the work (drag, Ctrl+click to type); only its paint is ours.
"""

import math
from typing import Any

from milkglass.viewer.gui.toolkit import ACCENT, imgui


def percent(share: float) -> str:
    """Return a share as text in per cent, with two significant digits."""
    return f"{significant(100.0 * share, 2)} %"


def duration(seconds: float) -> str:
    """Return a time as a person says it: "40 ms", "1.4 s", "22 s", "3 min"."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.0f} ms"
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"


DECIMALS = 6  # ImGui's logarithmic scale starts at 10^-DECIMALS where a slider starts at 0


class Sliders:
    """Draws sliders, and keeps the name of the slider that a number is typed into."""

    def __init__(self) -> None:
        self._typing = ""

    def number(
        self, name: str, value: float, low: float, high: float, text: str, *, logarithmic: bool = False,
        colour: tuple[float, float, float] = ACCENT,
    ) -> float | None:  # fmt: skip
        """Draw a slider from `low` to `high` that shows `text`; returns the new value, None if unchanged."""
        flags = imgui.SliderFlags_.logarithmic.value if logarithmic else 0
        self._hide(name)
        changed, new = imgui.slider_float(f"##{name}", value, low, high, f"%.{DECIMALS}f", flags)
        self._paint(name, position(value, low, high, logarithmic=logarithmic), text, colour)
        return float(f"{new:.6g}") if changed else None

    def integer(self, name: str, value: int, low: int, high: int, text: str) -> int | None:
        """Draw a slider of whole numbers that shows `text`; returns the new value, None if unchanged."""
        self._hide(name)
        changed, new = imgui.slider_int(f"##{name}", value, low, high)
        self._paint(name, position(value, low, high, logarithmic=False), text, ACCENT)
        return int(new) if changed else None

    def _hide(self, name: str) -> None:
        """Make ImGui's own paint invisible, unless its text is being edited."""
        colours = [imgui.Col_.slider_grab, imgui.Col_.slider_grab_active]
        colours += [] if name == self._typing else [imgui.Col_.text]
        for colour in colours:
            imgui.push_style_color(colour.value, (0.0, 0.0, 0.0, 0.0))
        self._pushed = len(colours)

    def _paint(self, name: str, share: float, text: str, colour: tuple[float, float, float]) -> None:
        imgui.pop_style_color(self._pushed)
        active = imgui.is_item_active()
        typing = active and imgui.get_io().want_text_input
        if typing or name == self._typing:
            self._typing = name if typing or active else ""
            if typing:
                return
        draw: Any = imgui.get_window_draw_list()
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        rounding = imgui.get_style().frame_rounding
        strength = 0.62 if active else 0.52 if imgui.is_item_hovered() else 0.42
        inset = imgui.get_style().grab_min_size * 0.5 + 2.0  # where ImGui's own handle would stop
        edge = low.x + inset + share * (high.x - low.x - 2.0 * inset)
        red, green, blue = colour
        bar = imgui.get_color_u32((strength * red, strength * green, strength * blue, 1.0))
        draw.add_rect_filled((low.x, low.y), (max(edge, low.x + 1.5), high.y), bar, rounding)
        size = imgui.calc_text_size(text)
        place = (0.5 * (low.x + high.x - size.x), 0.5 * (low.y + high.y - size.y))
        draw.push_clip_rect((low.x, low.y), (high.x, high.y), True)
        draw.add_text(place, imgui.get_color_u32(imgui.Col_.text.value), text)
        draw.pop_clip_rect()


def position(value: float, low: float, high: float, *, logarithmic: bool) -> float:
    """Return the place of a value on a slider, [0, 1], on the scale that ImGui uses."""
    if high <= low:
        return 0.0
    if not logarithmic:
        return min(1.0, max(0.0, (value - low) / (high - low)))
    start = max(low, 10.0**-DECIMALS)
    return min(1.0, max(0.0, math.log(max(value, start) / start) / math.log(high / start)))


def significant(value: float, digits: int = 3) -> str:
    """Return a number as text with some significant digits, in powers of ten only where very large or small."""
    if value == 0.0 or not 1e-6 <= abs(value) < 1e6:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"
