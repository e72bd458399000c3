"""Texts over the view: messages, the cheat sheet, the status line."""

from dataclasses import dataclass
from typing import Any

from milkglass.viewer.gui.command import Rows
from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.toolkit import ERROR, MUTED, Gui, icons, imgui
from milkglass.viewer.session.session import Message

MESSAGE_SECONDS, ERROR_SECONDS = 4.0, 15.0
GAP = "   "  # between parts of the status line
LARGEST_COUNT = 4  # of messages at once


@dataclass(frozen=True)
class _Shown:
    message: Message
    until: float


class Messages:
    """Shows messages at the foot of the view, for some seconds."""

    def __init__(self) -> None:
        self._shown: list[_Shown] = []

    def take(self, messages: list[Message], now: float) -> None:
        """Show new messages, emptying the list; a repeated one starts anew."""
        for message in messages:
            self._shown = [shown for shown in self._shown if shown.message != message]
            self._shown.append(_Shown(message, now + (ERROR_SECONDS if message.is_error else MESSAGE_SECONDS)))
        messages.clear()
        self._shown = [shown for shown in self._shown if shown.until > now][-LARGEST_COUNT:]

    @property
    def texts(self) -> list[str]:
        """Sentences that show."""
        return [shown.message.text for shown in self._shown]

    def next_end(self) -> float | None:
        """Time at which the next message goes away, None if none shows."""
        return min((shown.until for shown in self._shown), default=None)

    def clear(self) -> bool:
        """Take all messages away, and return whether there were any."""
        had_any = bool(self._shown)
        self._shown.clear()
        return had_any

    def draw(self, view: Box) -> None:
        """Draw the messages at the foot of the view, the newest lowest."""
        bottom = view[3] - 3.0 * imgui.get_font_size()
        for i, shown in enumerate(reversed(self._shown)):
            width = min(46.0 * imgui.get_font_size(), view[2] - view[0] - 24.0)
            imgui.set_next_window_pos((0.5 * (view[0] + view[2]), bottom), imgui.Cond_.always.value, (0.5, 1.0))
            imgui.set_next_window_size_constraints((60.0, 0.0), (width, 400.0))
            imgui.set_next_window_bg_alpha(0.93)
            if imgui.begin(f"##message{i}", None, _float_flags())[0]:
                is_error = shown.message.is_error
                icon = icons.ICON_FA_TRIANGLE_EXCLAMATION if is_error else icons.ICON_FA_CIRCLE_INFO
                imgui.text_colored((*(ERROR if is_error else MUTED), 1.0), icon)
                imgui.same_line()
                imgui.push_text_wrap_pos(width - 20.0)
                imgui.text_unformatted(shown.message.text)
                imgui.pop_text_wrap_pos()
                clicked = imgui.is_window_hovered() and imgui.is_mouse_clicked(imgui.MouseButton_.left.value)
                bottom -= imgui.get_window_height() + 6.0
                if clicked:
                    self._shown.remove(shown)
            imgui.end()


def draw_status(view: Box, left: str, right: str) -> None:
    """Write the status line at the foot of the view: progress on the right, the model on the left.

    Where there is no room for both the model goes, and then what comes last in the progress.
    """
    draw: Any = imgui.get_window_draw_list()
    style = imgui.get_style()

    def overflows() -> bool:
        return bool(imgui.calc_text_size(left + GAP + right).x + 2.0 * style.window_padding.x > view[2] - view[0])

    if right and overflows():
        left = ""
    while GAP in right and overflows():
        right = right.rpartition(GAP)[0]
    height = imgui.get_font_size()
    y = view[3] - height - style.window_padding.y
    for text, x in (
        (left, view[0] + style.window_padding.x),
        (right, view[2] - style.window_padding.x - imgui.calc_text_size(right).x),
    ):
        if text:
            draw.add_text((x + 1.0, y + 1.0), imgui.get_color_u32((0.0, 0.0, 0.0, 0.8)), text)
            draw.add_text((x, y), imgui.get_color_u32((0.72, 0.73, 0.75, 1.0)), text)


