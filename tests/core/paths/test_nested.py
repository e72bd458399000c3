"""Media within media: a liquid in its glass, by rays that know all that they are in."""

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import face_cross, face_normals
from milkglass.core.material.fresnel import index_of, internal_moment, reflectance
from milkglass.core.paths.beams import Emitted, traced
from milkglass.core.paths.events import NESTED_EVENTS, Chords, follow, most_events
from milkglass.core.paths.second import returns
from milkglass.core.paths.surface import ClearPart, Surface
from milkglass.core.paths.tree import Seen, Sight, Tree
from tests.core.paths.test_events import beam
from tests.core.paths.test_tree import sky
from tests.support import solids

LIQUID, GLASS, NONE = 1.33, 1.5, (0.0, 0.0, 0.0)


def ball(radius: float) -> trimesh.Trimesh:
    return solids.ball(radius, subdivisions=4)


def filled(liquid: float, eta: float = GLASS, absorption=NONE) -> Surface:
    """A ball of liquid of some radius in a shell of glass from 8 to 10 mm."""
    return Surface.of(
        solids.mesh_of(ball(liquid)), LIQUID, clear=[ClearPart(solids.hollow(ball(10.0), ball(8.0)), eta, absorption)]
    )


def seen_through(surface: Surface, extinction, around, radius: float, count: int = 2000) -> np.ndarray:
    """Return the radiance of rays along -z, over a disc, that meet the surface: (k, 3), and the rays' numbers."""
    rays = beam(count, radius)
    face, distance, u, v = surface.rays.places(rays.origins, rays.directions)
    met = np.flatnonzero(face >= 0)
    faces, weights = surface.faces, np.stack([1.0 - u - v, u, v], axis=1)[met]
    normals = np.einsum("ij,ijk->ik", weights, faces.normals[faces.corners[face[met]]])
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    points = rays.origins[met] + distance[met, None] * rays.directions[met]
    sight = Sight(points, normals, rays.directions[met], faces.bodies[face[met]])
    rows = np.array([extinction] * surface.scattering + [NONE] * (len(faces.etas) - surface.scattering))
    rows = (rows + surface.absorption).astype(np.float32)
    found: Seen = Tree(surface, rows, around, events=most_events(surface)).trace(sight)
    return np.asarray(found.mirror + found.unscattered + found.scattered)


def together(layers: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """What a stack of surfaces lets through: each its reflectance, and the share that what follows it leaves."""
    through, back = np.ones(3), np.zeros(3)  # back: reflectance of the stack so far as what comes after sees it
    for r, left in layers:
        gain = (1.0 - r) / (1.0 - r * back)
        through, back = through * gain * left, (r + (1.0 - r) ** 2 * back / (1.0 - r * back)) * left**2
    return through


@pytest.mark.parametrize(("overlap", "absorbs", "error"), [(0.1, 0.0, 0.006), (0.0, 0.0, 0.006), (0.1, 1.0, 0.016)])
def test_a_stack_of_plane_media_lets_through_what_fresnel_says(overlap, absorbs, error):
    """Air, glass, liquid, glass, air, with all reflections between them.

    Paths end in their weaker branch below a weight of 0.02, which goes on in the stronger: that is the error.
    """
    wall = solids.hollow(solids.block((40.0, 40.0, 10.0)), solids.block((36.0, 36.0, 6.0)))
    liquid = solids.mesh_of(solids.block((36.0 + overlap, 36.0 + overlap, 6.0 + overlap)))
    tint, murk = absorbs * np.array([0.0, 0.02, 0.1]), absorbs * np.array([0.0, 0.05, 0.01])
    surface = Surface.of(liquid, LIQUID, clear=[ClearPart(wall, GLASS, tuple(tint))])
    behind = sky(lambda d: np.where(d[..., 2] < 0.0, 1.0, 0.0))
    found = seen_through(surface, murk, behind, 2.0, 200)
    outer, inner = float(reflectance(GLASS, 1.0)), float(reflectance(GLASS / LIQUID, 1.0))
    glass, matter = np.exp(-2.0 * tint), np.exp(-6.0 * murk)
    expected = together([(outer, glass), (inner, matter), (inner, glass), (outer, np.ones(3))])
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=error)


