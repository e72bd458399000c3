"""Light that forward peaks turn: what of it stays, how wide it is, and what is seen by it."""

import numpy as np
import pytest

from milkglass.core.light.maps import latlong_to_direction
from milkglass.core.light.probe import Probe
from milkglass.core.material.medium import Medium
from milkglass.core.paths.events import Rays, follow
from milkglass.core.paths.lamps import BALL, DISC, PANEL, Lamp
from milkglass.core.paths.lobes import peak_cosine
from milkglass.core.paths.peaks import Peaks, turned
from milkglass.core.paths.surface import Surface
from milkglass.core.paths.surroundings import Surroundings
from milkglass.core.paths.tree import Sight, Tree
from milkglass.core.reference.phase import henyey_greenstein
from tests.support import solids

FLIGHTS = [Medium(sigma_s_prime, 0.0, 1.33, g=0.93).delta_eddington() for sigma_s_prime in (0.002, 0.003, 0.004)]
WHITE = np.ones((2, 4, 3), np.float32)


def ball(eta: float = 1.33, radius: float = 30.0) -> Surface:
    return Surface.of(solids.mesh_of(solids.ball(radius, subdivisions=5)), eta)


def across(surface: Surface, offsets: np.ndarray) -> Sight:
    """Rays along -z that meet a ball of 30 mm at distances from its axis."""
    heights = np.sqrt(30.0**2 - offsets**2)
    points = np.stack([offsets, np.zeros_like(offsets), heights], axis=1)
    directions = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (len(offsets), 1))
    bodies = np.zeros(len(offsets), np.int32)
    return Sight(points.astype(np.float32), (points / 30.0).astype(np.float32), directions, bodies)


def extinction(flights=FLIGHTS) -> np.ndarray:
    return np.array([[flight.sigma_t for flight in flights]], np.float32)


@pytest.mark.parametrize("g", [0.3, 0.8, 0.93])
def test_peak_and_rest_are_the_phase_function(g):
    """Of what Henyey and Greenstein scatter, what rises above a level has the peak's share, and its mean cosine."""
    cosines = henyey_greenstein((np.arange(200_000) + 0.5) / 200_000, g)
    density = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosines) ** 1.5
    low, high = 0.0, float(density.max())
    for _ in range(60):
        level = 0.5 * (low + high)
        low, high = (level, high) if np.maximum(1.0 - level / density, 0.0).mean() > g * g else (low, level)
    above = np.maximum(1.0 - level / density, 0.0)
    assert peak_cosine(g) == pytest.approx((above @ cosines) / above.sum(), abs=1e-3)


def test_after_a_way_light_has_the_straight_share_and_the_mean_cosine_of_its_turns():
    """In one step as in many: e^(-s_f l), e^(-s_f (1 - p) l), and the moments of turns all along."""
    peaks = Peaks.of([FLIGHTS], ball())
    weights, s_f = np.array([0.0, 1.0, 0.0], np.float32), FLIGHTS[1].peak
    fall, length = s_f * (1.0 - peak_cosine(FLIGHTS[1].g)), 40.0
    for steps in (1, 8):
        straight, lobe = np.float32(1.0), np.zeros(3, np.float32)
        for _ in range(steps):
            straight = turned(peaks, 0, weights, length / steps, straight, lobe)
        assert straight == pytest.approx(np.exp(-s_f * length), rel=1e-5)
        expected = fall * length * np.array([1.0, length / 2.0, length**2 / 3.0])
        np.testing.assert_allclose((1.0 - straight) * lobe, expected, rtol=1e-4)
        mean = straight + (1.0 - straight) * np.exp(-lobe[0])
        assert mean == pytest.approx(np.exp(-fall * length), abs=2e-3)


def test_turns_drawn_one_by_one_have_these_moments():
    """By Henyey and Greenstein's phase function without a split, small angles: those above the level of its peak."""
    g, length, count, rng = 0.98, 10.0, 300_000, np.random.default_rng(0)
    flight = Medium(0.002, 0.0, 1.0, g=g).delta_eddington()
    lobe, peaks = np.zeros(3, np.float32), Peaks.of([[flight] * 3], ball())
    straight = turned(peaks, 0, np.ones(3, np.float32), length, np.float32(1.0), lobe)
    drawn = henyey_greenstein(rng.random(400_000), g)
    density = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * drawn) ** 1.5
    level = np.quantile(density, 0.5)
    for _ in range(100):  # level / density is the chance that what is drawn is the rest's
        level *= (np.minimum(level / density, 1.0).mean() / (1.0 - g * g)) ** -1.0
    peak = drawn[rng.random(len(drawn)) > level / density]
    turns = rng.poisson(flight.peak * length, count)
    owner = np.repeat(np.arange(count), turns)
    angle = np.arccos(rng.choice(peak, len(owner))) * np.cos(2.0 * np.pi * rng.random(len(owner)))
    left = length * rng.random(len(owner))
    angles, places = np.bincount(owner, angle, count), np.bincount(owner, angle * left, count)
    assert (turns == 0).mean() == pytest.approx(straight, abs=0.01)
    found = [np.mean(angles**2), np.mean(angles * places), np.mean(places**2)]
    np.testing.assert_allclose((1.0 - straight) * lobe, found, rtol=0.06)


