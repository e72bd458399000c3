"""The whole chain against equation (1): summed directly in float64 over the surface, visibility by rays."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.samples import surface_samples
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import direct_exitance
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene, apply_set
from tests.support.rendering import BACK, FRONT, RayCaster, inside, relative_rms, scene_of

LAYERS = (8, 16, 32, 64)
POINTS = 150
# Rms over rms, worst channel, at 64 layers of 128 texels; measured 1.5 times lower or better. From the front the tents
# of (4) and (7) blur the light near its source; from behind the flux has spread before it is gathered.
LIMITS = {("skimmilk", FRONT): 0.05, ("marble", FRONT): 0.09, ("skimmilk", BACK): 0.006, ("marble", BACK): 0.006}


def reference(mesh, material, light, points):
    """M at points (n, 3) of a mesh, from sources a fifth of skim milk's mean free path apart."""
    sources = surface_samples(mesh, 0.3)
    entering = RayCaster(mesh).irradiance(sources.points, sources.normals, sources.normals, light, material.eta)
    return direct_exitance(points, sources.points, entering * sources.areas[:, None], dipoles(material))


def visible_points(frame, seed=0):
    """Rows and columns of pixels inside the object: a tuple that indexes its arrays."""
    rows, columns = np.nonzero(inside(frame))
    chosen = np.random.default_rng(seed).choice(len(rows), POINTS, replace=False)
    return rows[chosen], columns[chosen]


@pytest.mark.slow
@pytest.mark.parametrize("direction", [FRONT, BACK], ids=["front", "back"])
@pytest.mark.parametrize("material", ["skimmilk", "marble"])
@pytest.mark.parametrize("shape", ["ball", "knot", "plate"])
def test_the_error_falls_with_the_layers(renderer_of, shapes, shape, material, direction):
    """Objects of 20 mm, exitance at random visible points: every doubling of the layers helps in every channel."""
    light = DirectionalLight(direction)
    settings = [f"material.name={material}", "display.image_size=[192, 192]", "transport.resolution=128"]
    errors, expected = [], None
    for n_layers in LAYERS:
        scene = scene_of(*settings, f"transport.layers={n_layers}", lights=(light,))
        frame = renderer_of(shape).render(scene, samples=1)
        if expected is None:
            pixels = visible_points(frame)
            expected = reference(shapes[shape], scene.material.resolve(), light, frame.position[pixels])
        errors.append(relative_rms(frame.exitance[pixels], expected))
    assert np.all(np.diff(errors, axis=0) < 0.0), errors
    assert np.all(errors[-1] < LIMITS[material, direction]), errors


@pytest.mark.slow
def test_the_error_falls_with_the_resolution(renderer_of, shapes):
    """Ketchup, whose mean free path of half a millimetre needs fine texels, on the plate lit from the front."""
    light = DirectionalLight(FRONT)
    errors, expected = [], None
    for resolution in (16, 32, 64, 128):
        scene = scene_of(
            "material.name=ketchup", "transport.layers=64", f"transport.resolution={resolution}", lights=(light,)
        )
        frame = renderer_of("plate").render(scene, samples=1)
        if expected is None:
            pixels = visible_points(frame)
            expected = reference(shapes["plate"], scene.material.resolve(), light, frame.position[pixels])
        errors.append(relative_rms(frame.exitance[pixels], expected)[0])
    assert np.all(np.diff(errors) < 0.0), errors


def test_the_ball_of_skim_milk(renderer_of, shapes):
    """64 layers at 128 texels on a ball of 20 mm: under 6 % rms in every channel (measured .6, 1.5 and 3.4 %)."""
    light = DirectionalLight(FRONT)
    scene = scene_of("material.name=skimmilk", "transport.layers=64", "transport.resolution=128", lights=(light,))
    frame = renderer_of("ball").render(scene, samples=1)
    pixels = visible_points(frame, seed=1)
    expected = reference(shapes["ball"], scene.material.resolve(), light, frame.position[pixels])
    assert np.all(relative_rms(frame.exitance[pixels], expected) < [0.012, 0.025, 0.06])
    np.testing.assert_allclose(frame.exitance[pixels].mean(axis=0), expected.mean(axis=0), rtol=0.04)


@pytest.mark.parametrize("direction", [FRONT, BACK], ids=["front", "back"])
@pytest.mark.parametrize("material", ["skimmilk", "marble"])
@pytest.mark.parametrize("shape", ["ball", "knot", "plate"])
def test_ewald_meets_its_error_target(renderer_of, shapes, shape, material, direction):
    """2 % in rms; rms over the channels, as a picture shows them together."""
    light = DirectionalLight(direction)
    settings = ["transport.method=ewald", "transport.error_target=0.02", f"material.name={material}"]
    scene = replace(
        apply_set(Scene(), [*settings, "display.image_size=[192, 192]", "camera.azimuth_deg=20"]), lights=(light,)
    )
    renderer = renderer_of(shape)
    frame = renderer.render(scene, samples=1)
    assert renderer.light(scene).quality.warning is None
    pixels = visible_points(frame)
    expected = reference(shapes[shape], scene.material.resolve(), light, frame.position[pixels])
    error = np.sqrt(np.square(frame.exitance[pixels] - expected).mean() / np.square(expected).mean())
    assert error < 0.02
    # at an eighth of the work of 64 layers, and closer than those from the front
    assert np.prod(renderer.light(scene).grid.shape) < 64 * 128 * 128 / 8


@pytest.mark.slow
def test_the_two_methods_converge_to_each_other(renderer_of):
    """Many layers and a fine split, on the knot lit from behind: they share no kernel, no weights and no box."""
    light = (DirectionalLight(BACK),)
    layered = scene_of("material.name=skimmilk", "transport.layers=128", "transport.resolution=128", lights=light)
    split = scene_of("material.name=skimmilk", "transport.resolution=64", method="ewald", lights=light)
    one, other = (renderer_of("knot").render(scene, samples=1) for scene in (layered, split))
    seen = inside(one)
    assert np.all(relative_rms(one.exitance[seen], other.exitance[seen]) < 0.003)