@pytest.mark.parametrize("liquid", [8.1, 8.0, 7.8])
def test_a_filled_glass_in_a_white_furnace_is_not_to_be_seen(liquid):
    white = sky(lambda d: np.ones(d.shape[:-1]))
    np.testing.assert_allclose(seen_through(filled(liquid), NONE, white, 9.9), 1.0, atol=2e-3)


def test_surfaces_that_coincide_are_as_if_they_overlapped_and_not_as_with_air_between():
    around = sky(lambda d: 1.0 + 0.5 * d[..., 0] - 0.4 * d[..., 2])
    overlapping, touching, apart = (seen_through(filled(radius), NONE, around, 9.5) for radius in (8.1, 8.0, 7.9))
    np.testing.assert_allclose(touching, overlapping, atol=2e-3)
    assert np.abs(apart - overlapping).mean() > 0.01


def test_glass_of_the_index_of_its_liquid_is_one_with_it():
    around, murk = sky(lambda d: 1.0 + 0.5 * d[..., 0] - 0.4 * d[..., 2]), (0.01, 0.03, 0.06)
    whole = seen_through(Surface.of(solids.mesh_of(ball(10.0)), LIQUID), murk, around, 9.9)
    nested = seen_through(filled(8.05, LIQUID, murk), murk, around, 9.9)
    np.testing.assert_allclose(nested, whole, atol=0.01)
    assert np.abs(nested - whole).mean() < 1e-3


def test_glass_of_the_index_of_air_is_not_there():
    around, murk = sky(lambda d: 1.0 + 0.5 * d[..., 0] - 0.4 * d[..., 2]), (0.01, 0.03, 0.06)
    liquid = solids.mesh_of(ball(7.8))
    shell = ClearPart(solids.hollow(ball(10.0), ball(8.0)), 1.0, NONE)
    # Of an index whose mirror is kept, be it the first on the path or not.
    alone = seen_through(Surface.of(liquid, 1.8), murk, around, 7.7)
    nested = seen_through(Surface.of(liquid, 1.8, clear=[shell]), murk, around, 7.7)
    error = np.abs(nested - alone)
    assert np.quantile(error, 0.995) < 1e-3  # but for paths that meet another face beside an edge
    assert error.mean() < 1e-4


@pytest.mark.parametrize(
    ("liquid", "wall"), [(solids.hollow(ball(10.0), ball(8.0)), 2.0), (solids.mesh_of(ball(10.0)), 5.0)]
)
def test_glass_floats_in_a_cavity_of_matter_and_lies_in_matter(liquid, wall):
    surface = Surface.of(liquid, LIQUID, clear=[ClearPart(solids.mesh_of(ball(5.0)), GLASS, NONE)])
    events = follow(surface, beam(50, 0.1), np.zeros((2, 3), np.float32), events=NESTED_EVENTS)
    straight = [chords for event in events if (chords := heavy(event.chords)).lengths.size]
    assert [set(chords.bodies.tolist()) for chords in straight] == [{0}, {1}, {0}]
    np.testing.assert_allclose([chords.lengths.mean() for chords in straight], [wall, 10.0, wall], atol=0.05)


def heavy(chords: Chords) -> Chords:
    """Those of rays that nothing has mirrored yet."""
    return Chords(*(column[chords.weights[:, 0] > 0.7] for column in chords))


