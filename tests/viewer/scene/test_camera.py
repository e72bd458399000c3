"""The camera's matrices: (x, y, z, 1) @ M, right-handed, looking along -z, y up."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.scene.camera import (
    FILL,
    framed,
    further_offsets,
    jittered,
    model_camera,
    pixel_offsets,
    place_camera,
)
from milkglass.viewer.scene.settings import CameraSettings

RADIUS = 50.0
SQUARE, WIDE, TALL = (256, 256), (400, 200), (200, 400)
FRONT = CameraSettings(azimuth_deg=0.0, elevation_deg=0.0)


def placed(size=SQUARE, radius=RADIUS, **changes):
    return place_camera(replace(FRONT, **changes), radius, size)


def window(camera, points):
    """Normalised device coordinates (n, 3) of world points (n, 3)."""
    points = np.atleast_2d(np.asarray(points, np.float64))
    clip = np.c_[points, np.ones(len(points))] @ camera.world_to_clip
    assert np.all(clip[:, 3] > 0.0)
    return clip[:, :3] / clip[:, 3:]


def sphere(count=20_000, radius=RADIUS, seed=2):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return radius * d / np.linalg.norm(d, axis=1, keepdims=True)


def test_matrices_are_for_row_vectors():
    """Translation in row 3; the eye lands at the origin of view space, the target on -z, up on +y."""
    camera = placed(azimuth_deg=40.0, elevation_deg=25.0, target_mm=(3.0, -2.0, 5.0))
    np.testing.assert_allclose(camera.view[:, 3], [0, 0, 0, 1])
    np.testing.assert_allclose(camera.eye @ camera.view, [0, 0, 0, 1], atol=1e-10)
    target = np.array([3.0, -2.0, 5.0, 1.0]) @ camera.view
    distance = np.linalg.norm(camera.eye[:3] - [3.0, -2.0, 5.0])
    np.testing.assert_allclose(target, [0, 0, -distance, 1], atol=1e-10)
    assert (np.array([0.0, 1.0, 0.0]) @ camera.rotation)[1] > 0.9


@pytest.mark.parametrize("azimuth", [0.0, 20.0, 90.0, -130.0, 360.0])
@pytest.mark.parametrize("elevation", [-90.0, -89.9, -30.0, 0.0, 45.0, 90.0])
@pytest.mark.parametrize("roll", [0.0, 33.0])
def test_a_view_is_a_rotation_everywhere_poles_included(azimuth, elevation, roll):
    camera = placed(azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=roll)
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)
    a, e = np.radians([azimuth, elevation])
    towards = [np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)]
    np.testing.assert_allclose(camera.rotation[:, 2], towards, atol=1e-12)


def test_azimuth_turns_and_elevation_rises():
    """From azimuth 90 the eye stands on +x and sees +z on its left; from elevation 90 it looks down, -z up."""
    np.testing.assert_allclose(placed(azimuth_deg=90.0).rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(placed(elevation_deg=90.0).rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)


@pytest.mark.parametrize("elevation", [89.999, -89.999])
def test_nothing_jumps_at_the_poles(elevation):
    near = placed(azimuth_deg=70.0, elevation_deg=elevation)
    at = placed(azimuth_deg=70.0, elevation_deg=float(np.sign(elevation) * 90.0))
    np.testing.assert_allclose(near.rotation, at.rotation, atol=1e-4)


@pytest.mark.parametrize("roll", [90.0, -25.0])
def test_roll_leans_the_camera_to_the_right(roll):
    """So the picture turns counter-clockwise."""
    points = sphere(100)
    before = placed(azimuth_deg=30.0, elevation_deg=15.0).rotation
    after = placed(azimuth_deg=30.0, elevation_deg=15.0, roll_deg=roll).rotation
    angle = np.radians(roll)
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    forwards = np.abs(points @ after - points @ before @ turn).max() < 1e-9
    backwards = np.abs(points @ after - points @ before @ turn.T).max() < 1e-9
    assert (forwards, backwards) == (True, False)


@pytest.mark.parametrize("size", [SQUARE, WIDE, TALL], ids=str)
@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("view_angle", [1.0, 35.0, 120.0])
def test_the_bounding_sphere_touches_the_edges_of_the_narrower_side(size, orthographic, view_angle):
    camera = placed(size, azimuth_deg=30.0, elevation_deg=10.0, orthographic=orthographic, view_angle_deg=view_angle)
    reach = np.abs(window(camera, sphere())).max(axis=0)
    narrow = 0 if size[0] <= size[1] else 1
    assert 0.995 < reach[narrow] <= 1.0 + 1e-9
    assert reach[1 - narrow] <= reach[narrow] + 1e-3
    assert reach[2] <= 1.0


@pytest.mark.parametrize("size", [SQUARE, WIDE, TALL], ids=str)
@pytest.mark.parametrize("orthographic", [False, True])
def test_a_circle_stays_round_in_pixels(size, orthographic):
    angle = np.linspace(0.0, 2.0 * np.pi, 64)
    circle = 10.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], axis=1)
    pixels = window(placed(size, orthographic=orthographic), circle)[:, :2] * size / 2.0
    radii = np.linalg.norm(pixels, axis=1)
    np.testing.assert_allclose(radii, radii[0], rtol=1e-9)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("zoom", [0.01, 0.5, 3.0, 100.0])
def test_zoom_magnifies_about_the_centre(orthographic, zoom):
    points = sphere(200, 20.0)
    one, zoomed = placed(orthographic=orthographic), placed(orthographic=orthographic, zoom=zoom)
    np.testing.assert_allclose(window(zoomed, points)[:, :2], zoom * window(one, points)[:, :2], rtol=1e-9)
    np.testing.assert_allclose(zoomed.view, one.view)


def test_an_orthographic_eye_is_a_direction():
    camera = placed(azimuth_deg=90.0, orthographic=True)
    np.testing.assert_allclose(camera.eye, [1, 0, 0, 0], atol=1e-12)
    near, far = window(camera, [[40.0, 5.0, 7.0]]), window(camera, [[-40.0, 5.0, 7.0]])
    np.testing.assert_allclose(near[0, :2], far[0, :2])
    assert near[0, 2] < far[0, 2]


def test_the_target_is_the_centre_of_the_picture():
    target = (12.0, -7.0, 3.0)
    for orthographic in (False, True):
        camera = placed(azimuth_deg=50.0, elevation_deg=-20.0, target_mm=target, orthographic=orthographic)
        np.testing.assert_allclose(window(camera, target)[0, :2], 0.0, atol=1e-12)


@pytest.mark.parametrize("target", [(0.0, 0.0, 0.0), (0.0, 0.0, -400.0), (1e4, 0.0, 0.0)])
@pytest.mark.parametrize("orthographic", [False, True])
def test_the_object_lies_between_near_and_far_wherever_the_target_is(target, orthographic):
    """If in front of the eye at all."""
    camera = placed(target_mm=target, orthographic=orthographic)
    points = sphere(500)
    depth = -(np.c_[points, np.ones(500)] @ camera.view)[:, 2]
    clip = np.c_[points, np.ones(500)] @ camera.world_to_clip
    shown = depth > 1.0 if not orthographic else depth > -np.inf
    assert np.all(np.abs(clip[shown, 2]) <= np.abs(clip[shown, 3]))


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e6])
def test_framing_scales_with_the_object(radius):
    points = sphere(100, 0.9)
    np.testing.assert_allclose(
        window(placed(radius=radius), radius * points), window(placed(radius=1.0), points), atol=1e-9
    )


# Framing


def cloud(vertices):
    """A mesh whose vertices are what matters."""
    return Mesh.of(vertices, np.ones_like(vertices), [[0, 1, 2]])


def box(width, height, depth):
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return cloud(signs * np.array([width, height, depth]) / 2.0)


def ball():
    return cloud(sphere())


# Shape, and the half width and half height of its silhouette seen orthographically from the front.
SHAPES = {
    "lying rod": (box(100, 4, 4), 50.0, 2.0),
    "standing rod": (box(4, 100, 4), 2.0, 50.0),
    "plate": (box(80, 60, 2), 40.0, 30.0),
    "ball": (ball(), 50.0, 50.0),
}


def reach(camera, mesh):
    """Ends of the silhouette's box in the picture, -1 to 1: ((left, bottom), (right, top))."""
    seen = window(camera, mesh.vertices)[:, :2]
    return seen.min(axis=0), seen.max(axis=0)