def test_matter_with_a_forward_peak_in_a_white_furnace_is_as_bright_as_without():
    surface, offsets = ball(), np.linspace(0.0, 29.5, 200)
    tree = Tree(surface, np.zeros((1, 3), np.float32), Surroundings.of(WHITE), peaks=Peaks.of([FLIGHTS], surface))
    seen = tree.trace(across(surface, offsets))
    np.testing.assert_allclose(seen.mirror + seen.unscattered, 1.0, atol=1e-3)


def test_pictures_without_a_peak_are_the_same_bit_for_bit_and_with_one_whatever_is_followed_beside():
    surface, offsets = ball(), np.linspace(0.0, 29.0, 300)
    even = [Medium(0.003, 0.001, 1.33).delta_eddington()] * 3
    y = latlong_to_direction(np.stack(np.meshgrid(np.arange(64) / 64, np.arange(32) / 32), axis=-1))[..., 1:2]
    around = Surroundings.of(np.repeat(1.0 + y**2, 3, axis=-1).astype(np.float32))
    plain = Tree(surface, extinction(even), around).trace(across(surface, offsets))
    without = Tree(surface, extinction(even), around, peaks=Peaks.of([even], surface)).trace(across(surface, offsets))
    assert all((a == b).all() for a, b in zip(plain, without, strict=True))
    tree = Tree(surface, extinction(), around, peaks=Peaks.of([FLIGHTS], surface))
    whole, part = tree.trace(across(surface, offsets)), tree.trace(across(surface, offsets[100:150]))
    assert not (whole.unscattered == plain.unscattered).all()
    assert all((a[100:150] == b).all() for a, b in zip(whole, part, strict=True))


def test_light_that_would_be_reflected_totally_for_ever_leaves_a_ball():
    """Of a ray from within, some degrees beyond the critical angle, none ever leaves unless it turns."""
    surface = ball()
    start = np.array([[23.5, 0.0, 0.0]], np.float32)
    rays = Rays.beginning(start, np.array([[0.0, 0.0, 1.0]], np.float32), np.ones((1, 3), np.float32), np.zeros(1, int))
    rays.within[:] = 1 << surface.faces.media[0]
    none = np.zeros((1, 3), np.float32)
    kept = [event.mirrored[0] for event in follow(surface, rays, none, most=3)]
    turns = [event.mirrored[0] for event in follow(surface, rays, none, most=3, peaks=Peaks.of([FLIGHTS], surface))]
    assert kept[:2] == [1.0, 1.0]
    assert 0.5 < turns[0] < 0.95


LAMPS = [
    Lamp(DISC, (0.0, 0.0, -1.0), (2.0, 1.0, 0.5), float(np.cos(0.01))),
    Lamp(DISC, (0.0, 0.0, -1.0), (2.0, 1.0, 0.5), float(np.cos(0.3))),
    Lamp(BALL, (0.0, 0.0, -100.0), (2.0, 1.0, 0.5), 10.0),
    Lamp(PANEL, (0.0, 0.0, -100.0), (2.0, 1.0, 0.5), 0.0, (5.0, 0.0, 0.0), (0.0, 8.0, 0.0), (0.0, 0.0, 1.0)),
]


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("width", [0.02, 0.1, 0.4])
def test_lamps_send_as_much_by_lobes_as_without(lamp, width):
    count = 200_000
    cosine, turn = 1.0 - 2.0 * (np.arange(count) + 0.5) / count, np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    sine = np.sqrt(1.0 - cosine**2)
    directions = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), -cosine]).astype(np.float32)
    rays = Rays.beginning(
        np.zeros_like(directions), directions, np.ones((count, 3), np.float32), np.zeros(count, np.int32)
    )
    rays.straight[:], rays.lobes[:, 0] = 0.0, width**2
    Surroundings.of(lamps=[lamp]).add(rays, radiance := np.zeros((1, 3)), 0)
    solid_angle = {
        DISC: 2.0 * np.pi * (1.0 - lamp.size), BALL: 2.0 * np.pi * (1.0 - np.sqrt(0.99)), PANEL: 160.0 / 1e4
    }[lamp.shape]  # fmt: skip
    np.testing.assert_allclose(radiance[0] * 4.0 * np.pi / count, solid_angle * np.array(lamp.radiance), rtol=0.02)


@pytest.mark.parametrize("width", [0.03, 0.08, 0.2, 0.5])
def test_surroundings_are_seen_by_lobes_as_heat_spreads_on_the_sphere(width):
    """A first harmonic falls by e^-v; between the widths of the maps v is that of neither, but near to it."""
    u, v = (np.arange(128) + 0.5) / 128, (np.arange(64) + 0.5) / 64
    y = latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))[..., 1:2]
    probe = Probe.from_pixels(np.repeat(2.0 + y, 3, axis=-1).astype(np.float32))
    directions = np.array([[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, -1.0, 0.0]], np.float32)
    rays = Rays.beginning(np.zeros((3, 3), np.float32), directions, np.ones((3, 3), np.float32), np.arange(3))
    rays.straight[:], rays.lobes[:, 0] = 0.25, width**2
    Surroundings.of(probe.latlong, sh=probe.sh).add(rays, seen := np.zeros((3, 3), np.float32), 0)
    expected = 2.0 + (0.25 + 0.75 * np.exp(-(width**2))) * directions[:, 1:2]
    np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), atol=0.01)
