"""What the window shows before there is light: the model in clay, in the light's place, and then no longer."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from milkglass.viewer.assets import sources
from milkglass.viewer.window.app import read_pixels
from milkglass.viewer.window.replay import Headless
from milkglass.viewer.window.sketch import Sketch
from tests.support.driving import small_scene

SIZE = (700, 420)


@pytest.fixture
def started(context, model):
    """Return a window as it starts, before it has drawn anything."""
    scene = small_scene(model)
    window = Headless(replace(scene, display=replace(scene.display, background="#405060")), SIZE)
    yield window
    window.close()


def shown(window: Headless) -> np.ndarray:
    """Where the object is in the view."""
    window.frame()
    left, top, right, bottom = map(round, window.app.view.drawn_at)
    pixels = read_pixels(window.target, SIZE)[top:bottom, left:right].astype(int)
    return np.abs(pixels - pixels[2, 2]).max(axis=2) > 8


def test_the_model_stands_there_before_there_is_light(started, context, monkeypatch):
    view = started.app.view
    monkeypatch.setattr(view.live, "draw", lambda *_: None)  # as while light spreads
    assert not shown(started).any()
    view.begin_with(Sketch.of(context, started.app.session.scene))
    sketched = shown(started)
    assert 0.1 < sketched.mean() < 0.9
    session = started.app.session
    session.look(replace(session.scene.camera, azimuth_deg=90.0))
    assert (shown(started) != sketched).mean() > 0.02  # it turns
    monkeypatch.undo()
    started.settle()
    lit = shown(started)
    monkeypatch.setattr(view.live, "draw", lambda *_: None)
    assert np.array_equal(shown(started), lit)  # once there is a picture, that stays


def test_the_file_is_read_once(started, context, monkeypatch):
    sketch = Sketch.of(context, started.app.session.scene)
    monkeypatch.setattr(sources, "read_model", lambda *_: pytest.fail("the file is read again"))
    started.app.view.begin_with(sketch)
    started.settle()
    assert started.app.view.live.lit.model.mesh is sketch.model.mesh


def test_a_sketch_is_drawn_when_the_camera_moves_alone(started, context, monkeypatch):
    monkeypatch.setattr(started.app.view.live, "draw", lambda *_: None)
    sketch, drawn, draw = Sketch.of(context, started.app.session.scene), [], Sketch.draw
    monkeypatch.setattr(Sketch, "draw", lambda self, *rest: drawn.append(1) or draw(self, *rest))
    started.app.view.begin_with(sketch)
    first = shown(started)
    assert np.array_equal(shown(started), first)
    assert len(drawn) == 1
    session = started.app.session
    session.look(replace(session.scene.camera, azimuth_deg=90.0))
    shown(started)
    assert len(drawn) == 2


def test_most_of_the_program_is_imported_after_the_sketch():
    program = "import sys, milkglass.viewer.commands.show; sys.exit('milkglass.viewer.live.live' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
