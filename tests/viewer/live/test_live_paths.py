"""Rays of sight in the window: few while something moves, and at rest the picture that `render` draws."""

import numpy as np
import pytest

from milkglass.viewer.files.images import write_exr
from milkglass.viewer.live.draft import DRAFT_PATH_STEP
from milkglass.viewer.render.tracing import Tracing
from milkglass.viewer.scene.scene import apply_set
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene
from tests.support.skies import sky


@pytest.fixture
def clear(context, few_rays, model):
    planes = dict(zip("RGB", np.moveaxis(sky(height=32), -1, 0), strict=True))
    write_exr(model.with_name("sky.exr"), planes)
    settings = [f"environment.path={model.with_name('sky.exr')}", "display.background=environment"]
    driver = Driver(
        apply_set(small_scene(model), [*settings, "material.name=apple juice", "transport.method=diffusion"])
    )
    yield driver
    driver.close()


@pytest.mark.slow
def test_a_clear_object_comes_to_rest_as_render_draws_it_and_is_dragged_with_few_rays(clear, monkeypatch):
    driver, traced = clear, []
    steps = Tracing.steps

    def counted(self, *arguments):
        traced.append((driver.view.detail.draft, arguments[-1]))
        return steps(self, *arguments)

    monkeypatch.setattr(Tracing, "steps", counted)
    first = driver.picture()
    np.testing.assert_array_equal(first, headless_picture(driver.session.scene, PICTURE))
    driver.drag((200.0, 200.0), (40.0, 10.0))
    turned = driver.picture()
    assert (turned != first).any()
    np.testing.assert_array_equal(turned, headless_picture(driver.session.scene, PICTURE))
    assert {step for is_draft, step in traced if is_draft} == {DRAFT_PATH_STEP}
    assert {step for is_draft, step in traced if not is_draft} == {1}
