"""Refraction, and where light first scatters: Snell's law, moments and published nodes."""

import numpy as np
import pytest
from scipy.integrate import quad

from milkglass.core.material import fresnel
from milkglass.core.material.refraction import first_scattering, mean_cosine, refract


def turned(angle):
    """Directions that meet the normal z under an angle."""
    return np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=-1)


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.5])
def test_snells_law(eta):
    angle = np.linspace(0.0, 0.5 * np.pi, 91)
    normals = np.tile([0.0, 0.0, 1.0], (len(angle), 1))
    rays = refract(turned(angle), normals, eta)
    np.testing.assert_allclose(rays[:, 0], np.sin(angle) / eta, atol=1e-12)
    np.testing.assert_allclose(rays[:, 2], -np.sqrt(1.0 - (np.sin(angle) / eta) ** 2), atol=1e-12)
    np.testing.assert_allclose(rays[:, 1], 0.0, atol=1e-15)


def test_refraction_turns_with_the_surface():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    d = np.array([0.36, -0.48, 0.8])
    facing = normals[normals @ d < 0.0]
    rays = refract(d, facing, 1.4)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    # The part along the surface is divided by eta, whatever the surface.
    along = d - (facing @ d)[:, None] * facing
    np.testing.assert_allclose(rays - np.einsum("ij,ij->i", rays, facing)[:, None] * facing, along / 1.4, atol=1e-12)


def test_light_from_behind_a_normal_grazes():
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    rays = refract(np.array([[1.0, 0.0, 0.0], [0.8, 0.0, 0.6]]), normals, 1.5)
    assert np.isfinite(rays).all()
    assert (rays[:, 2] < 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)


@pytest.mark.parametrize(("eta", "published"), [(1.3, 0.840), (1.5, 0.885)])
def test_mean_cosine(eta, published):
    def entering(mu):
        return float(mu * fresnel.transmittance(eta, mu))

    inside = quad(lambda mu: entering(mu) * np.sqrt(1.0 - (1.0 - mu * mu) / eta**2), 0.0, 1.0, epsabs=1e-12)[0]
    assert mean_cosine(eta) == pytest.approx(inside / quad(entering, 0.0, 1.0, epsabs=1e-12)[0], abs=1e-9)
    assert mean_cosine(eta) == pytest.approx(published, abs=6e-4)


def test_mean_cosine_without_an_interface():
    assert mean_cosine(1.0) == pytest.approx(2.0 / 3.0, abs=1e-9)


@pytest.mark.parametrize("chord", [1e-3, 0.01, 0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0, np.inf])
def test_moments(chord):
    """Two Gauss nodes integrate cubics against exp(-z) on [0, chord]."""
    depths, weights = first_scattering(np.array([chord]))
    end = min(chord, 200.0)
    for power in range(4):
        expected = quad(lambda z, p=power: z**p * np.exp(-z), 0.0, end, points=[min(1.0, 0.5 * end), end / 3.0])[0]
        assert np.sum(weights * depths**power) == pytest.approx(expected, rel=2e-4 if power else 1e-12)


@pytest.mark.parametrize(
    ("chord", "depths", "weights"),
    [
        (1.0, (0.181, 0.752), (0.370, 0.262)),
        (3.0, (0.403, 1.988), (0.686, 0.264)),
        (np.inf, (0.585786, 3.414214), (0.853553, 0.146447)),
    ],
)
def test_published_nodes(chord, depths, weights):
    digits = 1e-5 if np.isinf(chord) else 6e-4
    found = first_scattering(np.array([chord]))
    np.testing.assert_allclose(found[0][0], depths, atol=digits)
    np.testing.assert_allclose(found[1][0], weights, atol=digits)


def test_nodes_stay_inside_and_leave_out_what_crosses():
    chord = np.concatenate([[0.0], np.geomspace(1e-9, 1e9, 5000), [np.inf]])
    depths, weights = first_scattering(chord)
    assert np.isfinite(depths).all()
    assert (depths >= 0.0).all()
    assert (depths <= chord[:, None]).all()
    assert (weights >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=1), -np.expm1(-chord), rtol=1e-12)
    lower, upper = depths[1:].T
    assert (lower < upper).all()
