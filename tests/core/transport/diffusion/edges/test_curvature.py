"""Mean curvature of patches: closed forms, sheets, edges, smoothing; and what it is for: light around a cavity."""

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.medium import Medium
from milkglass.core.reference.photon_shapes import ClosedMesh
from milkglass.core.reference.photons import walk
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.edges.curvature import curvature
from milkglass.core.transport.diffusion.patches import make_patches
from milkglass.viewer.bench.shapes import bowl, detail, turned
from tests.support.diffusing import diffuse, samples_of
from tests.support.shapes import ball, cube


def patches_of(mesh):
    return make_patches(mesh, samples_of(mesh), 0.4)


def shell(outer, inner, subdivisions=4):
    around = trimesh.creation.icosphere(subdivisions)
    u, faces = np.asarray(around.vertices), around.faces
    vertices, normals = np.concatenate([outer * u, inner * u]), np.concatenate([u, -u])
    return Mesh.of(vertices, normals, np.concatenate([faces, faces[:, ::-1] + len(u)]))


@pytest.mark.parametrize("width", [0.0, 0.5, 2.0, 100.0])
def test_of_a_ball_whatever_the_width(width):
    np.testing.assert_allclose(curvature(patches_of(ball(20.0))).at(width)[0], 0.2, rtol=0.01)


def test_inside_of_a_bowl_is_concave():
    patches = patches_of(bowl())
    radius, low = np.linalg.norm(patches.points - [0.0, 0.0, 4.25], axis=1), patches.points[:, 2] < 1.0
    found = curvature(patches).at(0.5)[0]
    np.testing.assert_allclose(found[low & (radius < 8.5)], -2.0 / 7.0, rtol=0.02)
    np.testing.assert_allclose(found[low & (radius > 8.5)], 0.2, rtol=0.02)


def test_sides_of_a_sheet_do_not_mix():
    patches = patches_of(shell(10.0, 9.8))
    found = curvature(patches).at(0.5)[0]
    outside = np.einsum("ij,ij->i", patches.points, patches.normals) > 0.0
    np.testing.assert_allclose(found[outside], 0.2, rtol=0.05)
    np.testing.assert_allclose(found[~outside], -0.2, rtol=0.07)


def test_edges_are_convex_and_faces_flat():
    patches = patches_of(cube())
    found = curvature(patches).at(0.5)[0]
    to_edge = np.sort(10.0 - np.abs(patches.points), axis=1)[:, 1]
    assert np.abs(found[to_edge > 4.0]).max() < 1e-6
    assert found[to_edge < 0.3].min() > 0.2


@pytest.mark.parametrize("shape", [lambda: ball(20.0), lambda: shell(10.0, 9.8)])
def test_no_edges_on_what_is_smooth(shape):
    total, *edges = curvature(patches_of(shape())).at(0.5)
    for each in edges:
        assert each.min() >= 0.0
        assert np.median(each) < 1e-9
        assert each.mean() < 0.02 * np.abs(total).mean()


def test_edges_of_a_cube_are_most_of_its_curvature():
    total, convex, concave = curvature(patches_of(cube())).at(0.5)
    assert 0.6 * total.sum() < convex.sum() <= total.sum()
    assert not concave.any()


def test_a_floor_meets_a_wall_in_a_concave_edge():
    """A step turned on a lathe: its inner edge is concave, at a radius of 4 and a height of 0."""
    patches = patches_of(turned([(0, -6), (9, -6), (9, 0), (4, 0), (4, 6), (0, 6)], 1.0))
    _, convex, concave = curvature(patches).at(0.5)
    radius, height = np.hypot(*patches.points[:, :2].T), patches.points[:, 2]
    away = np.hypot(radius - 4.0, height)
    assert np.median(concave[away < 0.5]) > 0.1
    assert concave[away > 3.0].max() < 1e-3
    assert convex[away < 0.3].max() < 1e-3


def test_a_wider_mean_sees_no_detail():
    found = curvature(patches_of(detail(subdivisions=5)))
    spreads = [found.at(width)[0].std() for width in (0.0, 0.5, 1.0, 2.0)]
    assert (np.diff(spreads) < 0.0).all()
    assert spreads[-1] < 0.1 * spreads[0]
    np.testing.assert_array_equal(np.stack(found.at(1e3), axis=-1), found.values[-1])
    between = found.at(float(found.widths[:2].mean()))
    np.testing.assert_allclose(np.stack(between, axis=-1), found.values[:2].mean(axis=0), atol=1e-12)


def test_light_around_a_cavity_against_photons():
    """A shell of 3 mean free paths, lit from all around: with a flat surface's A its cavity is 5 to 7 % too bright."""
    mesh, albedos = shell(10.0, 7.0), (0.97, 0.99, 0.999)
    each = np.repeat([0, 1], len(mesh.faces) // 2)
    found = walk(ClosedMesh(mesh, each), 1.0, albedos, 1.3, None, 60_000, seed=1)
    truth = found.exitance / (found.entered[0] / found.areas[0])
    samples = samples_of(mesh)
    flux = samples.areas * (np.linalg.norm(samples.points, axis=1) > 8.5)
    light = EnteringLight(np.repeat(flux[:, None], 3, axis=1).astype(np.float32))
    solved = diffuse(mesh, [Medium(a, 1.0 - a, 1.3) for a in albedos], light=light, samples=samples)
    outside = np.linalg.norm(solved.patches.points, axis=1) > 8.5
    for channel in range(3):
        M, areas = solved.exitance(channel), solved.patches.areas
        for i, side in enumerate((outside, ~outside)):
            assert np.average(M[side], weights=areas[side]) == pytest.approx(truth[i, channel], rel=0.03)
