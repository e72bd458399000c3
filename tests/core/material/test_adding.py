"""What a half space returns that scatters forward: the closed form without direction, and photons."""

import numpy as np
import pytest

from milkglass.core.material import single_scattering
from milkglass.core.material.adding import SIMILAR_ALBEDO, reflectance_at
from milkglass.core.reference.photon_shapes import Slab
from milkglass.core.reference.photons import walk


@pytest.mark.parametrize("eta", [1.1, 1.33, 1.5])
def test_without_a_direction_it_is_chandrasekhars(eta):
    cosines = np.linspace(np.sqrt(1.0 - 1.0 / eta**2), 1.0, 7)
    for albedo in (0.01, 0.5, 0.99):
        expected = single_scattering.reflectance_at(cosines, albedo, eta)
        np.testing.assert_allclose(reflectance_at(cosines, albedo, 0.0, eta), expected, rtol=2e-3)


def test_photons_return_as_often_from_a_slant():
    albedos, g, eta, outside = (0.5, 0.9), 0.8, 1.33, 0.6
    inside = np.sqrt(1.0 - (1.0 - outside**2) / eta**2)
    towards = np.sqrt(1.0 - outside**2), 0.0, -outside
    found = walk(Slab(60.0), 1.0, albedos, eta, towards, 40_000, seed=3, g=g)
    for i, albedo in enumerate(albedos):
        shares = found.scattered[:, 0, i] / found.entered.sum()
        error = shares.std(ddof=1) / np.sqrt(len(shares))
        assert error < 0.05 * shares.mean()
        assert abs(shares.mean() - reflectance_at(np.array([inside]), albedo, g, eta)[0]) < 4.0 * error


def test_where_much_scatters_reduced_coefficients_tell_as_much():
    scattering = SIMILAR_ALBEDO / (1.0 - 0.9)
    unreduced = scattering / (scattering + 1.0 - SIMILAR_ALBEDO)
    found = reflectance_at(np.linspace(0.7, 1.0, 5), unreduced, 0.9, 1.33)
    expected = single_scattering.reflectance_at(np.linspace(0.7, 1.0, 5), SIMILAR_ALBEDO, 1.33)
    np.testing.assert_allclose(found, expected, rtol=2e-3)
