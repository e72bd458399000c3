"""Irradiance on the GPU against rays, tables and direct integrals."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light import probe as environment
from milkglass.core.light.probe import Probe
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.files.model import load_model
from milkglass.viewer.files.radiance import read_radiance
from milkglass.viewer.gl.buffers import MeshBuffers, SampleBuffers
from milkglass.viewer.gl.context import latlong_texture
from milkglass.viewer.passes.irradiance import SampleIrradiancePass
from milkglass.viewer.passes.light_source import lamp, surround
from milkglass.viewer.passes.shadows import ShadowsPass
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import EnvironmentSettings
from tests.support.rendering import (
    BACK,
    FRONT,
    OUTLIERS,
    RayCaster,
    inside,
    outliers,
    random_samples,
    relative_rms,
    scene_of,
)

ETA = 1.5
SAMPLES = 10_000
DIRECTIONAL = DirectionalLight(FRONT)
OUTSIDE, INSIDE = PointLight((40.0, 60.0, 120.0)), PointLight((5.0, 8.0, 13.0), (300.0, 200.0, 100.0))


@pytest.fixture(scope="module")
def passes(context):
    return ShadowsPass(context), SampleIrradiancePass(context), latlong_texture(context, np.zeros((1, 1, 3), "f4"))


@pytest.fixture(scope="module")
def dragon(data_dir):
    mesh, warning = load_model(data_dir / "meshes" / "dragon_100k.ply", 100.0)
    assert warning is None or "open" in warning
    return mesh


def both(context, passes, mesh, light, seed=0):
    """E of a light at random samples of a mesh, on the GPU and by rays: two arrays (n, 3)."""
    shadows, irradiance, table = passes
    samples, face_normals = random_samples(mesh, SAMPLES, seed)
    shadow = shadows.render(MeshBuffers(context, mesh), mesh, light)
    gpu = irradiance.run(SampleBuffers(context, samples), lamp(light, shadow, table), ETA)
    rays = RayCaster(mesh).irradiance(samples.points, samples.normals, face_normals, light, ETA)
    return gpu, rays


def samples_at(points, normals):
    return SurfaceSamples(np.float32(points), np.float32(normals), np.ones(len(points), np.float32))


def error(gpu, rays):
    return np.abs(gpu - rays).mean() / rays.mean()


# Lamps against rays. What is left sits at the edges of shadows, where the map is filtered over three texels; where
# face normals and interpolated ones disagree about facing the light; and in creases finer than a texel.


@pytest.mark.parametrize("direction", [FRONT, BACK, (1.0, 0.1, 0.0), (-0.6, 0.45, -0.65)])
def test_a_directional_light_on_the_dragon(context, passes, dragon, direction):
    assert error(*both(context, passes, dragon, DirectionalLight(direction))) < 0.015


@pytest.mark.parametrize("position", [(40.0, 60.0, 120.0), (0.0, 200.0, 10.0), (30.0, 25.0, 15.0), (-10.0, 20.0, 5.0)])
def test_a_point_light_on_the_dragon(context, passes, dragon, position):
    """Outside the bounding sphere (one view) and inside it (six)."""
    gpu, rays = both(context, passes, dragon, PointLight(position))
    assert error(gpu, rays) < 0.03


@pytest.mark.parametrize("shape", ["ball", "knot", "plate", "cube"])
@pytest.mark.parametrize("light", [DIRECTIONAL, DirectionalLight(BACK), OUTSIDE, INSIDE], ids=repr)
def test_a_lamp_on_a_shape(context, passes, shapes, shape, light):
    gpu, rays = both(context, passes, shapes[shape], light)
    assert error(gpu, rays) < 0.01


def test_a_light_reaches_hidden_parts_too(context, passes, shapes):
    """Samples know nothing of a camera: a light and its opposite light the ball alike."""
    front, _ = both(context, passes, shapes["ball"], DirectionalLight((0.0, 0.0, 1.0)))
    back, _ = both(context, passes, shapes["ball"], DirectionalLight((0.0, 0.0, -1.0)))
    np.testing.assert_allclose(front.mean(axis=0), back.mean(axis=0), rtol=0.02)
    assert not np.any((front > 0.0) & (back > 0.0))


def test_irradiance_scales_with_colour_and_by_the_inverse_square(context, passes, shapes):
    far, _ = both(context, passes, shapes["ball"], PointLight((0.0, 0.0, 1e6), (3e12, 6e12, 9e12)))
    sun, _ = both(context, passes, shapes["ball"], DirectionalLight((0.0, 0.0, 1.0), (3.0, 6.0, 9.0)))
    assert outliers(far, sun, rtol=2e-4, atol=1e-4) < 0.01
    np.testing.assert_allclose(sun[:, 1:], sun[:, :1] * [2.0, 3.0], rtol=1e-6)


@pytest.mark.parametrize("distance", [1e3, 1e5, 1.01e5, 1e7, 1e9])
def test_a_far_point_light_is_a_directional_one(context, passes, shapes, distance):
    """At 1e9 mm, the farthest that a scene may name, depths are told apart as well as near by."""
    direction = np.array(FRONT) / np.linalg.norm(FRONT)
    strength = 1e-6 * distance**2 / 1e3
    light = PointLight(tuple(map(float, distance * direction)), (strength,) * 3)
    gpu, _ = both(context, passes, shapes["knot"], light)
    _, rays = both(context, passes, shapes["knot"], DirectionalLight(FRONT, (1e-9,) * 3))
    assert error(gpu, rays) < 0.002 + 12.0 / distance


# Samples and pixels


@pytest.mark.parametrize("shape", ["ball", "knot", "plate"])
@pytest.mark.parametrize("light", [DIRECTIONAL, INSIDE], ids=repr)
def test_pixels_agree_with_rays(renderer_of, shapes, shape, light):
    frame = renderer_of(shape).render(scene_of("camera.elevation_deg=20", lights=(light,)), samples=1)
    seen = inside(frame)
    points, normals = frame.position[seen], frame.normal[seen]
    eta = scene_of().material.resolve().eta
    rays = RayCaster(shapes[shape]).irradiance(points, normals, normals, light, eta)
    assert np.count_nonzero(seen) > 500
    assert error(frame.irradiance[seen], rays) < 0.01


def test_samples_and_pixels_run_the_same_function(context, passes, renderer_of, shapes):
    """E at the pixels' own positions and normals, as surface samples: the same numbers, light by light."""
    shadows, irradiance, table = passes
    lights = (DIRECTIONAL, DirectionalLight(BACK, (1.0, 2.0, 3.0)), INSIDE)
    frame = renderer_of("knot").render(scene_of(lights=lights), samples=1)
    seen = frame.alpha == 1.0
    mesh = shapes["knot"]
    buffers = SampleBuffers(context, samples_at(frame.position[seen], frame.normal[seen]))
    total = np.zeros((buffers.count, 3))
    for light in lights:
        shadow = shadows.render(MeshBuffers(context, mesh), mesh, light)
        total += irradiance.run(buffers, lamp(light, shadow, table), scene_of().material.resolve().eta)
    assert outliers(frame.irradiance[seen], total, rtol=1e-4, atol=1e-6) <= OUTLIERS


