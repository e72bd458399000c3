"""What a pointer at rest sees: the window draws only when it says that it is due."""

from unittest.mock import patch

import pytest

from milkglass.viewer.gui.events import OUTSIDE, MouseMoved
from tests.support.driving import Driver, small_scene


@pytest.fixture
def driver(context, model):
    driver = Driver(small_scene(model), (640, 360), fixed_size=False)
    yield driver
    driver.close()


def until_idle(driver: Driver) -> None:
    """Draw the frames that are due and no others, as a window does."""
    for _ in range(200):
        due = driver.app.next_frame()
        driver.view.wait(60.0)
        if due is None and not driver.view.working:
            return
        driver.now += max(due or 0.0, 1e-3)
        driver.frame()
    raise TimeoutError("frames are due for ever")


def test_a_tooltip_comes_to_a_pointer_that_rests_and_goes_with_it(driver):
    controls = driver.app.panel.controls
    with patch.object(controls, "tooltip", wraps=controls.tooltip) as shown:
        driver.app.handle(MouseMoved(*driver.place("save")))
        until_idle(driver)
        assert shown.called
        shown.reset_mock()
        driver.frame()
        assert shown.called
        driver.app.handle(OUTSIDE)
        until_idle(driver)
        shown.reset_mock()
        driver.frame()
        assert not shown.called


def test_no_rate_of_frames_stays_when_none_are_made(driver):
    driver.drag((130.0, 180.0), (40.0, 10.0), steps=8)
    assert driver.app.frames_per_second > 0.0
    until_idle(driver)
    assert driver.app.frames_per_second == 0.0
