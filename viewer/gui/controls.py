"""Controls of settings: range, unit, tooltip and reset come from the table of settings.

A row is a label, the control, and a reset that appears when the value is not the default. Every row is known by name
(`Controls.boxes`), so that tests can click it.
"""

import dataclasses
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from milkglass.viewer.gui.sliders import Sliders
from milkglass.viewer.gui.toolkit import ERROR, MUTED, Gui, icons, imgui
from milkglass.viewer.scene.declaration import Setting, settings_of
from milkglass.viewer.scene.settings import TABLES
from milkglass.viewer.session.session import Session

CHANNELS = (("R", (0.93, 0.42, 0.40)), ("G", (0.45, 0.80, 0.45)), ("B", (0.45, 0.62, 0.95)))


BOUNDLESS = 1e5  # to both sides of 0, from which on a range tells nobody anything
LABEL_SHARE = 0.36  # of the panel's width
TYPE_HINT = "Ctrl+click to type a number, right click to reset."
RESET_HINT = "Right click to reset."
Box = tuple[float, float, float, float]  # left, top, right, bottom


class Reach(NamedTuple):
    """The range of a slider, narrower than that of its setting; a typed number may lie outside."""

    low: float
    high: float
    logarithmic: bool = False
    format: str = "%.3g"


class Reset(NamedTuple):
    """The default of a row, and what brings it back."""

    default: Any
    run: Callable[[], object]


REACH = {
    "model.size_mm": Reach(1.0, 1000.0, True, "%.1f"),
    "camera.azimuth_deg": Reach(-180.0, 180.0, False, "%.1f"),
    "camera.elevation_deg": Reach(-90.0, 90.0, False, "%.1f"),
    "camera.roll_deg": Reach(-180.0, 180.0, False, "%.1f"),
    "camera.view_angle_deg": Reach(5.0, 100.0, False, "%.1f"),
    "camera.zoom": Reach(0.1, 20.0, True, "%.2f"),
    "material.sigma_s_prime": Reach(0.0, 100.0, True, "%.4f"),
    "material.sigma_a": Reach(0.0, 100.0, True, "%.4f"),
    "material.eta": Reach(1.0, 2.5, False, "%.3f"),
    "material.g": Reach(0.0, 0.999, False, "%.3f"),
    "material.mix_share": Reach(0.0, 1.0, False, "%.3f"),
    "material.water": Reach(0.0, 1.0, False, "%.4g"),
    "detail.normal_strength": Reach(0.0, 3.0, False, "%.2f"),
    "specular.strength": Reach(0.0, 3.0, False, "%.2f"),
    "specular.shininess": Reach(1.0, 2000.0, True, "%.0f"),
    "environment.rotation_deg": Reach(-180.0, 180.0, False, "%.1f"),
    "environment.intensity": Reach(0.0, 100.0, True, "%.3f"),
    "ground.gap_mm": Reach(0.0, 100.0, False, "%.2f"),
    "transport.layers": Reach(1, 80),
    "transport.resolution": Reach(16, 512),
    "transport.error_target": Reach(0.001, 0.2, True, "%.3f"),
    "photo.depth_strength": Reach(0.2, 3.0, True, "%.2f"),
    "photo.depth_smoothing": Reach(0.02, 0.5, True, "%.3f"),
    "display.key": Reach(0.01, 2.0, True, "%.3f"),
    "display.exposure": Reach(-6.0, 6.0, False, "%.2f"),
    "display.average": Reach(1e-3, 10.0, True, "%.4g"),
    "display.white": Reach(0.1, 100.0, True, "%.2f"),
    "display.background_blur_deg": Reach(0.0, 60.0, False, "%.1f"),
}
UNITS = {"deg": "°", "1/mm": " /mm", "px": " px", "nodes": " nodes", "mm": " mm", "stops": " stops"}