# The environment


def noise(height=32, seed=5):
    pixels = np.random.default_rng(seed).random((height, 2 * height, 3), np.float32)
    pixels[height // 4, height // 3] *= 100.0  # so that a shift or a flip cannot go unnoticed
    return pixels


def environment_irradiance(context, passes, probe, normals, rotation=0.0, intensity=1.0):
    shadows, irradiance, _ = passes
    table = latlong_texture(context, environment.irradiance_table(probe.sh, ETA))
    source = surround(table, rotation, intensity, shadows.none)
    return irradiance.run(SampleBuffers(context, samples_at(np.zeros_like(normals), normals)), source, ETA)


def directions(count=2_000, seed=3):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    return np.concatenate([axes, d / np.linalg.norm(d, axis=1, keepdims=True)])


@pytest.mark.parametrize("rotation", [0.0, 30.0, -135.0, 360.0])
def test_the_environment_is_the_table_looked_up(context, passes, rotation):
    """Poles and seam included; an angle a looks the probe up at R_y(-a) n."""
    probe, normals = Probe.from_pixels(noise()), directions()
    a = np.radians(rotation)
    turned = np.stack(
        [
            np.cos(a) * normals[:, 0] - np.sin(a) * normals[:, 2],
            normals[:, 1],
            np.sin(a) * normals[:, 0] + np.cos(a) * normals[:, 2],
        ],
        axis=1,
    )
    np.testing.assert_allclose(normals @ world_to_probe(rotation), turned, atol=1e-12)
    expected = 2.5 * environment.lookup(environment.irradiance_table(probe.sh, ETA), turned)
    actual = environment_irradiance(context, passes, probe, normals, rotation, 2.5)
    assert np.all(relative_rms(actual, expected) < 2e-3)
    np.testing.assert_allclose(actual, expected, rtol=1e-2)


@pytest.mark.parametrize("rotation", [0.0, 90.0])
def test_a_bright_spot_lights_the_side_that_faces_it(context, passes, rotation):
    """A lamp in the probe's centre stands at -z; turned by +90 degrees about +y it stands at -x."""
    pixels = np.zeros((32, 64, 3), np.float32)
    pixels[15:17, 31:33] = 100.0
    lamp_at = np.array([0.0, 0.0, -1.0] if rotation == 0.0 else [-1.0, 0.0, 0.0])
    normals = directions(200)
    actual = environment_irradiance(context, passes, Probe.from_pixels(pixels), normals, rotation)
    brightest = normals[actual[:, 0].argmax()]
    assert brightest @ lamp_at > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uffizi_latlong_1200x600.hdr", "galileo_latlong_1024x512_derived.hdr"])
def test_the_environment_against_direct_integration(context, passes, data_dir, name):
    path = data_dir / "hdr" / name
    if not path.exists():
        pytest.skip(f"{name} is absent")
    pixels, normals = read_radiance(path), directions(100)
    actual = environment_irradiance(context, passes, Probe.from_pixels(pixels), normals)
    expected = environment.irradiance_direct(pixels, normals, ETA)
    assert np.all(relative_rms(actual, expected) < 0.01)


def test_an_environment_lights_the_pixels(renderer_of, tmp_path):
    pixels = noise()
    write_exr(tmp_path / "probe.exr", dict(zip("RGB", np.moveaxis(pixels, -1, 0), strict=True)))
    scene = replace(
        scene_of(lights=()), environment=EnvironmentSettings(tmp_path / "probe.exr", rotation_deg=70.0, intensity=0.5)
    )
    frame = renderer_of("ball").render(scene, samples=1)
    seen = inside(frame)
    table = environment.irradiance_table(Probe.from_pixels(pixels).sh, scene.material.resolve().eta)
    expected = 0.5 * environment.lookup(table, frame.normal[seen] @ world_to_probe(70.0))
    assert np.all(relative_rms(frame.irradiance[seen], expected) < 2e-3)
    assert frame.specular[seen].min() > 0.0
