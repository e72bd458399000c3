"""Grid coordinates and the gather from the 3-D texture, on the GPU, against core.layers."""

from dataclasses import replace

import numpy as np
import pytest

from core.layers import fit_layers, gather, tent_matrix
from tests.rendering import BACK, OUTLIERS, inside, outliers, random_samples, scene_of
from viewer.buffers import SampleBuffers
from viewer.composite_pass import Gather
from viewer.layers_pass import LayersPass
from viewer.picture import read_frame
from viewer.scene import DirectionalLight

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


@pytest.mark.parametrize("shape", ["ball", "knot", "plate", "cube"])
@pytest.mark.parametrize("view", ["camera.orthographic=true", "camera.elevation_deg=40"])
def test_pixels_gather_what_core_gathers(renderer_of, shape, view):
    """M of every pixel is the volume's trilinear interpolation at the pixel's position."""
    renderer = renderer_of(shape)
    scene = scene_of(view, "transport.layers=9", lights=(DirectionalLight(BACK),))
    frame = renderer.render(scene, samples=1)
    lit = renderer.light(scene)
    volume = renderer.scatter(lit)
    seen = inside(frame)
    expected = gather(tent_matrix(lit.grid, lit.grid.coordinates(frame.position[seen])), volume)
    assert outliers(frame.exitance[seen], expected, rtol=2e-3, atol=2e-4 * float(volume.max())) <= OUTLIERS


@pytest.mark.parametrize(("n_layers", "resolution"), LAYERINGS)
def test_a_volume_of_noise_is_gathered_without_a_shift(renderer_of, n_layers, resolution):
    """Noise from node to node: half a texel off, in any axis, and nothing would agree."""
    renderer = renderer_of("knot")
    scene = scene_of(f"transport.layers={n_layers}", f"transport.resolution={resolution}", "camera.elevation_deg=25")
    lit = renderer.light(scene)
    noise = np.random.default_rng(4).random((3, *lit.grid.shape), np.float32)
    frame = read_frame(renderer.shade(scene, lit, renderer.gather(lit, noise), parts=True), {})
    seen = inside(frame)
    expected = gather(tent_matrix(lit.grid, lit.grid.coordinates(frame.position[seen])), noise)
    # filter weights of GPUs may have 8 bits
    assert outliers(frame.exitance[seen], expected, rtol=0.0, atol=0.015) <= OUTLIERS


def test_a_volume_stays_valid_while_the_camera_moves(renderer_of):
    """M is a function of world position: another camera, an older volume, the same M."""
    renderer = renderer_of("knot")
    before = scene_of("transport.layers=32")
    lit = renderer.light(before)
    exitance = renderer.scatter(lit)
    volume = renderer.gather(lit, exitance)
    turned = replace(before, camera=replace(before.camera, azimuth_deg=50.0, zoom=1.5))
    lit_now = renderer.light(turned)
    frame = read_frame(renderer.shade(turned, lit_now, volume, parts=True), {})
    seen = inside(frame)
    expected = gather(tent_matrix(lit.grid, lit.grid.coordinates(frame.position[seen])), exitance)
    assert outliers(frame.exitance[seen], expected, rtol=2e-3, atol=2e-4 * float(exitance.max())) <= OUTLIERS


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
    full = renderer.gather(lit, np.full((3, *lit.grid.shape), 2.0, np.float32))
    far = full.world_to_texture @ np.diag([10.0, 10.0, 10.0, 1.0])
    frame = read_frame(renderer.shade(scene, lit, Gather(full.volume, far, full.eta), parts=True), {})
    np.testing.assert_allclose(frame.exitance[frame.alpha == 1.0], 2.0, rtol=1e-6)
