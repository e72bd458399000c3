"""Shadow maps: where they lie, and visibility in closed form."""

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.material.fresnel import transmittance
from milkglass.viewer.gl.buffers import MeshBuffers, SampleBuffers
from milkglass.viewer.gl.context import latlong_texture
from milkglass.viewer.passes.irradiance import SampleIrradiancePass
from milkglass.viewer.passes.light_source import lamp
from milkglass.viewer.passes.shadows import MAP_SIDE, ShadowsPass
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from tests.support.rendering import random_samples
from tests.support.shapes import ball, plate

ETA = 1.3
DIRECTIONS = ((0.3, 0.4, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, -2.0), (-1e-3, 5.0, 1e-3))


@pytest.fixture(scope="module")
def shadows(context):
    return ShadowsPass(context)


@pytest.fixture(scope="module")
def irradiance_of(context, shadows):
    """Return E of a light at samples of a mesh, (n, 3)."""
    run = SampleIrradiancePass(context)
    table = latlong_texture(context, np.zeros((1, 1, 3), np.float32))

    def irradiance(mesh, samples, light, eta=ETA):
        shadow = shadows.render(MeshBuffers(context, mesh), mesh, light)
        return run.run(SampleBuffers(context, samples), lamp(light, shadow, table), eta)

    return irradiance


def square(side, z, facing=1.0):
    """Two triangles across z, normals along z."""
    corners = 0.5 * side * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, z]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return corners, faces if facing > 0 else faces[:, ::-1]


def blocked_floor():
    """A floor of 40 mm at z = 0 under a square of 10 mm at z = 5, both facing up."""
    (floor, faces), (blocker, more) = square(40.0, 0.0), square(10.0, 5.0)
    vertices = np.concatenate([floor, blocker])
    return Mesh(vertices, np.tile([0, 0, 1], (8, 1)), np.concatenate([faces, more + 4]))


def on_floor(n=20_000, side=39.0, seed=1):
    rng = np.random.default_rng(seed)
    points = np.zeros((n, 3), np.float32)
    points[:, :2] = side * (rng.random((n, 2)) - 0.5)
    return SurfaceSamples(points, np.tile(np.float32([0, 0, 1]), (n, 1)), np.ones(n, np.float32))


# Where the maps lie


@pytest.mark.parametrize(
    ("light", "views"),
    [
        (DirectionalLight((0.3, 0.4, 1.0)), 1),
        (PointLight((0.0, 0.0, 30.0)), 1),
        (PointLight((0.0, 10.2, 0.0)), 6),
        (PointLight((0.0, 0.0, 0.0)), 6),
    ],
)
def test_a_light_in_the_bounding_sphere_needs_six_views(context, shadows, light, views):
    mesh = ball(20.0, 3)
    shadow = shadows.render(MeshBuffers(context, mesh), mesh, light)
    assert shadow.views == views
    assert shadow.texture.size == ((MAP_SIDE, MAP_SIDE) if views == 1 else (MAP_SIDE // 2 * 3, MAP_SIDE // 2 * 2))


@pytest.mark.parametrize(
    "light", [*map(DirectionalLight, DIRECTIONS), PointLight((0.0, 50.0, 0.0)), PointLight((30.0, 1.0, -8.0))]
)
def test_one_view_holds_the_whole_object_with_two_texels_to_spare(context, shadows, shapes, light):
    mesh = shapes["knot"]
    shadow = shadows.render(MeshBuffers(context, mesh), mesh, light)
    clip = np.c_[mesh.vertices.astype(np.float64), np.ones(len(mesh.vertices))] @ shadow.world_to_clip[0]
    assert np.all(clip[:, 3] > 0.0)
    window = clip[:, :3] / clip[:, 3:]
    assert np.abs(window[:, :2]).max() <= 1.0 - 4.0 / MAP_SIDE + 1e-6
    assert np.abs(window[:, 2]).max() < 1.0


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (3.0, -2.0, 4.0)])
def test_six_views_divide_all_directions(context, shadows, shapes, position):
    mesh = shapes["ball"]
    shadow = shadows.render(MeshBuffers(context, mesh), mesh, PointLight(position))
    clip = np.c_[mesh.vertices.astype(np.float64), np.ones(len(mesh.vertices))] @ shadow.world_to_clip
    w = clip[..., 3]
    held = (w > 0.0) & (np.abs(clip[..., :3]) < w[..., None]).all(axis=-1)  # strictly: off the edges of the cube
    touched = (w > 0.0) & (np.abs(clip[..., :3]) <= w[..., None] * (1.0 + 1e-9)).all(axis=-1)
    assert np.all(held.sum(axis=0) <= 1)
    assert np.all(touched.sum(axis=0) >= 1)


def test_a_texel_covers_what_it_says(context, shadows):
    """Neighbouring texels of a directional map lie `texel` mm apart on a surface that faces the light."""
    mesh = ball(20.0, 4)
    shadow = shadows.render(MeshBuffers(context, mesh), mesh, DirectionalLight((0.3, 0.4, 1.0)))
    per_mm = np.linalg.norm(shadow.world_to_clip[0][:3, :2], axis=0) * MAP_SIDE / 2
    np.testing.assert_allclose(shadow.texel * per_mm, 1.0, rtol=1e-6)
    np.testing.assert_allclose(shadow.texel, 20.0 / (MAP_SIDE - 4), rtol=2e-3)


