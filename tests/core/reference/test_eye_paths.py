"""Paths from the eye against closed forms and shares of photons."""

import numpy as np
import pytest

from milkglass.core.material.fresnel import transmittance
from milkglass.core.reference.eye_paths import PARTS, LitObject, group_radiance, traced
from milkglass.core.reference.near_lamps import NearBall, NearPanel
from milkglass.core.reference.phase import henyey_greenstein, phase
from milkglass.core.reference.photon_lights import Beam, Surroundings
from tests.support.solids import ball, block, mesh_of

RADIUS, ETA = 10.0, 1.33
WHITE = Surroundings(np.ones((16, 32, 3), np.float32), np.eye(3))


@pytest.fixture(scope="module")
def sphere():
    return mesh_of(ball(RADIUS, subdivisions=5))


def down(n, radius=RADIUS):
    """Parallel rays that cover a sphere evenly."""
    r, turn = radius * np.sqrt((np.arange(n) + 0.5) / n), 2.399963 * np.arange(n)
    places = np.stack([r * np.cos(turn), r * np.sin(turn), np.full(n, 3.0 * radius)], axis=1)
    return places, np.tile([0.0, 0.0, -1.0], (n, 1))


def matter(mesh, scattering, absorption, g=0.0, eta=ETA, lights=(WHITE,), peak=0.0):
    scattering, absorption, g, peak = (np.broadcast_to(np.float64(x), 3) for x in (scattering, absorption, g, peak))
    return LitObject(mesh, scattering, absorption, g, eta, lights, peak)


def mean(lit, n=20_000, seed=0):
    places, directions = down(n)
    sums, lost = traced(lit, places, directions, np.zeros(n, np.int64), 1, np.random.default_rng(seed))
    assert lost < 1e-3
    return sums[0] / n


@pytest.mark.parametrize("g", [0.0, 0.7])
def test_white_matter_is_not_to_be_seen_in_white_surroundings(sphere, g):
    found = mean(matter(sphere, [0.02, 0.1, 0.3], 0.0, g), 6000)
    np.testing.assert_allclose(found.sum(axis=0), 1.0, atol=0.02)


@pytest.mark.parametrize(
    ("thickness", "unscattered", "once", "often"),
    [
        (0.3, 0.5876, 0.2555, (0.0253, 0.1136)),
        (1.0, 0.1768, 0.2934, (0.0643, 0.3518)),
        (3.0, 0.0066, 0.1331, (0.0505, 0.4185)),
    ],
)
def test_shares_of_a_sphere(sphere, thickness, unscattered, once, often):
    """By order and in channels of albedos 0.5, 0.9 and 0.9, of photons; the eye's parallel paths are a lamp's."""
    albedos = np.array([0.5, 0.9, 0.9])
    extinction = thickness / RADIUS
    found = mean(matter(sphere, albedos * extinction, (1.0 - albedos) * extinction))
    mu = (np.arange(1000) + 0.5) / 1000
    entered = 2.0 * np.mean(mu * transmittance(ETA, mu))
    np.testing.assert_allclose(found[0], 1.0 - entered, atol=2e-3)
    np.testing.assert_allclose(found[1] / entered, unscattered, atol=0.012)
    np.testing.assert_allclose(found[2] / entered, albedos * once, rtol=0.05, atol=2e-3)
    np.testing.assert_allclose(found[3] / entered, [often[0], often[1], often[1]], rtol=0.06, atol=2e-3)


def test_channels_share_paths_whatever_their_coefficients(sphere):
    """Together as each alone, where one is clear and one opaque."""
    scattering, absorption = np.array([0.001, 0.1, 3.0]), np.array([0.0, 0.05, 3.0])
    together = mean(matter(sphere, scattering, absorption))
    for i in range(3):
        alone = mean(matter(sphere, scattering[i], absorption[i]), 6000, seed=1)
        np.testing.assert_allclose(together[:, i], alone.mean(axis=1), rtol=0.06, atol=4e-3)


def test_what_absorbs_and_does_not_bend_is_seen_through_by_its_thickness(sphere):
    n, kinds = 6000, 4
    kind = np.arange(n) % kinds
    places, directions = (rows[kind] for rows in down(kinds, 0.9 * RADIUS))
    lit = matter(sphere, 0.0, [0.01, 0.05, 0.0], eta=1.0)
    sums, _ = traced(lit, places, directions, kind, kinds, np.random.default_rng(0))
    chords = 2.0 * np.sqrt(RADIUS**2 - np.square(places[:kinds, :2]).sum(axis=1))
    expected = np.exp(-chords[:, None] * [0.01, 0.05, 0.0])
    np.testing.assert_allclose(kinds * sums[:, PARTS.index("unscattered")] / n, expected, rtol=0.08)
    assert not sums[:, [0, 2, 3]].any()


