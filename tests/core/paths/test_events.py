import numpy as np
import pytest
import trimesh

from milkglass.core.material.fresnel import reflectance, transmittance
from milkglass.core.paths.events import EVENTS, MOST_EVENTS, Rays, follow
from milkglass.core.paths.surface import Surface
from tests.support import solids

ETA, EXTINCTION = 1.33, np.array([[0.02, 0.1, 0.4]], np.float32)


def beam(count: int, radius: float, channels: int = 3) -> Rays:
    """Rays along -z, at random over a disc."""
    rng = np.random.default_rng(0)
    at = radius * np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
    origins = np.column_stack([at[0] * np.cos(at[1]), at[0] * np.sin(at[1]), np.full(count, 50.0)])
    return Rays.beginning(
        origins.astype(np.float32),
        np.tile(np.array([0, 0, -1], np.float32), (count, 1)),
        np.ones((count, channels), np.float32),
        np.arange(count, dtype=np.int32),
    )


def sums(rays: Rays, count: int) -> np.ndarray:
    return np.stack([np.bincount(rays.sources, column, count) for column in rays.weights.T], axis=1)


@pytest.fixture(scope="module")
def sphere() -> Surface:
    return Surface.of(solids.mesh_of(solids.ball(10.0, subdivisions=5)), ETA)


@pytest.mark.parametrize("part", [solids.ball(10.0, subdivisions=4), trimesh.creation.torus(8.0, 3.0, 64, 32)])
def test_no_energy_is_lost_without_absorption(part):
    surface, rays = Surface.of(solids.mesh_of(part), ETA), beam(3000, 12.0)
    left = sum(sums(event.escaped, 3000) for event in follow(surface, rays, 0.0 * EXTINCTION))
    np.testing.assert_allclose(left, 1.0, atol=2e-5)


def test_paths_through_a_sphere_are_those_of_descartes(sphere):
    """Chords of 2 R cos(theta_t), and a turn of 2 (theta_i - theta_t) after two refractions."""
    rays = beam(2000, 9.5)
    first, second, third = list(follow(sphere, rays, EXTINCTION))[:3]
    sine = np.hypot(rays.origins[:, 0], rays.origins[:, 1]) / 10.0
    inner = np.arcsin(sine / ETA)
    assert len(first.chords.lengths) == 0
    np.testing.assert_allclose(first.mirrored, 1.0 - transmittance(ETA, np.cos(np.arcsin(sine))), atol=2e-3)
    np.testing.assert_allclose(second.chords.lengths, 20.0 * np.cos(inner)[second.chords.sources], rtol=3e-3)
    absorbed = second.meetings.weights / second.chords.weights
    expected = np.exp(-second.chords.lengths[:, None] * EXTINCTION)
    np.testing.assert_allclose(absorbed, expected, rtol=1e-5)
    through = third.escaped
    turned = np.arccos(np.clip(-through.directions[:, 2], -1.0, 1.0))
    np.testing.assert_allclose(turned, 2.0 * (np.arcsin(sine) - inner)[through.sources], atol=0.03)


def test_paths_that_are_mirrored_inside_again_and_again_go_on_as_a_geometric_series():
    """Of a beam through the middle R + T^2 a / (1 - R a) leaves, a what a diameter lets through.

    Ended after twelve meetings, 6 and 10 % more leaves: a third of what enters is left then, and absorbed no further.
    """
    surface = Surface.of(solids.mesh_of(solids.ball(10.0, subdivisions=4)), 40.0)
    absorbed, count = np.array([[0.0, 1e-3, 2.5e-3]], np.float32), 4000
    events = list(follow(surface, beam(count, 0.05), absorbed, least=0.0, most=MOST_EVENTS))
    assert max(len(event.meetings.points) for event in events[EVENTS:]) <= 1.01 * count
    left = sum(sums(event.escaped, count) for event in events).mean(axis=0)
    r, a = float(reflectance(40.0, 1.0)), np.exp(-20.0 * absorbed[0])
    np.testing.assert_allclose(left - r, (1.0 - r) ** 2 * a / (1.0 - r * a), rtol=0.005)


def test_weights_follow_from_chords_and_their_parents():
    """What a slider of the material needs: absorption of a whole path by the lengths of its chords alone."""
    surface = Surface.of(solids.mesh_of(solids.ball(10.0, subdivisions=4)), 2.0)  # its inner mirrors are all kept
    plain, absorbing = (list(follow(surface, beam(500, 6.0), factor * EXTINCTION))[:3] for factor in (0.0, 0.01))
    lengths, parents, before = (
        np.concatenate([getattr(event.chords, name) for event in plain]) for name in ("lengths", "parents", "weights")
    )
    crossed = np.zeros(len(lengths))
    for i in np.flatnonzero(parents >= 0):
        assert parents[i] < i
        crossed[i] = crossed[parents[i]] + lengths[parents[i]]
    assert (crossed > 15.0).any()
    found = np.concatenate([event.chords.weights for event in absorbing])
    np.testing.assert_allclose(found, before * np.exp(-0.01 * crossed[:, None] * EXTINCTION), rtol=1e-4)


def test_what_leaves_a_concave_object_enters_it_again():
    near, far = solids.ball(5.0, (0.0, 0.0, 8.0), 4), solids.ball(5.0, (0.0, 0.0, -8.0), 4)
    mesh = solids.mesh_of(near, far)
    bodies = np.repeat(np.arange(2, dtype=np.int32), len(mesh.faces) // 2)
    surface = Surface.of(mesh, [1.0, 1.0], bodies)
    events = list(follow(surface, beam(100, 0.1), np.array([[0.1] * 3, [0.2] * 3], np.float32)))
    assert [event.chords.bodies.tolist() for event in events[:4]] == [[], [0] * 100, [], [1] * 100]
    left = sum(sums(event.escaped, 100) for event in events)
    np.testing.assert_allclose(left, np.exp(-0.1 * 10.0 - 0.2 * 10.0), rtol=0.02)


def test_matter_of_the_index_of_air_is_not_there():
    surface, rays = Surface.of(solids.mesh_of(trimesh.creation.torus(8.0, 3.0, 64, 32)), 1.0), beam(500, 12.0, 1)
    escaped = [event.escaped for event in follow(surface, rays, np.zeros((1, 1), np.float32))]
    heavy = [rays.weights[:, 0] > 1e-6 for rays in escaped]
    straight = np.concatenate([rays.directions[chosen] for rays, chosen in zip(escaped, heavy, strict=True)])
    np.testing.assert_allclose(straight[:, 2], -1.0, atol=1e-5)
