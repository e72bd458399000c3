"""Pictures of clear and murky matter against paths from the eye, part by part."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.light.probe import Probe
from milkglass.core.material import library
from milkglass.viewer.error.eye import BLOCK, MOST_BLOCKS, Blocks, eye_error, judged, judged_by_eye, part_error
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import MaterialSettings, Scene, apply_set
from milkglass.viewer.scene.settings import EnvironmentSettings, ModelSettings
from tests.support import solids

SMALL = "display.image_size=[96, 96]", "transport.resolution=24", "ground.on=true"


@pytest.fixture(scope="module")
def renderer(context):
    return Renderer(context)


@pytest.fixture(scope="module")
def mesh():
    return solids.mesh_of(solids.ball(10.0, subdivisions=4))


@pytest.fixture(scope="module")
def scene(mesh):
    sky = np.linspace(2.0, 0.2, 16)[:, None, None] * np.linspace(0.5, 1.5, 32)[:, None] * np.ones(3)
    environment = EnvironmentSettings(probe=Probe.from_pixels(sky.astype(np.float32)))
    return apply_set(Scene(model=ModelSettings(mesh=mesh), environment=environment, lights=()), SMALL)


@pytest.mark.parametrize(
    ("scattering", "absorption", "bars"),
    [
        ((0.0, 0.0, 0.0), (0.05, 0.05, 0.2), {"whole": 0.04, "mirror": 0.03, "unscattered": 0.04}),
        (
            (0.03, 0.1, 0.03),
            (0.01, 0.02, 0.1),
            {"whole": 0.04, "mirror": 0.03, "unscattered": 0.04, "once": 0.04, "often": 0.05, "scattered": 0.04},
        ),
    ],
)
def test_every_part_of_radiance_is_that_of_paths(renderer, scene, scattering, absorption, bars):
    matter = f"material.sigma_s_prime={list(scattering)}", f"material.sigma_a={list(absorption)}"
    found = eye_error(renderer, apply_set(scene, matter), 60_000, 0, lambda _: None)
    assert found.lost < 1e-3
    for name, bar in bars.items():
        part = found.whole if name == "whole" else found.parts[name]
        noise = np.array(part.noise)
        assert np.all((noise > 0.0) & (noise < 0.3)), name
        far = bar + 3.0 * noise.max() / np.sqrt(found.blocks)
        np.testing.assert_allclose(part.ratio, 1.0, atol=far, err_msg=name)
        assert max(part.rms) < 2.0 * bar, name
    shares = [found.parts[name].share for name in ("mirror", "unscattered", "once", "often")]
    np.testing.assert_allclose(np.sum(shares, axis=0), 1.0)


def test_what_a_transport_does_not_tell_apart_is_no_number(renderer, scene):
    found = eye_error(
        renderer, apply_set(scene, ["material.name=sprite", "transport.method=ewald"]), 2000, 0, lambda _: None
    )
    assert np.isnan([found.parts["once"].ratio, found.parts["mirror"].ratio]).sum() == 3
    np.testing.assert_array_equal(found.parts["unscattered"].ratio, 0.0)
    assert max(found.whole.ratio) < 0.3


def test_pictures_are_judged_small_under_wide_lamps(mesh):
    scene = apply_set(Scene(model=ModelSettings(mesh=mesh)), ["display.image_size=[800, 400]", "ground.on=true"])
    scene = replace(
        scene, lights=(DirectionalLight((0.0, 0.0, 1.0)), DirectionalLight((0.0, 0.0, 1.0), angle_deg=60.0))
    )
    small = judged(scene)
    assert small.display.image_size == (160, 80)
    assert [light.angle_deg for light in small.all_lights()] == [30.0, 60.0]
    assert not small.ground.on


def test_materials_of_few_collisions_are_judged_by_paths(mesh):
    judged_so = {name: judged_by_eye(Scene(material=MaterialSettings(name=name)), mesh)[0] for name in library.names()}
    assert all(judged_so[name] for name in ("Sprite", "Head & Shoulders Shampoo", "Merlot", "Espresso"))
    assert not any(judged_so[name] for name in ("Marble", "Cream", "Skimmilk", "Spectralon"))
    marble = Scene(material=MaterialSettings(name="marble"))
    assert judged_by_eye(marble, mesh)[1].startswith("light loses its course about 74 times in the object at most")


def test_paths_start_in_the_pixels_of_their_block(scene, mesh):
    alpha = np.zeros((64, 64))
    alpha[10:60, 10:60] = 1.0
    blocks = Blocks.of(alpha, seed=0)
    assert 16 <= blocks.count <= MOST_BLOCKS
    image = np.zeros((64, 64, 3))
    image[..., 0], image[..., 1] = np.mgrid[:64, :64]
    means = blocks.means(image)
    camera = model_camera(scene.camera, mesh, (64, 64))
    origins, directions, groups = blocks.shots(
        np.linalg.inv(camera.world_to_clip), (64, 64), 50, np.random.default_rng(0)
    )
    clip = np.concatenate([origins + directions, np.ones((len(origins), 1))], axis=1) @ camera.world_to_clip
    ndc = clip[:, :2] / clip[:, 3:]
    columns, rows = 32.0 * (ndc[:, 0] + 1.0) - 0.5, 32.0 * (1.0 - ndc[:, 1]) - 0.5
    counts = np.bincount(groups)
    np.testing.assert_array_equal(counts, 50)
    for found, expected in ((rows, means[:, 0]), (columns, means[:, 1])):
        np.testing.assert_allclose(np.bincount(groups, found) / counts, expected, atol=0.25 * BLOCK)
    with pytest.raises(InputError, match="too little of the object"):
        Blocks.of(np.zeros((64, 64)), seed=0)


def test_errors_are_without_the_noise_of_paths():
    rng = np.random.default_rng(0)
    truth, noise = 1.0 + rng.random((400, 3)), np.full((400, 3), 0.1)
    seen = truth + noise * rng.normal(size=truth.shape)
    everywhere = np.ones(3, np.bool_)
    right = part_error(truth, seen, noise, 2.0 * truth.mean(axis=0), everywhere)
    assert max(right.rms) < 0.04
    np.testing.assert_allclose(right.share, 0.5, rtol=0.02)
    wrong = part_error(1.2 * truth, seen, noise, truth.mean(axis=0), np.array([True, True, False]))
    np.testing.assert_allclose(wrong.ratio[:2], 1.2, rtol=0.01)
    np.testing.assert_allclose(wrong.rms[:2], 0.2, rtol=0.1)
    assert np.isnan([wrong.ratio[2], wrong.rms[2]]).all()
