"""Stages that pause between their steps: what is drawn meanwhile changes nothing of theirs, nor they of it."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from milkglass.core.stages import Allowance, Unfinished
from milkglass.viewer.gl.context import float_targets
from milkglass.viewer.render.picture import PictureRequest, read_frame
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.lights import DirectionalLight
from tests.support.rendering import MeshRenderer, scene_of
from tests.support.shapes import ball

T = TypeVar("T")
REQUEST = PictureRequest(pixel_offsets(2, 0), parts=True)
LAMPS = DirectionalLight((0.3, 0.8, 0.5), (2.0, 1.0, 0.5)), DirectionalLight((-0.5, 0.8, 0.3), angle_deg=4.0)


@pytest.mark.slow
def test_a_picture_in_steps_is_the_picture_whatever_is_bound_between_them(context, monkeypatch):
    """Bands of maps and pixels: scissor and viewport are those of a framebuffer, and stay with it."""
    for module in ("ground", "irradiance"):
        monkeypatch.setattr(f"milkglass.viewer.passes.{module}.PIXELS_A_STEP", 10_000)
    scene = scene_of("display.image_size=[64, 64]", "camera.elevation_deg=50", "ground.on=true", lights=LAMPS)
    stepped, whole = MeshRenderer(context, ball()), MeshRenderer(context, ball())
    bystander, pauses = context.framebuffer(float_targets(context, (8, 8), 1)), 0

    def finished(work: Callable[[], T]) -> T:
        nonlocal pauses
        while True:
            stepped.stages.begin(Allowance(1, 60.0))
            try:
                return work()
            except Unfinished:
                pauses += 1
                bystander.use()

    lit = finished(lambda: stepped.light(scene))
    gather = stepped.gather(lit, stepped.scatter(lit))
    picture = finished(lambda: stepped.shade(scene, lit, gather, REQUEST))
    found, expected = read_frame(picture, {}), read_frame(whole.draw(scene, REQUEST), {})
    assert pauses > 10
    for drawn in (bystander, context.extra.framebuffer):
        assert drawn.scissor == drawn.viewport == (0, 0, *drawn.size)
    for part in ("radiance", "irradiance", "alpha"):
        np.testing.assert_allclose(getattr(found, part), getattr(expected, part), rtol=1e-5, atol=1e-6)
