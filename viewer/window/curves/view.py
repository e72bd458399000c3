"""The view of profiles below the picture: that of the scene, a second one beside it, and marked lengths.

It draws nothing and asks for nothing while it is closed.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from milkglass.core.profiles.registry import BEAM, PROFILES, TABLE
from milkglass.viewer.gui.command import Commands
from milkglass.viewer.gui.controls import CHANNELS, Box, Controls
from milkglass.viewer.gui.toolkit import MUTED, WARNING, icons, imgui
from milkglass.viewer.live.live import Live, solves
from milkglass.viewer.scene.keys import version
from milkglass.viewer.scene.material_settings import MaterialSettings
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.curves.curves import Curves, CurvesJob, Wish
from milkglass.viewer.window.curves.marks import Mark, marks
from milkglass.viewer.window.curves.plot import ProfilePlot

NONE, KEPT = "nothing", "B, the kept state"
R_D, PER_RADIUS = "R_d", "2π r R_d"
NOT_SEEN = "The picture solves an equation, which has no profile: it is not made of these curves."
SHARE, SMALLEST_SHARE, LARGEST_SHARE = 0.45, 0.2, 0.75  # of the view's height
LEGEND = 27.0  # width, em
# Widths of the view, em: for reflectances in the legend, for words in it, for options beside it.
NUMBERED_WIDTH, TITLED_WIDTH, WIDE_WIDTH = 26.0, 33.0, 45.0
EDGE_HEIGHT = 6.0  # px, of the edge that is dragged
TIPS = {
    "profiles.other": "Another profile of the same material, dashed; or the material and profile kept as B (K).",
    "profiles.quantity": "R_d: exitance at a distance from where light enters, in logarithms. 2π r R_d: light that "
    "leaves per mm of radius; over a linear r its area is the reflectance.",
    "profiles.log": "Logarithmic radius, or linear from 0 to where 99 % of the light has left.",
    "profiles.export": "Write the solid curves as CSV, radius_mm, R, G, B: a table that the profile \"table\" reads.",
    "profiles.close": "Close (P)",
}  # fmt: skip


class ProfileView:
    """Draws the view of profiles: its plot, the choice of the second profile, the quantity, the scale.

    Attributes
    ----------
    second : str
        The second profile: a name, `KEPT` or `NONE`.
    quantity : R_D or PER_RADIUS
    log_radius : bool
    named : list of (name, Curves)
        Curves of the last frame; the first are those of the scene.
    marks : list of Mark
    """

    def __init__(
        self, session: Session, controls: Controls, commands: Commands[Any], wake: Callable[[], object]
    ) -> None:
        self.second, self.quantity, self.log_radius = BEAM, R_D, True
        self.named: list[tuple[str, Curves]] = []
        self.marks: list[Mark] = []
        self.plot = ProfilePlot()
        self._session, self._controls, self._commands = session, controls, commands
        self._job = CurvesJob(wake)
        self._share = SHARE
        self._last: list[Curves | None] = [None, None]

    @property
    def busy(self) -> bool:
        """Whether curves are being sampled."""
        return self._session.view.profiles and self._job.busy

    def wait(self, timeout: float) -> None:
        """Wait until the curves are sampled; for tests and replays."""
        self._job.wait(timeout)

    def stop(self) -> None:
        """Sample nothing more, and wait for nothing."""
        self._job.stop()

    def close(self) -> None:
        """Stop the worker and free ImPlot."""
        self._job.close()
        self.plot.close()

    def split(self, box: Box) -> tuple[Box, Box | None]:
        """Return the boxes of the picture and of the curves, None where those do not show."""
        if not self._session.view.profiles:
            return box, None
        edge = round(box[3] - self._share * (box[3] - box[1]))
        return (box[0], box[1], box[2], edge), (box[0], edge, box[2], box[3])

    def draw(self, box: Box, live: Live) -> None:
        """Draw the view into a box of the window."""
        self._follow(live)
        flags = imgui.WindowFlags_
        bare = flags.no_decoration.value | flags.no_move.value | flags.no_bring_to_front_on_focus.value
        imgui.set_next_window_pos((box[0], box[1]))
        imgui.set_next_window_size((box[2] - box[0], box[3] - box[1]))
        imgui.push_style_var(imgui.StyleVar_.window_rounding.value, 0.0)
        imgui.begin("profile view", None, bare | flags.no_nav.value | flags.no_scroll_with_mouse.value)
        imgui.pop_style_var()
        self._edge(box)
        self._head(box)
        if solves(live):
            imgui.text_colored((*WARNING, 1.0), NOT_SEEN)
        for name, curves in self.named:
            if curves.problem:
                self._controls.note(f"{name}: {curves.problem}", warning=True)
        per_radius = self.quantity == PER_RADIUS
        self.plot.draw(self.named, self.marks, log_radius=self.log_radius, per_radius=per_radius)
        imgui.end()

    def _follow(self, live: Live) -> None:
        """Ask for the curves; those of a moment ago stay until new ones are there."""
        session = self._session
        material = session.scene.material
        wanted = [(material.profile, material)]
        second = self._compared(material)
        if second is not None and second != material:
            wanted.append((self.second if self.second != KEPT else f"B, {second.profile}", second))
        wishes = tuple(Wish(material, _state(material)) for _, material in wanted)
        sampled = self._job.follow(wishes, live.assets.profile_table)
        self._last = [new or old for new, old in zip([*sampled, None][:2], self._last, strict=True)]
        shown = zip(wanted, self._last, strict=False)
        self.named = [(name, curves) for (name, _), curves in shown if curves is not None]
        self.marks = marks(session.scene, None if live.finished is None else live.finished.lit)

    def _compared(self, material: MaterialSettings) -> MaterialSettings | None:
        if self.second == KEPT:
            return None if self._session.kept is None else self._session.kept.material
        if self.second == NONE or (self.second == TABLE and material.profile_table is None):
            return None
        return replace(material, profile=self.second)

    def _edge(self, box: Box) -> None:
        """Let the upper edge be dragged."""
        imgui.set_cursor_screen_pos((box[0], box[1]))
        imgui.invisible_button("##profiles.edge", (box[2] - box[0], EDGE_HEIGHT))
        self._controls.mark("profiles.edge")
        if imgui.is_item_hovered() or imgui.is_item_active():
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ns.value)
        if imgui.is_item_active():
            height = imgui.get_io().display_size.y
            share = (box[3] - imgui.get_io().mouse_pos.y) / max(1.0, height)
            self._share = min(LARGEST_SHARE, max(SMALLEST_SHARE, share))

    def _head(self, box: Box) -> None:
        """Draw the legend and, beside or below it, what is plotted; buttons at the right."""
        em, padding = imgui.get_font_size(), imgui.get_style().window_padding.x
        width = box[2] - box[0]
        top = imgui.get_cursor_pos_y()
        self._legend(titled=width > TITLED_WIDTH * em, numbered=width > NUMBERED_WIDTH * em)
        below = imgui.get_cursor_pos()
        imgui.set_cursor_pos((width - padding - 2.0 * imgui.get_frame_height() - imgui.get_style().item_spacing.x, top))
        self._buttons()
        if width > WIDE_WIDTH * em:
            imgui.set_cursor_pos((padding + (LEGEND + 1.5) * em, top + imgui.get_style().cell_padding.y))
        else:
            imgui.set_cursor_pos(below)
        self._options(stacked=width > WIDE_WIDTH * em)
        if width > WIDE_WIDTH * em:
            imgui.set_cursor_pos(below)

    def _legend(self, *, titled: bool, numbered: bool) -> None:
        """Two lines: how a curve is drawn, whose it is, its reflectance where there is room."""
        em = imgui.get_font_size()
        flags = imgui.TableFlags_.sizing_fixed_fit.value | imgui.TableFlags_.no_host_extend_x.value
        widths = (2.4, 9.0, 5.0 if titled else 0.1, 2.8, 2.8, 2.8) if numbered else (2.4, 6.0)
        if not imgui.begin_table("##legend", len(widths), flags):
            return
        for width in widths:
            imgui.table_setup_column("", imgui.TableColumnFlags_.width_fixed.value, width * em)
        profile = self._session.scene.material.profile
        for row in range(2):
            imgui.table_next_row()
            imgui.table_next_column()
            _sample(dashed=row == 1, width=2.0 * em)
            imgui.table_next_column()
            if row == 0:
                imgui.align_text_to_frame_padding()
                imgui.text_unformatted(profile)
            else:
                self._choose_second()
            if numbered and row < len(self.named):
                imgui.table_next_column()
                imgui.align_text_to_frame_padding()
                imgui.text_colored((*MUTED, 1.0), "reflectance" if titled else "")
                for (_, colour), total in zip(CHANNELS, self.named[row][1].totals, strict=True):
                    imgui.table_next_column()
                    imgui.text_colored((*colour, 1.0), f"{total:.3f}")
        imgui.end_table()

    def _choose_second(self) -> None:
        material, kept = self._session.scene.material, self._session.kept
        choices = [NONE, *(name for name in PROFILES if name != TABLE or material.profile_table is not None)]
        choices += [KEPT] if kept is not None else []
        imgui.set_next_item_width(-1.0)
        self.second = self._choice("profiles.other", self.second, choices)

    def _options(self, *, stacked: bool) -> None:
        imgui.begin_group()
        imgui.set_next_item_width(7.0 * imgui.get_font_size())
        self.quantity = self._choice("profiles.quantity", self.quantity, [R_D, PER_RADIUS])
        if not stacked:
            imgui.same_line()
        clicked, log_radius = imgui.checkbox("log r", self.log_radius)
        self._mark("profiles.log")
        if clicked:
            self.log_radius = log_radius
        imgui.end_group()

    def _buttons(self) -> None:
        if self._controls.icon("profiles.export", icons.ICON_FA_FILE_EXPORT, TIPS["profiles.export"]):
            self._commands.request("export_profile")
        imgui.same_line()
        if self._controls.icon("profiles.close", icons.ICON_FA_XMARK, TIPS["profiles.close"], quiet=True):
            self._session.view.profiles = False

    def _choice(self, name: str, current: str, choices: list[str]) -> str:
        chosen = self._controls.choice(name, current, choices) or current
        self._mark(name)
        return chosen

    def _mark(self, name: str) -> None:
        self._controls.mark(name)
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
            self._controls.tooltip("", TIPS[name])


def _state(material: MaterialSettings) -> tuple[int, int]:
    """Of a table in use: the version that pictures have, and the file's time, so that a corrected one is tried."""
    path = material.table_in_use
    try:
        return version(path), 0 if path is None else path.stat().st_mtime_ns
    except OSError:
        return version(path), 0


def _sample(*, dashed: bool, width: float) -> None:
    """Draw a piece of a curve's line."""
    draw: Any = imgui.get_window_draw_list()
    corner, ink = imgui.get_cursor_screen_pos(), imgui.get_color_u32((0.9, 0.9, 0.9, 1.0))
    y, pieces = corner.y + 0.5 * imgui.get_frame_height(), 3 if dashed else 1
    for i in range(pieces):
        start = corner.x + width * i / pieces
        draw.add_line((start, y), (start + width / pieces * (0.6 if dashed else 1.0), y), ink, 1.5 if dashed else 2.2)
    imgui.dummy((width, imgui.get_frame_height()))
