"""Patches of samples: nothing is lost, sides stay apart, slivers do no harm; and the slopes of their weights."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.grid.layers import fit_box, tsc_gradient_matrix, tsc_matrix
from milkglass.core.transport.diffusion.patches import make_patches
from tests.support.shapes import ball, cube, torus_knot
from tests.support.solids import block, mesh_of


def patched(mesh: Mesh, spacing: float, finer: float = 3.0):
    samples = surface_samples(mesh, spacing / finer)
    return samples, make_patches(mesh, samples, spacing)


@pytest.mark.parametrize("mesh", [ball(), cube(), torus_knot(n_along=120, n_around=16)], ids=["ball", "cube", "knot"])
@pytest.mark.parametrize("spacing", [0.6, 2.0])
def test_nothing_is_lost(mesh, spacing):
    samples, patches = patched(mesh, spacing)
    assert len(patches) < 0.6 * len(samples)
    assert patches.areas.sum() == pytest.approx(mesh.area, rel=1e-5)
    np.testing.assert_allclose(patches.vector_areas.sum(axis=0), 0.0, atol=1e-5 * mesh.area)
    # Divergence theorem: the vector areas enclose what the mesh does.
    first_moment = np.einsum("ij,ij->", samples.points.astype(float), vector_areas(mesh, samples)) / 3.0
    assert first_moment == pytest.approx(mesh.volume, rel=1e-5)
    flux = np.random.default_rng(0).uniform(size=(len(samples), 3)).astype(np.float32)
    np.testing.assert_allclose((patches.sums @ flux).sum(axis=0), flux.sum(axis=0, dtype=float), rtol=1e-5)
    np.testing.assert_array_equal(patches.sums.sum(axis=0), 1.0)


def vector_areas(mesh, samples):
    cross = face_cross(mesh.vertices, mesh.faces)[samples.faces]
    return samples.areas[:, None] * cross / np.linalg.norm(cross, axis=1, keepdims=True)


@pytest.mark.slow
def test_sums_of_each_patch():
    mesh = torus_knot(n_along=120, n_around=16)
    samples, patches = patched(mesh, 1.0)
    sums = patches.sums.toarray().astype(bool)
    for i in range(0, len(patches), 37):
        of = samples.areas[sums[i]].astype(float)
        assert patches.areas[i] == pytest.approx(of.sum(), rel=1e-6)
        np.testing.assert_allclose(patches.points[i], np.average(samples.points[sums[i]], 0, of), rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(
            patches.vector_areas[i], vector_areas(mesh, samples)[sums[i]].sum(axis=0), rtol=1e-5, atol=1e-6
        )


def test_each_has_its_cell_and_one_of_its_samples():
    mesh = torus_knot(n_along=120, n_around=16)
    samples, patches = patched(mesh, 1.0)
    of = patches.sums.tocsc().indices  # each sample is of one patch
    off = np.abs(samples.points - patches.points[of]).max(axis=1)
    assert off.max() <= 1.0 + 1e-4  # in a cell of this side both of them
    on = {tuple(p) for p in samples.points.tolist()}
    assert all(tuple(np.float32(p).tolist()) in on for p in patches.on_surface)
    np.testing.assert_allclose(np.linalg.norm(patches.normals, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(patches.face_normals, axis=1), 1.0, atol=1e-6)
    assert (np.einsum("ij,ij->i", patches.normals, patches.face_normals) > 0.5).all()


@pytest.mark.parametrize("turn", range(5))
@pytest.mark.parametrize("thickness", [1e-3, 0.05, 0.4])
def test_sides_of_a_sheet_stay_apart(turn, thickness):
    plate = block((20.0, 20.0, thickness))
    if turn:
        plate.apply_transform(
            trimesh.transformations.random_rotation_matrix(np.random.default_rng(turn).uniform(size=3))
        )
    samples, patches = patched(mesh_of(plate), 1.0)
    axis = np.linalg.eigh(np.cov(samples.points.T.astype(float)))[1][:, 0]
    side = np.sign(vector_areas(mesh_of(plate), samples) @ axis) * (np.abs(samples.normals @ axis) > 0.9)
    of = patches.sums.tocsc().indices
    most, least = np.full(len(patches), -2.0), np.full(len(patches), 2.0)
    np.maximum.at(most, of, side)
    np.minimum.at(least, of, side)
    assert not ((most > 0) & (least < 0)).any()
    # And so neither's vector area is lost to the other.
    faces = np.abs(patches.normals @ axis) > 0.99
    np.testing.assert_allclose(
        np.linalg.norm(patches.vector_areas[faces], axis=1), patches.areas[faces], atol=2.0 * thickness
    )


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.25, 0.0, 0.0), (0.25, 0.25, 0.0), (0.5, 0.0, 0.25)])
def test_faces_of_a_box_stay_apart(angles):
    """Along the world's axes, or turned by parts of pi: three faces of a box would share an octant of those axes."""
    box = block((9.0, 9.0, 9.0))
    box.apply_transform(trimesh.transformations.euler_matrix(*(np.pi * np.array(angles))))
    _, patches = patched(mesh_of(box), 1.0)
    np.testing.assert_allclose(np.linalg.norm(patches.vector_areas, axis=1), patches.areas, rtol=1e-4)


