"""Grid coordinates and the gather from the 3-D texture, on the GPU, against core.grid.layers."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.grid.layers import fit_box, fit_layers, gather
from milkglass.core.material.fresnel import transmittance
from milkglass.core.transport.fft import NodeExitance
from milkglass.viewer.gl.buffers import SampleBuffers
from milkglass.viewer.passes.layers import LayersPass
from milkglass.viewer.render.picture import PictureRequest, read_frame
from milkglass.viewer.scene.lights import DirectionalLight
from tests.support.rendering import (
    FRONT,
    METHODS,
    OUTLIERS,
    MeshRenderer,
    inside,
    outliers,
    random_samples,
    scene_of,
)
from tests.support.shapes import plate

LAYERINGS = [(1, 16), (2, 64), (8, 128), (33, 100)]


@pytest.mark.parametrize(("n_layers", "resolution"), LAYERINGS)
@pytest.mark.parametrize("shape", ["ball", "knot", "plate"])
def test_coordinates_are_those_of_the_grid(context, renderer_of, shapes, shape, n_layers, resolution):
    mesh = shapes[shape]
    lit = renderer_of(shape).light(scene_of("camera.elevation_deg=-35", "camera.roll_deg=12"))
    grid = fit_layers(mesh.vertices, lit.camera.rotation, n_layers, resolution)
    samples, _ = random_samples(mesh, 5_000)
    actual = LayersPass(context).coordinates(SampleBuffers(context, samples), grid)
    assert actual.dtype == np.float32
    np.testing.assert_allclose(actual, grid.coordinates(samples.points), atol=2e-6 * resolution)
    top = np.array([grid.width, grid.height, grid.n_layers]) - 1.0
    assert np.all((actual > -1e-3) & (actual < top + 1e-3))


@pytest.mark.parametrize("shape", ["ball", "plate"])
def test_coordinates_are_those_of_a_box(context, shapes, shape):
    mesh = shapes[shape]
    grid = fit_box(mesh.bounds, 0.4)
    samples, _ = random_samples(mesh, 5_000)
    actual = LayersPass(context).coordinates(SampleBuffers(context, samples), grid)
    np.testing.assert_allclose(actual, grid.coordinates(samples.points), atol=1e-4)


def carried(lit, volume):
    """A volume as if transport had made it."""
    return NodeExitance(lit.transport, lit.grid, lit.profiles, volume)


def gathered(lit, volume, frame, seen):
    """M at pixels in float64, as core has it: W O + factor(0) E."""
    positions = lit.grid.coordinates(frame.position[seen])
    local = lit.transport.local(lit.grid, lit.profiles).factors[0]
    return gather(lit.transport.weights(lit.grid, positions), volume) + local * frame.irradiance[seen]


def facing(frame, *lights):
    """Pixels inside the object that no light reaches through a sheet, for they face them all."""
    return inside(frame) & np.all([frame.normal @ np.array(light.direction) > 0.0 for light in lights], axis=0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", ["ball", "knot", "plate", "cube"])
@pytest.mark.parametrize("view", ["camera.orthographic=true", "camera.elevation_deg=40"])
def test_pixels_gather_what_core_gathers(renderer_of, shape, view, method):
    """M of every pixel is the volume's interpolation at the pixel's position, trilinear or by B-splines."""
    renderer = renderer_of(shape)
    lights = (DirectionalLight(FRONT), DirectionalLight((1.0, 0.4, 0.8), (1.0, 2.0, 3.0)))
    scene = scene_of(view, method=method, lights=lights)
    frame = renderer.render(scene, samples=1)
    lit = renderer.light(scene)
    volume = renderer.scatter(lit).volume
    seen = facing(frame, *lights)
    assert np.count_nonzero(seen) > 300
    expected = gathered(lit, volume, frame, seen)
    assert outliers(frame.exitance[seen], expected, rtol=2e-3, atol=2e-4 * float(expected.max())) <= OUTLIERS


@pytest.mark.parametrize(("n_layers", "resolution"), LAYERINGS)
def test_a_volume_of_noise_is_gathered_without_a_shift(renderer_of, n_layers, resolution):
    """Noise from node to node: half a texel off, in any axis, and nothing would agree."""
    renderer = renderer_of("knot")
    scene = scene_of(f"transport.layers={n_layers}", f"transport.resolution={resolution}", "camera.elevation_deg=25")
    lit = renderer.light(scene)
    noise = np.random.default_rng(4).random((3, *lit.grid.shape), np.float32)
    gather = renderer.gather(lit, carried(lit, noise))
    frame = read_frame(renderer.shade(scene, lit, gather, PictureRequest(parts=True)), {})
    seen = inside(frame)
    expected = gathered(lit, noise, frame, seen)
    # filter weights of GPUs may have 8 bits
    assert outliers(frame.exitance[seen], expected, rtol=0.0, atol=0.015) <= OUTLIERS


def test_noise_is_gathered_by_splines_without_a_shift(renderer_of):
    renderer = renderer_of("knot")
    scene = scene_of("camera.elevation_deg=25", method="ewald")
    lit = renderer.light(scene)
    noise = np.random.default_rng(4).random((3, *lit.grid.shape), np.float32)
    gather = renderer.gather(lit, carried(lit, noise))
    frame = read_frame(renderer.shade(scene, lit, gather, PictureRequest(parts=True)), {})
    seen = facing(frame, DirectionalLight(FRONT))
    assert outliers(frame.exitance[seen], gathered(lit, noise, frame, seen), rtol=0.0, atol=0.015) <= OUTLIERS


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.5, 0.2, -1.0)])
def test_a_sheet_passes_on_what_the_layers_are_too_coarse_for(context, direction):
    """A plate of half a millimetre lit from behind: M = W O + factor(thickness) E of the other side."""
    renderer = MeshRenderer(context, plate(20.0, 0.5, 32))
    light = DirectionalLight(direction)
    scene = scene_of("camera.elevation_deg=10", method="ewald", lights=(light,))
    frame, lit = renderer.render(scene, samples=1), renderer.light(scene)
    local = lit.transport.local(lit.grid, lit.profiles)
    assert local.reach > 0.5
    thickness = np.linspace(0.0, local.reach, len(local.factors))
    factor = np.array([np.interp(0.5, thickness, local.factors[:, channel]) for channel in range(3)])
    cosine = -direction[2] / np.linalg.norm(direction)
    through = factor * 3.0 * cosine * transmittance(lit.eta, cosine)
    seen = inside(frame, 8) & (frame.normal[..., 2] > 0.9)
    on_layers = gathered(lit, renderer.scatter(lit).volume, frame, seen)
    expected = on_layers + through
    assert np.all(np.abs(through) > 0.02 * on_layers.mean(axis=0))
    assert outliers(frame.exitance[seen], expected, rtol=0.01) <= OUTLIERS


def test_a_volume_stays_valid_while_the_camera_moves(renderer_of):
    """M is a function of world position: another camera, an older volume, the same M."""
    renderer = renderer_of("knot")
    before = scene_of("transport.layers=32")
    lit = renderer.light(before)
    exitance = renderer.scatter(lit)
    volume = renderer.gather(lit, exitance)
    turned = replace(before, camera=replace(before.camera, azimuth_deg=50.0, zoom=1.5))
    lit_now = renderer.light(turned)
    frame = read_frame(renderer.shade(turned, lit_now, volume, PictureRequest(parts=True)), {})
    seen = inside(frame)
    expected = gathered(lit, exitance.volume, frame, seen)
    assert outliers(frame.exitance[seen], expected, rtol=2e-3, atol=2e-4 * float(exitance.volume.max())) <= OUTLIERS


@pytest.mark.parametrize("shape", [(1, 1, 2, 2), (3, 2, 5, 7), (3, 128, 3, 4)])
def test_a_volume_reads_back_as_it_was(context, shape):
    exitance = np.random.default_rng(0).random((3, *shape[1:]), np.float32)
    texture = LayersPass(context).volume(exitance)
    assert texture.size == (shape[3], shape[2], shape[1])
    back = np.frombuffer(texture.read(), np.float32).reshape(*shape[1:], 3)
    np.testing.assert_array_equal(np.moveaxis(back, -1, 0), exitance)


def test_outside_the_volume_its_edge_goes_on(renderer_of):
    """A volume that covers a tenth of the object: clamped, never wrapped and never black."""
    renderer = renderer_of("ball")
    scene = scene_of()
    lit = renderer.light(scene)
    full = renderer.gather(lit, carried(lit, np.full((3, *lit.grid.shape), 2.0, np.float32)))
    far = replace(full, world_to_texture=full.world_to_texture @ np.diag([10.0, 10.0, 10.0, 1.0]))
    frame = read_frame(renderer.shade(scene, lit, far, PictureRequest(parts=True)), {})
    np.testing.assert_allclose(frame.exitance[frame.alpha == 1.0], 2.0, rtol=1e-6)
