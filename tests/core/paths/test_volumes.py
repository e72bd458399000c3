"""What fills the cells of a grid, one flight of light from cell to cell, and beams that collide in them."""

import numpy as np
import pytest

from milkglass.core.geometry.samples import surface_samples
from milkglass.core.grid.layers import LayerGrid, fit_nodes, tent_matrix
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.light.maps import texel_solid_angles
from milkglass.core.material.fresnel import transmittance
from milkglass.core.paths.beams import Emitted, traced
from milkglass.core.paths.deposit import collided, moments
from milkglass.core.paths.emission import Ball, diverging, parallel, surrounding
from milkglass.core.paths.filled import Filled, filled
from milkglass.core.paths.flight import flight_spectrum, potential_spectrum
from milkglass.core.paths.resolved import Scattered
from milkglass.core.paths.second import carried_on, exits, left
from milkglass.core.paths.surface import Surface
from tests.core.paths.test_events import beam
from tests.support import solids
from tests.support.solids import ball, block, mesh_of

ETA, RADIUS, BEAMS = 1.33, 10.0, 8000
THICK = (5.0,) * 3  # 1/mm: all that enters collides


@pytest.fixture(scope="module")
def sphere():
    return mesh_of(ball(RADIUS, subdivisions=5))


@pytest.mark.parametrize("mesh", [mesh_of(ball(RADIUS)), mesh_of(block((10.0, 7.0, 3.0)))])
def test_filled_cells_have_the_volume_of_the_mesh(mesh):
    grid = fit_nodes(mesh.bounds, 40)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    volume = np.linalg.det(corners).sum() / 6.0 / grid.texel**3
    found = filled(mesh, grid)
    outside = found.weight <= 0.03
    assert found.share.sum() == pytest.approx(volume, rel=0.01)
    assert found.weight[~outside].sum() == pytest.approx(volume, rel=0.01)


@pytest.mark.parametrize("axis", range(3))
def test_sheets_along_the_axes_and_thinner_than_a_cell_are_as_thick_as_they_are(axis):
    sides = np.roll([0.15, 10.0, 7.0], axis)
    mesh = mesh_of(block(tuple(sides)))
    grid = fit_nodes(mesh.bounds, 40)
    found = filled(mesh, grid)
    assert found.share.sum() == pytest.approx(sides.prod() / grid.texel**3, rel=0.06)
    assert found.weight[found.weight > 0.03].sum() == pytest.approx(sides.prod() / grid.texel**3, rel=0.06)


def test_the_weight_of_a_node_is_what_even_points_inside_assign_to_it():
    mesh = mesh_of(ball(5.0, subdivisions=4))
    grid = fit_nodes(mesh.bounds, 12)
    along = (np.arange(100) + 0.5) / 10.0 - 5.0
    points = np.stack(np.meshgrid(along, along, along), axis=-1).reshape(-1, 3)
    inside = points[np.linalg.norm(points, axis=1) < 4.99]
    density = 10.0**3 * grid.texel**3
    counts = np.asarray(tent_matrix(grid, grid.coordinates(inside)).sum(axis=1)).reshape(grid.shape) / density
    np.testing.assert_allclose(filled(mesh, grid).weight, np.maximum(counts, 0.03), atol=0.03)


@pytest.mark.parametrize(("k", "expected"), [(0.1, 0.9966865), (1.0, 0.7853982), (10.0, 0.1471128)])
def test_the_spectrum_of_a_flight(k, expected):
    """(1 / k) arctan k, of means over cells: less by their own transform."""
    step = 0.1 if k > 1.0 else 0.4
    size = 2 * int(np.ceil(9.0 / step))
    grid = LayerGrid(4, 4, 4, step, step, tuple(map(tuple, np.eye(4).tolist())))
    shape = ConvolutionShape(*grid.shape, padding=(size,) * 3)
    period = shape.padded_width * step
    nearest = max(1, round(k * period / (2.0 * np.pi)))
    at = 2.0 * np.pi * nearest / period
    found = float(flight_spectrum(1.0, grid, shape)[0, 0, nearest]) / np.sinc(at * step / (2.0 * np.pi))
    assert np.arctan(k) / k == pytest.approx(expected, abs=1e-6)
    assert found == pytest.approx(np.arctan(at) / at, rel=0.02)


