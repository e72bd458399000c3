"""core.geometry.implicit against solids with closed forms."""

import numpy as np
import pytest

from milkglass.core.geometry.implicit import Primitive, polygonise, smooth_max, smooth_min
from milkglass.core.geometry.mesh import face_cross, find_flaws, half_edges, signed_volume

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def ball(centre: tuple[float, float, float], radius: float) -> Primitive:
    middle = np.array(centre, np.float32)[:, None]
    return Primitive(lambda p: np.sqrt(((p - middle) ** 2).sum(axis=0)) - np.float32(radius), 1e-6)


def euler(vertices: np.ndarray, faces: np.ndarray) -> int:
    return len(vertices) - len(half_edges(faces, len(vertices))[1]) + len(faces)


def test_a_ball_has_its_volume_and_radial_normals() -> None:
    vertices, faces, normals = polygonise([ball((0.1, -0.05, 0.02), 0.7)], *BOX, 0.03)
    radial = vertices - [0.1, -0.05, 0.02]
    np.testing.assert_allclose(np.linalg.norm(radial, axis=1), 0.7, atol=1e-5)
    np.testing.assert_allclose(normals, radial / 0.7, atol=1e-3)
    assert find_flaws(vertices, faces).solid
    assert euler(vertices, faces) == 2
    assert signed_volume(vertices, faces) == pytest.approx(4.0 / 3.0 * np.pi * 0.7**3, rel=2e-3)


def test_a_torus_has_one_handle() -> None:
    torus = Primitive(lambda p: np.hypot(np.hypot(p[0], p[2]) - np.float32(0.6), p[1]) - np.float32(0.2), 0.01)
    vertices, faces, _ = polygonise([torus], *BOX, 0.04)
    assert find_flaws(vertices, faces).solid
    assert euler(vertices, faces) == 0
    assert signed_volume(vertices, faces) == pytest.approx(2.0 * np.pi**2 * 0.6 * 0.2**2, rel=1e-2)


def test_triangles_are_spread_evenly() -> None:
    vertices, faces, _ = polygonise([ball((0, 0, 0), 0.7)], *BOX, 0.05)
    sides = np.linalg.norm(vertices[faces[:, [1, 2, 0]]] - vertices[faces], axis=2)
    twice_area = np.linalg.norm(face_cross(vertices, faces), axis=1)
    # 2 area / longest side^2 is 0.87 for an equilateral triangle; bare marching cubes has 1 % below 0.02.
    assert np.percentile(twice_area / sides.max(axis=1) ** 2, 1) > 0.2


def test_the_union_of_distant_parts_is_their_sum() -> None:
    parts = [ball((-0.5, 0, 0), 0.3), ball((0.5, 0, 0), 0.2), ball((0.5, 0.6, 0), 0.1)]
    vertices, faces, _ = polygonise(parts, *BOX, 0.03)
    assert euler(vertices, faces) == 6
    expected = 4.0 / 3.0 * np.pi * (0.3**3 + 0.2**3 + 0.1**3)
    assert signed_volume(vertices, faces) == pytest.approx(expected, rel=1e-2)


def test_bubbles_are_filled() -> None:
    hollow = Primitive(lambda p: np.abs(np.sqrt((p * p).sum(axis=0)) - np.float32(0.5)) - np.float32(0.1), 0.01)
    vertices, faces, _ = polygonise([hollow], *BOX, 0.04)
    assert euler(vertices, faces) == 2
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.6, atol=1e-4)


def test_blends_are_exact_away_from_the_crossing_and_fill_it() -> None:
    a, b = np.linspace(-1.0, 1.0, 101), np.zeros(101)
    low, high = smooth_min(a, b, 0.2), smooth_max(a, b, 0.2)
    far = np.abs(a) >= 0.2
    np.testing.assert_array_equal(low[far], np.minimum(a, b)[far])
    np.testing.assert_array_equal(high[far], np.maximum(a, b)[far])
    assert low[50] == pytest.approx(-0.05)
    np.testing.assert_allclose(high, -smooth_min(-a, -b, 0.2), atol=1e-9)
