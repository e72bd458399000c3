"""The error in the panel and over the picture: the key, the switches, the dots and what they say."""

from types import SimpleNamespace

import numpy as np
import pytest

from milkglass.core.transport.quality import Quality
from milkglass.viewer.error.map import colours, scale_end
from milkglass.viewer.gui.events import MouseMoved, Resized
from milkglass.viewer.gui.sliders import percent
from milkglass.viewer.window.app import read_pixels
from milkglass.viewer.window.panel.error import rows, verdict
from tests.support.driving import Driver, small_scene

SIZE = (720, 520)
POINTS = 20  # far enough apart that most dots lie alone


@pytest.fixture
def driver(context, model):
    driver = Driver(small_scene(model), SIZE, fixed_size=False)
    driver.session.view.error_points = POINTS
    yield driver
    driver.close()


def view_pixels(driver: Driver) -> np.ndarray:
    return read_pixels(driver.target, SIZE)[:, : round(driver.view.drawn_at[2])].astype(int)


def dots(driver: Driver) -> np.ndarray:
    """Where the dots should be in the window, (n, 2)."""
    (left, top, right, bottom), measured = driver.view.drawn_at, driver.app.error.result
    seen = measured.error.points
    places = (np.stack([seen.columns, seen.rows], axis=1) + 0.5) / measured.size
    return np.array([left, top]) + places * [right - left, bottom - top]


@pytest.mark.slow
def test_the_key_measures_opens_the_section_and_shows_the_map(driver):
    driver.settle()
    plain = view_pixels(driver)
    assert "error.measure" not in driver.app.panel.controls.boxes
    driver.key("e")
    driver.settle()
    assert driver.session.view.measure
    top, bottom = driver.app.panel.controls.boxes["error.measure"][1::2]
    assert 0.0 < top < bottom < SIZE[1]  # scrolled to where it is seen
    values = driver.app.error.result.error.at_points
    pixels = view_pixels(driver)
    right = [
        np.abs(pixels[int(y), int(x)] - colour).max() <= 3
        for (x, y), colour in zip(dots(driver), colours(values / scale_end(values)), strict=True)
    ]
    assert np.mean(right) >= 0.8  # a few lie under others
    driver.key("e")
    driver.settle()
    assert np.array_equal(view_pixels(driver), plain)


@pytest.mark.slow
def test_the_map_can_be_hidden_and_stays_only_with_the_camera(driver):
    driver.settle()
    plain = driver.app.frame(driver.target) or view_pixels(driver)
    driver.key("e")
    driver.settle()
    dotted = view_pixels(driver)
    x, y = map(int, dots(driver)[int(driver.app.error.result.error.at_points.argmax())])
    driver.click("error.map")
    driver.settle()
    status = np.s_[: SIZE[1] - 40]
    assert np.array_equal(view_pixels(driver)[status], plain[status])
    driver.click("error.map")
    driver.settle()
    assert np.array_equal(view_pixels(driver), dotted)
    driver.session.edit("material", name="ketchup")  # the same points, of old numbers: faded
    driver.frames(1)
    assert driver.app.error.outdated
    faded = np.abs(view_pixels(driver)[y, x] - dotted[y, x]).max()
    assert faded > 20
    driver.session.undo()
    driver.settle()
    driver.session.edit("camera", zoom=1.1)
    driver.frames(1)
    drawn = []
    driver.app.error_overlay.draw = lambda *_, **__: drawn.append(1)
    driver.frames(1)
    assert not drawn
    driver.settle()
    assert drawn