def test_the_potential_of_a_flight_has_its_gradient():
    """Its transform is (1 / k^2) (1 - arctan(k) / k); its integral 1/3, a sixth of the mean square of a flight."""
    step, size = 0.3, 40
    grid = LayerGrid(4, 4, 4, step, step, tuple(map(tuple, np.eye(4).tolist())))
    shape = ConvolutionShape(*grid.shape, padding=(size,) * 3)
    found = potential_spectrum(1.0, grid, shape)
    assert found[0, 0, 0] == pytest.approx(1.0 / 3.0, rel=0.01)
    for n in (1, 3, 6):
        k = 2.0 * np.pi * n / (shape.padded_width * step)
        expected = (1.0 - np.arctan(k) / k) / k**2 * np.sinc(k * step / (2.0 * np.pi))
        assert found[0, 0, n] == pytest.approx(expected, rel=0.02)


def test_light_that_collides_has_the_flux_of_its_beams(sphere):
    surface, grid, around = Surface.of(sphere, 1.0), fit_nodes(sphere.bounds, 24), Ball.around(sphere)
    towards = np.array([0.6, 0.0, 0.8])
    beams = traced(surface, parallel(towards, (1.0, 2.0, 3.0), around, BEAMS))
    power, *flux = moments(beams, (0.1, 0.2, 0.3), grid, 4)
    np.testing.assert_array_equal(power, collided(beams, (0.1, 0.2, 0.3), grid))
    for along, cosine in zip(flux, -towards, strict=True):
        np.testing.assert_allclose(along, cosine * power, atol=1e-5 * power.max())


def test_all_that_enters_collides(sphere):
    surface, grid, around = Surface.of(sphere, ETA), fit_nodes(sphere.bounds, 24), Ball.around(sphere)
    mu = (np.arange(4000) + 0.5) / 4000
    entering = transmittance(ETA, mu)

    def entered(light):
        return collided(traced(surface, light), THICK, grid).sum(axis=(1, 2, 3))

    even = 2.0 * np.pi * RADIUS**2 * np.mean(entering * mu)
    np.testing.assert_allclose(
        entered(parallel((0, 0, 1), (1.0, 2.0, 3.0), around, BEAMS)), even * np.array([1, 2, 3]), rtol=5e-3
    )
    lamp = np.array([0.0, 0.0, 50.0])
    height = RADIUS * (2.0 * mu - 1.0)
    square = RADIUS**2 + 50.0**2 - 100.0 * height
    cosine = np.maximum((50.0 * height / RADIUS - RADIUS) / np.sqrt(square), 0.0)
    near = 4.0 * np.pi * RADIUS**2 * np.mean(cosine * transmittance(ETA, cosine) / square)
    light = diverging(lamp, lambda points: 1.0 / np.square(points - lamp).sum(axis=1), (1.0, 1.0, 1.0), around, BEAMS)
    np.testing.assert_allclose(entered(light), near, rtol=5e-3)
    sky = surrounding(np.ones((16, 32, 3)), np.eye(3), around, BEAMS)
    np.testing.assert_allclose(entered(sky), np.pi * 4.0 * even, rtol=5e-3)


def test_light_from_all_around_has_the_power_of_a_probe(sphere):
    """Of two halves and a small sun, none of which a sphere keeps from itself."""
    probe = np.zeros((32, 64, 3))
    probe[:, :32], probe[3, 9] = (1.0, 0.5, 0.0), 300.0
    light = surrounding(probe, np.eye(3), Ball.around(sphere), BEAMS)
    expected = np.pi * RADIUS**2 * (texel_solid_angles(probe)[:, None, None] * probe).sum(axis=(0, 1))
    np.testing.assert_allclose(light.power.sum(axis=0), expected, rtol=0.01)


def test_unscattered_light_of_a_sphere(sphere):
    """Shares of what has entered that cross spheres of 0.3, 1 and 3 mean free paths without a collision."""
    beams = traced(Surface.of(sphere, ETA), parallel((0, 0, 1), (1.0,) * 3, Ball.around(sphere), BEAMS))
    grid = fit_nodes(sphere.bounds, 24)
    entered = collided(beams, THICK, grid).sum(axis=(1, 2, 3))
    left = collided(beams, (0.3 / RADIUS, 1.0 / RADIUS, 3.0 / RADIUS), grid).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(1.0 - left / entered, [0.5876, 0.1768, 0.0066], atol=3e-3)


