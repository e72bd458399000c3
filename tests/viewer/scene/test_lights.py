"""Kinds of light: what they are made of, how they are written, what they turn with, and their sub-lights."""

import inspect
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.commands.options import parse_light, scene_options
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.lights import (
    LIGHT_KINDS,
    DirectionalLight,
    PointLight,
    RectangleLight,
    SphereLight,
    SpotLight,
    as_kind,
)
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, PARTS, SHAPE_CONE
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings_docs import settings_markdown
from milkglass.viewer.session.navigation import lights_turned, turn_matrix
from tests.support.rendering import scene_of
from tests.support.ring_light import RingLight

LIGHTS = (
    DirectionalLight((0.3, 0.4, 1.0), (1.0, 2.0, 3.0), angle_deg=12.0, fixed_to="camera"),
    PointLight((10.0, 20.0, 30.0), fixed_to="camera"),
    SphereLight((90.0, 120.0, 80.0), (3e4, 2e4, 1e4), radius_mm=25.0),
    RectangleLight((-60.0, 10.0, -150.0), size_mm=(80.0, 30.0), roll_deg=20.0, target_mm=(0.0, 5.0, 1.0)),
    SpotLight((0.0, 200.0, 50.0), cone_deg=25.0, softness=0.5, on=False),
)


def test_every_kind_returns_from_a_scene_file(tmp_path):
    assert {light.KIND for light in LIGHTS} == set(LIGHT_KINDS)
    scene = Scene(lights=LIGHTS)
    scene.save(tmp_path / "scene.toml")
    assert Scene.load(tmp_path / "scene.toml") == scene


@pytest.mark.parametrize(
    ("text", "light"),
    [
        ("sphere:1,2,3:radius_mm=7", SphereLight((1.0, 2.0, 3.0), radius_mm=7.0)),
        ("directional:0,1,0:1,1,1:angle_deg=.5", DirectionalLight((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), angle_deg=0.5)),
        (
            "rectangle:0,50,9 : 1e4,1e4,1e4 : size_mm=40,20 : target_mm=0,1,0 : fixed_to=camera",
            RectangleLight(
                (0.0, 50.0, 9.0), (1e4,) * 3, size_mm=(40.0, 20.0), target_mm=(0.0, 1.0, 0.0), fixed_to="camera"
            ),
        ),
        ("spot:0,9,0:cone_deg=12:softness=0:on=false", SpotLight((0.0, 9.0, 0.0), on=False, cone_deg=12, softness=0)),
    ],
)
def test_lights_on_the_command_line(text, light):
    assert parse_light(text) == light


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sphere:1,2,3:radius=7", 'unknown key radius; did you mean "radius_mm"?'),
        ("sphere:1,2,3:radius_mm=0", "radius_mm must be a number from 0.001 to 1e9, not 0.0"),
        ("sphere:1,2,3:radius_mm=wide", "'wide' is not a list of numbers; write a number"),
        ("sphere:radius_mm=4:1,2,3", "write sphere:x,y,z or sphere:x,y,z:r,g,b, then :key=value for more"),
        ("spot:1,2,3:4,5,6:intensity=1,1,1", "intensity is given twice; leave one out"),
        ("spot:0,0,0", "target_mm is where the light is; give it another point to face"),
        ("spot:1,2,3:on=1", "on must be true or false"),
        ("spots:1,2,3", 'unknown kind of light; did you mean "spot"?'),
    ],
)
def test_bad_lights_on_the_command_line_are_one_sentence(text, message):
    with pytest.raises(InputError) as caught:
        parse_light(text)
    assert str(caught.value).startswith(f"--light {text}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_black_lights_and_those_that_are_off_do_not_shine():
    black = DirectionalLight((0.0, 1.0, 0.0), (0.0, 0.0, 0.0))
    assert Scene(lights=(*LIGHTS, black)).effective_lights()[2:] == LIGHTS[2:4]


# What they turn with


def test_a_light_fixed_to_the_camera_is_where_it_is_in_the_view():
    scene = apply_set(scene_of(lights=LIGHTS[:4]), ["camera.azimuth_deg=70", "camera.roll_deg=20"])
    rotation = place_camera(scene.camera, 1.0, (1, 1)).rotation
    directional, point, sphere, rectangle = scene.effective_lights()
    np.testing.assert_allclose(np.array(directional.direction) @ rotation, LIGHTS[0].direction, atol=1e-12)
    np.testing.assert_allclose(np.array(point.position_mm) @ rotation, LIGHTS[1].position_mm, atol=1e-12)
    assert (sphere, rectangle) == LIGHTS[2:4]
    assert scene.camera.azimuth_deg == 70.0


def test_a_turn_takes_the_sides_of_a_rectangle_with_it():
    turn = turn_matrix(np.array([0.6, 0.0, 0.8]), 50.0) @ turn_matrix(np.array([0.0, 1.0, 0.0]), 130.0)
    np.testing.assert_allclose(LIGHTS[3].turned(turn).axes, LIGHTS[3].axes @ turn, atol=1e-12)


@pytest.mark.parametrize("light", [LIGHTS[0], *LIGHTS[2:]], ids=lambda light: light.KIND)
def test_fixing_it_to_something_else_leaves_it_where_it_is(light):
    rotation = place_camera(Scene().camera, 1.0, (1, 1)).rotation
    expected = light.in_world(rotation).sub_lights(4).vectors
    for to in ("camera", "world"):
        fixed = light.refixed(to, rotation)
        assert fixed.fixed_to == to
        np.testing.assert_allclose(fixed.in_world(rotation).sub_lights(4).vectors, expected, rtol=1e-4, atol=1e-3)


def test_a_drag_turns_lights_of_the_camera_as_those_of_the_world():
    rotation = place_camera(Scene().camera, 1.0, (1, 1)).rotation
    world = replace(LIGHTS[0], fixed_to="world")
    of_camera = world.refixed("camera", rotation)
    moved = lights_turned(Scene(lights=(world, of_camera)), 40.0, 25.0, 800.0)
    one, other = (light.direction for light in moved.effective_lights())
    assert moved.lights[1].fixed_to == "camera"
    np.testing.assert_allclose(other, one, atol=1e-5)
    assert np.linalg.norm(np.subtract(one, world.direction)) > 0.1


@pytest.mark.parametrize("kind", LIGHT_KINDS)
@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.KIND)
def test_a_light_of_another_kind_shines_about_the_same(light, kind):
    other = as_kind(light, kind)
    assert (other.KIND, other.on, other.fixed_to) == (kind, light.on, light.fixed_to)
    distance = [1.0 if each.KIND == "directional" else np.linalg.norm(each.position_mm) for each in (light, other)]
    irradiance = [np.array(each.brightness) / d**2 for each, d in zip((light, other), distance, strict=True)]
    np.testing.assert_allclose(irradiance[1], irradiance[0], rtol=1e-4)