@pytest.mark.slow
def test_a_dot_says_what_was_found_there(driver, monkeypatch):
    read = []
    monkeypatch.setattr("milkglass.viewer.window.view.error_overlay.read_dot", lambda measured, i: read.append(i))
    driver.key("e")
    driver.settle()
    places = dots(driver)
    alone = max(range(POINTS), key=lambda i: np.sort(np.hypot(*(places - places[i]).T))[1])
    driver.send(MouseMoved(*places[alone]))
    assert set(read) == {alone}
    read.clear()
    driver.send(MouseMoved(3.0, 3.0))
    assert not read
    driver.send(MouseMoved(*driver.place("error.measure")))
    assert not read
    monkeypatch.undo()
    before = view_pixels(driver)
    driver.send(MouseMoved(*places[alone]))
    assert np.mean(view_pixels(driver) != before) > 0.02  # the real one is drawn


@pytest.mark.slow
def test_switches_and_slider_of_the_panel(driver):
    driver.key("e")  # unfolds the section and scrolls to it
    driver.key("e")
    driver.settle()
    driver.click("error.measure")
    driver.settle()
    assert len(driver.app.error.result.error.reference) == POINTS
    driver.click("error.points", 0.03)
    points = driver.session.view.error_points
    assert 50 <= points < 200
    driver.settle()
    assert len(driver.app.error.result.error.reference) == points
    driver.click("error.points", 0.5, button="right")
    assert driver.session.view.error_points == 300
    driver.click("error.measure")
    driver.settle()
    assert not driver.session.view.measure
    assert driver.app.error.progress is None


@pytest.mark.slow
def test_the_panel_may_be_hidden_and_the_window_resized_while_it_measures(driver):
    driver.key("tab")
    driver.key("e")
    driver.settle()
    assert driver.app.error.result is not None
    assert driver.app.error_status() == f"error {percent(max(driver.app.error.result.error.deviation.rms))}"
    driver.send(Resized((700, 500), (700, 500), 1.0))
    assert driver.app.error.outdated or driver.app.error.result.size == (512, 366)
    driver.settle()
    assert driver.app.error.dots.lies_in(driver.view.shown)
    driver.key("tab")
    driver.settle()
    assert "error.measure" in driver.app.panel.controls.boxes


@pytest.mark.slow
def test_split_view_and_layers_with_a_measurement(driver):
    driver.key("e")
    for key in ("k", "v"):
        driver.key(key)
    driver.settle()
    assert driver.app.error.result is not None
    driver.session.view.show = "layer out"
    driver.settle()
    drawn = []
    driver.app.error_overlay.draw = lambda *_, **__: drawn.append(1)
    driver.frames(2)
    assert not drawn


# What is said


def of(rms, target, predicted, method="ewald"):
    """A measurement with these errors."""
    ones = np.ones((2, 3))
    deviation = SimpleNamespace(rms=rms, p99=rms, rms_together=1.0)
    error = SimpleNamespace(reference=ones, points=SimpleNamespace(exitance=ones), deviation=deviation)
    return SimpleNamespace(
        error=error, quality=Quality(method, None, 40, predicted_error=predicted, error_target=target), is_dark=False
    )


@pytest.mark.parametrize(
    ("rms", "target", "predicted", "kept", "words"),
    [
        (0.01, 0.02, 0.015, True, "within the error target"),
        (0.03, 0.02, 0.05, False, "as was expected"),
        (0.06, 0.02, 0.05, False, "above what was expected"),
        (0.03, 0.02, 0.01, False, "above what was expected"),
        (0.03, None, 0.05, True, "as expected"),
        (0.06, None, 0.05, False, "above what was expected"),
        (0.06, None, None, None, "promises no error"),
    ],
)
def test_verdict_judges_the_worst_channel(rms, target, predicted, kept, words):
    found, sentence = verdict(of((0.001, rms, 0.001), target, predicted, "layered" if predicted is None else "ewald"))
    assert found is kept
    assert words in sentence


def test_a_black_channel_has_no_number():
    measured = of((0.01, 0.0, 0.0123), 0.02, 0.01)
    measured.error.reference = measured.error.points.exitance = np.array([[1.0, 0.0, 1.0]])
    assert rows(measured)[0] == ("rms", ["1.0 %", "black", "1.2 %"])
    assert rows(None)[2] == ("rms together", ["-"])
    assert percent(1.755) == "176 %"
