"""One transport more is one file and one row of the registry; settings, renderer, window and reports know no other."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.transport.methods import METHODS
from milkglass.viewer.error.point_exitance import scene_exitance
from milkglass.viewer.error.report import error_report, illumination_of
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import DirectionalLight
from tests.support import uniform
from tests.support.rendering import BACK, FRONT, MeshRenderer, inside, scene_of
from tests.support.shapes import ball
from tests.support.solids import plates

LIGHTS = DirectionalLight(FRONT, (2.0, 1.0, 0.5)), DirectionalLight(BACK)


@pytest.fixture
def scene(monkeypatch):
    monkeypatch.setitem(METHODS, uniform.NAME, uniform.ROW)
    return scene_of(f"transport.method={uniform.NAME}", "transport.layers=4", lights=LIGHTS)


def test_without_its_row_nobody_knows_it():
    with pytest.raises(InputError, match='must be one of "diffusion", "ewald", "layered", not "uniform"'):
        apply_set(Scene(), [f"transport.method={uniform.NAME}"])


@pytest.mark.slow
def test_pixels_have_its_exitance(context, scene):
    frame = MeshRenderer(context, ball(20.0, 4)).render(scene, samples=1)
    seen = inside(frame)
    assert (frame.quality.method, frame.quality.resolution) == (uniform.NAME, 64)
    assert frame.irradiance[seen].max() > 0.5
    np.testing.assert_allclose(frame.exitance[seen], uniform.SHARE * frame.irradiance[seen], rtol=1e-5)


@pytest.mark.parametrize("mode", ["joined", "separate"])
def test_so_have_points_of_each_body(context, scene, mode):
    renderer = MeshRenderer(context, plates())
    scene = apply_set(scene, [f"model.bodies={mode}"])
    frame = renderer.render(scene, samples=1)
    lit = renderer.light(scene)
    assert (lit.body_marks is not None) == (mode == "separate")
    seen = inside(frame)
    np.testing.assert_allclose(frame.exitance[seen], uniform.SHARE * frame.irradiance[seen], rtol=1e-5)
    evaluate = scene_exitance(lit, renderer.scatter(lit), illumination_of(renderer, scene, lit))
    found = evaluate(frame.position[seen].astype(np.float64), frame.normal[seen].astype(np.float64))
    off = np.abs(found - frame.exitance[seen]) > 0.02 * found.max()
    assert off.any(axis=1).mean() < 0.01  # at the rims of shadows


@pytest.mark.slow
def test_its_error_is_reported(context, scene):
    content = error_report(MeshRenderer(context, ball(20.0, 4)), scene, points=20).content
    assert content["transport"]["method"] == uniform.NAME
    assert "difference" in content


@pytest.mark.slow
def test_the_window_draws_it(context, scene):
    live = Live(context, lambda: None)
    try:
        for _ in range(5):  # model, light and transport, each waited for
            live.draw(scene, Detail(at_once=True))
            live.wait()
        assert live.picture is not None
        assert live.is_settled(scene)
        assert live.finished.scattered.residuals == (0.0, 0.0, 0.0)
    finally:
        live.close()