@pytest.mark.parametrize("size", [SQUARE, WIDE, TALL], ids=str)
@pytest.mark.parametrize("name", SHAPES)
def test_a_known_silhouette_fills_the_picture(name, size):
    mesh, half_width, half_height = SHAPES[name]
    settings = replace(FRONT, orthographic=True)
    low, high = reach(model_camera(settings, mesh, size), mesh)
    np.testing.assert_allclose(high, -low, atol=1e-6)
    aspect = size[0] / size[1]
    expected = np.array([half_width / aspect, half_height]) / max(half_width / aspect, half_height)
    np.testing.assert_allclose(high, FILL * expected, rtol=1e-3)


@pytest.mark.parametrize("size", [SQUARE, WIDE, TALL], ids=str)
@pytest.mark.parametrize(
    "view", [(0.0, 0.0, 0.0), (30.0, 10.0, 0.0), (-70.0, 80.0, 0.0), (200.0, -35.0, 40.0)], ids=str
)
@pytest.mark.parametrize("view_angle", [5.0, 35.0, 100.0])
@pytest.mark.parametrize("name", SHAPES)
def test_the_silhouette_stands_in_the_middle_and_meets_one_pair_of_edges(name, view, view_angle, size):
    mesh, azimuth, elevation, roll = SHAPES[name][0], *view
    camera = CameraSettings(azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=roll, view_angle_deg=view_angle)
    low, high = reach(model_camera(camera, mesh, size), mesh)
    np.testing.assert_allclose(high, -low, atol=1e-6)
    assert high.max() == pytest.approx(FILL, abs=1e-6)


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_lopsided_silhouette_is_moved_to_the_middle(orthographic):
    """A vertex far to the right and up, of a cloud about the origin."""
    mesh = cloud(np.array([[40, 30, 0], [-10, -10, 5], [-10, 0, -5], [0, -10, 20]]))
    settings = replace(FRONT, orthographic=orthographic)
    found = framed(settings, mesh, SQUARE)
    assert found.target_mm[0] > 5.0
    assert found.target_mm[1] > 5.0
    assert found.target_mm[2] == pytest.approx(0.0, abs=1e-9)  # across the line of sight
    low, high = reach(place_camera(found, mesh.radius, SQUARE), mesh)
    np.testing.assert_allclose(high, -low, atol=1e-6)


