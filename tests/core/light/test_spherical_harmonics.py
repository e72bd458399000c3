"""Real spherical harmonics: orthonormality, and projection against closed forms and itself."""

import numpy as np
import pytest

from milkglass.core.light import harmonics as sh


def noise_probe(height, seed=3):
    """Radiance with a strong highlight, so that a shift or flip cannot go unnoticed."""
    pixels = np.random.default_rng(seed).random((height, 2 * height, 3), np.float32)
    pixels[height // 4, height // 3] *= 200.0
    return pixels


def test_basis_is_orthonormal_and_band_one_is_the_direction():
    order = 11
    x, w = np.polynomial.legendre.leggauss(order + 1)
    phi = 2 * np.pi * np.arange(2 * order + 1) / (2 * order + 1)
    count = (order + 1) ** 2
    basis = np.concatenate(
        [sh.evaluate_grid(np.eye(count)[:, i : i + 3], np.arccos(x), phi).reshape(-1, 3) for i in range(0, count, 3)],
        axis=1,
    )
    weights = np.repeat(w, len(phi)) * 2 * np.pi / len(phi)
    np.testing.assert_allclose(basis.T @ (basis * weights[:, None]), np.eye(count), atol=1e-12)
    theta, azimuth = np.meshgrid(np.arccos(x), phi, indexing="ij")
    d = np.stack([np.sin(theta) * np.sin(azimuth), np.cos(theta), -np.sin(theta) * np.cos(azimuth)], axis=-1)
    expected = np.sqrt(0.75 / np.pi) * d.reshape(-1, 3) * [1, 1, -1]
    np.testing.assert_allclose(basis[:, 1:4], expected, atol=1e-14)


@pytest.mark.parametrize("height", [2, 5, 64])
def test_constant_map_has_one_coefficient(height):
    coefficients = sh.project_latlong(np.full((height, 2 * height, 3), 2.0, np.float32), 32)
    np.testing.assert_allclose(coefficients[0], 2.0 * np.sqrt(4 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(coefficients[1:], 0.0, atol=1e-8)


def test_projection_inverts_evaluation():
    order, height = 6, 400
    expected = np.random.default_rng(5).normal(size=((order + 1) ** 2, 3))
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = 2 * np.pi * ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5)
    found = sh.project_latlong(sh.evaluate_grid(expected, theta, phi), order)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_projection_of_a_small_map_equals_the_finely_repeated_one():
    """Texels are constant areas: splitting them changes nothing, in any band."""
    pixels = noise_probe(6)
    fine = pixels.repeat(8, axis=0).repeat(8, axis=1)
    expected = sh.project_latlong(fine, 24)
    np.testing.assert_allclose(sh.project_latlong(pixels, 24), expected, atol=1e-8 * np.abs(expected).max())
