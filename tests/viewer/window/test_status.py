"""What the window says of what goes on, and Escape, which ends it."""

import threading
from unittest.mock import patch

import numpy as np
import pytest

from milkglass.viewer.assets import sources
from milkglass.viewer.render.renderer import Renderer
from tests.support.driving import Driver, small_scene, write_knot


@pytest.fixture
def driver(context, model):
    driver = Driver(small_scene(model), (640, 360), fixed_size=False)
    yield driver
    driver.close()


def held(function, until: threading.Event):
    """A function that first waits for an event."""

    def wait(*arguments, **named):
        assert until.wait(60.0)
        return function(*arguments, **named)

    return wait


def test_loading_is_told_by_name_and_escape_ends_it(driver, tmp_path):
    before, picture, go_on = driver.session.scene, driver.picture(), threading.Event()
    with patch.object(sources, "read_model", held(sources.read_model, go_on)):
        driver.app.commands.run("open", str(write_knot(tmp_path / "other.ply")))
        driver.frames(3)
        left, right = driver.app.status()
        assert left.startswith("knot.ply")  # which is what is seen
        assert right == "loading other.ply: 0 %   Esc cancels"
        driver.key("escape")
        assert driver.session.scene == before
        assert not driver.session.can_undo
        go_on.set()
        assert np.array_equal(driver.picture(), picture)


def test_light_on_its_way_makes_the_picture_preliminary_until_escape(driver):
    before, picture, go_on = driver.session.scene, driver.picture(), threading.Event()
    with patch.object(Renderer, "scatter", held(Renderer.scatter, go_on)):
        driver.session.edit("material", name="ketchup")
        driver.frames(3)
        _, right = driver.app.status()
        assert right == "light spreads   preliminary   Esc cancels"
        driver.key("escape")
        assert driver.session.scene == before
        go_on.set()
        assert np.array_equal(driver.picture(), picture)
    assert driver.app.status()[1] == "final"


def test_escape_closes_what_is_open_before_it_cancels(driver):
    go_on = threading.Event()
    with patch.object(Renderer, "scatter", held(Renderer.scatter, go_on)):
        driver.key("h")
        driver.session.edit("material", name="ketchup")
        driver.frames(3)
        driver.key("escape")
        assert not driver.app.actions.help_shown
        assert driver.session.scene.material.name == "Ketchup"
        go_on.set()
        driver.settle()
