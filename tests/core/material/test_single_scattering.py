"""How much of what leaves a half space has scattered once: closed forms, conservation, and photons."""

import numpy as np
import pytest

from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.material.single_scattering import (
    NOTABLE_SHARE,
    chandrasekhar_h,
    reflectance,
    reflected_once,
    share,
    statement,
)
from milkglass.core.reference.photons import walk
from tests.support.half_space import HalfSpace

DOWN = (0.0, 0.0, -1.0)


@pytest.mark.parametrize("eta", [1.0, 1.001, 1.33, 2.0, 3.0])
def test_without_absorption_all_light_returns(eta):
    assert reflectance(1.0, eta) == pytest.approx(1.0, abs=1e-11)


@pytest.mark.parametrize("albedo", [0.1, 0.5, 0.9, 0.99])
def test_h_solves_its_integral_equation(albedo):
    nodes, weights = np.polynomial.legendre.leggauss(200)
    mu, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    h = chandrasekhar_h(mu, albedo)
    scattered = 0.5 * albedo * np.sum(weights * mu * h / (mu[:, None] + mu), axis=1)
    np.testing.assert_allclose(1.0 / h, np.sqrt(1.0 - albedo) + scattered, rtol=2e-6)
    at_1 = float(chandrasekhar_h(np.ones(1), albedo)[0])
    assert reflectance(albedo, 1.0) == pytest.approx(1.0 - at_1 * np.sqrt(1.0 - albedo), abs=1e-12)


def test_without_a_boundary_single_scattering_is_closed():
    for albedo in (0.0, 0.2, 1.0):
        assert reflected_once(albedo, 1.0) == pytest.approx(0.5 * albedo * (1.0 - np.log(2.0)), abs=1e-14)


@pytest.mark.parametrize(("eta", "photons"), [(1.3, 0.0752), (1.33, 0.0721), (1.5, 0.0539)])
def test_light_that_scatters_once_and_leaves_a_half_space(eta, photons):
    assert reflected_once(1.0, eta) == pytest.approx(photons, rel=0.01)


@pytest.mark.parametrize("eta", [1.0, 1.33, 1.5, 2.5])
def test_share_falls_from_all_of_it_as_albedo_rises(eta):
    albedos = (1e-9, 0.01, 0.3, 0.7, 0.95, 1.0)
    shares = [reflected_once(a, eta) / reflectance(a, eta) for a in albedos]
    assert shares[0] == pytest.approx(1.0, abs=1e-6)
    assert np.diff(shares).max() < 0.0
    assert shares[-1] > 0.01


@pytest.mark.parametrize("eta", [1.33, 1.5])
def test_photons_return_as_much_in_all_and_once(eta):
    """One walk has all the albedos; where next to nothing scatters twice, the first scattering is all."""
    albedos = (0.9, 0.5, 0.005)
    found = walk(HalfSpace([0.0, 1e3]), 1.0, albedos, eta, DOWN, 60_000, seed=5)
    for i, albedo in enumerate(albedos):
        total = found.scattered[:, :, i].sum(axis=1) / found.entered.sum()
        error = total.std(ddof=1) / np.sqrt(len(total))
        assert abs(total.mean() - reflectance(albedo, eta)) < 4.0 * error
        assert error < 0.02 * total.mean()
    assert reflected_once(0.005, eta) == pytest.approx(reflectance(0.005, eta), rel=0.01)


def test_what_is_told_of_a_material():
    assert share(Material("m", (0.0, 1.0, 1.0), (1.0, 0.0, 0.0), 1.3))[0] == 0.0
    assert statement(Material("m", (0.0,) * 3, (0.0,) * 3, 1.3)) == "nothing scatters"
    marble, sprite = materials.lookup("marble"), materials.lookup("sprite")
    np.testing.assert_allclose(share(marble), [0.0639, 0.0670, 0.0703], atol=1e-4)
    assert share(marble).max() < NOTABLE_SHARE < share(sprite).min()
    assert statement(marble).startswith("6 %, 7 %, 7 % of the light that leaves")
    for material in materials.library():
        assert np.isfinite(share(material)).all()
        assert 0.0 <= share(material).min() <= share(material).max() <= 1.0
