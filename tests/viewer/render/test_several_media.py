"""Pictures of bodies of several kinds of matter that scatter light, each solved in its own, which light each other."""

from dataclasses import replace

import numpy as np
import pytest

import milkglass as mg
from milkglass.core.light.probe import Probe
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from milkglass.viewer.files.model import joined
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer, render
from tests.support import solids

WHITE = mg.EnvironmentSettings(probe=Probe.from_pixels(np.ones((16, 32, 3), np.float32)))


def white(scattering: tuple[float, ...], eta: float) -> mg.MaterialSettings:
    return mg.MaterialSettings(sigma_s_prime=scattering, sigma_a=(0.0, 0.0, 0.0), eta=eta)


MILKY, STONY = white((2.0, 2.0, 2.0), 1.33), white((4.0, 4.0, 4.0), 1.6)


def balls(gap: float, material: mg.MaterialSettings, other: mg.MaterialSettings | None, **values) -> mg.Scene:
    """Balls of 10 and 7 mm beside each other; the right one is the other's."""
    left, right = solids.ball(10.0, subdivisions=3), solids.ball(7.0, subdivisions=3)
    left.apply_translation([-10.0 - 0.5 * gap, 0.0, 0.0])
    right.apply_translation([7.0 + 0.5 * gap, 0.0, 0.0])
    scene = mg.Scene(
        model=mg.ModelSettings(mesh=joined(solids.mesh_of(left), solids.mesh_of(right))),
        material=material,
        materials={} if other is None else {"2": other},
        environment=WHITE,
        camera=mg.CameraSettings(elevation_deg=12.0, azimuth_deg=20.0),
        display=mg.DisplaySettings(image_size=(48, 48)),
        transport=mg.TransportSettings(resolution=40),
    )
    return replace(scene, **values)


def on_each(frame: Frame) -> list[np.ndarray]:
    """Radiance of the pixels of the left and of the right ball."""
    hit, right = frame.alpha >= 1.0, frame.position[..., 0] > 0.0
    return [frame.radiance[hit & ~right], frame.radiance[hit & right]]


@pytest.mark.slow
def test_bodies_of_two_media_are_not_to_be_seen_in_a_white_furnace(context, few_rays):
    """Without light between them, or with the other's index of refraction, they would be."""
    frame = render(balls(1.0, MILKY, STONY), samples=1)
    for radiance in on_each(frame):
        np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=0.01)
        assert radiance.std() < 0.015
    told = [sentence for sentence in frame.parts if "surface" in sentence]
    assert [sentence.partition(",")[0] for sentence in told] == ["the material", "2"]


@pytest.mark.slow
def test_a_body_in_the_murky_shell_of_another_is_not_to_be_seen_in_a_white_furnace(context, few_rays):
    """All its light has come through the shell: unscattered, or from its surface; and goes back there."""
    shell = solids.hollow(solids.ball(12.0, subdivisions=3), solids.ball(9.0, subdivisions=3))
    model = mg.ModelSettings(mesh=joined(shell, solids.mesh_of(solids.ball(7.0, subdivisions=3))))
    scene = balls(0.0, white((0.02, 0.05, 0.2), 1.33), None, model=model, materials={"3": STONY})
    hit = (frame := render(scene, samples=1)).alpha >= 1.0
    np.testing.assert_allclose(frame.radiance[hit].mean(axis=0), 1.0, atol=0.025)
    assert frame.radiance[hit].std() < 0.05


@pytest.mark.slow
def test_a_slider_of_one_part_solves_that_part_alone_where_no_light_goes_between(context, few_rays, monkeypatch):
    solved, channels, renderer = list[int](), DiffusionTransport._channels, Renderer(context)
    first = balls(1.0, MILKY, STONY, transport=mg.TransportSettings(resolution=40, exchange="off"))

    def counted(transport, problem, stages):
        solved.append(round(0.5 * np.ptp(problem.mesh.bounds[:, 1])))
        return channels(transport, problem, stages)

    monkeypatch.setattr(DiffusionTransport, "_channels", counted)
    renderer.scatter(renderer.light(first))
    assert solved == [10, 7]
    renderer.scatter(renderer.light(replace(first, materials={"2": replace(STONY, sigma_a=(0.1, 0.2, 0.3))})))
    assert solved == [10, 7, 7]


@pytest.mark.slow
@pytest.mark.parametrize("scattering", [(2.0, 2.0, 2.0), (0.05, 0.15, 4.0)])
def test_the_same_matter_twice_is_as_once(context, few_rays, scattering):
    matter = white(scattering, 1.33)
    once, twice = (render(balls(8.0, matter, other), samples=1) for other in (None, matter))
    np.testing.assert_allclose(twice.radiance, once.radiance, atol=2e-6)


def test_media_that_touch_are_told_and_a_method_that_knows_but_one(context, few_rays):
    small = mg.DisplaySettings(image_size=(16, 16)), mg.TransportSettings(resolution=32)
    touching = balls(-0.5, MILKY, STONY, display=small[0], transport=small[1])
    assert any(sentence.startswith("the material and 2 touch") for sentence in render(touching, samples=1).warnings)
    apart = balls(0.5, MILKY, STONY, display=small[0], transport=mg.TransportSettings(method="ewald", resolution=32))
    warnings = render(apart, samples=1).warnings
    assert not any("touch" in sentence for sentence in warnings)
    assert any(sentence.startswith("2: a part with a material of its own that scatters light") for sentence in warnings)