# Sub-lights


@pytest.mark.parametrize("count", [4, 24, 200])
@pytest.mark.parametrize("light", [LIGHTS[0], LIGHTS[2], LIGHTS[4]], ids=lambda light: light.KIND)
def test_a_surface_that_faces_a_light_gets_what_the_light_says(light, count):
    """E = irradiance, or I / d^2 whatever the radius of a sphere."""
    parts = light.sub_lights(count)
    point = np.zeros((1, 3))
    ways = parts.vectors if parts.kind == DIRECTIONAL else parts.vectors - point
    cosines = ways @ np.array(parts.vector) / np.linalg.norm(ways, axis=1) / np.linalg.norm(parts.vector)
    factors = [float(parts.emission(i, point)[0]) for i in range(len(parts))]
    distance = 1.0 if parts.kind == DIRECTIONAL else np.linalg.norm(light.position_mm)
    found = np.mean(cosines * factors) * np.array(parts.colour)
    np.testing.assert_allclose(found, np.array(light.brightness) / distance**2, rtol=1e-3)


def test_a_sphere_close_by_lights_all_places_as_a_sphere_does():
    """I / d^2 wherever a surface faces it; sub-lights in the disc that the origin sees are another shape from aside."""
    light = SphereLight((0.0, 45.0, 40.0), radius_mm=20.0)
    centre = np.array(light.position_mm)

    def found(count, point):
        parts = light.sub_lights(count)
        ways = parts.vectors - point
        towards = (centre - point) / np.linalg.norm(centre - point)
        cosines = np.maximum(ways @ towards / np.linalg.norm(ways, axis=1), 0.0)
        return np.mean([c * parts.emission(i, point[None])[0] for i, c in enumerate(cosines)])

    for place in ([0.0, 10.0, 20.0], [30.0, 40.0, 60.0], [-25.0, 60.0, 20.0]):
        point = np.array(place)
        assert found(96, point) == pytest.approx(1.0 / np.square(centre - point).sum(), rel=0.01)
    assert found(32, point) != pytest.approx(1.0 / np.square(centre - point).sum(), rel=0.02)


def test_a_rectangle_shines_as_the_integral_over_it():
    light = LIGHTS[3]
    width, height, way = light.axes
    steps = (np.arange(200) + 0.5) / 200.0 - 0.5
    u, v = (side.ravel() for side in np.meshgrid(*[steps] * 2))
    points = np.array([[0.0, 0.0, 0.0], [10.0, -20.0, 5.0], [-90.0, 0.0, -300.0]])  # the last one behind it
    expected = []
    for point in points:
        places = light.position_mm + (light.size_mm[0] * u)[:, None] * width + (light.size_mm[1] * v)[:, None] * height
        ways = point - places
        distance = np.linalg.norm(ways, axis=1)
        expected.append(np.mean(np.maximum(ways @ way / distance, 0.0) / distance**2))
    parts = light.sub_lights(24)
    found = np.mean([parts.emission(i, points) for i in range(24)], axis=0)
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    assert found[2] == 0.0


