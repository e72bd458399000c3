"""Scenes at the edge of what makes sense: each gives a finite picture, and mostly a known one."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material.fresnel import transmittance
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import direct_exitance
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import MaterialSettings, ModelSettings
from tests.support.rendering import BACK, FRONT, METHODS, MeshRenderer, RayCaster, inside, relative_rms, scene_of
from tests.support.shapes import ball

FACING = DirectionalLight((0.0, 0.0, 1.0))
FRONTAL = ("camera.azimuth_deg=0", "camera.elevation_deg=0")


def material(sigma_s_prime, sigma_a, eta=1.3):
    return MaterialSettings(sigma_s_prime=(sigma_s_prime,) * 3, sigma_a=(sigma_a,) * 3, eta=eta)


def made_of(coefficients, *assignments, **options):
    return replace(scene_of(*assignments, **options), material=coefficients)


def assert_sensible(frame, lit=True):
    """Finite, not negative, 0 beside the object and not all black on it."""
    for name in ("radiance", "alpha", "position", "normal", "irradiance", "exitance", "subsurface", "specular"):
        values = getattr(frame, name)
        assert np.all(np.isfinite(values)), name
        assert np.all(values[frame.alpha == 0.0] == 0.0), name
        if name not in ("position", "normal"):
            assert values.min() >= 0.0, name
    if lit:
        assert frame.exitance.max() > 0.0
        assert frame.image.max() > 0


def square(side=20.0):
    """Two triangles across z, one-sided: nothing behind them."""
    corners = 0.5 * side * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return Mesh(corners, np.tile([0.0, 0.0, 1.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))


def needle(length=100.0, diameter=0.05):
    shape = trimesh.creation.cylinder(0.5 * diameter, length, sections=12)
    return Mesh(shape.vertices[:, [0, 2, 1]] * [1, 1, -1], shape.vertex_normals[:, [0, 2, 1]] * [1, 1, -1], shape.faces)


# Materials


@pytest.mark.parametrize("method", METHODS)
def test_a_mean_free_path_of_a_ten_thousandth_of_the_object(renderer_of, method):
    """Light leaves where it entered: M = T(0) E, on a flat face that the light and the camera face.

    Ewald's local term is just that. Tents return it through one layer, patterned by samples against texels.
    """
    coefficients = material(500.0, 0.5)
    layers = ("transport.layers=1",) if method == "layered" else ()
    frame = renderer_of("cube").render(
        made_of(coefficients, *FRONTAL, *layers, method=method, lights=(FACING,)), samples=1
    )
    assert_sensible(frame)
    seen = inside(frame, 12)
    ratio = frame.exitance[seen] / (dipoles(coefficients.resolve())[0].total(0.0) * frame.irradiance[seen])
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert ratio.std() < {"layered": 0.05, "ewald": 0.001}[method]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", ["ball", "knot"])
def test_a_mean_free_path_of_ten_thousand_times_the_object(renderer_of, shapes, shape, method):
    """All light is equally far: M = R_d(0) times the flux that entered, everywhere."""
    coefficients = material(4e-6, 1e-6)
    renderer = renderer_of(shape)
    scene = made_of(coefficients, method=method)
    frame = renderer.render(scene, samples=1)
    assert_sensible(frame)
    expected = dipoles(coefficients.resolve())[0].radial(0.0) * renderer.light(scene).flux.sum(axis=0, dtype=np.float64)
    ratio = frame.exitance[frame.alpha == 1.0] / expected
    np.testing.assert_allclose(ratio, 1.0, atol=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("sigma_s_prime", "sigma_a"), [(1.0, 0.0), (1e-5, 0.0), (500.0, 0.0)])
def test_no_absorption(renderer_of, shapes, method, sigma_s_prime, sigma_a):
    """sigma_tr = 0, a tail of 1 / rho^3: still equation (1), where the layers can carry the mean free path."""
    coefficients = material(sigma_s_prime, sigma_a)
    layers = ("transport.layers=64",) if method == "layered" else ()
    scene = made_of(coefficients, *layers, method=method, lights=(DirectionalLight(BACK),))
    frame = renderer_of("ball").render(scene, samples=1)
    assert_sensible(frame)
    if sigma_s_prime <= 1.0:
        sources = surface_samples(shapes["ball"], 0.5)
        rays = RayCaster(shapes["ball"])
        entering = rays.irradiance(sources.points, sources.normals, sources.normals, scene.lights[0], 1.3)
        rows, columns = np.nonzero(inside(frame))
        some = np.random.default_rng(0).choice(len(rows), 60, replace=False)
        points = frame.position[rows[some], columns[some]]
        flux = entering * sources.areas[:, None]
        expected = direct_exitance(points, sources.points, flux, dipoles(coefficients.resolve()))
        assert np.all(relative_rms(frame.exitance[rows[some], columns[some]], expected) < 0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sigma_a", [0.0, 1.0, 1e6])
def test_no_scattering(renderer_of, method, sigma_a):
    """Nothing comes back from inside; the highlight stays."""
    frame = renderer_of("ball").render(made_of(material(0.0, sigma_a), method=method), samples=1)
    assert_sensible(frame, lit=False)
    assert np.all(frame.exitance == 0.0)
    np.testing.assert_array_equal(frame.radiance, frame.specular)
    assert frame.specular.max() > 0.1
    assert frame.image.max() > 100


@pytest.mark.parametrize("method", METHODS)
def test_no_scattering_in_one_channel(renderer_of, method):
    coefficients = MaterialSettings(sigma_s_prime=(1.0, 0.0, 1.0), sigma_a=(0.1, 0.1, 0.0), eta=1.3)
    frame = renderer_of("ball").render(made_of(coefficients, method=method), samples=1)
    assert_sensible(frame)
    assert np.all(frame.exitance[..., 1] == 0.0)
    assert np.all(frame.exitance[inside(frame)][:, [0, 2]] > 0.0)


def test_the_largest_coefficients(renderer_of):
    """A mean free path of a nanometre."""
    for coefficients in (material(1e6, 0.0), material(1e6, 1e6), material(1e-9, 1e6)):
        assert_sensible(renderer_of("knot").render(made_of(coefficients), samples=1), lit=False)


@pytest.mark.parametrize("method", METHODS)
def test_no_interface(renderer_of, method):
    """eta = 1: all light enters and leaves, E = 3 cos, L = M / pi."""
    frame = renderer_of("ball").render(made_of(material(1.0, 0.01, eta=1.0), method=method), samples=1)
    assert_sensible(frame)
    seen = inside(frame)
    np.testing.assert_allclose(frame.subsurface[seen], frame.exitance[seen] / np.pi, rtol=1e-5)
    cosine = frame.normal[seen] @ (np.array(FRONT) / np.linalg.norm(FRONT))
    bright = cosine > 0.1
    np.testing.assert_allclose(frame.irradiance[seen][bright, 0], 3.0 * cosine[bright], rtol=0.02)


# Layers


def test_one_layer_knows_no_depth(renderer_of):
    """Lit from the front or from behind, an orthographic ball looks the same through a single layer."""
    options = (*FRONTAL, "camera.orthographic=true", "transport.layers=1", "specular.strength=0")
    front, back = (
        renderer_of("ball").render(scene_of(*options, lights=(DirectionalLight((0.0, 0.0, z)),)), samples=1)
        for z in (1.0, -1.0)
    )
    assert_sensible(front)
    seen = inside(front)
    assert np.all(relative_rms(back.exitance[seen], front.exitance[seen]) < 5e-3)


def test_two_layers(renderer_of):
    """One at the front, one at the back; from behind the ball is dimmer than from the front."""
    means = []
    for z in (1.0, -1.0):
        scene = scene_of(*FRONTAL, "transport.layers=2", lights=(DirectionalLight((0.0, 0.0, z)),))
        frame = renderer_of("ball").render(scene, samples=1)
        assert_sensible(frame)
        means.append(frame.exitance[inside(frame)].mean())
    assert means[1] < means[0]


@pytest.mark.slow
@pytest.mark.parametrize(("layers", "resolution"), [(128, 16), (1, 1024), (128, 128)])
@pytest.mark.parametrize("shape", ["ball", "plate"])
def test_the_most_layers_and_texels(renderer_of, shape, layers, resolution):
    scene = scene_of(f"transport.layers={layers}", f"transport.resolution={resolution}")
    assert_sensible(renderer_of(shape).render(scene, samples=1))


@pytest.mark.parametrize("assignment", ["transport.layers=1", "transport.layers=128", "transport.resolution=16"])
def test_the_extremes_of_ewald(renderer_of, assignment):
    assert_sensible(renderer_of("plate").render(scene_of(assignment, method="ewald"), samples=1))


# Shapes


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("layers", [1, 8])
def test_a_flat_square_that_faces_the_camera(context, method, layers):
    """No depth at all: one layer. Far from its rim the sheet returns T(0) of what enters.

    A plane along Ewald's nodes meets all of them at one offset, where its error does not average out.
    """
    coefficients = material(5.0, 0.5)
    scene = made_of(coefficients, *FRONTAL, f"transport.layers={layers}", method=method, lights=(FACING,))
    renderer = MeshRenderer(context, square())
    frame = renderer.render(scene, samples=1)
    assert_sensible(frame)
    if method == "layered":
        assert renderer.light(scene).grid.n_layers == 1
    seen = inside(frame, 20)
    expected = float(dipoles(coefficients.resolve())[0].total(0.0)) * 3.0 * float(transmittance(1.3, 1.0))
    ratio = frame.exitance[seen] / expected
    assert ratio.mean() == pytest.approx(1.0, abs={"layered": 0.01, "ewald": 0.06}[method])
    assert ratio.std() < 0.01


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("azimuth", [90.0, 89.999, 85.0])
def test_a_flat_square_edge_on(context, method, azimuth):
    scene = scene_of(f"camera.azimuth_deg={azimuth}", "camera.elevation_deg=0", method=method, lights=(FACING,))
    frame = MeshRenderer(context, square()).render(scene, samples=1)
    assert_sensible(frame, lit=False)
    if azimuth == 85.0:
        assert frame.exitance.max() > 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("view", ["camera.elevation_deg=0", "camera.elevation_deg=90"])
def test_a_needle(context, method, view):
    """2000 times longer than thick, from the side and along its axis."""
    frame = MeshRenderer(context, needle()).render(scene_of(view, "camera.zoom=20", method=method), samples=2)
    assert_sensible(frame)
    assert frame.alpha.max() > 0.0


@pytest.mark.parametrize("method", METHODS)
def test_twelve_triangles(renderer_of, shapes, method):
    """Each face of a cube receives the closed form of its cosine."""
    direction = np.array([0.5, 0.7, 1.0])
    frame = renderer_of("cube").render(
        scene_of("camera.elevation_deg=30", method=method, lights=(DirectionalLight(tuple(direction)),)), samples=1
    )
    assert_sensible(frame)
    seen = inside(frame)
    cosine = np.maximum(frame.normal[seen] @ (direction / np.linalg.norm(direction)), 0.0)
    expected = 3.0 * cosine * transmittance(1.5, cosine)
    assert len(np.unique(frame.normal[seen].round(3), axis=0)) == 3
    away_from_edges = np.abs(np.sort(np.abs(frame.position[seen]), axis=1)[:, 1] - 10.0) > 0.2
    np.testing.assert_allclose(
        frame.irradiance[seen][away_from_edges], np.repeat(expected[away_from_edges, None], 3, 1), rtol=1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_million_triangles(context, renderer_of, method):
    """The ball of 20 thousand, finer: the same picture."""
    fine = ball(20.0, 8)
    assert len(fine.faces) > 1_000_000
    frame = MeshRenderer(context, fine).render(scene_of(method=method), samples=1)
    coarse = renderer_of("ball").render(scene_of(method=method), samples=1)
    both = inside(frame) & inside(coarse)
    assert_sensible(frame)
    assert np.all(relative_rms(frame.exitance[both], coarse.exitance[both]) < 0.01)


def test_a_model_far_from_the_origin(context, tmp_path):
    """A file in map coordinates: the same picture as at the origin."""
    shape = trimesh.creation.icosphere(subdivisions=3, radius=3.0)
    shape.vertices[shape.vertices[:, 0] > 0.0, 0] *= 1.7
    frames = []
    for offset in (0.0, 5e6):
        path = tmp_path / f"at_{offset:g}.obj"
        lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in shape.vertices + np.array([offset, -offset, offset])]
        lines += [f"f {a} {b} {c}" for a, b, c in shape.faces + 1]
        path.write_text("\n".join(lines) + "\n")
        scene = replace(scene_of(), model=ModelSettings(path=path, size_mm=30.0))
        frames.append(Renderer(context).render(scene, samples=1))
    assert_sensible(frames[1])
    assert np.mean(frames[0].alpha != frames[1].alpha) < 2e-3
    both = inside(frames[0]) & inside(frames[1])
    assert np.all(relative_rms(frames[1].radiance[both], frames[0].radiance[both]) < 2e-3)


# Lights


@pytest.mark.parametrize("strength", [1e-6, 1e6])
def test_very_weak_and_very_strong_light(renderer_of, strength):
    """The exposure makes up for it: the same picture."""
    renderer = renderer_of("knot")
    one = renderer.render(scene_of(lights=(DirectionalLight(FRONT, (1.0, 1.0, 1.0)),)), samples=2)
    other = renderer.render(scene_of(lights=(DirectionalLight(FRONT, (strength,) * 3),)), samples=2)
    assert_sensible(other)
    assert np.abs(other.image.astype(int) - one.image).max() <= 1


def test_the_strongest_light_a_scene_may_hold(renderer_of):
    lights = (DirectionalLight(FRONT, (1e9, 1e9, 1e9)), PointLight((0.0, 0.0, 12.0), (1e15, 1e15, 1e15)))
    assert_sensible(renderer_of("ball").render(scene_of(lights=lights), samples=1))


def test_a_point_light_inside_the_object(renderer_of):
    """No surface faces it: nothing enters from outside."""
    frame = renderer_of("ball").render(scene_of(lights=(PointLight((1.0, 2.0, -3.0)),)), samples=1)
    assert_sensible(frame, lit=False)
    assert np.all(frame.radiance == 0.0)
    assert np.all(frame.image == 0)


@pytest.mark.parametrize("height", [0.0, 1e-4])
@pytest.mark.parametrize("place", [(0.0, 0.0), (5.0, 5.0), (10.0, 10.0)])
def test_a_point_light_on_the_surface(renderer_of, place, height):
    """In the plane of a face it grazes it; just above, it is infinitely bright nowhere."""
    light = PointLight((*place, 10.0 + height), (1.0, 1.0, 1.0))
    assert_sensible(renderer_of("cube").render(scene_of(lights=(light,)), samples=1), lit=False)


@pytest.mark.parametrize("light", [DirectionalLight((1.0, 0.0, 0.0)), PointLight((100.0, 0.0, 0.5))], ids=repr)
def test_a_light_exactly_edge_on(renderer_of, light):
    """It reaches the rim of the plate, not its face, which it grazes."""
    frame = renderer_of("plate").render(scene_of("camera.azimuth_deg=30", lights=(light,)), samples=1)
    assert_sensible(frame)
    seen = inside(frame)
    face = frame.normal[seen][:, 2] > 0.5
    assert np.all(frame.irradiance[seen][face] < 1e-3 * frame.irradiance.max())


# Views


@pytest.mark.parametrize("orthographic", ["false", "true"])
@pytest.mark.parametrize("zoom", [100.0, 0.01])
def test_the_strongest_zoom(renderer_of, orthographic, zoom):
    """At 100, a hundredth of the ball fills the picture; at 0.01 it is a pixel or two."""
    frame = renderer_of("ball").render(
        scene_of(f"camera.zoom={zoom}", f"camera.orthographic={orthographic}"), samples=16
    )
    assert_sensible(frame)
    if zoom > 1.0:
        assert np.all(frame.alpha == 1.0)
        assert np.ptp(frame.position[..., 1]) < 0.3
    else:
        assert 0.2 < frame.alpha.sum() < 6.0


@pytest.mark.parametrize("view_angle", [1.0, 120.0])
@pytest.mark.parametrize("elevation", [-90.0, 90.0])
def test_extreme_lenses_from_the_poles(renderer_of, view_angle, elevation):
    scene = scene_of(f"camera.view_angle_deg={view_angle}", f"camera.elevation_deg={elevation}")
    assert_sensible(renderer_of("knot").render(scene, samples=1))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(16, 16), (512, 16), (16, 300)], ids=str)
def test_odd_image_sizes(renderer_of, size):
    frame = renderer_of("ball").render(scene_of(f"display.image_size={list(size)}"), samples=1)
    assert_sensible(frame)
    assert frame.alpha.shape == size[::-1]
