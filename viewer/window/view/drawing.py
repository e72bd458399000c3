"""Pictures laid into the view."""

from typing import Any

import numpy as np

from milkglass.core.display import log_average
from milkglass.viewer.display.registry import transform
from milkglass.viewer.gui.controls import Box
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.scene.settings import DisplaySettings


def developed(image: Any, maps: Any, display: DisplaySettings) -> Any:
    """Return a layer (h, w, 3) exposed for the average of all lit texels of its maps: (h, w, 4) uint8."""
    values = maps.max(axis=0)
    average = log_average(values, (values > 1e-4 * values.max()).astype(np.float64))
    exposure = display.exposed_key / average if average > 0.0 else 0.0
    pixels = np.full((*image.shape[:2], 4), 255, np.uint8)
    encoded = transform(display.transform).encoded(exposure * np.maximum(image, 0.0), display.white)
    pixels[..., :3] = np.rint(255.0 * encoded)
    return pixels


def fitted(box: Box, size: tuple[int, int], share: float = 1.0) -> Box:
    """Return the largest box of the proportions of `size` in the middle of `box`."""
    width, height = box[2] - box[0], box[3] - box[1]
    scale = share * min(width / size[0], height / size[1])
    x, y = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    half = (0.5 * scale * size[0], 0.5 * scale * size[1])
    return x - half[0], y - half[1], x + half[0], y + half[1]


def checkerboard(draw: Any, box: Box, side: float = 14.0) -> None:
    """Draw the checkerboard that stands for a transparent ground."""
    draw.add_rect_filled((box[0], box[1]), (box[2], box[3]), imgui.get_color_u32((0.23, 0.23, 0.24, 1.0)))
    light = imgui.get_color_u32((0.28, 0.28, 0.29, 1.0))
    draw.push_clip_rect((box[0], box[1]), (box[2], box[3]), True)
    for row in range(int((box[3] - box[1]) / side) + 1):
        for column in range(row % 2, int((box[2] - box[0]) / side) + 1, 2):
            x, y = box[0] + column * side, box[1] + row * side
            draw.add_rect_filled((x, y), (x + side, y + side), light)
    draw.pop_clip_rect()
