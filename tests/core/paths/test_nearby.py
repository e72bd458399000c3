"""Radiance between the pixels whose rays were followed."""

import numpy as np
import pytest

from milkglass.core.paths.nearby import nearby
from milkglass.core.paths.tree import Sight

SIDE, STEP = 13, 4


@pytest.fixture
def plane():
    """Pixels of a plane that fills a picture, which of them have rays, and rows and columns of all."""
    pixels = np.arange(SIDE * SIDE)
    rows, columns = pixels // SIDE, pixels % SIDE
    normals = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(pixels), 1))
    sight = Sight(np.zeros_like(normals), normals, -normals, np.zeros(len(pixels), np.int32))
    return sight, np.flatnonzero((rows % STEP == 0) & (columns % STEP == 0)), rows, columns


def between(plane, values):
    sight, chosen, _, _ = plane
    found = np.repeat(values[None, chosen, None], 3, axis=2).astype(np.float32)
    pixels = np.arange(SIDE * SIDE)
    shown, differ = nearby(found, chosen, pixels, pixels, SIDE, STEP, sight)
    return shown[0, :, 1], differ


def test_it_is_linear_where_the_surface_is_alike(plane):
    _, _, rows, columns = plane
    values = 1.0 + 2.0 * rows + 3.0 * columns
    shown, differ = between(plane, values)
    np.testing.assert_allclose(shown, values, rtol=1e-5)
    even, none = between(plane, np.ones(len(values)))
    np.testing.assert_allclose(even, 1.0, rtol=1e-6)
    assert differ[rows % STEP > 0].min() > 0.0 == none.max()


def test_it_ends_at_another_body_and_at_an_edge(plane):
    sight, chosen, _, columns = plane
    beyond = columns >= 6
    for other in ("bodies", "normals"):
        values = np.where(beyond, 5.0, 1.0)
        if other == "bodies":
            sight.bodies[beyond] = 1
        else:
            sight.bodies[:], sight.normals[beyond] = 0, (1.0, 0.0, 0.0)
        shown, differ = between((sight, chosen, None, None), values)
        whole = (columns < 5) | (columns >= 8)  # pixels between are of squares whose rays meet the other one
        np.testing.assert_allclose(shown[whole], values[whole], rtol=1e-5)
        assert differ[whole].max() == 0.0
