"""Light that crosses matter unscattered: uniform light stays, plates have their closed form, and lamps their flux."""

import numpy as np
import pytest

from milkglass.core.geometry.refine import refined
from milkglass.core.light.crossing import Needed, cast_crossings, few_crossings
from milkglass.core.light.exchange import cast_hits
from milkglass.core.light.mirror import Mirror
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance, transmittance
from milkglass.viewer.bench.shapes import torus_knot
from tests.support.solids import block, mesh_of, plates

ETA = 1.5


def white(directions):
    return np.ones((len(directions), 3))


FLOOR = block((2.0, 2.0, 20.0), (0.0, 0.0, -10.0)).subdivide_to_size(0.3, max_iter=20)
ROOF = block((60.0, 60.0, 0.1), (0.0, 0.0, 0.55))


def from_above(directions):
    return white(directions) * (directions[:, 2:] > 0.0)


@pytest.fixture(scope="module")
def roofed():
    """A deep floor with vertices all over, under a wide roof .1 thick."""
    return mesh_of(FLOOR, ROOF)


def below(mesh):
    return (np.abs(mesh.vertices[:, 2]) < 1e-4) & (np.abs(mesh.vertices[:, :2]).max(axis=1) < 0.9)


def test_uniform_light_stays_uniform_in_clear_matter():
    """All that the object covers of white surroundings comes by way of its mirror or through it."""
    mesh = torus_knot(20.0, 120, 16)
    hits = cast_hits(mesh)
    covered = 1.0 - reflectance(ETA, hits.cosines[:, 0])
    expected = np.pi / hits.rays * np.bincount(hits.vertices, covered, minlength=len(mesh.vertices))
    found = hits.mirrored(ETA, white) + cast_crossings(mesh, ETA).irradiance(white, (0.0,) * 3)
    assert found.sum(axis=0) == pytest.approx(3 * [expected.sum()], rel=3e-3)


def test_a_plate_lets_through_its_closed_form(roofed):
    """F_t there, then exp(-chord) between two surfaces that mirror; the rest scatters or goes back up."""
    extinctions = 2.0, 8.0, 20.0
    paths = cast_crossings(roofed, ETA)
    found = paths.irradiance(from_above, extinctions)[below(roofed)].mean(axis=0)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    mirrored, entering = reflectance(ETA, mu), transmittance(ETA, mu)
    chords = 0.1 / np.sqrt(1.0 - (1.0 - mu * mu) / ETA**2)
    for value, extinction in zip(found, extinctions, strict=True):
        left = np.exp(-extinction * chords)
        plate = (1.0 - mirrored) ** 2 * left / (1.0 - (mirrored * left) ** 2)
        assert value == pytest.approx(2.0 * np.pi * np.sum(weights * mu * entering * plate), rel=0.02)


def test_what_a_part_lets_out_comes_through_another(roofed):
    """An even glow above the roof: as surroundings that are as bright do, but for the angle at which it leaves."""
    mesh = mesh_of(FLOOR, ROOF, block((60.0, 60.0, 1.0), (0.0, 0.0, 2.0)))
    glowing = np.where(mesh.vertices[mesh.faces][..., 2].min(axis=1) > 1.4, 0, -1)
    paths = cast_crossings(mesh, ETA)
    received = paths.matrix(glowing, 1, 8.0) @ np.array([np.pi * hemispherical_transmittance(ETA)], np.float32)
    around = cast_crossings(roofed, ETA).irradiance(white, (8.0,) * 3)
    assert 0.9 < received[below(mesh)].mean() / around[below(roofed), 0].mean() < 1.06


def test_a_lamp_through_a_plate_has_its_flux(roofed):
    """At normal incidence F_t of what the plate lets through enters the floor; some goes up and comes back."""
    n, extinction = 4000, 6.0
    points = np.column_stack([np.random.default_rng(0).uniform(-0.8, 0.8, (n, 2)), np.full(n, 0.6)])
    up = np.broadcast_to([0.0, 0.0, 1.0], (n, 3))
    mirror = Mirror(roofed)
    received = mirror.crossing(points, up, up, np.ones((n, 3)), ETA, np.inf, ETA)
    mirrored, left = float(reflectance(ETA, 1.0)), np.exp(-0.1 * extinction)
    plate = (1.0 - mirrored) ** 2 * left / (1.0 - (mirrored * left) ** 2)
    back = mirrored + (1.0 - mirrored) ** 2 * mirrored * left**2 / (1.0 - (mirrored * left) ** 2)
    expected = plate * (1.0 - mirrored) / (1.0 - mirrored * back)
    on_floor = (np.abs(roofed.vertices[received.corners][..., 2]) < 1e-4).all(axis=1)
    flux = received.flux[on_floor, 0] * np.exp(-extinction * received.lengths[on_floor])
    assert flux.sum() / n == pytest.approx(expected, rel=0.02)
    assert mirror.irradiance(received, (extinction,) * 3).any()


def test_reach_ends_paths_that_matter_has_put_out(roofed):
    every, few = cast_crossings(roofed, ETA), cast_crossings(roofed, ETA, 1.0)
    assert few.left_lengths.max() <= 1.0
    assert few.irradiance(white, (8.0,) * 3)[below(roofed)].mean() == pytest.approx(
        every.irradiance(white, (8.0,) * 3)[below(roofed)].mean(), rel=0.01
    )


def test_paths_are_needed_where_light_crosses():
    few = few_crossings(refined(plates(thickness=0.2), 2.0).mesh)
    assert Needed.of(few, (60.0, 40.0)) is None
    some, much = Needed.of(few, (15.0,)), Needed.of(few, (15.0, 1.0))
    assert some.rays < much.rays
    assert some.reach > 0.2
    assert much.reach > 5.0
