"""Pictures of matter in clear parts: a tumbler with what is in it."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.light.probe import Probe
from milkglass.core.paths.surface import ClearPart
from milkglass.core.paths.tree import Tree
from milkglass.viewer.render.picture import Frame, PictureRequest, read_image
from milkglass.viewer.render.renderer import Renderer, render
from milkglass.viewer.render.tracing import dimming
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import (
    CameraSettings,
    DisplaySettings,
    EnvironmentSettings,
    GroundSettings,
    MaterialSettings,
    ModelSettings,
    TransportSettings,
)
from tests.support import solids

WHITE = EnvironmentSettings(probe=Probe.from_pixels(np.ones((16, 32, 3), np.float32)))
MILK = MaterialSettings(sigma_s_prime=(2.0, 2.0, 2.0), sigma_a=(0.0, 0.0, 0.0), eta=1.33)


def tumbler(material: MaterialSettings, **values) -> Scene:
    scene = Scene(
        model=ModelSettings(builtin="tumbler", size_mm=95.0),
        material=material,
        environment=WHITE,
        camera=CameraSettings(elevation_deg=12.0),
        display=DisplaySettings(image_size=(64, 64)),
        transport=TransportSettings(resolution=32),
    )
    return replace(scene, **values)


def radiance_on(frame: Frame) -> np.ndarray:
    return frame.radiance[frame.alpha >= 1.0]


def test_a_filled_glass_in_a_white_furnace_is_not_to_be_seen(context, few_rays):
    np.testing.assert_allclose(radiance_on(render(tumbler(MaterialSettings.clear(1.33)))), 1.0, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("material", "error", "deviation"),
    [(MILK, 0.01, 0.04), (replace(MILK, sigma_s_prime=(0.02, 0.1, 0.2)), 0.025, 0.04)],
)
def test_what_scatters_in_a_glass_is_hardly_to_be_seen_in_a_white_furnace(context, material, error, deviation):
    scene = tumbler(material, transport=TransportSettings(), display=DisplaySettings(image_size=(128, 128)))
    found = radiance_on(render(scene))
    np.testing.assert_allclose(found.mean(axis=0), 1.0, atol=error)
    assert found.std() < deviation


@pytest.mark.slow
@pytest.mark.parametrize(("eta", "absorption", "least", "most"), [(1.0, 0.0, 0.9, 1.05), (1.5, 5.0, 0.0, 0.1)])
def test_a_clear_part_casts_the_shadow_of_what_it_takes_away(context, few_rays, eta, absorption, least, most):
    """A lamp from the left, and the ground on the right: of glass that bends and absorbs nothing none is to be seen."""
    nothing, dark = MaterialSettings.clear(eta), MaterialSettings.clear(eta, (absorption,) * 3)
    lamp = DirectionalLight((-1.0, 1.0, 0.0), (3.0, 3.0, 3.0), angle_deg=10.0)
    black = EnvironmentSettings()
    view = CameraSettings(elevation_deg=60.0, zoom=0.6)
    on = GroundSettings(on=True, reflectance=0.5, gap_mm=0.1)
    scene = tumbler(nothing, materials={"glass": dark}, environment=black, lights=(lamp,), camera=view, ground=on)
    frame = render(scene, samples=1)
    radiance, (height, width) = frame.radiance[..., 1], frame.alpha.shape
    middle = radiance[height // 2 - 2 : height // 2 + 2]
    beside, in_open = middle[:, width // 2 + 4 : width // 2 + 10], np.quantile(middle, 0.9)
    assert least <= beside.mean() / in_open < most


def test_pictures_depend_on_the_material_of_a_part_and_say_it(context, few_rays):
    renderer, clear = Renderer(context), tumbler(MaterialSettings.clear(1.33))
    amber = replace(clear, materials={"glass": MaterialSettings.clear(1.5, (0.0, 0.1, 0.5))})
    plain, tinted, again = (renderer.render(scene, samples=1) for scene in (clear, amber, clear))
    np.testing.assert_array_equal(again.radiance, plain.radiance)
    red, green, blue = radiance_on(tinted).mean(axis=0)
    assert red > 0.98
    assert blue < 0.8 * green < 0.9 * red
    assert any("clear parts: glass (eta 1.5, absorption 0, 0.1, 0.5 /mm)" in sentence for sentence in tinted.parts)


@pytest.mark.slow
def test_few_rays_of_sight_show_a_glass_without_blocks(context, few_rays, monkeypatch):
    """They are followed where it differs, and so few as squares of pixels would have, each of one colour."""
    size, side, renderer, followed = 128, 4, Renderer(context), list[int]()
    juice = MaterialSettings.clear(1.33, (0.005, 0.02, 0.05))
    around = EnvironmentSettings(builtin="window")
    scene = tumbler(juice, environment=around, display=DisplaySettings(image_size=(size, size)))
    find = Tree.find
    monkeypatch.setattr(
        Tree, "find", lambda tree, sight, *rest: followed.append(len(sight.points)) or find(tree, sight, *rest)
    )
    lit = renderer.light(scene)
    gather = renderer.gather(lit, renderer.scatter(lit))

    def picture(step: int) -> np.ndarray:
        followed.clear()
        return read_image(renderer.shade(scene, lit, gather, PictureRequest(path_step=step))).astype(float)

    whole, squares = picture(1), followed[0] / side**2
    few = picture(side)
    assert sum(followed) < 1.5 * squares  # along outlines squares have few pixels
    blocks = np.repeat(np.repeat(whole[::side, ::side], side, axis=0), side, axis=1)
    assert np.abs(few - whole).mean() < 0.5 * np.abs(blocks - whole).mean()


def test_a_transport_that_follows_no_rays_says_that_it_leaves_clear_parts_out(context, few_rays):
    frame = render(tumbler(MILK, transport=TransportSettings(method="ewald", resolution=32)), samples=1)
    assert any(sentence.startswith("glass: parts with a material of their own") for sentence in frame.warnings)


def test_an_opaque_part_says_what_does_not_know_it(context, few_rays):
    holder = {"glass": MaterialSettings.clear(1.5, (5.0, 5.0, 5.0))}
    frame = render(tumbler(MILK, materials=holder), samples=1)
    assert any(sentence.startswith("glass: little light crosses it") for sentence in frame.warnings)
    assert radiance_on(frame).min() < 0.1 < radiance_on(frame).max()


def test_opaque_matter_is_dimmed_by_the_thickness_of_what_is_before_it():
    wall = solids.hollow(solids.block((12.0, 12.0, 12.0)), solids.block((10.0, 10.0, 10.0)))
    part = ClearPart(wall, 1.5, (0.0, 0.1, 1.0))
    for matter, thickness in ((4.0, 1.0), (10.4, 0.8)):  # with air between, and reaching into it
        found = dimming(solids.mesh_of(solids.block((matter, matter, matter))), [part])
        longer = 2.0 * 1.5**2 * (1.0 - np.sqrt(1.0 - 1.0 / 1.5**2))
        expected = np.exp(-longer * thickness * np.array(part.absorption))
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-4)
