"""Random scenes over the whole ranges of every setting: drawn or refused, finite, not negative, the same again.

MILKGLASS_SCENES=200 draws so many of each transport in place of those that every run has time for.
"""

import os

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.render.renderer import Renderer
from tests.support.random_scenes import random_scene, write_models

CASES = int(os.environ.get("MILKGLASS_SCENES", "6"))  # of each transport
WARM = 2e-3  # that a warm start of the solver may change, of the brightest
SPAN = {"layered": 0.0, "ewald": 0.0, "diffusion": WARM}


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    return write_models(tmp_path_factory.mktemp("models"))


def layers_of(frame):
    return {"radiance": frame.radiance, "irradiance": frame.irradiance, "exitance": frame.exitance}


def drawn(renderer, scene):
    """Layers of a picture, None where the scene is refused."""
    try:
        return layers_of(renderer.render(scene, samples=1))
    except InputError:
        return None


@pytest.mark.slow
@pytest.mark.parametrize("method", SPAN)
def test_random_scenes_are_finite_and_a_kept_renderer_draws_as_a_new_one(context, models, few_rays, method):
    rng, refused = np.random.default_rng(20), 0
    kept = Renderer(context)
    for i in range(CASES):
        scene = random_scene(rng, models, method)
        found = drawn(kept, scene)
        refused += found is None
        if found is None:
            continue
        for name, layer in found.items():
            assert np.isfinite(layer).all(), f"case {i}: {name}"
            assert (layer >= 0.0).all(), f"case {i}: {name}"
        if i % 24 == 0:
            first = drawn(Renderer(context), scene)
            kept.start_cold()
            second = drawn(kept, scene)
            for name, layer in found.items():
                np.testing.assert_array_equal(first[name], second[name], err_msg=f"case {i}: {name}")
                allowed = SPAN[method] * float(layer.max(initial=0.0))
                np.testing.assert_allclose(layer, first[name], rtol=0, atol=allowed, err_msg=f"case {i}: {name}")
    assert refused < CASES // 4
