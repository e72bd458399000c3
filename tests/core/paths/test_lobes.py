"""Light that scatters once by the whole phase function: its density, what rays gather of it, and where it goes on."""

import numpy as np
import pytest

from milkglass.core.grid.layers import fit_nodes
from milkglass.core.material.medium import Medium
from milkglass.core.paths.beams import traced
from milkglass.core.paths.deposit import collided
from milkglass.core.paths.emission import Ball, parallel
from milkglass.core.paths.events import Chords
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.lobes import density, tables, turned
from milkglass.core.paths.onwards import sent_on
from milkglass.core.paths.surface import Surface
from tests.support.solids import ball, mesh_of

COSINES = -np.cos((np.arange(4000) + 0.5) / 4000 * np.pi)


def over_the_sphere(values, cosines=COSINES):
    return 0.5 * np.trapezoid(values, cosines, axis=-1)


@pytest.mark.parametrize("g", [0.1, 0.6, 0.9, 0.98])
def test_what_scatters_has_all_power_the_mean_cosine_and_what_goes_back(g):
    found = density(COSINES, g)
    assert over_the_sphere(found) == pytest.approx(1.0, abs=1e-4)
    assert over_the_sphere(found * COSINES) == pytest.approx(g / (1.0 + g), abs=1e-3)
    henyey_greenstein = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * COSINES) ** 1.5
    back = COSINES < -0.7
    np.testing.assert_allclose((1.0 - g * g) * found[back], henyey_greenstein[back], rtol=0.3)
    drawn = turned(np.random.default_rng(0).random(100_000), np.zeros(100_000, np.int64), [g])
    assert drawn.mean() == pytest.approx(g / (1.0 + g), abs=5e-3)


def test_tables_run_from_light_all_around_to_that_from_one_direction():
    even, table = tables([0.0, 0.9])
    sines = np.linspace(0.0, 1.0, table.shape[1])
    fine = np.linspace(0.0, 1.0, 4001)
    assert (even == 1.0).all()
    np.testing.assert_allclose(table[0], 1.0, rtol=1e-5)
    np.testing.assert_allclose(table[-1], density(1.0 - 2.0 * sines**2, 0.9), rtol=0.01)
    means = [np.trapezoid(2.0 * fine * np.interp(fine, sines, row), fine) for row in table]
    np.testing.assert_allclose(means, 1.0, rtol=1e-4)
    assert (np.diff(table[:, -1]) < 1e-6).all()  # the less goes back, the less light comes from there


def test_a_chord_gathers_what_lobes_send_along_it():
    lobes, up = np.zeros((2, 4, 4, 4, 3, 4), np.float32), np.array([0.0, 0.0, 1.0], np.float32)
    lobes[0, ..., 0], lobes[1, ..., 0] = 1.0, 0.5
    lobes[0, ..., 3] = 1.0  # light along z; of the other source from all around
    glow = Glow.of(np.zeros((3, 4, 4, 4)), (0.0, 0.0, 0.0), 1.0)._replace(lobes=lobes, tables=tables([0.0, 0.6, 0.9]))
    ends = np.array([[1.5, 1.5, 0.5], [1.5, 1.5, 2.5]], np.float32)
    none = np.zeros(1, np.int32)
    for start, towards in ((1, 1.0), (0, -1.0)):
        chords = Chords(
            ends[start, None], ends[1 - start, None], np.full(1, 2.0, np.float32), np.ones((1, 3), np.float32), none,
            none, none, none,
        )  # fmt: skip
        found = np.zeros((1, 3), np.float32)
        glow.add(chords, np.zeros((1, 3), np.float32), np.ones(1, np.float32), found)
        expected = [2.0 * (float(density(towards * up[2:], g)[0]) + 0.5) for g in (0.0, 0.6, 0.9)]
        np.testing.assert_allclose(found[0], expected, rtol=0.01)


@pytest.fixture(scope="module")
def across():
    """Beams through a ball of 10 mm, and their ways on."""
    mesh = mesh_of(ball(10.0, subdivisions=3))
    surface, grid = Surface.of(mesh, 1.33), fit_nodes(mesh.bounds, 24)
    beams = traced(surface, parallel((0.0, 0.0, 1.0), (1.0, 2.0, 3.0), Ball.around(mesh), 2000))
    return beams, grid, sent_on(beams, (0.9, 0.6, 0.0), surface)


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
def test_what_goes_on_is_what_has_scattered_whatever_the_coefficients(across, factor):
    """All of it, from where on its way and along the way on that matter has it scatter; of channels that differ."""
    beams, grid, rays = across
    absorbed, scattered, cosines = (0.01, 0.02, 0.0), (0.01, 0.1, 0.5), (0.9, 0.6, 0.0)
    media = [Medium(factor * s, factor * a, 1.33, g=g) for s, a, g in zip(scattered, absorbed, cosines, strict=True)]
    flights, used = [medium.delta_eddington() for medium in media], (True, True, False)
    found = rays.scattered(beams, flights, used)
    first = found.before[:, 0] == 0.0
    met = collided(beams, [flight.sigma_t for flight in flights], grid).sum(axis=(1, 2, 3))
    expected = [flight.albedo * power * of for flight, power, of in zip(flights, met, used, strict=True)]
    np.testing.assert_allclose(found.power[first].sum(axis=0), expected, rtol=0.02)
    sent, axis = found.power[first].astype(float), found.ends[first] - found.starts[first]
    turns = (axis / found.lengths[first, None])[:, 2]
    for i, flight in enumerate(flights[:2]):
        # Along the axis of a ball beams go nearly straight on; of all they lose what they bend by.
        light = sent[:, i] / sent[:, i].sum()
        extinction, lengths = flight.sigma_t, beams.lengths.astype(float)
        reached = beams.power[:, i] * np.exp(-extinction * beams.before[:, 0])
        mean = 1.0 / extinction - lengths / np.expm1(extinction * lengths)
        share = reached * -np.expm1(-extinction * lengths)
        begun = beams.starts[rays.chords[rays.courses.sources[first]]]
        along = np.linalg.norm(found.starts[first] - begun, axis=1)
        assert light @ along == pytest.approx(share @ mean / share.sum(), rel=0.03)
        heading = ((beams.ends - beams.starts)[:, 2] / lengths) @ share / share.sum()
        assert light @ turns == pytest.approx(flight.cosine * heading, abs=0.02)
