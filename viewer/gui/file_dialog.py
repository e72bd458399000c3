"""A dialog to open and save files, drawn with Dear ImGui: the same on every machine, and driven by tests."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from milkglass.viewer.gui.toolkit import icons, imgui

TITLE = "file dialog"
ROWS = 15


@dataclass(frozen=True)
class Request:
    """A purpose of the dialog: its title, the `suffixes` that it lists, the callback `done` of the chosen path."""

    title: str
    suffixes: tuple[str, ...]
    done: Callable[[Path], object]
    save_as: str = ""  # a suggested name: the dialog writes a file
    folder: Path | None = None  # to start in, where that is not the last one


class FileDialog:
    """Shows a modal dialog, at most one at a time."""

    def __init__(self) -> None:
        self.request: Request | None = None
        self.folder = Path.cwd()
        self.name = ""
        self._typed_folder = ""
        self._entries: list[tuple[str, bool]] = []
        self._error = ""
        self._opening = False
        self.boxes: dict[str, tuple[float, float, float, float]] = {}  # of the entries, in the last frame
        self._entered = False  # whether the last click in the list opened a folder

    @property
    def is_open(self) -> bool:
        """Whether the dialog shows."""
        return self.request is not None

    def open(self, request: Request, folder: Path) -> None:
        """Show the dialog in a folder, from the next frame on."""
        self.request, self.name, self._opening = request, request.save_as, True
        self._go(folder)

    def close(self) -> None:
        """Close the dialog without a choice."""
        self.request = None

    def draw(self) -> None:
        """Draw the dialog in the middle of the window while it is open, and run `done` with the chosen path."""
        if self.request is None:
            return
        if self._opening:
            imgui.open_popup(TITLE)
        size = imgui.get_io().display_size
        em = imgui.get_font_size()
        imgui.set_next_window_pos((0.5 * size.x, 0.5 * size.y), imgui.Cond_.always.value, (0.5, 0.5))
        imgui.set_next_window_size((min(44.0 * em, 0.95 * size.x), 0.0))
        flags = imgui.WindowFlags_.no_resize.value | imgui.WindowFlags_.no_title_bar.value
        shown, _ = imgui.begin_popup_modal(TITLE, None, flags)
        if not shown:
            return
        chosen = self._contents(self.request)
        if chosen is not None or imgui.is_key_pressed(imgui.Key.escape):
            imgui.close_current_popup()
            request, self.request = self.request, None
            if chosen is not None:
                request.done(chosen)
        self._opening = False
        imgui.end_popup()

    def _contents(self, request: Request) -> Path | None:
        imgui.text_unformatted(request.title)
        chosen = None
        if imgui.button(f"{icons.ICON_FA_ARROW_UP}##up"):
            self._go(self.folder.parent)
        imgui.same_line()
        if imgui.button(f"{icons.ICON_FA_HOUSE}##home"):
            self._go(Path.home())
        imgui.same_line()
        imgui.set_next_item_width(-1.0)
        enter = imgui.InputTextFlags_.enter_returns_true.value
        went, self._typed_folder = imgui.input_text("##folder", self._typed_folder, enter)
        if went:
            self._go(Path(os.path.expanduser(self._typed_folder)))
        height = ROWS * imgui.get_text_line_height_with_spacing()
        imgui.begin_child("##files", (0.0, height), imgui.ChildFlags_.borders.value)
        self.boxes.clear()
        for name, is_folder in self._entries:
            icon = icons.ICON_FA_FOLDER if is_folder else icons.ICON_FA_FILE
            flags = imgui.SelectableFlags_.allow_double_click.value | imgui.SelectableFlags_.no_auto_close_popups.value
            clicked, _ = imgui.selectable(f"{icon}  {name}", name == self.name, flags)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            self.boxes[name] = (low.x, low.y, high.x, high.y)
            if not clicked:
                continue
            is_second = imgui.is_mouse_double_clicked(imgui.MouseButton_.left.value)
            if is_second and self._entered:  # the other half of a double click on a folder, which one click opens
                self._entered = False
                continue
            self._entered = is_folder
            if is_folder:
                self._go(self.folder / name)
                break
            self.name = name
            if is_second:
                chosen = self.folder / name
        if not self._entries:
            imgui.text_disabled(self._error or f"no {', '.join(request.suffixes)} here")
        imgui.end_child()
        return self._buttons(request) or chosen

    def _buttons(self, request: Request) -> Path | None:
        verb = "Save" if request.save_as else "Open"
        width = 6.0 * imgui.get_font_size()
        imgui.set_next_item_width(-2.0 * (width + imgui.get_style().item_spacing.x))
        if self._opening:
            imgui.set_keyboard_focus_here()
        flags = imgui.InputTextFlags_.enter_returns_true.value | imgui.InputTextFlags_.auto_select_all.value
        entered, self.name = imgui.input_text_with_hint("##name", "file name", self.name, flags)
        imgui.same_line()
        imgui.begin_disabled(not self.name)
        accepted = (imgui.button(verb, (width, 0.0)) or entered) and bool(self.name)
        imgui.end_disabled()
        imgui.same_line()
        if imgui.button("Cancel", (width, 0.0)):
            imgui.close_current_popup()
            self.request = None
            return None
        if not accepted:
            return None
        path = Path(os.path.expanduser(self.folder / self.name))
        if os.path.isdir(path):
            self._go(path)
            return None
        if request.save_as and path.suffix.lower() not in request.suffixes:
            path = path.with_name(path.name + request.suffixes[0])
        return path

    def _go(self, folder: Path) -> None:
        """Show a folder; one that cannot be listed says so."""
        self.folder = Path(os.path.abspath(folder))
        self._typed_folder, self._error = str(self.folder), ""
        suffixes = self.request.suffixes if self.request is not None else ()
        entries = []
        try:
            with os.scandir(self.folder) as found:
                for entry in found:
                    is_folder = entry.is_dir()
                    listed = is_folder or Path(entry.name).suffix.lower() in suffixes
                    if listed and not entry.name.startswith("."):
                        entries.append((entry.name, is_folder))
        except OSError as error:
            self._error = f"{error.strerror or error}"
        self._entries = sorted(entries, key=lambda entry: (not entry[1], entry[0].casefold()))
