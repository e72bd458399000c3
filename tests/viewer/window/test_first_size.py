"""The size of the first window, by what the display says; a display as dense as that is not at hand."""

from unittest.mock import MagicMock, patch

import glfw
import pytest

from milkglass.viewer.window import window


@pytest.mark.parametrize(
    ("scale", "platform", "work_area", "expected"),
    [
        (1.0, glfw.PLATFORM_X11, (3840, 2160), (1440, 900)),
        (2.0, glfw.PLATFORM_X11, (3840, 2160), (2880, 1800)),
        (2.0, glfw.PLATFORM_X11, (1280, 800), (1280, 800)),
        (2.0, glfw.PLATFORM_WAYLAND, (1920, 1080), (1440, 900)),  # whose coordinates are scaled already
    ],
)
def test_the_first_window_is_as_large_to_the_eye_on_every_display(scale, platform, work_area, expected):
    display = MagicMock()
    display.PLATFORM_X11, display.PLATFORM_WIN32 = glfw.PLATFORM_X11, glfw.PLATFORM_WIN32
    display.get_platform.return_value = platform
    display.get_monitor_content_scale.return_value = (scale, scale)
    display.get_monitor_workarea.return_value = (0, 0, *work_area)
    with patch.object(window, "glfw", display):
        window.open_window(None)
    assert display.create_window.call_args.args[:2] == expected
