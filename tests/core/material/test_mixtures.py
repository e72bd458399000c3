"""Mixtures and dilution: laws in closed form, and the published measurements of diluted liquids."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.material.mixtures import WATER, dilute, mix
from milkglass.core.profiles import dipole

MILK, WAX, CLEAR = (
    materials.lookup("Regular Milk"),
    materials.lookup("wax"),
    Material("clear", (0,) * 3, (0,) * 3, 1.33),
)


def coefficients(material):
    return np.array([material.sigma_s_prime, material.sigma_a])


def test_optical_depths_add():
    """A mixed slab is as deep as its parts one behind the other, in scattering and in absorption."""
    for share in (0.0, 0.1, 0.5, 1.0):
        mixed = mix(MILK, WAX, share)
        np.testing.assert_allclose(
            coefficients(mixed), (1 - share) * coefficients(MILK) + share * coefficients(WAX), rtol=1e-14
        )
        assert mixed.eta == pytest.approx((1 - share) * MILK.eta + share * WAX.eta, rel=1e-14)


def test_mixtures_commute_associate_and_leave_a_material_with_itself():
    np.testing.assert_allclose(coefficients(mix(MILK, WAX, 0.3)), coefficients(mix(WAX, MILK, 0.7)), rtol=1e-14)
    jade = materials.lookup("jade")
    # Thirds: (milk + wax) / 2 with a third of jade, or milk with two thirds of (wax + jade) / 2.
    one, other = mix(mix(MILK, WAX, 0.5), jade, 1 / 3), mix(MILK, mix(WAX, jade, 0.5), 2 / 3)
    np.testing.assert_allclose(coefficients(one), coefficients(other), rtol=1e-14)
    assert one.eta == pytest.approx(other.eta, rel=1e-14)
    np.testing.assert_allclose(coefficients(mix(WAX, WAX, 0.4)), coefficients(WAX), rtol=1e-14)
    assert "25 % wax" in mix(MILK, WAX, 0.25).name


def test_clear_matter_thins_and_keeps_the_colour():
    thin = mix(MILK, CLEAR, 0.9)
    np.testing.assert_allclose(thin.mean_free_path, 10.0 * MILK.mean_free_path, rtol=1e-13)
    np.testing.assert_allclose(dipole.diffuse_reflectance(thin), dipole.diffuse_reflectance(MILK), rtol=1e-13)


def test_library_diluted_as_in_the_tank_is_what_was_measured(data_dir):
    with open(data_dir / "ngd06_tank_table.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 35
    for row in rows:
        water = 1.0 - 1.0 / float(row["undilution_factor"])
        found = dilute(materials.lookup(row["name"]), water)
        for i, channel in enumerate("rgb"):
            extinction, absorption, g = (
                float(row[f"{key}_{channel}"] or 0.0) for key in ("sigma_t_x1e2", "sigma_a_x1e2", "g")
            )
            scattering = (extinction - absorption) * (1.0 - g) * 1e-2
            # The printed digits of either table.
            assert found.sigma_s_prime[i] == pytest.approx(scattering, rel=2e-4, abs=1e-12)
            without_water = found.sigma_a[i] - water * WATER.sigma_a[i]
            assert without_water == pytest.approx(absorption * 1e-2, rel=2e-3, abs=1e-9)


def test_published_coefficients_hold_no_water(data_dir):
    """Else the tank of milk, nearly all water, could not absorb a hundredth of what water does in red."""
    with open(data_dir / "ngd06_tank_table.csv", newline="") as file:
        milk = next(row for row in csv.DictReader(file) if row["name"] == "Regular Milk")
    assert float(milk["sigma_a_x1e2_r"]) * 1e-2 < 0.01 * WATER.sigma_a[0]


def test_water_alone_is_black_and_its_own():
    alone = dilute(MILK, 1.0)
    assert (alone.sigma_s_prime, alone.sigma_a, alone.eta) == (WATER.sigma_s_prime, WATER.sigma_a, WATER.eta)
    np.testing.assert_array_equal(alone.alpha_prime, 0.0)
    np.testing.assert_array_equal(coefficients(dilute(MILK, 0.0)), coefficients(MILK))


@pytest.mark.parametrize("water", [0.3, 0.9, 0.999])
def test_what_was_diluted_is_undiluted_again(water):
    thin = dilute(MILK, water)
    back = dilute(thin, -water / (1.0 - water))
    np.testing.assert_allclose(back.sigma_s_prime, MILK.sigma_s_prime, rtol=1e-12)
    added = np.array(WATER.sigma_a) * water / (1.0 - water)
    np.testing.assert_allclose(back.sigma_a, MILK.sigma_a + added, rtol=1e-12)
    assert back.eta == thin.eta


def test_what_scatters_keeps_its_mean_cosine():
    """Of all that scatters in a mixture: unreduced scattering adds, and so does it times the cosine."""
    juice = materials.lookup("White Grapefruit Juice")
    for share in (0.0, 0.3, 1.0):
        parts = [(1.0 - share, MILK), (share, juice)]
        scattering = sum(f * np.array(m.sigma_s_prime) / (1.0 - np.array(m.g)) for f, m in parts)
        forward = sum(f * np.array(m.sigma_s_prime) * m.g / (1.0 - np.array(m.g)) for f, m in parts)
        np.testing.assert_allclose(mix(MILK, juice, share).g, forward / scattering, rtol=1e-14)
    for water in (0.0, 0.9, -3.0):
        assert dilute(MILK, water).g == MILK.g
    assert mix(MILK, MILK, 0.3).g == MILK.g
    assert mix(CLEAR, MILK, 0.01).g == MILK.g
    half = mix(replace(MILK, g=(0.0, 0.9, 0.999)), MILK, 0.5)
    assert 0.0 < half.g[0] < MILK.g[0]


def test_nothing_to_scatter_or_to_absorb_is_no_trouble():
    spectralon, merlot = materials.lookup("spectralon"), materials.lookup("merlot")
    assert mix(spectralon, spectralon, 0.5).sigma_a == (0.0, 0.0, 0.0)
    assert mix(merlot, merlot, 0.5).sigma_s_prime[1:] == (0.0, 0.0)
    assert coefficients(mix(CLEAR, CLEAR, 0.5)).max() == 0.0
    for share in (0.0, 0.5, 1.0):
        assert np.isfinite(coefficients(mix(spectralon, merlot, share))).all()


def test_an_impossible_concentration_is_told():
    with pytest.raises(InputError, match=r"Spectralon, 100001 times as strong: sigma_s_prime must be"):
        dilute(materials.lookup("spectralon"), -1e5)