def draw_label(corner: tuple[float, float], text: str, *, from_right: bool = False) -> None:
    """Write a label on a dark plate, such as the A and B of a comparison."""
    draw: Any = imgui.get_window_draw_list()
    size = imgui.calc_text_size(text)
    x, y = (corner[0] - size.x - 20.0 if from_right else corner[0] + 8.0), corner[1] + 8.0
    draw.add_rect_filled((x, y), (x + size.x + 12.0, y + size.y + 6.0), imgui.get_color_u32((0.0, 0.0, 0.0, 0.6)), 4.0)
    draw.add_text((x + 6.0, y + 3.0), imgui.get_color_u32((0.9, 0.9, 0.9, 1.0)), text)


def draw_help(gui: Gui, groups: list[tuple[str, Rows]]) -> tuple[Box, Box]:
    """Draw the cheat sheet, groups of rows under headings, in the middle of the window.

    It has two columns, two groups in the first, or one where the window is narrow; it scrolls where it is low.
    Returns the boxes of the sheet and of all that is in it, as far as it is scrolled.
    """
    window, em = imgui.get_io().display_size, imgui.get_font_size()
    columns = [groups[:2], groups[2:]]
    style, gap = imgui.get_style(), 2.0 * em
    widths = [max(_help_width(rows) for _, rows in column) for column in columns]
    if sum(widths) + gap + 2.0 * style.window_padding.x > window.x:
        columns, widths = [groups], [max(widths)]
    imgui.set_next_window_pos((0.5 * window.x, 0.5 * window.y), imgui.Cond_.always.value, (0.5, 0.5))
    imgui.set_next_window_bg_alpha(1.0)
    width = min(window.x, sum(widths) + gap * (len(columns) - 1) + 2.0 * style.window_padding.x + style.scrollbar_size)
    imgui.set_next_window_size_constraints((width, 0.0), (width, window.y))
    flags = _float_flags() & ~imgui.WindowFlags_.no_scrollbar.value
    sheet = content = (0.0, 0.0, 0.0, 0.0)
    if imgui.begin("##help", None, flags)[0]:
        imgui.begin_group()
        for i, column in enumerate(columns):
            if i:
                imgui.same_line(0.0, gap)
            imgui.begin_group()
            for title, rows in column:
                _help_group(gui, title, rows)
            imgui.end_group()
        imgui.end_group()
        content = (*imgui.get_item_rect_min(), *imgui.get_item_rect_max())
        place, size = imgui.get_window_pos(), imgui.get_window_size()
        sheet = (place.x, place.y, place.x + size.x, place.y + size.y)
    imgui.end()
    return sheet, content


def _help_width(rows: Rows) -> float:
    """Return the width of the rows of a group."""
    keys, titles = (max(imgui.calc_text_size(row[i]).x for row in rows) for i in range(2))
    return float(keys + titles + imgui.get_font_size())


def _help_group(gui: Gui, title: str, rows: Rows) -> None:
    imgui.push_font(gui.bold, 0.0)
    imgui.text_unformatted(title)
    imgui.pop_font()
    start, em = imgui.get_cursor_pos_x(), imgui.get_font_size()
    keys_width = max(imgui.calc_text_size(keys).x for keys, _ in rows) + em
    imgui.push_text_wrap_pos(0.0)
    for keys, title in rows:
        imgui.text_unformatted(keys)
        imgui.same_line()
        imgui.set_cursor_pos_x(start + keys_width)
        imgui.text_disabled(title)
    imgui.pop_text_wrap_pos()
    imgui.spacing()


def _float_flags() -> int:
    flags = imgui.WindowFlags_
    return int(
        flags.no_decoration.value
        | flags.always_auto_resize.value
        | flags.no_saved_settings.value
        | flags.no_focus_on_appearing.value
        | flags.no_nav.value
        | flags.no_move.value
    )
