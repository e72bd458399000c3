"""Beams of a scene's lights: the power of every kind of lamp, what casts them again, and matter that needs none."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.grid.convolution import LayerConvolver
from milkglass.core.grid.layers import fit_nodes
from milkglass.core.paths.deposit import collided
from milkglass.core.paths.emission import Ball
from milkglass.core.paths.surface import Surface
from milkglass.viewer.render.beams import lamp_beams
from milkglass.viewer.scene.lights import LIGHT_KINDS, DirectionalLight, as_kind
from milkglass.viewer.scene.scene import apply_set
from tests.support.counting import rays_cast
from tests.support.rendering import inside, scene_of
from tests.support.solids import ball, mesh_of

SUN = DirectionalLight((0.3, 0.4, 1.0), (3.0, 2.0, 1.0))
MURKY = ["material.sigma_s_prime=[0.03,0.05,0.08]", "material.sigma_a=[0.0001,0.0002,0.0005]", "material.eta=1.33"]


@pytest.mark.parametrize("kind", LIGHT_KINDS)
def test_lamps_of_all_kinds_send_the_power_that_a_distant_one_does(kind):
    mesh = mesh_of(ball(5.0, subdivisions=4))
    surface, around, grid = Surface.of(mesh, 1.33), Ball.around(mesh), fit_nodes(mesh.bounds, 12)
    light = as_kind(SUN, kind)
    if kind == "rectangle":
        light = light.with_values(size_mm=(20.0, 20.0))
    entered, expected = (
        collided(lamp_beams(lamp, surface, around, 30_000), (5.0,) * 3, grid).sum(axis=(1, 2, 3))
        for lamp in (light, SUN)
    )
    np.testing.assert_allclose(entered, expected, rtol=0.03)


@pytest.mark.gl
@pytest.mark.slow
def test_beams_are_cast_where_a_light_moves_and_by_no_material(renderer_of, monkeypatch):
    """Where the camera moves no product runs at all."""
    renderer = renderer_of("ball")
    size = float(np.ptp(renderer.model.mesh.bounds, axis=0).max())
    settings = [f"model.size_mm={size}", "transport.resolution=24", "display.image_size=[48,48]"]
    lamps = SUN, DirectionalLight((0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
    scene = scene_of("transport.method=diffusion", *settings, *MURKY, method="ewald", lights=lamps)

    def cast(scene) -> set[str]:
        frame = renderer.render(scene, samples=1)
        assert frame.subsurface[inside(frame)].min() > 0.0
        return {name for name in frame.timings if name.startswith("beams of light")}

    assert cast(scene) == {"beams of light 1", "beams of light 2"}
    assert cast(apply_set(scene, ["material.sigma_a=[0.001,0.002,0.003]"])) == set()
    moved = replace(scene, lights=(SUN, replace(lamps[1], direction=(1.0, 0.0, 0.0))))
    assert cast(moved) == {"beams of light 2"}
    assert cast(apply_set(scene, ["material.name=marble"])) == set()
    cast(scene)
    monkeypatch.setattr(LayerConvolver, "convolve", lambda *_: pytest.fail("a product has run"))
    assert cast(apply_set(scene, ["camera.azimuth_deg=100", "camera.zoom=1.3"])) == set()


@pytest.mark.gl
@pytest.mark.slow
def test_a_slider_of_matter_that_scatters_forward_casts_no_ray(renderer_of):
    """Neither for what collides first nor for what does again; an index of refraction casts all."""
    renderer = renderer_of("ball")
    size = float(np.ptp(renderer.model.mesh.bounds, axis=0).max())
    settings = [f"model.size_mm={size}", "transport.resolution=24", "display.image_size=[48,48]"]
    forward = [*MURKY, "material.g=[0.9,0.7,0.5]"]
    scene = scene_of("transport.method=diffusion", *settings, *forward, method="ewald", lights=(SUN,))

    def cast(*settings: str) -> int:
        return rays_cast(lambda: renderer.scatter(renderer.light(apply_set(scene, settings))))

    assert cast() > 0
    assert cast("material.sigma_a=[0.001,0.002,0.003]") == 0
    assert cast("material.sigma_s_prime=[0.3,0.05,0.01]") == 0
    assert cast("material.eta=1.4") > 0
