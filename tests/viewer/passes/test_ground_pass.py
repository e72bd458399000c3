"""The plane that an object stands on, in frames: its radiance, shadow and glow on it, and what stays as it was."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.light.probe import Probe, irradiance_direct
from milkglass.core.material.fresnel import hemispherical_transmittance
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import EnvironmentSettings
from tests.support.rendering import MeshRenderer, scene_of
from tests.support.shapes import ball

ABOVE = ("camera.elevation_deg=60", "camera.zoom=0.5", "display.background=transparent")
BLACK = ("material.sigma_s_prime=[0, 0, 0]", "material.sigma_a=[1, 1, 1]", "material.eta=1")  # it mirrors nothing
MIDNIGHT = Probe.from_pixels(np.full((16, 32, 3), 0.5, np.float32))


@pytest.fixture(scope="module")
def renderer(context):
    return MeshRenderer(context, ball())


def on_ground(scene: Scene, **values) -> Scene:
    return replace(scene, ground=replace(scene.ground, on=True, **values))


def places(scene: Scene, renderer: MeshRenderer, height: float) -> np.ndarray:
    """World place on the plane at every pixel, (H, W, 3), by rays in float64."""
    width, rows = scene.display.image_size
    camera = place_camera(scene.camera, renderer.model.mesh.radius, scene.display.image_size)
    x, y = (np.arange(width) + 0.5) / width * 2.0 - 1.0, 1.0 - (np.arange(rows) + 0.5) / rows * 2.0
    clip = np.stack([*np.meshgrid(x, y), np.ones((rows, width)), np.ones((rows, width))], axis=-1)
    far = clip @ np.linalg.inv(camera.world_to_clip)
    eye, far = camera.eye[:3], far[..., :3] / far[..., 3:]
    return eye + (height - eye[1]) / (far[..., 1:2] - eye[1]) * (far - eye)


def low(renderer: MeshRenderer) -> float:
    return float(renderer.model.mesh.bounds[0, 1])


@pytest.mark.slow
def test_a_ground_in_the_open_returns_its_share_of_a_uniform_sky(renderer):
    scene = on_ground(scene_of(*ABOVE, *BLACK, lights=()), reflectance=0.5, color=(1.0, 0.5, 0.25))
    scene = replace(scene, environment=EnvironmentSettings(probe=MIDNIGHT, occluded=False))
    frame = renderer.render(scene, samples=1)
    ground = (frame.alpha > 0.5) & ~frame.position.any(axis=2)
    assert ground.mean() > 0.3
    radiance = frame.radiance[ground] / frame.alpha[ground, None]
    np.testing.assert_allclose(radiance, np.tile(0.5 * 0.5 * np.array([1.0, 0.5, 0.25]), (len(radiance), 1)), rtol=0.02)


@pytest.mark.parametrize("angle_deg", [0.0, 6.0])
def test_a_lamp_lights_the_ground_but_for_the_balls_shadow(renderer, angle_deg):
    lamp = DirectionalLight((0.0, 1.0, 0.0), (3.0, 2.0, 1.0), angle_deg=angle_deg)
    scene = on_ground(scene_of(*ABOVE, *BLACK, lights=(lamp,)), gap_mm=4.0)
    frame = renderer.render(scene, samples=1)
    place, radius = places(scene, renderer, low(renderer) - 4.0), -low(renderer)
    off, ground = np.hypot(place[..., 0], place[..., 2]), ~frame.position.any(axis=2) & (frame.alpha > 1e-3)
    radiance = frame.radiance / np.maximum(frame.alpha, 1e-6)[..., None]
    # The half shadow of the disc reaches as far as the ball's middle is high, times its angular radius.
    blur = 0.05 * radius + (radius + 4.0) * np.tan(np.radians(0.5 * angle_deg))
    lit, dark = ground & (off > radius + 1.1 * blur), ground & (off < radius - 1.1 * blur)
    assert lit.sum() > 500
    assert dark.sum() > 50
    expected = np.broadcast_to(0.5 / np.pi * np.array([3.0, 2.0, 1.0]), (lit.sum(), 3))
    np.testing.assert_allclose(radiance[lit], expected, rtol=0.01)
    assert np.abs(radiance[dark]).max() < 1e-3
    between = ground & (np.abs(off - radius) < 0.1 * blur)
    if angle_deg > 0.0:
        np.testing.assert_allclose(radiance[between][:, 0].mean() / (1.5 / np.pi), 0.5, atol=0.1)


def test_a_lamp_below_the_ground_does_not_light_it(renderer):
    scene = on_ground(scene_of(*ABOVE, *BLACK, lights=(DirectionalLight((0.3, -1.0, 0.0)),)))
    frame = renderer.render(scene, samples=1)
    ground = ~frame.position.any(axis=2) & (frame.alpha > 1e-3)
    assert ground.any()
    assert not frame.radiance[ground].any()


def test_what_leaves_the_ball_lights_the_ground_by_its_form_factor(renderer):
    """In a uniform sky all of the ball lets out much the same M; the sky itself is taken to be seen whole."""
    scene = scene_of(*ABOVE, "material.eta=1", method="ewald", lights=())
    scene = on_ground(scene, gap_mm=3.0, reflectance=1.0)
    scene = replace(scene, environment=EnvironmentSettings(probe=MIDNIGHT, occluded=False))
    glowing = renderer.render(scene, samples=1)
    place = places(scene, renderer, low(renderer) - 3.0)
    ground = ~glowing.position.any(axis=2) & (glowing.alpha > 0.9)
    exitance = glowing.exitance[glowing.position.any(axis=2)]
    assert exitance.std(axis=0).max() < 0.15 * exitance.mean()
    radiance = glowing.radiance[ground] / glowing.alpha[ground, None]
    height, distance = low(renderer) - 3.0, np.linalg.norm(place[ground], axis=1)
    share = low(renderer) ** 2 * -height / distance**3
    added = radiance - 0.5
    near = share > 0.1
    ratio = added[near].mean(axis=0) / (share[near].mean() * exitance.mean(axis=0) / np.pi)
    np.testing.assert_allclose(ratio, 1.0, atol=0.08)


def entering(renderer: MeshRenderer, scene: Scene) -> np.ndarray:
    """E at the surface samples of a scene, light that leaves the object and comes back included: (n, 3)."""
    lit = renderer.light(scene)
    again = lit.entering_again(renderer.scatter(lit))
    first = lit.flux / lit.samples.areas[:, None]
    if again is None:
        return first
    points, normals = lit.samples.points, lit.samples.normals
    return first + lit.surface.at(again, points, normals)


def in_furnace(reflectance: float, *assignments: str) -> Scene:
    """A scene of white matter without an interface, on a ground, in light of radiance 1 from all around."""
    white = ["material.sigma_s_prime=[20, 20, 20]", "material.sigma_a=[0, 0, 0]", "transport.method=diffusion"]
    scene = apply_set(scene_of(lights=()), [*white, "transport.resolution=32", "material.eta=1.33", *assignments])
    probe = Probe.from_pixels(np.ones((16, 32, 3), np.float32))
    return on_ground(replace(scene, environment=EnvironmentSettings(probe=probe)), reflectance=reflectance)


def test_on_a_white_ground_in_a_white_furnace_the_ball_gets_all_light(renderer):
    irradiance = entering(renderer, in_furnace(1.0)) / (np.pi * hemispherical_transmittance(1.33))
    assert irradiance.mean() == pytest.approx(1.0, abs=0.01)
    assert irradiance.std() < 0.02
    np.testing.assert_array_less(np.quantile(irradiance, 0.01), 1.0)
    assert np.quantile(irradiance, 0.01) > 0.9


@pytest.mark.parametrize("eta", [1.0, 1.5])
def test_below_clear_matter_in_a_white_furnace_a_white_ground_has_no_shadow(renderer, eta):
    clear = ["material.sigma_s_prime=[0, 0, 0]", "material.sigma_a=[0, 0, 0]", f"material.eta={eta}"]
    ground = renderer.light(apply_set(in_furnace(1.0), clear)).ground
    plane, irradiance = ground.standing.plane, ground.around[:, 0] / np.pi
    distance, areas = np.hypot(*plane.places()[:, [0, 2]].T), plane.areas()
    for near, far, error in ((0.0, 0.5, 0.05), (0.5, 1.0, 0.02), (1.0, 2.0, 0.01), (2.0, 5.0, 0.005)):
        ring = (distance >= near * plane.radius) & (distance < far * plane.radius)
        assert np.average(irradiance[ring], weights=areas[ring]) == pytest.approx(1.0, abs=error)


@pytest.mark.parametrize("method", ["diffusion", "ewald"])
def test_of_a_black_ground_the_ball_gets_nothing(renderer, method):
    """E(n) = pi (1 + n_y) / 2: the view factor of the sky above a plane without end."""
    scene = in_furnace(0.0, f"transport.method={method}", "material.eta=1")
    normals = renderer.light(scene).samples.normals.astype(np.float64)
    np.testing.assert_allclose(entering(renderer, scene)[:, 1], 0.5 * np.pi * (1.0 + normals[:, 1]), atol=0.02 * np.pi)


def test_a_lamp_by_way_of_the_ground_lights_the_ball_as_rays_say(renderer):
    """A black ball, so that nothing else does: directions at random, shadows by the sphere's equation."""
    gap, radius, towards = 6.0, -low(renderer), np.array([0.6, 0.8, 0.0])
    lamp = DirectionalLight(tuple(towards), (2.0, 1.0, 0.5))
    scene = on_ground(scene_of(*BLACK, lights=(lamp,)), gap_mm=gap, color=(1.0, 0.5, 1.0))
    lit, rng = renderer.light(scene), np.random.default_rng(0)
    samples = lit.samples
    chosen = rng.choice(np.flatnonzero(samples.normals[:, 1] < -0.2), 60, replace=False)
    returned = lit.surface.at(lit.unscattered.irradiance, samples.points, samples.normals)[chosen]
    probe = lit.ground.standing.environment.probe.latlong
    returned = returned + irradiance_direct(probe, samples.normals[chosen], 1.0)
    expected = []
    for point, normal in zip(radius * samples.normals[chosen].astype(np.float64), samples.normals[chosen], strict=True):
        rays = rng.normal(size=(20000, 3))
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) + normal
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        place = point - (radius + gap + point[1]) / rays[:, 1:2] * rays
        nearest = np.linalg.norm(place - (place @ towards)[:, None] * towards, axis=1)
        expected.append(np.mean((rays[:, 1] < 0.0) & (nearest > radius)) * 0.8)
    expected = 0.5 * np.array(expected)[:, None] * np.array([2.0, 0.5, 0.5])
    np.testing.assert_allclose(returned.mean(axis=0), expected.mean(axis=0), rtol=0.02)
    np.testing.assert_allclose(returned, expected, atol=0.06)


