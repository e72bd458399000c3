"""Refined meshes: the same surface, no cracks, and every point of it found again."""

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import MAX_FACES, refined
from milkglass.core.geometry.samples import surface_samples
from tests.support.shapes import ball, cube
from tests.support.solids import block, mesh_of

SHAPES = {
    "cube": cube,
    "coarse ball": lambda: ball(subdivisions=1),
    "long block": lambda: mesh_of(block((30.0, 1.0, 3.0))),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_surface_stays_and_does_not_crack(name):
    mesh = SHAPES[name]()
    fine = refined(mesh, 1.7)
    sides = fine.mesh.vertices[fine.mesh.faces] - np.roll(fine.mesh.vertices[fine.mesh.faces], 1, axis=1)
    assert np.linalg.norm(sides, axis=2).max() <= 1.7 * (1.0 + 1e-6)
    assert fine.mesh.area == pytest.approx(mesh.area, rel=1e-6)
    assert fine.mesh.volume == pytest.approx(mesh.volume, rel=1e-5)
    # Every edge has two faces, by position: there is no vertex on the middle of another face's edge.
    _, welded = np.unique(fine.mesh.vertices, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[fine.mesh.faces]
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


@pytest.mark.parametrize("name", SHAPES)
def test_samples_find_their_place(name):
    mesh = SHAPES[name]()
    fine, samples = refined(mesh, 1.7), surface_samples(mesh, 0.6)
    corners, weights = fine.locate(samples.points, samples.faces)
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)
    there = np.einsum("nk,nkc->nc", weights, fine.mesh.vertices[corners])
    np.testing.assert_allclose(there, samples.points, atol=1e-4)
    # Normals run as they do over the original faces, too: pictures stay the same.
    normals = np.einsum("nk,nkc->nc", weights, fine.mesh.normals[corners])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, samples.normals, atol=1e-4)


def test_a_fine_mesh_is_left_alone():
    mesh = ball()
    fine = refined(mesh, 100.0)
    assert fine.mesh is mesh
    assert np.array_equal(fine.sources, np.arange(len(mesh.vertices)))


def test_new_vertices_know_their_part():
    mesh = mesh_of(block((4.0, 4.0, 4.0)), block((4.0, 4.0, 4.0), (9.0, 0.0, 0.0)))
    fine = refined(mesh, 0.5)
    part = mesh.vertices[fine.sources][:, 0] > 4.5
    assert np.array_equal(part, fine.mesh.vertices[:, 0] > 4.5)


def test_a_wanted_edge_that_no_memory_holds_is_widened():
    fine = refined(cube(), 1e-3)
    assert len(fine.mesh.faces) < 4 * MAX_FACES


def test_a_face_without_area_is_no_trouble():
    mesh = Mesh.of([[0, 0, 0], [4, 0, 0], [8, 0, 0]], [[0, 0, 1]] * 3, [[0, 1, 2]])
    corners, weights = refined(mesh, 1.0).locate(np.array([[2.0, 0.0, 0.0]]), np.array([0], np.int32))
    assert np.isfinite(weights).all()
    assert corners.shape == (1, 3)
