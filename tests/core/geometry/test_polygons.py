"""core.geometry.polygons: triangles cover what their polygon does, once, and look the way it looks."""

import numpy as np
import pytest

from milkglass.core.geometry.polygons import triangulated


def star(count: int, depth: float, seed: int) -> np.ndarray:
    """Corners of a star in a plane of any direction, the inner ones at `depth` of the radius."""
    rng = np.random.default_rng(seed)
    angle, radius = 2 * np.pi * np.arange(count) / count, np.where(np.arange(count) % 2, depth, 1.0)
    across, along = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    return (radius * np.cos(angle))[:, None] * across + (radius * np.sin(angle))[:, None] * along + rng.normal(size=3)


@pytest.mark.parametrize(("count", "depth"), [(4, 0.2), (8, 0.2), (10, 1.0), (40, 0.4)])
def test_areas_and_directions_are_those_of_the_polygon(count, depth):
    """Of a star, the sum of its corners' triangles about the middle; no triangle looks the other way."""
    for seed in range(4):
        ring = star(count, depth, seed)
        triangles, polygon = triangulated(ring, [count], np.arange(count))
        assert triangles.shape == (count - 2, 3)
        assert (polygon == 0).all()
        a, b, c = np.moveaxis(ring[triangles], 1, 0)
        vectors = 0.5 * np.cross(b - a, c - a)
        middle = ring.mean(axis=0)
        whole = 0.5 * np.cross(ring - middle, np.roll(ring, -1, axis=0) - middle).sum(axis=0)
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1).sum(), np.linalg.norm(whole), rtol=1e-9)
        np.testing.assert_allclose(vectors.sum(axis=0), whole, atol=1e-12)


def test_convex_ones_are_fans_in_their_order():
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    triangles, polygon = triangulated(square, [3, 2, 4], [2, 1, 0, 0, 1, 0, 1, 2, 3])
    assert triangles.tolist() == [[0, 1, 2], [5, 6, 7], [5, 7, 8]]
    assert polygon.tolist() == [0, 2, 2]


def test_a_polygon_without_area_is_a_fan_and_an_unknown_vertex_is_told():
    line = np.array([(i % 3, 0, 0) for i in range(6)], float)
    assert triangulated(line, [6], np.arange(6))[0].shape == (4, 3)
    for wrong in (6, -1):
        with pytest.raises(ValueError, match="none of its 6"):
            triangulated(line, [3], [0, 1, wrong])
