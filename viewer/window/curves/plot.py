"""The plot of profiles, by ImPlot: curves of three channels, marked lengths, values under the pointer."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from milkglass.viewer.gui.controls import CHANNELS, Box
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.gui.toolkit import MUTED, imgui, implot
from milkglass.viewer.window.curves.axes import Axes, axes_for, dashes, plotted
from milkglass.viewer.window.curves.curves import Curves
from milkglass.viewer.window.curves.marks import Mark

LINE, DASHED_LINE = 2.2, 1.5  # thickness, px
INK = (0.78, 0.79, 0.81)
LABEL_GAP = 10.0  # px
AXIS_LIMITS = (1e-12, 1e12)  # of a logarithmic axis
SAME_LENGTH = 0.02  # relative; mean free paths that differ by less are written once


class ProfilePlot:
    """Draws the curves of profiles on axes that the mouse moves: drag, wheel, double click for the whole.

    Attributes
    ----------
    box : Box
        Where the curves lie in the window, of the last frame.
    axes : Axes or None
        What they span.
    """

    def __init__(self) -> None:
        self.box: Box = (0.0, 0.0, 1.0, 1.0)
        self.axes: Axes | None = None
        self._context: Any = None
        self._target: Axes | None = None
        self._moved = False  # whether a person has moved the axes
        self._rows = 1  # of labels above the plot

    def draw(
        self, named: Sequence[tuple[str, Curves]], marks: Sequence[Mark], *, log_radius: bool, per_radius: bool
    ) -> None:
        """Draw named curves into what is left of the current ImGui window, the second ones dashed."""
        self._enter()
        target = axes_for([curves for _, curves in named], marks, log_radius=log_radius, per_radius=per_radius)
        scales = (log_radius, per_radius)
        if self._target is not None and scales != (self._target.log_x, not self._target.log_y):
            self._moved = False
        imgui.dummy((1.0, self._rows * imgui.get_text_line_height() + 2.0))
        flags = implot.Flags_
        quiet = flags.no_legend.value | flags.no_mouse_text.value | flags.no_menus.value | flags.no_box_select.value
        if not implot.begin_plot("##profiles", (-1.0, -1.0), quiet | flags.no_title.value):
            return
        self._set_up(target, per_radius=per_radius)
        position, size, limits = implot.get_plot_pos(), implot.get_plot_size(), implot.get_plot_limits()
        self.box = position.x, position.y, position.x + size.x, position.y + size.y
        self.axes = replace(target, x=(limits.x.min, limits.x.max), y=(limits.y.min, limits.y.max))
        self._draw_marks(marks)
        for i, (name, curves) in reversed(list(enumerate(named))):
            self._draw_curves(name, curves, per_radius=per_radius, dashed=i > 0)
        hovered = implot.is_plot_hovered()
        self._watch(target, hovered=hovered)
        if hovered:
            self._read(named, per_radius=per_radius)
        implot.end_plot()
        self._write_labels(marks)

    def close(self) -> None:
        """Free ImPlot's context, before ImGui's goes."""
        if self._context is not None:
            implot.destroy_context(self._context)
            self._context = None

    def _enter(self) -> None:
        if self._context is not None:
            implot.set_current_context(self._context)
            return
        self._context = implot.create_context()
        implot.set_current_context(self._context)
        style = implot.get_style()
        style.plot_padding, style.label_padding = imgui.ImVec2(6.0, 4.0), imgui.ImVec2(4.0, 3.0)
        style.plot_border_size, style.minor_alpha = 0.0, 0.35
        for name, colour in (
            ("frame_bg", (0.0, 0.0, 0.0, 0.0)),
            ("plot_bg", (0.09, 0.094, 0.10, 1.0)),
            ("axis_grid", (1.0, 1.0, 1.0, 0.16)),
            ("axis_text", (*MUTED, 1.0)),
        ):
            style.set_color_(getattr(implot.Col_, name), imgui.ImVec4(*colour))

    def _set_up(self, target: Axes, *, per_radius: bool) -> None:
        x, y = implot.ImAxis_.x1.value, implot.ImAxis_.y1.value
        implot.setup_axes("r, mm", "2π r R_d, 1/mm" if per_radius else "R_d, 1/mm²")
        for axis, is_logarithmic, ends in ((x, target.log_x, target.x), (y, target.log_y, target.y)):
            implot.setup_axis_scale(axis, (implot.Scale_.log10 if is_logarithmic else implot.Scale_.linear).value)
            implot.setup_axis_format(axis, "%g")
            if is_logarithmic:
                implot.setup_axis_limits_constraints(axis, *AXIS_LIMITS)
            if not self._moved and target != self._target:
                implot.setup_axis_limits(axis, *ends, implot.Cond_.always.value)
        if not self._moved:
            self._target = target
        implot.setup_finish()

    def _watch(self, target: Axes, *, hovered: bool) -> None:
        """Find out whether a person moves the axes, or wants all back."""
        if not hovered:
            return
        if imgui.is_mouse_double_clicked(imgui.MouseButton_.left.value):
            self._moved, self._target = False, None
        elif imgui.get_io().mouse_wheel != 0.0 or imgui.is_mouse_dragging(imgui.MouseButton_.left.value):
            self._moved = True

    def _draw_curves(self, name: str, curves: Curves, *, per_radius: bool, dashed: bool) -> None:
        assert self.axes is not None
        size = self.box[2] - self.box[0], self.box[3] - self.box[1]
        for (letter, colour), values in zip(CHANNELS, plotted(curves, per_radius=per_radius), strict=True):
            positive = values > 0.0
            x, y = curves.radii[positive], values[positive]
            spec = implot.Spec()
            spec.line_color = imgui.ImVec4(*colour, 0.9 if dashed else 1.0)
            spec.line_weight = (DASHED_LINE if dashed else LINE) * imgui.get_style().font_scale_dpi
            if dashed:
                x, y = dashes(x, y, self.axes, size)
                spec.flags = implot.LineFlags_.segments.value
            if len(x) > 1:
                implot.plot_line(f"{name} {letter}", np.ascontiguousarray(x), np.ascontiguousarray(y), spec)

    def _draw_marks(self, marks: Sequence[Mark]) -> None:
        draw: Any = implot.get_plot_draw_list()
        implot.push_plot_clip_rect()
        for mark in marks:
            x = self._across(mark.radius)
            if self.box[0] <= x <= self.box[2]:
                draw.add_line((x, self.box[1]), (x, self.box[3]), _paint(mark, 0.55), 1.0)
        implot.pop_plot_clip_rect()

    def _across(self, radius: float) -> float:
        """Where a radius lies in the window; a little outside the plot where it does not lie in it."""
        assert self.axes is not None
        with np.errstate(divide="ignore", invalid="ignore"):
            share = float(np.clip(self.axes.share(radius, 1.0)[0], -0.1, 1.1))
        return self.box[0] + share * (self.box[2] - self.box[0])

    def _write_labels(self, marks: Sequence[Mark]) -> None:
        """Write what the marks are above the plot, where no curve is, each as low as it fits."""
        draw: Any = imgui.get_window_draw_list()
        line, taken = imgui.get_text_line_height(), list[tuple[int, float, float]]()
        for text, radius in labels(marks):
            x = self._across(radius)
            arrow = "  →" if x > self.box[2] + 0.5 else ""
            before = "←  " if x < self.box[0] - 0.5 else ""
            text = f"{before}{text}{arrow}"
            width = imgui.calc_text_size(text).x
            left = min(max(x - 0.5 * width, self.box[0]), self.box[2] - width)
            beside = {row for row, start, end in taken if left < end + LABEL_GAP and start < left + width + LABEL_GAP}
            row = next(row for row in range(len(taken) + 1) if row not in beside)
            taken.append((row, left, left + width))
            draw.add_text((left, self.box[1] - (row + 1) * line - 2.0), imgui.get_color_u32((*INK, 1.0)), text)
        self._rows = 1 + max((row for row, *_ in taken), default=0)

    def _read(self, named: Sequence[tuple[str, Curves]], *, per_radius: bool) -> None:
        """Read all curves at the pointer's radius."""
        r, x = float(implot.get_plot_mouse_pos().x), imgui.get_io().mouse_pos.x
        if r <= 0.0 or not any(curves.profiles for _, curves in named):
            return
        draw: Any = implot.get_plot_draw_list()
        draw.add_line((x, self.box[1]), (x, self.box[3]), imgui.get_color_u32((1.0, 1.0, 1.0, 0.6)), 1.0)
        if not imgui.begin_tooltip():
            return
        imgui.text_unformatted(f"r = {significant(r)} mm")
        if imgui.begin_table("##read", 5, imgui.TableFlags_.sizing_fixed_fit.value):
            for name, curves in named:
                for row in reading(name, curves, r, per_radius=per_radius):
                    imgui.table_next_row()
                    for i, cell in enumerate(row):
                        imgui.table_next_column()
                        colour = CHANNELS[i - 1][1] if 0 < i < 4 else MUTED
                        imgui.text_colored((*colour, 1.0), cell)
            imgui.end_table()
        imgui.end_tooltip()


