"""Whole pictures in a white furnace: what a shape mirrors, lets through and scatters adds up to its surroundings."""

import numpy as np
import pytest

from milkglass.core.light.probe import Probe
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import EnvironmentSettings, ModelSettings
from tests.support.furnaces import bowl, coarse_sculpture, shape

SHARES = np.array([0.05, 0.1, 0.2])  # of the longest side: mean free paths of R, G and B, which nodes resolve
WHITE = EnvironmentSettings(probe=Probe.from_pixels(np.ones((16, 32, 3), np.float32)))


@pytest.mark.slow
@pytest.mark.parametrize("make", [bowl, coarse_sculpture])
def test_pictures_in_a_white_furnace_are_white(context, make):
    mesh = shape(make)
    scattering = 1.0 / (SHARES * float(np.ptp(mesh.bounds, axis=0).max()))
    scene = apply_set(
        Scene(model=ModelSettings(mesh=mesh), environment=WHITE, lights=()),
        [
            "display.image_size=[80, 80]",
            "material.eta=1.33",
            "material.sigma_a=[0,0,0]",
            f"material.sigma_s_prime={scattering.tolist()}",
        ],
    )
    frame = Renderer(context).render(scene, samples=1)
    radiance = frame.radiance[frame.alpha >= 1.0]
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=0.02)
    assert radiance.std(axis=0).max() < 0.04