class Controls:
    """Draws rows in the current ImGui window and passes changes on to a session.

    Attributes
    ----------
    session : Session
    boxes : dict of str to Box
        Where the controls of this frame lie in the window, by their names.
    sliders : Sliders
    """

    def __init__(self, session: Session, gui: Gui) -> None:
        self.session = session
        self.boxes: dict[str, Box] = {}
        self.sliders = Sliders()
        self._gui = gui
        self._heights: dict[str, tuple[Hashable, float]] = {}  # of blocks that change while one looks
        self._labels: tuple[float, float] = (0.0, 0.0)

    def begin(self) -> None:
        """Forget the boxes of the frame before."""
        self.boxes.clear()

    # rows of settings

    def setting(self, name: str, label: str, automatic: float | str | None = None, *, off: str | None = None) -> None:
        """Draw the control of a scalar setting, "table.key".

        `automatic` is what None stands for now; `off` says why the setting means nothing now, a sentence.
        """
        table, key = name.split(".")
        current = getattr(self.session.scene, table)
        declared, value = settings_of(current)[key], getattr(current, key)
        default = default_of(table, key)
        if value is None and automatic is None:
            return
        changed = self.value(
            name, label, declared, value, Reset(default, lambda: self._put(table, key, default)),
            automatic=automatic, off=off,
        )  # fmt: skip
        if changed is not None:
            self._put(table, key, changed)

    def value(
        self, name: str, label: str, declared: Setting, value: Any, reset: Reset, *,
        reach: Reach | None = None, automatic: float | str | None = None, off: str | None = None,
    ) -> Any:  # fmt: skip
        """Draw the control of any value that a `Setting` describes; returns the new value, None if unchanged."""
        imgui.begin_disabled(off is not None)
        self.begin_row(label, resettable=True)
        if declared.choices and not declared.pattern and not declared.is_number:
            new = self._choice(name, declared, value, automatic)
        elif declared.kind == "boolean":
            changed, new = imgui.checkbox(f"##{name}", value)
            new = new if changed else None
        elif declared.kind == "integer":
            new = self._integer(name, declared, value, reach or REACH.get(name), automatic)
        else:
            new = self._number(name, declared, value, reach or REACH.get(name), automatic)
        hint = TYPE_HINT if declared.is_number else RESET_HINT
        tip = explained(declared, reset.default) + "\n" + (hint if off is None else off)
        self.end_row(name, label, tip, reset.run, differs=value != reset.default, is_off=off is not None)
        imgui.end_disabled()
        return new

    # the parts of a row

    def begin_row(self, label: str, *, resettable: bool = False, colour: Any = None) -> None:
        """Draw the label of a row, whose control is the next ImGui item; leave room for a reset if `resettable`."""
        imgui.align_text_to_frame_padding()
        start = imgui.get_cursor_screen_pos()
        if colour is not None:
            imgui.text_colored((*colour, 1.0), label)
        else:
            imgui.text_unformatted(label)
        self._labels = (start.x, start.y)
        width = imgui.get_content_region_avail().x
        imgui.same_line(imgui.get_cursor_pos_x() + width * LABEL_SHARE)
        spare = (imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x) if resettable else 0.0
        imgui.set_next_item_width(-max(spare, 1.0))

    def end_row(
        self, name: str, label: str, tip: str, on_reset: Callable[[], object] | None = None,
        *, differs: bool = False, is_off: bool = False,
    ) -> None:  # fmt: skip
        """Finish a row after its control: note its box, draw the tooltip, and the reset unless the row is off."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.boxes[name] = (low.x, low.y, high.x, high.y)
        label_hovered = imgui.is_mouse_hovering_rect((self._labels[0], low.y), (low.x, high.y))
        label_hovered = label_hovered and imgui.is_window_hovered()
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value) or label_hovered:
            self.tooltip(label, tip)
        if on_reset is None:
            return
        right = imgui.MouseButton_.right.value
        if not is_off and (imgui.is_item_hovered() or label_hovered) and imgui.is_mouse_clicked(right):
            on_reset()
        imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
        if differs:
            if self.icon(f"{name}.reset", icons.ICON_FA_ARROW_ROTATE_LEFT, "Reset", quiet=True):
                on_reset()
        else:
            imgui.dummy((imgui.get_frame_height(), imgui.get_frame_height()))

    def icon(self, name: str, icon: str, tip: str, *, quiet: bool = False, on: bool = False) -> bool:
        """Draw a square button with an icon, and return whether it was clicked."""
        if quiet:
            imgui.push_style_color(imgui.Col_.button.value, (0.0, 0.0, 0.0, 0.0))
            imgui.push_style_color(imgui.Col_.text.value, (*MUTED, 1.0))
        elif on:
            imgui.push_style_color(imgui.Col_.button.value, imgui.get_style().color_(imgui.Col_.button_active))
        side = imgui.get_frame_height()
        padding = imgui.get_style().frame_padding
        imgui.push_style_var(imgui.StyleVar_.frame_padding.value, (0.0, padding.y))
        clicked = bool(imgui.button(f"{icon}##{name}", (side, side)))
        imgui.pop_style_var()
        if quiet:
            imgui.pop_style_color(2)
        elif on:
            imgui.pop_style_color()
        self.mark(name)
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
            self.tooltip("", tip)
        return clicked

    def mark(self, name: str) -> None:
        """Note the box of the last ImGui item under a name."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.boxes[name] = (low.x, low.y, high.x, high.y)

    def tooltip(self, title: str, text: str) -> None:
        """Show a tooltip at the pointer."""
        if not imgui.begin_tooltip():
            return
        imgui.push_text_wrap_pos(imgui.get_font_size() * 22.0)
        if title:
            imgui.push_font(self._gui.bold, 0.0)
            imgui.text_unformatted(title)
            imgui.pop_font()
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()

    def note(self, text: str, *, warning: bool = False) -> None:
        """Draw a sentence in small letters, wrapped."""
        imgui.push_style_color(imgui.Col_.text.value, (*(ERROR if warning else MUTED), 1.0))
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.pop_style_color()

    @contextmanager
    def steady(self, name: str, key: Hashable) -> Iterator[None]:
        """Keep what is drawn in a block as high as it has been for a key, so that rows below it stay where they are."""
        start, width = imgui.get_cursor_pos_y(), imgui.get_content_region_avail().x
        yield
        spacing = imgui.get_style().item_spacing.y
        height = imgui.get_cursor_pos_y() - start
        known, least = self._heights.get(name, (None, 0.0))
        least = least if known == (key, width) else 0.0
        if height + spacing < least:
            imgui.dummy((0.0, least - height - spacing))
        self._heights[name] = (key, width), max(height, least)

    def section(self, label: str, *, is_open: bool = False) -> bool:
        """Draw a heading that folds, and return whether the rows below it show."""
        imgui.push_font(self._gui.bold, 0.0)
        flags = imgui.TreeNodeFlags_.default_open.value if is_open else 0
        shown = bool(imgui.collapsing_header(label, flags))
        imgui.pop_font()
        self.mark(f"section.{label}")
        return shown

    def choice(
        self,
        name: str,
        current: str | None,
        choices: Iterable[str],
        shown: str | None = None,
        tips: Mapping[str, str] | None = None,
        flags: int = 0,
    ) -> str | None:
        """Draw a combo box, and return the choice if it differs from `current`; the caller ends the row.

        `shown` stands for a `current` that is no choice; `tips` are tooltips of choices.
        """
        new = None
        if imgui.begin_combo(f"##{name}", shown or current or "", flags):
            for choice in choices:
                clicked, _ = imgui.selectable(choice, choice == current)
                self.mark(f"{name}={choice}")
                if tips and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                    self.tooltip(choice, tips[choice])
                if clicked and choice != current:
                    new = choice
            imgui.end_combo()
        return new

    def several(self, name: str, chosen: Collection[str], choices: Sequence[str], shown: str) -> list[str] | None:
        """Draw a combo box of check boxes, and return what is chosen if that changes; the caller ends the row."""
        new = None
        if imgui.begin_combo(f"##{name}", shown, imgui.ComboFlags_.height_large.value):
            for choice in choices:
                changed, is_on = imgui.checkbox(choice, choice in chosen)
                self.mark(f"{name}={choice}")
                if changed:
                    new = [other for other in choices if (is_on if other == choice else other in chosen)]
            imgui.end_combo()
        return new

    # kinds of control

    def _choice(self, name: str, declared: Setting, value: Any, automatic: float | str | None) -> Any:
        return self.choice(name, value, declared.choices, f"auto: {automatic}" if value is None else str(value))

    def _integer(
        self, name: str, declared: Setting, value: int | None, reach: Reach | None, automatic: float | str | None
    ) -> int | None:
        low, high = (int(reach.low), int(reach.high)) if reach else (int(declared.low or 0), int(declared.high or 100))
        shown = int(automatic or low) if value is None else value
        text = f"{'auto: ' if value is None else ''}{shown}{UNITS.get(declared.unit, '')}"
        new = self.sliders.integer(name, shown, low, max(high, shown), text)
        return new if new is None or declared.high is None else min(new, int(declared.high))

    def _number(
        self,
        name: str,
        declared: Setting,
        value: float | str | None,
        reach: Reach | None,
        automatic: float | str | None,
    ) -> float | None:
        reach = reach or Reach(declared.low or 0.0, declared.high or 1.0)
        is_word = not isinstance(value, float | int)
        shown = value if isinstance(value, float | int) else float(automatic or reach.low)
        word = f"{value or 'auto'}: " if is_word else ""
        text = f"{word}{reach.format % shown}{UNITS.get(declared.unit, '')}"
        return self.sliders.number(name, shown, reach.low, reach.high, text, logarithmic=reach.logarithmic)

    def _put(self, table: str, key: str, value: Any) -> None:
        self.session.edit(table, **{key: value})


def default_of(table: str, key: str) -> Any:
    """Return the default of a setting."""
    return next(field.default for field in dataclasses.fields(TABLES[table]) if field.name == key)


def explained(declared: Setting, default: Any) -> str:
    """Return the tooltip of a setting: its purpose, unit, range and default."""
    purpose = declared.tip or declared.why
    text = purpose[:1].upper() + purpose[1:] + "."
    facts = [declared.unit and f"unit {declared.unit}"]
    is_bounded = min(-(declared.low or 0.0), declared.high or 0.0) < BOUNDLESS
    facts += [declared.range_text()] if declared.is_number and is_bounded else []
    if declared.default_text or default not in (None, dataclasses.MISSING):
        shown = ("off", "on")[default] if declared.kind == "boolean" else default
        facts.append(f"default {declared.default_text or shown}")
    facts = [fact for fact in facts if fact]
    return text + ("\n" + ", ".join(facts) if facts else "")
