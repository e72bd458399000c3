"""core.geometry.solids: volumes and areas of closed forms, and what lies in what."""

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.geometry.mesh import Mesh, flaws
from milkglass.core.geometry.solids import solids
from tests.support.solids import ball, block, hollow, mesh_of, scattered, sheet


def turned(part: trimesh.Trimesh) -> trimesh.Trimesh:
    part = part.copy()
    part.invert()
    return part


def of(*parts: trimesh.Trimesh, nested: str = "hollow"):
    found = solids(mesh_of(*parts), hollow=nested == "hollow")
    assert found is not None
    assert flaws(found.mesh).solid
    return found


@pytest.mark.parametrize(
    "mesh",
    [
        mesh_of(block((2, 3, 4))),
        hollow(ball(3.0), ball(2.0)),
        mesh_of(ball(3.0), turned(ball(2.0)), ball(1.0)),
        mesh_of(ball(), ball(at=(3, 0, 0)), sheet(0.0, 9.0)),
        scattered(20),
    ],
)
def test_what_bounds_its_matter_stays_as_it_is(mesh: Mesh) -> None:
    assert solids(mesh, hollow=True) is None
    assert solids(mesh, hollow=False) is None


# The second bar goes flush into the first, or not; is turned inside out, or not.
@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("depth", [10.0, 8.0])
def test_bars_that_cross_are_their_union(depth: float, inverted: bool) -> None:
    second = block((10, 40, depth))
    found = of(block((40, 10, 10)), turned(second) if inverted else second)
    assert found.joined == 2
    assert found.turned == inverted
    assert found.mesh.volume == pytest.approx(4000 + 30 * 10 * depth, rel=1e-5)
    across_z, ends, sides = 2 * (400 + 300), 2 * (100 + 10 * depth), 2 * (400 - 10 * depth) + 4 * 15 * depth
    assert found.mesh.area == pytest.approx(across_z + ends + sides)
    assert find_bodies(found.mesh).count == 1
    for axis, half in enumerate((20.0, 20.0, 5.0)):
        assert np.abs(found.mesh.vertices[:, axis]).max() == pytest.approx(half)


def test_pieces_know_their_place_in_the_faces_that_they_are_of() -> None:
    mesh = mesh_of(ball(2.0), turned(ball(2.0, (1.5, 0.3, 0.2))))
    found = solids(mesh, hollow=True)
    corners = np.einsum("ijk,ikl->ijl", found.weights, mesh.vertices[mesh.faces[found.face]].astype(float))
    np.testing.assert_allclose(corners, found.mesh.vertices[found.mesh.faces], atol=1e-5)
    # Normals of either ball, of a vertex in both spheres either.
    radial = (
        np.einsum("ij,ij->i", (found.mesh.vertices - centre) / 2.0, found.mesh.normals)
        for centre in (np.zeros(3), np.array([1.5, 0.3, 0.2]))
    )
    assert np.maximum(*radial).min() > 0.99


def test_each_part_in_no_other_looks_outwards() -> None:
    found = of(block((2, 2, 2)), turned(block((1, 2, 2), (4, 0, 0))))
    assert (found.turned, found.joined, found.nested, found.count) == (1, 0, 0, 2)
    assert found.mesh.volume == pytest.approx(8.0 + 4.0)
    np.testing.assert_array_equal(np.sort(found.face), np.arange(24))
    away = np.abs(found.mesh.vertices[:, 0] - 4.0) <= 0.5001
    centre = np.where(away[:, None], (4, 0, 0), 0.0)
    assert np.einsum("ij,ij->i", found.mesh.vertices - centre, found.mesh.normals).min() > 0.0


def test_a_hollow_solid_inside_out_keeps_its_cavity() -> None:
    found = of(turned(block((20, 20, 20))), block((10, 10, 10)))
    assert (found.turned, found.nested) == (2, 0)
    assert found.mesh.volume == pytest.approx(8000.0 - 1000.0)


@pytest.mark.parametrize(("nested", "volume"), [("hollow", 64.0 - 27.0 + 1.0), ("solid", 64.0)])
def test_parts_within_each_other_that_look_the_same_way_are_ambiguous(nested: str, volume: float) -> None:
    found = of(block((4, 4, 4)), block((3, 3, 3)), block((1, 1, 1)), nested=nested)
    assert found.mesh.volume == pytest.approx(volume)
    assert found.turned == 0
    assert found.nested == 1


def test_a_cavity_stays_in_a_solid_that_is_joined_with_another() -> None:
    found = of(block((20, 20, 20)), turned(block((4, 4, 4))), block((10, 10, 20), (0, 0, 12)))
    assert found.joined == 2
    assert found.mesh.volume == pytest.approx(8000.0 - 64.0 + 100.0 * 12.0)


def test_kinds_of_matter_may_lie_within_each_other() -> None:
    mesh = mesh_of(block((4, 4, 4)), block((2, 2, 2)), turned(block((1, 1, 1), (9, 0, 0))))
    kinds = np.repeat([0, 1, 1], 12)
    found = solids(Mesh(mesh.vertices, mesh.normals, mesh.faces, kinds=kinds), hollow=True)
    assert (found.turned, found.nested) == (1, 0)
    np.testing.assert_array_equal(found.mesh.kinds, kinds[found.face])
    assert found.mesh.volume == pytest.approx(64.0 + 8.0 + 1.0)