def test_what_is_given_stays():
    mesh = SHAPES["plate"][0]
    given = replace(FRONT, zoom=3.0, target_mm=(1.0, 2.0, 3.0))
    assert framed(given, mesh, SQUARE) == given
    assert framed(replace(FRONT, zoom=3.0), mesh, SQUARE) == replace(FRONT, zoom=3.0, target_mm=(0.0, 0.0, 0.0))
    about = framed(replace(FRONT, target_mm=(30.0, 0.0, 0.0)), mesh, SQUARE)
    assert about.target_mm == (30.0, 0.0, 0.0)
    low, high = reach(place_camera(about, mesh.radius, SQUARE), mesh)
    assert -low[0] == pytest.approx(FILL, abs=1e-6)
    assert high[0] < 0.2


def test_zoom_one_of_a_scene_is_the_bounding_sphere():
    mesh = ball()
    one = model_camera(replace(FRONT, zoom=1.0), mesh, SQUARE)
    np.testing.assert_array_equal(one.world_to_clip, placed(radius=mesh.radius, zoom=1.0).world_to_clip)


def test_the_eye_keeps_its_distance():
    """Perspective is that of any zoom: a long lens, not a step forward."""
    mesh = SHAPES["lying rod"][0]
    near = place_camera(framed(FRONT, mesh, TALL), mesh.radius, TALL)
    np.testing.assert_allclose(near.view, placed(TALL, mesh.radius).view, atol=1e-5)


@pytest.mark.parametrize("target", [(0.0, 0.0, -1e4), (0.0, 0.0, -200.0), (1e6, 0.0, 0.0)])
def test_a_model_out_of_sight_is_no_error(target):
    found = framed(replace(FRONT, target_mm=target), ball(), SQUARE)
    assert 0.01 <= found.zoom <= 100.0


# Antialiasing


def test_jitter_moves_the_picture_by_pixels():
    camera, points = placed(WIDE), sphere(50)
    clip = np.c_[points, np.ones(50)] @ jittered(camera, (0.25, -0.5), WIDE)
    moved = clip[:, :2] / clip[:, 3:] - window(camera, points)[:, :2]
    np.testing.assert_allclose(moved * np.array(WIDE) / 2.0, np.tile([0.25, -0.5], (50, 1)), atol=1e-9)


def test_one_sample_sits_in_the_centre():
    assert pixel_offsets(1, seed=5) == ((0.0, 0.0),)


@pytest.mark.parametrize("samples", [2, 4, 16, 64])
def test_samples_cover_the_pixel_evenly(samples):
    """Discrepancy: every centred box holds its share of the points to within 2 / sqrt(n) of it."""
    offsets = np.array(pixel_offsets(samples, seed=3))
    assert offsets.shape == (samples, 2)
    assert np.all((offsets >= -0.5) & (offsets < 0.5))
    assert len(np.unique(offsets, axis=0)) == samples
    for corner in np.random.default_rng(0).random((100, 2)):
        share = np.mean(((offsets + 0.5) < corner).all(axis=1))
        assert abs(share - corner.prod()) <= 2.5 / samples**0.75


def test_further_offsets_of_all_samples_are_those_of_more_samples():
    own = pixel_offsets(4, 3)
    found = [*own, *(other for offset in own for other in further_offsets(offset, 4, 3))]
    np.testing.assert_allclose(sorted(found), sorted(pixel_offsets(16, 3)), atol=1e-12)


def test_a_seed_moves_the_pattern_and_repeats():
    assert pixel_offsets(4, 1) == pixel_offsets(4, 1)
    assert pixel_offsets(4, 1) != pixel_offsets(4, 2)
