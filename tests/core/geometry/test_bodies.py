from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from milkglass.core.geometry.bodies import bodies_at, bodies_of_kinds, find_bodies, touching_kinds
from milkglass.core.geometry.boxes import group_bounds, overlapping_boxes
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.rays import RayMesh
from milkglass.viewer.files.model import load_model
from tests.support.counting import calls, peak_bytes
from tests.support.shapes import torus_knot
from tests.support.solids import ball, block, mesh_of, rings, scattered, sheet


@pytest.mark.parametrize(
    ("parts", "count"),
    [
        ([ball()], 1),
        ([ball(), ball(at=(3, 0, 0))], 2),
        ([ball(), ball(at=(2.001, 0, 0))], 2),
        ([ball(), ball(at=(1.5, 0, 0))], 1),
        ([block((4, 1, 1)), block((1, 4, 0.9))], 1),  # no vertex of either in the other
        ([ball(), ball(0.5, inverted=True)], 1),
        ([ball(), ball(0.3)], 1),
        ([ball(), ball(0.5, inverted=True), ball(0.2)], 2),  # floats in the cavity
        ([ball(), ball(0.5, inverted=True), ball(0.1, (0.2, 0, 0)), ball(0.1, (-0.2, 0, 0))], 3),
        ([ball(), ball(0.6, inverted=True), ball(0.4), ball(0.3, inverted=True), ball(0.1)], 3),
        ([ball(), ball(0.5, inverted=True), ball(0.3, (0.4, 0, 0))], 1),  # grows out of the cavity's wall
        ([*rings()], 2),
        ([ball(at=(0, 0, 9)), sheet(0.0), sheet(1.0)], 2),
        ([ball(), sheet(0.0), sheet(5.0)], 1),  # a sheet through the ball, and all sheets are one body
        ([sheet(0.0), sheet(1.0)], 1),
        ([block((4, 1, 4)), block((1, 1, 1), (0, 1, 0))], 2),  # on a table
        ([block((4, 1, 4)), block((1, 1, 1), (0, 0.999, 0))], 1),  # sunk into it
        ([block((1, 1, 1)), block((1, 1, 1), (0, 1, 0))], 1),  # shares vertices
    ],
)
def test_bodies_of_parts(parts, count):
    mesh = mesh_of(*parts)
    bodies = find_bodies(mesh)
    assert bodies.count == count
    assert set(bodies.of_face) == set(range(count))
    # Each part lies in one body, whichever came first.
    ends = np.cumsum([0, *(len(part.faces) for part in parts)])
    for start, stop in pairwise(ends):
        assert len(set(bodies.of_face[start:stop])) == 1
    assert find_bodies(mesh_of(*parts[::-1])).count == count


def test_the_answer_does_not_depend_on_size_place_or_turn():
    rng = np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    mesh = mesh_of(ball(), ball(0.5, inverted=True), ball(0.2), *rings(1.0), block((9, 9, 1), (0, 0, -3)))
    for scale in (1e-3, 1.0, 1e5):
        moved = (mesh.vertices.astype(np.float64) @ turn + [3.0, -7.0, 2.0]) * scale
        turned = Mesh.of(moved, mesh.normals @ turn, mesh.faces)
        np.testing.assert_array_equal(find_bodies(turned).of_face, find_bodies(mesh).of_face)


def test_open_components_are_counted():
    bodies = find_bodies(mesh_of(ball(at=(0, 0, 9)), sheet(0.0), sheet(1.0)))
    assert (bodies.count, bodies.open_components) == (2, 2)
    assert find_bodies(mesh_of(ball())).open_components == 0


def test_vertices_and_parts_of_a_body():
    mesh = mesh_of(*rings())
    bodies = find_bodies(mesh)
    np.testing.assert_array_equal(bodies.of_vertex(mesh)[mesh.faces], np.tile(bodies.of_face[:, None], 3))
    parts = [bodies.submesh(mesh, body) for body in range(2)]
    assert sum(part.area for part in parts) == pytest.approx(mesh.area)
    np.testing.assert_array_equal(parts[0].bounds, mesh.bounds)


@pytest.mark.parametrize(("gap", "touch"), [(0.1, []), (0.0, [(0, 1)]), (-0.2, [(0, 1)])])
def test_bodies_of_several_kinds_of_matter_are_numbered_kind_by_kind_and_touch(gap, touch):
    """Three blocks, of which the middle one is of a second kind: beside the first, far from the third."""
    sides = (1.0, 1.0, 1.0)
    mesh = mesh_of(block(sides), block(sides, (1.0 + gap, 0.0, 0.0)), block(sides, (5.0, 0.0, 0.0)))
    mesh = replace(mesh, kinds=np.repeat([0, 1, 0], 12))
    bodies, ranges = bodies_of_kinds(mesh, joined=False)
    assert (bodies.count, ranges) == (3, (range(2), range(2, 3)))
    np.testing.assert_array_equal(bodies.of_face, np.repeat([0, 2, 1], 12))
    assert bodies_of_kinds(mesh, joined=True)[1] == (range(1), range(1, 2))
    assert touching_kinds(mesh) == touch