def reading(name: str, curves: Curves, r: float, *, per_radius: bool) -> list[tuple[str, ...]]:
    """Return the rows of curves at a radius, of a label, three texts and a unit: values, and the flux within."""
    if not curves.profiles:
        return []
    factor = 2.0 * np.pi * r if per_radius else 1.0
    values = [0.0 if p.is_black else factor * float(p.radial(r)) for p in curves.profiles]
    within = [0.0 if p.is_black else float(p.total_within(r) / p.total(0.0)) for p in curves.profiles]
    unit = "1/mm" if per_radius else "1/mm²"
    return [
        (name, *(significant(value) for value in values), unit),
        ("   light within", *(f"{100.0 * share:.3g}" for share in within), "%"),
    ]


def labels(marks: Sequence[Mark]) -> list[tuple[str, float]]:
    """Return labels and their radii, one for the mean free paths of all channels, in the middle of them."""
    paths = [mark.radius for mark in marks if mark.channel is not None]
    rest = [(mark.label, mark.radius) for mark in marks if mark.channel is None]
    if not paths:
        return rest
    distinct = paths if max(paths) > (1.0 + SAME_LENGTH) * min(paths) else paths[:1]
    text = f"mean free path {' / '.join(significant(path, 2) for path in distinct)} mm"
    return [(text, float(np.exp(np.mean(np.log(paths))))), *rest]


def _paint(mark: Mark, alpha: float) -> int:
    colour = INK if mark.channel is None else CHANNELS[mark.channel][1]
    return int(imgui.get_color_u32((*colour, alpha)))
