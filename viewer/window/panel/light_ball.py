"""A ball that shows where light comes from, as the camera sees it."""

from typing import Any

from milkglass.viewer.gui.toolkit import ACCENT, imgui
from milkglass.viewer.scene.settings import Light


def draw_ball(corner: tuple[float, float], side: float, direction: Any, light: Light) -> None:
    """Shade a ball by the light: rings of growing brightness around the point that faces it."""
    draw: Any = imgui.get_window_draw_list()
    radius = 0.5 * side - 2.0
    centre = (corner[0] + 0.5 * side, corner[1] + 0.5 * side)
    draw.add_circle_filled(centre, radius, _colour(0.10, 0.105, 0.115), 48)
    facing = max(0.0, float(direction[2]))
    for i in range(12):
        share = (i + 1) / 12.0
        inner = radius * (1.0 - share)
        offset = 0.92 * radius * share
        grey = (0.10 + 0.42 * share * (0.25 + 0.75 * facing)) if facing > 0.0 else 0.10
        place = (centre[0] + offset * float(direction[0]), centre[1] - offset * float(direction[1]))
        draw.add_circle_filled(place, inner, _colour(grey, grey, grey * 1.02), 40)
    draw.add_circle(centre, radius, _colour(0.33, 0.34, 0.36), 48, 1.0)
    spot = (centre[0] + 0.9 * radius * float(direction[0]), centre[1] - 0.9 * radius * float(direction[1]))
    colour = _colour(*ACCENT) if light.on else _colour(0.5, 0.5, 0.5)
    if direction[2] >= 0.0:
        draw.add_circle_filled(spot, 5.0, colour)
    else:
        draw.add_circle(spot, 4.5, colour, 0, 2.0)


def _colour(red: float, green: float, blue: float) -> Any:
    return imgui.get_color_u32((red, green, blue, 1.0))