@pytest.mark.parametrize("liquid", [8.1, 7.999])
def test_glass_sends_back_what_its_outer_surface_does(liquid):
    """Alone a liquid sends back R1, and so it does in glass so thin that nothing goes astray in it."""
    alone, expected = solids.mesh_of(ball(liquid)), internal_moment(LIQUID, 1)
    corners = alone.vertices[alone.faces].astype(np.float64)
    cross = face_cross(alone.vertices, alone.faces)
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    places = corners.mean(axis=1), face_normals(alone.vertices, alone.faces), areas
    surface = Surface.of(alone, LIQUID)
    shares = [returns(*places, surface, 1e-3, around).reflected() for around in (surface, thin(liquid), filled(liquid))]
    assert shares[0] == pytest.approx(expected, abs=0.01)
    assert shares[1] == pytest.approx(expected, abs=0.02)
    assert shares[2] < 0.8 * expected
    assert index_of(expected) == pytest.approx(LIQUID, abs=1e-3)


def thin(liquid: float) -> Surface:
    """A ball of liquid in glass of a hundredth of its radius."""
    wall = solids.hollow(ball(1.01 * liquid), ball(0.999 * liquid))
    return Surface.of(solids.mesh_of(ball(liquid)), LIQUID, clear=[ClearPart(wall, GLASS, NONE)])


def test_beams_reach_a_liquid_through_its_glass():
    """Along the axis: by the transmittance of both surfaces of the wall and what it absorbs."""
    tint = np.array([0.0, 0.1, 0.5])
    surface = filled(8.1, GLASS, tuple(tint))
    rays = beam(500, 0.2)
    found = traced(surface, Emitted(rays.origins, rays.directions, np.ones((500, 3), np.float32)))
    assert (found.bodies == 0).all()
    first = (found.before[:, 0] == 0.0) & (found.power[:, 0] > 0.5)
    expected = (1.0 - reflectance(GLASS, 1.0)) * (1.0 - reflectance(GLASS / LIQUID, 1.0)) * np.exp(-2.0 * tint)
    assert first.sum() == 500
    np.testing.assert_allclose(found.power[first], np.broadcast_to(expected, (500, 3)), rtol=0.01)
    np.testing.assert_allclose(found.lengths[first], 16.0, rtol=0.01)


def test_ways_are_known_in_each_kind_of_matter_and_bodies_keep_their_own():
    """Two balls of two kinds in a row, of the index of air, and a beam along both: one is lit through the other."""
    pair = solids.mesh_of(ball(4.0).apply_translation([0, 0, 6.0]), ball(5.0).apply_translation([0, 0, -6.0]))
    bodies = (pair.vertices[pair.faces].mean(axis=1)[:, 2] < 0.0).astype(np.int32)
    surface = Surface.of(pair, [1.0, 1.0], bodies, matter=[0, 1])
    rays = beam(50, 0.1)
    found = traced(surface, Emitted(rays.origins, rays.directions, np.ones((50, 3), np.float32)))
    first, second = found.of_body(0), found.of_body(1)
    np.testing.assert_allclose(first.before, 0.0)
    np.testing.assert_allclose(second.before, np.broadcast_to([8.0, 0.0], (50, 2)), rtol=0.01)
    extinctions = np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 3.0]], np.float32)
    dimmed = second.in_matter(1, extinctions)
    np.testing.assert_allclose(dimmed.power, np.exp(-8.0 * extinctions[0]) * second.power, rtol=0.01)
    assert dimmed.before.shape == (50, 1)
    assert not dimmed.before.any()


def test_where_two_kinds_overlap_the_smaller_one_is_there():
    pair = solids.mesh_of(ball(6.0), ball(4.0).apply_translation([0, 0, -6.0]))
    bodies = np.repeat(np.array([0, 1], np.int32), len(ball(6.0).faces))
    surface = Surface.of(pair, [LIQUID, GLASS], bodies, matter=[0, 1])
    chords = [heavy(event.chords) for event in follow(surface, beam(50, 0.1), np.zeros((2, 3), np.float32))]
    crossed = [(set(part.bodies.tolist()), float(part.lengths.sum() / 50.0)) for part in chords if part.lengths.size]
    assert [bodies for bodies, _ in crossed] == [{0}, {1}]
    np.testing.assert_allclose([length for _, length in crossed], [8.0, 8.0], rtol=0.01)