def test_slivers_and_faces_of_no_area():
    good = ball(subdivisions=3)
    n = len(good.vertices)
    vertices = np.concatenate([good.vertices, [[30.0, 0.0, 0.0], [31.0, 0.0, 0.0], [32.0, 0.0, 0.0], [30.0, 9.0, 0.0]]])
    normals = np.concatenate([good.normals, np.zeros((4, 3))])
    faces = np.concatenate([good.faces, [[n, n + 1, n + 2], [n, n, n + 1], [n + 3, n + 3, n + 3], [5, 5, 9]]])
    _, patches = patched(Mesh.of(vertices, normals, faces), 2.0)
    for values in (patches.points, patches.on_surface, patches.normals, patches.face_normals, patches.vector_areas):
        assert np.isfinite(values).all()
    assert patches.areas.sum() == pytest.approx(good.area, rel=1e-5)
    sliver = patches.areas == 0.0
    assert sliver.any()
    low, high = vertices.min(axis=0) - 1e-3, vertices.max(axis=0) + 1e-3
    assert ((patches.points >= low) & (patches.points <= high)).all()


def test_samples_with_opposing_normals():
    """Shading normals that cancel: the face's own is taken."""
    mesh = block((1.0, 1.0, 1.0))
    samples = surface_samples(mesh_of(mesh), 0.1)
    flipped = samples.normals.copy()
    flipped[::2] *= -1.0
    noisy = SurfaceSamples(samples.points, np.zeros_like(flipped), samples.areas, samples.faces)
    for each in (noisy, replace(samples, normals=flipped)):
        patches = make_patches(mesh_of(mesh), each, 0.5)
        assert np.isfinite(patches.normals).all()
        np.testing.assert_allclose(np.linalg.norm(patches.normals, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("n_layers", [None, 7])
def test_slopes_are_those_of_the_weights(n_layers):
    """Central differences of `tsc_matrix` over places away from the joints of the spline."""
    rng = np.random.default_rng(0)
    grid = fit_box([[-1.0, -2.0, -3.0], [3.0, 2.0, 1.0]], 0.4, n_layers)
    points = rng.uniform([-1.0, -2.0, -3.0], [3.0, 2.0, 1.0], (300, 3))
    vectors = rng.normal(size=(300, 3))
    step = 2e-3
    moves = [grid.coordinates(points + sign * step * vectors) for sign in (-1.0, 0.0, 1.0)]
    same = np.ptp([np.floor(u + 0.5) for u in moves], axis=0).max(axis=1) == 0
    assert same.sum() > 250
    below, above = (tsc_matrix(grid, u[same]).toarray().astype(float) for u in (moves[0], moves[2]))
    weights = tsc_matrix(grid, moves[1][same])
    found = tsc_gradient_matrix(grid, moves[1][same], vectors[same], weights)
    np.testing.assert_allclose(found.toarray(), (above - below) / (2.0 * step), atol=1e-3 * np.abs(found.data).max())
    np.testing.assert_array_equal(found.indices, weights.indices)  # entry by entry
    np.testing.assert_array_equal(found.indptr, weights.indptr)


def test_slopes_sum_to_none_and_carry_a_linear_field():
    rng = np.random.default_rng(1)
    grid = fit_box([[0.0, 0.0, 0.0], [3.0, 2.0, 1.0]], 0.2)
    points, vectors = rng.uniform([0.0, 0.0, 0.0], [3.0, 2.0, 1.0], (200, 3)), rng.normal(size=(200, 3))
    places = grid.coordinates(points)
    slopes = tsc_gradient_matrix(grid, places, vectors, tsc_matrix(grid, places)).astype(float)
    np.testing.assert_allclose(slopes.sum(axis=0), 0.0, atol=1e-4)
    z, y, x = np.indices(grid.shape).reshape(3, -1)
    matrix = np.asarray(grid.world_to_grid)
    nodes = (np.column_stack([x, y, z]) - matrix[3, :3]) @ np.linalg.inv(matrix[:3, :3])
    gradient = np.array([0.3, -1.0, 2.0])
    np.testing.assert_allclose(slopes.T @ (nodes @ gradient), vectors @ gradient, atol=1e-3)
