"""Morton order keeps neighbours together."""

import numpy as np

from milkglass.core.geometry.morton import morton_order


def test_the_corners_of_a_cube_come_in_the_order_of_their_binary_numbers():
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    shuffled = np.random.default_rng(1).permutation(8)
    assert np.array_equal(shuffled[morton_order(corners[shuffled])], np.arange(8))


def test_a_cell_s_points_are_a_run_at_every_scale():
    points = np.random.default_rng(2).random((4096, 3))
    points[:2] = [[0.0], [1.0]]  # the bounding cube
    order = morton_order(points)
    assert np.array_equal(np.sort(order), np.arange(4096))
    for cells in (2, 4, 8):
        cell = (points * cells * (1.0 - 1e-6)).astype(int) @ (1, cells, cells**2)
        runs = 1 + np.count_nonzero(np.diff(cell[order]))
        assert runs == len(np.unique(cell))


def test_points_of_one_place_and_none_have_an_order():
    assert np.array_equal(morton_order(np.ones((3, 3))), [0, 1, 2])
    assert len(morton_order(np.empty((0, 3)))) == 0
