"""Surface samples: exact area, no gaps, long thin faces too."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import surface_samples
from tests.support.shapes import ball, cube, torus_knot


@pytest.mark.parametrize("spacing", [0.3, 2.0, 100.0])
def test_areas_sum_to_the_mesh(spacing: float) -> None:
    for mesh in (ball(subdivisions=3), cube(), torus_knot(n_along=120, n_around=16)):
        samples = surface_samples(mesh, spacing)
        assert samples.areas.sum(dtype=np.float64) == pytest.approx(mesh.area, rel=1e-5)
        np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0, atol=1e-5)


def test_twelve_triangles_are_covered_evenly() -> None:
    samples = surface_samples(cube(20.0), 1.0)
    assert samples.areas.max() <= 0.5  # a right triangle of hypotenuse 1 has 1/4
    rng = np.random.default_rng(0)
    points = rng.uniform(-10, 10, (2000, 3))
    points[np.arange(2000), rng.integers(0, 3, 2000)] = 10.0 * rng.choice([-1, 1], 2000)
    distance, _ = cKDTree(samples.points).query(points)
    assert distance.max() < 1.0


def test_long_thin_faces_are_cut_along_their_length() -> None:
    sliver = Mesh(
        np.array([[0, 0, 0], [100, 0, 0], [100, 0.01, 0]]), np.tile([0, 0, 1.0], (3, 1)), np.array([[0, 1, 2]])
    )
    samples = surface_samples(sliver, 1.0)
    gaps = np.diff(np.sort(samples.points[:, 0]))
    assert gaps.max() < 1.0
    assert samples.areas.sum() == pytest.approx(0.5, rel=1e-4)


def test_a_fine_mesh_keeps_one_sample_a_face() -> None:
    mesh = ball(subdivisions=4)
    assert len(surface_samples(mesh, 10.0)) == len(mesh.faces)


def test_the_number_of_samples_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("milkglass.core.geometry.samples.MAX_SAMPLES", 5000)
    assert len(surface_samples(cube(), 1e-3)) < 20000


def test_opposite_corner_normals_fall_back_to_the_face() -> None:
    normals = np.array([[0, 0, 1], [0, 0, -1], [0, 0, 0.0]])
    mesh = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), normals, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(surface_samples(mesh, 10.0).normals, [[0, 0, 1]], atol=1e-6)
