"""The error over the picture: a coloured dot at every place measured, its numbers, the scale of the colours."""

from collections.abc import Callable
from typing import Any

import numpy as np

from milkglass.core.arrays import Array
from milkglass.viewer.error.map import COLOURS, colours, scale_end
from milkglass.viewer.gui.controls import CHANNELS, Box
from milkglass.viewer.gui.sliders import percent, significant
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.error import Dots

SMALLEST_RADIUS, LARGEST_RADIUS = 0.15, 0.32  # of a dot, in letters' heights
RADIUS_SHARE = 0.25  # of the mean distance of the points
FADED_OPACITY = 0.35  # of an outdated map
REACH = 0.2  # of the pointer beside a dot, in letters' heights


class ErrorOverlay:
    """Draws the map of a measurement; places and colours are kept from frame to frame."""

    def __init__(self) -> None:
        self._of: Dots | None = None
        self._order: list[int] = []  # the worst last, so that they lie on top
        self._places = np.zeros((0, 2))  # in the picture, [0, 1], y down
        self._colours = np.zeros((0, 3))
        self._end = 1.0

    def draw(self, dots: Dots, picture: Box, right: float, *, faded: bool, is_hovered: bool) -> None:
        """Draw the map over the picture, left of `right`, in the current ImGui window.

        Parameters
        ----------
        dots : Dots
        picture : Box
            Where the picture lies.
        right : float
            Where it ends, x: the divider of a split view.
        faded : bool
            Whether the numbers are outdated.
        is_hovered : bool
            Whether the pointer is on the view, so that a dot may be read.
        """
        self._prepare(dots)
        em = imgui.get_font_size()
        width, height = picture[2] - picture[0], picture[3] - picture[1]
        centres = np.array(picture[:2]) + self._places * [width, height]
        pixel = width * height / (dots.size[0] * dots.size[1])  # of the picture measured, on screen
        spacing = np.sqrt(dots.covered * pixel / max(1, len(centres)))
        radius = float(np.clip(RADIUS_SHARE * spacing, SMALLEST_RADIUS * em, LARGEST_RADIUS * em))
        draw: Any = imgui.get_window_draw_list()
        draw.push_clip_rect((picture[0], picture[1]), (right, picture[3]), True)
        alpha = FADED_OPACITY if faded else 1.0
        # Two rims, so that a dot stands out from an object of any colour, its own too.
        dark, light = (imgui.get_color_u32((*(3 * (grey,)), 0.8 * alpha)) for grey in (0.0, 0.95))
        corners = 12 if radius > 0.2 * em else 8
        paints = [_paint(colour, alpha) for colour in self._colours]
        for i in self._order:
            centre = (float(centres[i, 0]), float(centres[i, 1]))
            draw.add_circle_filled(centre, radius + 2.0, dark, corners)
            draw.add_circle_filled(centre, radius + 1.0, light, corners)
            draw.add_circle_filled(centre, radius, paints[i], corners)
        mouse = imgui.get_io().mouse_pos
        if is_hovered and mouse.x < right and len(centres):
            distance = np.hypot(centres[:, 0] - mouse.x, centres[:, 1] - mouse.y)
            nearest = int(distance.argmin())
            if distance[nearest] <= radius + REACH * em:
                place = (float(centres[nearest, 0]), float(centres[nearest, 1]))
                draw.add_circle(place, radius + 2.5, imgui.get_color_u32((1.0, 1.0, 1.0, 0.95)), 16, 2.0)
                read_dot(dots, nearest)
        draw.pop_clip_rect()
        draw_scale(draw, picture, self._end)

    def _prepare(self, dots: Dots) -> None:
        if dots is self._of:
            return
        values = dots.values
        self._of, self._end = dots, scale_end(values)
        self._order = np.argsort(values).tolist()
        self._places = (np.stack([dots.columns, dots.rows], axis=1) + 0.5) / dots.size
        self._colours = colours(values / self._end) / 255.0


def read_dot(dots: Dots, i: int) -> None:
    """Show the numbers of a place in a tooltip."""
    rows: list[tuple[str, Array, Callable[[float], str]]] = [
        ("M", dots.exitance[i], significant),
        ("M_ref", dots.reference[i], significant),
        ("error", dots.shares[i], percent),
    ]
    meaning = "error: |M - M_ref| over the rms of M_ref"
    if dots.noise is not None:
        rows.append(("noise", dots.noise[i], percent))
        meaning = f"{meaning},\nbeyond the noise of the photons; means of a region"
    if not imgui.begin_tooltip():
        return
    if imgui.begin_table("##dot", 4, imgui.TableFlags_.sizing_fixed_fit.value):
        imgui.table_next_row()
        imgui.table_next_column()
        for letter, colour in CHANNELS:
            imgui.table_next_column()
            imgui.text_colored((*colour, 1.0), letter)
        for label, values, text in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_disabled(label)
            for value in values:
                imgui.table_next_column()
                imgui.text_unformatted(text(float(value)))
        imgui.end_table()
    imgui.text_disabled(meaning)
    imgui.end_tooltip()


def draw_scale(draw: Any, picture: Box, end: float) -> None:
    """Draw the scale of the colours on a dark plate, in a corner where no message comes to lie."""
    em, title = imgui.get_font_size(), "error, worst channel"
    width, pad = max(11.0 * em, imgui.calc_text_size(title).x), 0.5 * em
    left, top = picture[0] + 0.8 * em, picture[1] + 0.8 * em
    bottom = top + 3.4 * em + 2.0 * pad
    draw.add_rect_filled(
        (left, top), (left + width + 2.0 * pad, bottom), imgui.get_color_u32((0.0, 0.0, 0.0, 0.75)), 4.0
    )
    ink = imgui.get_color_u32((0.9, 0.9, 0.9, 1.0))
    x, y = left + pad, top + pad
    draw.add_text((x, y), ink, title)
    paints = [_paint(colour / 255.0) for colour in COLOURS]
    step = width / (len(paints) - 1)
    for i in range(len(paints) - 1):
        low, high = (x + i * step, y + 1.35 * em), (x + (i + 1) * step, y + 2.1 * em)
        draw.add_rect_filled_multi_color(low, high, paints[i], paints[i + 1], paints[i + 1], paints[i])
    for share, text in ((0.0, "0"), (0.5, percent(0.5 * end)), (1.0, percent(end))):
        place = x + share * (width - imgui.calc_text_size(text).x)
        draw.add_text((place, y + 2.35 * em), ink, text)


def _paint(colour: Array, alpha: float = 1.0) -> int:
    return int(imgui.get_color_u32((float(colour[0]), float(colour[1]), float(colour[2]), alpha)))