# Visibility


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.4, 0.0, 1.0), (-0.5, 0.7, 1.0)])
def test_the_shadow_of_a_square_is_a_square(irradiance_of, direction):
    """On the floor, moved along the light; edges within 3 texels, sloped by the light."""
    mesh, samples, light = blocked_floor(), on_floor(), DirectionalLight(direction)
    towards = np.array(direction) / np.linalg.norm(direction)
    expected = 3.0 * towards[2] * float(transmittance(ETA, towards[2]))
    actual = irradiance_of(mesh, samples, light)
    offset = samples.points[:, :2] + 5.0 * towards[:2] / towards[2]
    edge = np.abs(offset).max(axis=1) - 5.0  # < 0 in the shadow
    margin = 3.0 * 60.0 / MAP_SIDE / towards[2]
    np.testing.assert_allclose(actual[edge < -margin], 0.0)
    np.testing.assert_allclose(actual[edge > margin], expected, rtol=1e-5)
    assert np.mean(np.abs(edge) <= margin) < 0.15


@pytest.mark.parametrize("height", [12.0, 60.0])
def test_the_shadow_of_a_square_from_a_point_is_a_larger_square(irradiance_of, height):
    """By central projection, from within the bounding sphere (12 mm) and from outside (60 mm)."""
    mesh, samples = blocked_floor(), on_floor()
    light = PointLight((0.0, 0.0, height), (1e3,) * 3)
    distance = np.sqrt(height**2 + np.square(samples.points[:, :2].astype(np.float64)).sum(axis=1))
    cosine = height / distance
    expected = 1e3 * transmittance(ETA, cosine) * cosine / distance**2
    actual = irradiance_of(mesh, samples, light)[:, 0]
    edge = np.abs(samples.points[:, :2]).max(axis=1) - 5.0 * height / (height - 5.0)
    np.testing.assert_allclose(actual[edge < -0.3], 0.0)
    np.testing.assert_allclose(actual[edge > 0.3], expected[edge > 0.3], rtol=1e-5)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_ball_has_no_acne(irradiance_of, direction):
    """Convex: nothing is shadowed but the far side; the filter may soften 4 degrees before the terminator.

    On slopes across a texel's diagonal the bias is a little short: a few percent on 4 % of the points, never a stripe.
    More bias would lose more at the contact of shadows than this.
    """
    mesh = ball(20.0, 6)
    samples, _ = random_samples(mesh, 20_000)
    towards = np.array(direction) / np.linalg.norm(direction)
    cosine = samples.normals @ towards
    actual = irradiance_of(mesh, samples, DirectionalLight(direction))[:, 0]
    expected = 3.0 * np.maximum(cosine, 0.0) * transmittance(ETA, np.maximum(cosine, 0.0))
    clear = cosine > np.sin(np.radians(4.0))
    np.testing.assert_allclose(actual[clear], expected[clear], rtol=0.06)
    assert np.abs(actual - expected).mean() < 3e-4 * expected.mean()
    assert np.all(actual[cosine <= 0.0] == 0.0)
    assert np.all(actual <= expected * 1.0001 + 1e-9)


def test_a_plate_has_no_acne_at_any_slope(irradiance_of):
    """A flat face shadows nothing of itself, up to a light that grazes it."""
    mesh = plate(20.0, 1.0, 8)
    samples, face_normals = random_samples(mesh, 5_000)
    for angle in np.radians([0.0, 30.0, 60.0, 80.0, 87.0, 89.0]):
        direction = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
        actual = irradiance_of(mesh, samples, DirectionalLight(direction))[:, 0]
        top = face_normals[:, 2] > 0.5
        expected = 3.0 * direction[2] * float(transmittance(ETA, direction[2]))
        np.testing.assert_allclose(actual[top], expected, rtol=1e-4, err_msg=f"{np.degrees(angle)} degrees")
        assert np.all(actual[face_normals[:, 2] < -0.5] == 0.0)


def test_no_light_leaks_through_a_thin_plate(irradiance_of):
    """Where the two sides are four texels apart."""
    mesh = plate(20.0, 0.04, 8)
    samples, face_normals = random_samples(mesh, 5_000)
    turned = SurfaceSamples(samples.points, -samples.normals, samples.areas)  # the far side, made to face the light
    far = face_normals[:, 2] < -0.5
    actual = irradiance_of(mesh, turned, DirectionalLight((0.2, 0.1, 1.0)))
    rim = np.abs(samples.points[:, :2]).max(axis=1) > 9.9
    assert np.all(actual[far & ~rim] == 0.0)


def test_a_light_without_a_shadow_reaches_everything_that_faces_it(context, shadows):
    mesh = blocked_floor()
    samples = on_floor(100)
    light = DirectionalLight((0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    source = lamp(light, shadows.none, latlong_texture(context, np.zeros((1, 1, 3), np.float32)))
    assert shadows.none.views == 0
    actual = SampleIrradiancePass(context).run(SampleBuffers(context, samples), source, 1.5)
    np.testing.assert_allclose(actual, np.tile([0.96, 1.92, 2.88], (100, 1)), rtol=1e-6)
    assert mesh.area == pytest.approx(1700.0)


def test_the_smallest_map_still_works(context, shapes):
    """A GPU's limit, or a caller, may ask for less than MAP_SIDE."""
    mesh = shapes["ball"]
    coarse = ShadowsPass(context, 64)
    shadow = coarse.render(MeshBuffers(context, mesh), mesh, DirectionalLight((0.0, 0.0, 1.0)))
    assert shadow.texture.size == (64, 64)
    assert shadow.texel == pytest.approx(20.0 / 60, rel=1e-3)
