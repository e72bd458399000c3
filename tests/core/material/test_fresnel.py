"""Fresnel against values that anyone can check by hand."""

import numpy as np
import pytest

from milkglass.core.material import fresnel


def test_normal_incidence_is_the_textbook_value() -> None:
    for eta in (1.0, 1.3, 1.5, 2.5):
        assert fresnel.reflectance(eta, 1.0) == pytest.approx(((eta - 1) / (eta + 1)) ** 2, abs=1e-15)


def test_grazing_incidence_reflects_everything() -> None:
    assert fresnel.reflectance(1.5, 0.0) == pytest.approx(1.0, abs=1e-15)


def test_brewster_angle_reflects_half_of_the_perpendicular_part() -> None:
    eta = 1.5
    mu = np.cos(np.arctan(eta))
    mu_t = np.sqrt(1 - (1 - mu**2) / eta**2)
    perpendicular = (mu - eta * mu_t) / (mu + eta * mu_t)
    assert fresnel.reflectance(eta, mu) == pytest.approx(0.5 * perpendicular**2, abs=1e-15)


def test_matched_index_never_reflects() -> None:
    assert np.all(fresnel.reflectance(1.0, np.linspace(0, 1, 101)) < 1e-25)
    assert fresnel.hemispherical_transmittance(1.0) == pytest.approx(1.0, abs=1e-12)


def test_total_reflection_from_the_dense_side() -> None:
    critical = np.sqrt(1 - (1 / 1.5) ** 2)
    assert fresnel.reflectance(1 / 1.5, 0.99 * critical) == 1.0
    assert fresnel.reflectance(1 / 1.5, 1.05 * critical) < 0.5


def test_reciprocity_along_a_refracted_ray() -> None:
    mu = np.linspace(0.05, 1, 50)
    mu_t = np.sqrt(1 - (1 - mu**2) / 1.4**2)
    np.testing.assert_allclose(fresnel.reflectance(1.4, mu), fresnel.reflectance(1 / 1.4, mu_t), atol=1e-13)


@pytest.mark.parametrize(("eta", "internal"), [(1.3, 2.340532), (1.4, 2.948493), (1.5, 3.627933)])
def test_diffuse_averages_give_the_known_boundary_constant(eta: float, internal: float) -> None:
    # A = (1 + R2) / (1 - R1) of light from the inside, computed elsewhere to seven digits
    critical = np.sqrt(1 - 1 / eta**2)  # below it everything is reflected, above it F_r falls like a square root
    nodes, weights = np.polynomial.legendre.leggauss(200)
    t = 0.5 * (nodes + 1)
    mu = critical + (1 - critical) * t**2
    w = weights * t * (1 - critical)
    reflected = fresnel.reflectance(1 / eta, mu)
    r1 = critical**2 + 2 * np.sum(w * mu * reflected)
    r2 = critical**3 + 3 * np.sum(w * mu**2 * reflected)
    assert (1 + r2) / (1 - r1) == pytest.approx(internal, rel=2e-5)
    # and reciprocity ties the hemispherical transmittances of both sides: T_in = eta^2 T_out
    assert fresnel.hemispherical_transmittance(eta) == pytest.approx(eta**2 * (1 - r1), rel=2e-5)


def test_fit_is_continuous_enough_and_below_one() -> None:
    eta = np.linspace(1, 3, 201)
    fit = np.array([fresnel.diffuse_reflectance_fit(float(e)) for e in eta])
    assert np.all((fit >= 0) & (fit < 1))
    assert fresnel.diffuse_reflectance_fit(1.3) == pytest.approx(0.4447, abs=2e-3)
