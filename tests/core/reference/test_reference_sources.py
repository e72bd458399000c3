"""Where the float64 reference puts its sources, and the light that enters there."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material import library as materials
from milkglass.core.material.fresnel import transmittance
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.reference.sources import SourcePieces, graded_sources
from milkglass.viewer.error.report import illumination_of
from milkglass.viewer.error.visible import Illumination, measure
from milkglass.viewer.files import images
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import EnvironmentSettings
from tests.support.rendering import (
    BACK,
    FRONT,
    OUTLIERS,
    inside,
    outliers,
    relative_rms,
    scene_of,
    seen_at,
    surface_points,
)
from tests.support.shapes import ball, cube, plate, torus_knot

# Sources


@pytest.mark.parametrize("make", [ball, plate, torus_knot, cube])
def test_graded_sources_cover_the_surface(make):
    mesh = make()
    sources = graded_sources(mesh, surface_points(mesh, 5), 0.3)
    assert sources.areas.sum() == pytest.approx(mesh.area, rel=1e-6)
    for normals in (sources.normals, sources.face_normals):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)
    assert np.all(np.einsum("ij,ij->i", sources.normals, sources.face_normals) > 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("material", ["wholemilk", "skimmilk"])
@pytest.mark.parametrize("make", [ball, torus_knot, plate])
def test_few_graded_sources_are_worth_many_even_ones(make, material):
    """Within 0.1 % rms of an even cover four to ten times as dense (measured .06), light from behind and the front."""
    mesh, found = make(), materials.lookup(material)
    points, occluder = surface_points(mesh, 8), Occluder(mesh)
    graded, even = graded_sources(mesh, points, dipoles(found)[2].z_r), surface_samples(mesh, 0.12)
    assert len(graded) < 0.6 * len(even)
    light = Illumination((DirectionalLight(FRONT), DirectionalLight(BACK)), None, np.eye(3), 1.0)
    M = measure(seen_at(points), mesh, light, found).reference
    E = sum(
        occluder.irradiance(even.points, even.normals, even.normals, direction, (3, 3, 3), found.eta)
        for direction in (FRONT, BACK)
    )
    expected = direct_exitance(points, even.points, E * even.areas[:, None], dipoles(found))
    assert np.all(relative_rms(M, expected) < 1e-3)


def test_a_mean_free_path_far_below_the_object_needs_no_more_sources():
    """Exitance is T(0) E in the middle of a face, at a ten thousandth of it."""
    found = materials.Material("test", (450.0,) * 3, (50.0,) * 3, 1.3, "test")
    points = np.array([[1.0, 2.0, 10.0], [-3.3, 4.1, 10.0]])
    light = Illumination((DirectionalLight((0.0, 0.0, 1.0)),), None, np.eye(3), 1.0)
    result = measure(seen_at(points), cube(), light, found)
    expected = float(dipoles(found)[0].total(0.0)) * 3.0 * float(transmittance(1.3, 1.0))
    np.testing.assert_allclose(result.reference, expected, rtol=2e-3)
    assert result.n_sources < 300_000


# Light


def test_point_light_has_a_shadow_and_falls_with_the_square_of_the_distance():
    mesh = plate(20.0, 1.0)
    occluder, up = Occluder(mesh), np.array([[0.0, 0.0, 1.0]])
    for height in (1.0, 7.0):
        point = np.array([[0.3, 0.2, 0.5]])
        position = point[0] + [0.0, 0.0, height]
        E = occluder.point_irradiance(point, up, up, position, (1, 2, 3), 1.5)
        np.testing.assert_allclose(E, [np.array([1, 2, 3]) * 0.96 / height**2], rtol=1e-6)
        below = occluder.point_irradiance(point * [1, 1, -1], -up, -up, position, (1, 2, 3), 1.5)
        assert not below.any()


def test_what_lies_beyond_a_point_light_casts_no_shadow():
    """Between two faces that look at each other: the light reaches both."""
    a, b = plate(20.0, 1.0, 2), plate(20.0, 1.0, 2)
    vertices = np.concatenate([a.vertices, b.vertices + np.float32([0, 0, 10])])
    mesh = Mesh(vertices, np.concatenate([a.normals, b.normals]), np.concatenate([a.faces, b.faces + len(a.vertices)]))
    points, normals = np.array([[1.0, 0.0, 0.5], [1.0, 0.0, 9.5]]), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    occluder = Occluder(mesh)
    np.testing.assert_array_equal(occluder.reached(points, normals, (1.0, 0.0, 5.0)), [True, True])
    np.testing.assert_array_equal(occluder.reached(points, normals, (1.0, 0.0, 20.0)), [False, False])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["directional", "point", "environment"])
def test_the_lights_are_the_renderers(renderer_of, tmp_path, kind):
    """E of the picture at pixels in the light, but for a few at the edge of a shadow."""
    lights = {"directional": (DirectionalLight(FRONT),), "point": (PointLight((20.0, 15.0, 30.0), (900, 800, 700)),)}
    scene = scene_of("display.image_size=[64, 64]", lights=lights.get(kind, ()))
    if kind == "environment":
        pixels = np.random.default_rng(0).random((32, 64, 3)).astype(np.float32) ** 8
        images.write_exr(tmp_path / "probe.exr", {name: pixels[..., i] for i, name in enumerate("RGB")})
        scene = replace(scene, environment=EnvironmentSettings(tmp_path / "probe.exr", 40.0, 2.0))
    renderer = renderer_of("ball")
    frame = renderer.render(scene, samples=1)
    seen = inside(frame)
    if kind != "environment":
        seen &= frame.irradiance.max(axis=-1) > 0.3
    points, normals = (frame.position[seen].astype(np.float64), frame.normal[seen].astype(np.float64))
    where = SourcePieces(points, normals, normals, np.ones(len(points)))
    illumination = illumination_of(renderer, scene)
    E = illumination.irradiance(Occluder(renderer.model.mesh), where, scene.material.resolve().eta)
    assert outliers(frame.irradiance[seen], E, rtol=2e-3) < OUTLIERS