def test_a_lamp_below_the_ground_does_not_light_the_ball(renderer):
    scene = scene_of(lights=(DirectionalLight((0.3, -1.0, 0.0)),))
    assert renderer.light(scene).flux.max() > 0.0
    assert not renderer.light(on_ground(scene)).flux.any()


def test_as_a_shadow_the_ground_over_itself_in_the_open_is_the_ground(renderer):
    """(1 - a) P + rgb, P of the plane in the open, is the plane with the object: shadow, glow and all."""
    lamp = DirectionalLight((0.5, 1.0, 0.2), (3.0, 3.0, 3.0), angle_deg=8.0)
    scene = scene_of(*ABOVE, lights=(lamp,), method="ewald")
    plane, shadow = (renderer.render(on_ground(scene, shown=shown), samples=1) for shown in ("plane", "shadow"))
    ground = ~plane.position.any(axis=2) & (plane.alpha > 0.999)
    cosine = 1.0 / np.linalg.norm(lamp.direction)
    in_the_open = 0.5 / np.pi * 3.0 * cosine
    assert (shadow.alpha[ground] > 0.3).any()
    assert (shadow.alpha[ground] < 0.02).any()
    over = (1.0 - shadow.alpha[ground, None]) * in_the_open + shadow.radiance[ground]
    np.testing.assert_allclose(over, plane.radiance[ground], rtol=0.02, atol=2e-3)


def test_from_below_the_ground_is_not_seen(renderer):
    scene = scene_of("camera.elevation_deg=-40", "display.background=transparent")
    without, standing = (renderer.render(each, samples=1) for each in (scene, on_ground(scene)))
    np.testing.assert_array_equal(without.alpha, standing.alpha)
    assert not standing.radiance[standing.alpha == 0.0].any()


@pytest.mark.parametrize("orthographic", ["true", "false"])
def test_the_ground_goes_on_before_and_behind_the_object(renderer, orthographic):
    scene = on_ground(scene_of("camera.elevation_deg=45", "camera.zoom=0.4", f"camera.orthographic={orthographic}"))
    frame = renderer.render(scene, samples=1)
    assert (frame.alpha[-8:] > 0.05).all()
    object_rows = np.flatnonzero(frame.position.any(axis=(1, 2)))
    assert frame.alpha[object_rows[0] - 2, 64] > 0.1


@pytest.mark.slow
def test_a_ground_is_picked_as_nothing_and_shown_with_radiance_alone(context):
    renderer = Renderer(context)
    scene = on_ground(apply_set(scene_of(method="ewald"), ["model.size_mm=20", "transport.resolution=16"]))
    renderer.draw(scene)
    assert renderer.pick((64, 124)) is None