@pytest.mark.parametrize("kind", ["parallel", "diverging", "surrounding"])
def test_most_rays_meet_a_slender_object_and_bring_what_falls_on_it(kind):
    """A rod of 2 x 20 x 2 mm, which fills a tenth of its ball's disc; flux is counted on its faces."""
    rod, towards = solids.mesh_of(solids.block((2.0, 20.0, 2.0))), np.array([0.6, 0.0, 0.8])
    around, place = Ball.around(rod), 50.0 * towards
    if kind == "parallel":
        light, expected = parallel(towards, (1.0, 2.0, 3.0), around, 10_000), 40.0 * (0.6 + 0.8)
    elif kind == "surrounding":
        light, expected = surrounding(np.ones((16, 32, 3)), np.eye(3), around, 10_000), np.pi * rod.area
    else:
        light = diverging(place, lambda at: 1.0 / np.square(at - place).sum(axis=1), (1.0, 2.0, 3.0), around, 10_000)
        u = (np.arange(60) + 0.5) / 60.0
        x, y = np.meshgrid(2.0 * u - 1.0, 20.0 * u - 10.0)
        expected = 0.0
        for at, facing in (((x, y, np.ones_like(x)), 2), ((np.ones_like(x), y, x), 0)):
            off = place[:, None, None] - np.array(at)
            expected += 40.0 * np.mean(off[facing] / (off**2).sum(axis=0) ** 1.5)
    met = rod.rays.first(light.origins, light.directions)[0] >= 0
    assert met.mean() > 0.95
    assert 9_000 < met.sum() < 11_000
    assert light.power[met, 0].sum() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("thickness", "expected"), [(0.1, 0.0969), (0.3, 0.2631), (1.0, 0.6368)])
def test_light_along_the_normal_of_a_plate_collides_as_often_as_it_is_sent_back(thickness, expected):
    """(1 - e^-t) / (1 - F e^-t) of what enters, t mean free paths."""
    surface, light = Surface.of(mesh_of(block((40.0, 40.0, 2.0))), ETA), beam(200, 1.0)
    beams = traced(surface, Emitted(light.origins, light.directions, np.ones((200, 3), np.float32)))
    extinction = thickness / 2.0
    met = beams.power[:, 0] * np.exp(-extinction * beams.before[:, 0]) * -np.expm1(-extinction * beams.lengths)
    assert met.sum() / (200.0 * float(transmittance(ETA, 1.0))) == pytest.approx(expected, rel=2e-3)


def test_flux_that_flies_on_is_a_geometric_series():
    """Of what nothing leaves 1 / (1 - t) stays in all, t what a collision leaves; of what flies out, itself."""
    fill = Filled(np.ones((3, 4, 5), np.float32), np.ones((3, 4, 5), np.float32))
    flux = np.random.default_rng(0).normal(size=(3, 3, 4, 5)).astype(np.float32)
    np.testing.assert_allclose(carried_on(flux, 0.4, lambda part: part, fill), flux / 0.6, rtol=1e-5)
    np.testing.assert_array_equal(carried_on(flux, 0.4, np.zeros_like, fill), flux)
    np.testing.assert_array_equal(carried_on(0.0 * flux, 0.4, lambda part: part, fill), 0.0 * flux)


@pytest.mark.parametrize("thickness", [0.3, 1.0, 5.0])
def test_light_leaves_a_ball_as_often_as_it_would_be_absorbed_on_its_way_in(sphere, thickness):
    """Light that scatters evenly: without a boundary in closed form, with one by what beams from all around leave."""
    grid, extinction = fit_nodes(sphere.bounds, 40), (thickness / RADIUS,) * 3
    fill, samples = filled(sphere, grid), surface_samples(sphere, grid.texel)
    even, faces = Scattered.evenly([fill.weight] * 3), (samples.points, samples.normals, samples.areas)
    for eta in (1.0, ETA):
        surface = Surface.of(sphere, eta)
        out = exits(*(part.astype(np.float64) for part in faces), surface, 1e-3)
        found = left(even, extinction, fill, out, grid, eta)[0] / (4.0 / 3.0 * np.pi * (RADIUS / grid.texel) ** 3)
        if eta == 1.0:
            twice = 2.0 * thickness
            expected = 0.75 / thickness * (1.0 - 2.0 * (1.0 - (1.0 + twice) * np.exp(-twice)) / twice**2)
        else:
            sky = traced(surface, surrounding(np.ones((16, 32, 3)), np.eye(3), Ball.around(sphere), BEAMS))
            met = collided(sky, extinction, grid)[0].sum(dtype=float)
            expected = met / (16.0 / 3.0 * np.pi**2 * eta**2 * thickness * RADIUS**2)
        assert found == pytest.approx(expected, rel=0.02)
