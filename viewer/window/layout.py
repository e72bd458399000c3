"""Where view and panel stand in the window."""

from milkglass.viewer.gui.controls import Box

PANEL_WIDTH = 25.0  # in letters' heights
MOST_OF_WINDOW = 0.6  # that the panel takes


def view_and_panel(size: tuple[int, int], letter: float, *, panel_shown: bool = True) -> tuple[Box, Box]:
    """Return the boxes of the view and of the panel in a window of a size, where letters have a height."""
    width, height = size
    panel = min(MOST_OF_WINDOW * width, PANEL_WIDTH * letter) if panel_shown else 0.0
    split = width - panel
    return (0.0, 0.0, split, float(height)), (split, 0.0, float(width), float(height))