def test_a_body_in_the_cavity_of_another_kind_does_not_touch_it():
    shell, inner = mesh_of(ball(), ball(radius=0.8, inverted=True)), mesh_of(ball(radius=0.5))
    mesh = Mesh.of(
        np.concatenate([shell.vertices, inner.vertices]),
        np.concatenate([shell.normals, inner.normals]),
        np.concatenate([shell.faces, inner.faces + len(shell.vertices)]),
    )
    mesh = replace(mesh, kinds=np.repeat([0, 1], [len(shell.faces), len(inner.faces)]))
    assert touching_kinds(mesh) == []
    assert bodies_of_kinds(mesh, joined=False)[1] == (range(1), range(1, 2))


def test_points_of_the_surface_find_their_body_across_a_narrow_gap():
    mesh = mesh_of(block((20, 20, 2), (0, 0, -1.001)), block((20, 20, 2), (0, 0, 1.001)), *rings(3.0))
    bodies = find_bodies(mesh)
    rng = np.random.default_rng(0)
    face = rng.choice(len(mesh.faces), 400)
    points = np.einsum("ni,nij->nj", rng.dirichlet((1, 1, 1), 400), mesh.vertices[mesh.faces[face]].astype(np.float64))
    np.testing.assert_array_equal(bodies_at(mesh, bodies, points), bodies.of_face[face])


@pytest.mark.slow
def test_what_parts_apart_cost_grows_as_their_number():
    """Of balls whose boxes do not overlap no pair is looked at, and none has a loop of its own."""
    assert find_bodies(torus_knot()).count == 1
    few, many = scattered(60), scattered(1000)
    assert [find_bodies(balls).count for balls in (few, many)] == [60, 1000]
    assert calls(lambda: find_bodies(many)) < 1.1 * calls(lambda: find_bodies(few))
    held = [peak_bytes(lambda balls=balls: find_bodies(balls)) / len(balls.faces) for balls in (few, many)]
    assert held[1] < 1.1 * held[0]


@pytest.mark.slow
def test_thousands_of_overlapping_parts():
    """Measured: 1 s for 3000 balls of 80 faces thrown into a box, against pairs of centres nearer than they reach."""
    centres = np.random.default_rng(1).uniform(0.0, 30.0, (3000, 3))
    bodies = find_bodies(mesh_of(*(ball(0.5, at, 1) for at in centres)))
    near = np.linalg.norm(centres[:, None] - centres, axis=-1)
    for reach, beats in ((1.0, np.less_equal), (0.94, np.greater_equal)):  # ball; and within its polyhedron
        linked = near < reach
        label = np.arange(3000)
        while True:
            lower = np.where(linked, label, 3000).min(axis=1)
            if np.array_equal(lower, label):
                break
            label = lower
        assert beats(len(np.unique(label)), bodies.count)


def test_the_dragon(data_dir):
    mesh, _ = load_model(data_dir / "meshes" / "dragon_100k.ply", 100.0)
    assert find_bodies(mesh).count == 1


def test_overlapping_boxes_are_those_of_all_pairs(monkeypatch):
    rng = np.random.default_rng(0)
    low = rng.integers(0, 40, (300, 3))
    high = low + rng.integers(0, 9, (300, 3))
    both = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=2)
    expected = {(i, j) for i, j in zip(*np.nonzero(both), strict=True) if i < j}
    for at_a_time in (1 << 20, 7):
        monkeypatch.setattr("milkglass.core.geometry.boxes.PAIRS_AT_A_TIME", at_a_time)
        pairs = [tuple(sorted(pair)) for pair in zip(*overlapping_boxes(low, high), strict=True)]
        assert len(pairs) == len(set(pairs))
        assert set(pairs) == expected


def test_bounds_of_groups():
    rng = np.random.default_rng(0)
    points, group = rng.normal(size=(500, 3)), np.concatenate([np.arange(7), rng.integers(0, 7, 493)])
    low, high = group_bounds(points, group, 7)
    for i in range(7):
        np.testing.assert_array_equal(low[i], points[group == i].min(axis=0))
        np.testing.assert_array_equal(high[i], points[group == i].max(axis=0))


def test_rays_meet_every_face_on_their_way():
    mesh = mesh_of(block((1, 1, 1)), block((3, 3, 3)), block((5, 5, 5)))
    rays = RayMesh(mesh.vertices, mesh.faces)
    origins, directions = np.array([[0.1, 0.2, 9.0], [0.1, 0.2, 0.0]]), np.array([[0.0, 0.0, -1.0]] * 2)
    ray, face = rays.all_hits(origins, directions, 1e-4)
    assert [sorted(face[ray == i] // 12) for i in (0, 1)] == [[0, 0, 1, 1, 2, 2], [0, 1, 2]]
    ray, face = rays.all_hits(origins, 8.0 * directions, 1e-4, segments=True)
    assert [sorted(face[ray == i] // 12) for i in (0, 1)] == [[1, 2], [0, 1, 2]]
