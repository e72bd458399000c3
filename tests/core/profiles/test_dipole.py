"""The dipole: closed forms against numerical integrals and against published reflectances."""

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.profiles.dipole import Dipole, diffuse_reflectance, dipoles

SCATTERING = [
    (material.name, channel)
    for material in materials.library()
    for channel in range(3)
    if material.sigma_s_prime[channel] > 0 and material.sigma_a[channel] > 0
]


def integral(profile: Dipole, e: float, upper: float = np.inf) -> float:
    """2 pi int_0^upper R_d(sqrt(r^2 + e^2)) r dr, with r = z_r t so that the integrand has scale 1."""
    z = profile.z_r

    def integrand(t: float) -> float:
        return float(2 * np.pi * profile.radial(np.hypot(z * t, e)) * z * z * t)

    edges = [0.0, 1.0, 10.0, 100.0, 1e4, 1e7, np.inf]
    edges = [min(edge, upper / z) for edge in edges]
    return sum(quad(integrand, a, b, epsabs=1e-12, epsrel=1e-10, limit=200)[0] for a, b in pairwise(edges) if b > a)


@pytest.mark.parametrize(("name", "channel"), SCATTERING)
def test_numerical_integral_equals_the_closed_form(name: str, channel: int) -> None:
    profile = dipoles(materials.lookup(name))[channel]
    assert integral(profile, 0.0) == pytest.approx(float(profile.total(0.0)), abs=5e-6)


def test_published_reflectances(data_dir: Path) -> None:
    with (data_dir / "materials.csv").open() as file:
        rows = list(csv.DictReader(file))
    differences = [
        abs(diffuse_reflectance(materials.lookup(row["name"]))[i] - float(row[f"Rd3_{c}"]))
        for row in rows
        for i, c in enumerate("rgb")
        if row[f"Rd3_{c}"]
    ]
    assert len(differences) == 33
    assert max(differences) < 0.00051  # they are printed with three digits


@pytest.mark.parametrize("e", [0.0, 0.1, 1.0, 5.0])
def test_totals_and_spectrum_at_a_layer_distance(e: float) -> None:
    profile = dipoles(materials.lookup("marble"))[1]
    assert integral(profile, e) == pytest.approx(float(profile.total(e)), rel=1e-7)
    assert integral(profile, e, upper=0.7) == pytest.approx(float(profile.total_within(0.7, e)), rel=1e-7)
    assert float(profile.spectrum(0.0, e)) == pytest.approx(float(profile.total(e)), rel=1e-14)
    for k in (0.5, 3.0):  # Hankel transform

        def integrand(r: float, k: float = k) -> float:
            return float(2 * np.pi * r * profile.radial(np.hypot(r, e)) * j0(k * r))

        value = quad(integrand, 0, 60, limit=2000)[0]
        assert value == pytest.approx(float(profile.spectrum(k, e)), abs=2e-6)


def test_known_values_of_marble_green() -> None:
    assert float(dipoles(Material("m", (2.62,) * 3, (0.0041,) * 3, 1.5))[0].total(0.0)) == pytest.approx(
        0.790960, abs=5e-7
    )
    assert float(dipoles(Material("m", (3.77,) * 3, (0.014,) * 3, 1.3))[0].total(0.0)) == pytest.approx(
        0.759413, abs=5e-7
    )
    assert float(dipoles(Material("m", (0.03,) * 3, (1.45,) * 3, 1.3))[0].total(0.0)) == pytest.approx(
        0.001830, abs=5e-7
    )


def test_without_absorption_everything_returns_and_the_tail_is_cubic() -> None:
    profile = dipoles(Material("m", (1.0,) * 3, (0.0,) * 3, 1.3))[0]
    assert profile.sigma_tr == 0.0
    assert float(profile.total(0.0)) == pytest.approx(1.0, abs=1e-15)
    assert float(profile.radial(2e4) / profile.radial(1e4)) == pytest.approx(1 / 8, rel=1e-6)


def test_without_scattering_the_channel_is_black() -> None:
    for sigma_a in (0.0, 1.0):
        profile = dipoles(Material("m", (0.0,) * 3, (sigma_a,) * 3, 1.3))[0]
        assert profile.is_black
        assert float(profile.radial(0.0)) == 0.0
        assert float(profile.total(0.0)) == 0.0


def test_scaling_law() -> None:
    """Lengths times s with coefficients over s: R_d falls by s^2, totals stay."""
    for s in (1e-3, 1e3):
        small = dipoles(Material("m", (2.0,) * 3, (0.01,) * 3, 1.4))[0]
        large = dipoles(Material("m", (2.0 / s,) * 3, (0.01 / s,) * 3, 1.4))[0]
        assert float(large.radial(s * 0.3)) * s**2 == pytest.approx(float(small.radial(0.3)), rel=1e-12)
        assert float(large.total(s * 0.3)) == pytest.approx(float(small.total(0.3)), rel=1e-12)


def test_every_material_is_positive_and_falls_with_distance() -> None:
    rho = np.geomspace(1e-4, 1e4, 400)
    for material in materials.library():
        for profile in dipoles(material):
            values = profile.radial(rho)
            assert np.all(np.isfinite(values))
            assert np.all(values >= 0)
            assert np.all(np.diff(values) <= 0)