def test_a_spot_light_ends_at_its_cone():
    light = LIGHTS[4]
    parts = light.sub_lights(1)
    assert parts.shape == SHAPE_CONE
    way = -np.array(light.position_mm) / np.linalg.norm(light.position_mm)
    side = np.cross(way, [1.0, 0.0, 0.0])
    angles = np.radians([0.0, 6.2, 9.0, 12.4, 12.6, 40.0, 180.0])
    points = light.position_mm + 50.0 * (np.cos(angles)[:, None] * way + np.sin(angles)[:, None] * side)
    found = 2500.0 * parts.emission(0, points)
    np.testing.assert_allclose(found[:2], 1.0, atol=1e-9)
    assert 0.0 < found[3] < found[2] < 1.0
    assert np.all(found[4:] == 0.0)


def test_a_spot_light_fades_over_the_share_of_its_angle_that_its_softness_is():
    """A cubic in the cosine, 3 t^2 - 2 t^3: of 60 degrees half fade, from 15 off the axis to 30 off it."""
    light = SpotLight((0.0, 0.0, 10.0), cone_deg=60.0, softness=0.5)
    dark, whole = np.sqrt(3.0) / 2.0, (np.sqrt(6.0) + np.sqrt(2.0)) / 4.0  # cosines of 30 and 15 degrees
    t = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    cosines = dark + (whole - dark) * t
    points = np.stack([10.0 * np.sqrt(1.0 - cosines**2) / cosines, 0.0 * t, 0.0 * t], axis=-1)  # on the plane z = 0
    found = light.sub_lights(1).emission(0, points) * (10.0 / cosines) ** 2
    np.testing.assert_allclose(found, [0.0, 5.0 / 32.0, 0.5, 27.0 / 32.0, 1.0], atol=1e-9)


def test_lights_get_as_many_sub_lights_as_they_look_large():
    counts = [DirectionalLight((0, 1, 0), angle_deg=angle).sub_light_count(50.0) for angle in (0.5, 3, 10, 25, 90)]
    assert counts == [1, 4, 8, 16, 60]
    assert all(count % PARTS == 0 for count in counts[1:])
    assert SphereLight((0, 1e4, 0), radius_mm=40.0).sub_light_count(50.0) == 1
    large = RectangleLight((0.0, 60.0, 0.0), size_mm=(10.0, 90.0))
    assert large.apparent_deg(50.0) > 100.0
    assert 1 < large.sub_light_count(50.0, draft=True) < large.sub_light_count(50.0)


@pytest.mark.parametrize("light", LIGHTS[2:], ids=lambda light: light.KIND)
def test_far_lights_are_directions(light):
    far = replace(light, position_mm=tuple(1e6 * np.array(light.position_mm)))
    parts = far.sub_lights(4, far=1e6)
    assert parts.kind == DIRECTIONAL
    facing = np.array(far.brightness) / np.square(far.position_mm).sum()
    np.testing.assert_allclose(parts.colour, facing, rtol=1e-3)


def test_a_kind_in_the_registry_is_in_scene_files_options_and_tables(tmp_path, monkeypatch):
    monkeypatch.setitem(LIGHT_KINDS, RingLight.KIND, RingLight)
    scene = Scene(lights=(RingLight((0.0, 0.0, 150.0), radius_mm=30.0, fixed_to="camera"), *LIGHTS))
    scene.save(tmp_path / "scene.toml")
    assert Scene.load(tmp_path / "scene.toml") == scene
    assert parse_light("ring:0,0,150:radius_mm=30:fixed_to=camera") == scene.lights[0]
    assert "point, sphere, rectangle, spot, ring (position in mm; intensity)" in light_help()
    assert "| `lights.radius_mm (ring)` | 50.0 | mm | a number from 0.001 to 1e9 | radius of" in settings_markdown()
    for light in LIGHTS:
        assert as_kind(as_kind(light, "ring"), light.KIND).brightness == pytest.approx(light.brightness, rel=1e-4)


def light_help():
    options = inspect.signature(scene_options(lambda scene: None)).parameters
    return get_args(options["light"].annotation)[1].help


def test_more_lights_than_are_drawn_are_refused(tmp_path):
    with pytest.raises(InputError, match="lights has 65 entries, at most 64 are drawn"):
        Scene(lights=(PointLight((0.0, 0.0, 300.0)),) * 65)
    many = tmp_path / "many.toml"
    many.write_text('[[lights]]\nkind = "point"\nposition_mm = [0, 0, 300]\n' * 2000)
    with pytest.raises(InputError, match=r"many\.toml: lights has 2,000 entries"):
        Scene.load(many)


def test_a_light_at_the_end_of_its_range_turns():
    """A turn of a box leaves the box."""
    turn = turn_matrix(np.array([0.0, 0.6, 0.8]), 20.0)
    light = DirectionalLight((1e6, 1e6, -1e6)).turned(turn)
    expected = np.array([1.0, 1.0, -1.0]) @ turn
    np.testing.assert_allclose(
        np.divide(light.direction, np.abs(light.direction).max()), expected / np.abs(expected).max()
    )
    PointLight((1e9, -1e9, 1e9), fixed_to="camera").in_world(turn)
