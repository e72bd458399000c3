"""core.geometry.texture: means over texture coordinates."""

import numpy as np
import pytest

from milkglass.core.display import srgb
from milkglass.core.geometry import texture
from milkglass.core.geometry.texture import NORMAL, Texture, linear

POINT = np.zeros(1)


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (height, width, 3)).astype(np.uint8)


def test_linear_undoes_srgb():
    x = np.linspace(0.0, 1.0, 256)
    np.testing.assert_allclose(srgb(linear(x)), x, atol=1e-6)


def test_texels_lie_where_opengl_has_them_and_repeat():
    pixels = noise(4, 8)
    made = Texture(pixels)
    for row, column in ((0, 0), (3, 7), (2, 5)):
        for turn in (0, -3, 2):  # row 0 is at the top, v = 1
            at = np.array([[(column + 0.5) / 8 + turn, 1.0 - (row + 0.5) / 4 + turn]])
            np.testing.assert_allclose(made.mean(at, POINT)[0], linear(pixels[row, column] / 255.0), atol=1e-5)
    seam = made.mean(np.array([[0.0, 1.0 - 0.5 / 4]]), POINT)[0]
    np.testing.assert_allclose(seam, linear(pixels[0, [0, 7]] / 255.0).mean(axis=0), atol=1e-5)


@pytest.mark.parametrize("power", [1.0, 0.5])
def test_the_mean_over_everything_is_the_mean_of_the_powers(power):
    pixels = noise(32, 32)
    mean = Texture(pixels).mean(np.random.default_rng(0).random((5, 2)), np.ones(5), power)
    np.testing.assert_allclose(mean, np.tile((linear(pixels / 255.0) ** power).mean(axis=(0, 1)), (5, 1)), rtol=1e-5)


@pytest.mark.parametrize("size", [(70, 33), (1, 50), (64, 64)])
def test_a_large_texture_is_averaged_first(monkeypatch, size):
    pixels = noise(*size)
    monkeypatch.setattr(texture, "MAX_TEXELS", 16)
    made = Texture(pixels)
    assert max(made.levels()[0].shape[:2]) <= 16
    assert made.levels()[-1].shape[:2] == (1, 1)
    np.testing.assert_allclose(made.levels()[-1][0, 0], linear(pixels / 255.0).mean(axis=(0, 1)), atol=0.15)


def test_normals_shorten_where_they_disagree_and_flat_is_exact():
    flat = Texture(np.tile(np.uint8([128, 128, 255]), (8, 8, 1)), NORMAL)
    np.testing.assert_array_equal(flat.mean(np.array([[0.3, 0.7]]), np.ones(1)), [[0.0, 0.0, 1.0]])
    ridge = np.uint8([[[128 + 90, 128, 128 + 90], [128 - 90, 128, 128 + 90]]])
    np.testing.assert_allclose(
        Texture(ridge, NORMAL).mean(np.zeros((1, 2)), np.ones(1)), [[0.0, 0.0, np.sqrt(0.5)]], atol=1e-6
    )