def test_light_that_leaves_may_enter_again():
    """Through two blocks, one behind the other: F_t of both."""
    blocks = mesh_of(block((20.0, 20.0, 2.0)), block((20.0, 20.0, 2.0), (0.0, 0.0, 6.0)))
    lamp = Beam((0.0, 0.0, -1.0), (1.0, 1.0, 1.0), angle_deg=20.0)
    n = 4000
    places, directions = np.tile([0.5, 0.3, 30.0], (n, 1)), np.tile([0.0, 0.0, -1.0], (n, 1))
    lit = matter(blocks, 0.0, 0.0, lights=(lamp,))
    sums, _ = traced(lit, places, directions, np.zeros(n, np.int64), 1, np.random.default_rng(0))
    reflectance = 1.0 - transmittance(ETA, 1.0)
    through = (1.0 - reflectance) / (1.0 + 3.0 * reflectance)  # of four faces, with all light in between
    radiance = 1.0 / (np.pi * np.sin(np.radians(10.0)) ** 2)
    np.testing.assert_allclose(sums[0, 1] / n, through * radiance, rtol=0.02)


def test_the_most_forward_scattering_counts_as_none(sphere):
    """Without bending, so that all sees white: light in which nothing counts has the extinction of the rest."""
    g, peak = np.array([0.0, 0.8, 0.8]), np.array([0.0, 0.0, 0.64])
    scattering = np.array([0.1, 0.1, 0.1])
    places, directions = (np.tile(row, (20_000, 1)) for row in ([0.1, 0.2, 30.0], [0.0, 0.0, -1.0]))
    lit = matter(sphere, scattering, 0.0, g, eta=1.0, peak=peak)
    sums, _ = traced(lit, places, directions, np.zeros(20_000, np.int64), 1, np.random.default_rng(0))
    found = sums[0] / 20_000
    np.testing.assert_allclose(found[1, :2], np.exp(-2.0), rtol=0.06)
    assert found[1, 2] > 1.5 * np.exp(-2.0)
    np.testing.assert_allclose(found.sum(axis=0), 1.0, rtol=0.03)


def test_directions_of_the_phase_function():
    random, g = np.random.default_rng(0).random(100_000), np.full(100_000, 0.8)
    assert henyey_greenstein(random, g).mean() == pytest.approx(0.8, abs=3e-3)
    assert henyey_greenstein(random, 0.0 * g).mean() == pytest.approx(0.0, abs=5e-3)
    cosines = (np.arange(20_000) + 0.5) / 10_000 - 1.0
    density = phase(cosines, np.float64(0.8))
    assert density.mean() == pytest.approx(1.0, rel=1e-3)
    assert (cosines * density).mean() == pytest.approx(0.8, rel=1e-3)


def test_lights_are_as_bright_from_all_around_as_their_irradiance():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    facing = 4.0 * np.pi * np.maximum(directions @ [0.0, 0.6, 0.8], 0.0)
    lamp = Beam((0.0, 3.0, 4.0), (1.0, 2.0, 0.5), angle_deg=60.0)
    np.testing.assert_allclose(
        (facing[:, None] * lamp.arriving(directions, directions)).mean(axis=0), lamp.irradiance, rtol=0.02
    )
    half = np.zeros((16, 32, 3), np.float32)
    half[:8, 16:] = 1.0  # up, and to +x: a quarter of the sphere
    above = Surroundings(half, np.eye(3), 2.0).arriving(
        towards := np.array([[0.6, 0.8, 0.0], [-0.6, 0.8, 0.0], [0.6, -0.8, 0.0]]), towards
    )
    np.testing.assert_array_equal(above[:, 0], [2.0, 0.0, 0.0])


def test_noise_is_that_of_rounds(sphere):
    lit = matter(sphere, 0.1, 0.02)

    def shots(rng):
        places, directions = down(400)
        return places, directions, rng.permutation(np.repeat(np.arange(4), 100))

    told = []
    found = group_radiance(lit, shots, 4, 8, seed=2, progress=told.append)
    value, error = found.of(("unscattered", "once", "often"))
    assert value.shape == error.shape == (4, 3)
    assert np.all((error > 0.0) & (error < 0.2 * value))
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert 1.9 < lit.collisions < 0.12 * ETA**2 * sphere.mean_chord


def test_near_lamps_are_as_bright_at_places_as_their_solid_angle_says():
    """Irradiance on what faces them: of a ball pi L (r / d)^2, of a panel by L cos cos / d^2 over its area."""
    towards = np.random.default_rng(1).normal(size=(400_000, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    towards[:, 2] = np.abs(towards[:, 2])
    place = np.tile([1.0, -2.0, 3.0], (len(towards), 1))
    lamps = (
        NearBall(np.array([1.0, -2.0, 23.0]), 6.0, np.array([1.0, 2.0, 0.5])),
        NearPanel(*np.array([[1.0, -2.0, 23.0], [5.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, -1.0]]), np.ones(3)),
    )
    x, y = np.meshgrid(*[(np.arange(100) + 0.5) / 50.0 - 1.0] * 2)
    panel = 160.0 * np.mean(20.0**2 / (400.0 + (5.0 * x) ** 2 + (8.0 * y) ** 2) ** 2)
    for lamp, expected in zip(lamps, (np.pi * 0.3**2 * lamps[0].radiance, panel * np.ones(3)), strict=True):
        found = 2.0 * np.pi * np.mean(towards[:, 2:] * lamp.arriving(towards, place), axis=0)
        np.testing.assert_allclose(found, expected, rtol=0.02)
        assert not lamp.arriving(-towards, place).any()
    assert not lamps[1].arriving(-towards, place + np.array([0.0, 0.0, 40.0])).any()  # its back
