"""The panel: everything that can be changed, from top to bottom."""

from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.toolkit import Gui, imgui
from milkglass.viewer.window.panel.camera import CameraSection
from milkglass.viewer.window.panel.environment import EnvironmentSection
from milkglass.viewer.window.panel.error import ErrorSection
from milkglass.viewer.window.panel.ground import GroundSection
from milkglass.viewer.window.panel.highlights import HighlightsSection
from milkglass.viewer.window.panel.lights import LightsSection
from milkglass.viewer.window.panel.material import MaterialSection
from milkglass.viewer.window.panel.model import ModelSection
from milkglass.viewer.window.panel.performance import PerformanceSection
from milkglass.viewer.window.panel.photograph import PhotographSection
from milkglass.viewer.window.panel.section import Section, Seen, Tools
from milkglass.viewer.window.panel.shown import ShownRows
from milkglass.viewer.window.panel.tone_mapping import ToneMappingSection
from milkglass.viewer.window.panel.toolbar import Toolbar
from milkglass.viewer.window.panel.transport import TransportSection

SECTIONS: tuple[type[Section], ...] = (
    PhotographSection,
    MaterialSection,
    LightsSection,
    EnvironmentSection,
    GroundSection,
    HighlightsSection,
    ToneMappingSection,
    TransportSection,
    ErrorSection,
    ModelSection,
    CameraSection,
    PerformanceSection,
)


class Panel:
    """Draws the toolbar, what the view shows, and the sections."""

    def __init__(self, tools: Tools, gui: Gui) -> None:
        self.controls = tools.controls
        self._gui, self._entered, self._enters = gui, False, False
        self._toolbar = Toolbar(tools.controls, tools.commands)
        self._shown = ShownRows(tools.session, tools.controls)
        self._sections = [make(tools) for make in SECTIONS]

    def follow_keys(self, *, entered: bool) -> None:
        """Have keys move from row to row, from the first one that they are in the panel, or no longer."""
        self._enters = entered and not self._entered
        if entered != self._entered:
            self._entered = entered
            self._gui.navigate(on=entered)

    def draw(self, box: Box, seen: Seen) -> None:
        """Draw the panel into a box of the window."""
        self.controls.begin()
        imgui.set_next_window_pos((box[0], box[1]))
        imgui.set_next_window_size((box[2] - box[0], box[3] - box[1]))
        flags = imgui.WindowFlags_.no_decoration.value & ~imgui.WindowFlags_.no_scrollbar.value
        flags |= imgui.WindowFlags_.no_move.value | imgui.WindowFlags_.no_bring_to_front_on_focus.value
        imgui.push_style_var(imgui.StyleVar_.window_rounding.value, 0.0)
        imgui.begin("panel", None, flags)
        imgui.pop_style_var()
        self._toolbar.draw()
        imgui.begin_child("rows")
        if self._enters:
            imgui.set_keyboard_focus_here()
            imgui.set_nav_cursor_visible(True)
        self._shown.draw(seen.live)
        is_below_rows = False
        for section in self._sections:
            if not section.shows():
                continue
            if is_below_rows:
                imgui.spacing()
            if section.is_called():
                imgui.set_next_item_open(True)
                imgui.set_scroll_here_y(0.0)
            is_below_rows = self.controls.section(section.title, is_open=section.starts_open)
            if is_below_rows:
                section.draw(seen)
        imgui.end_child()
        imgui.end()
