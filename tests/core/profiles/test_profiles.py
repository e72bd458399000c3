"""Every diffusion profile: closed forms against quadrature, limits, scaling, positivity; kernels of both transports."""

import functools
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from milkglass.core.grid.spectra import texel_means
from milkglass.core.material import library as materials
from milkglass.core.material.fresnel import internal_moments, transmittance
from milkglass.core.material.library import Material
from milkglass.core.profiles.better_dipole import BetterDipole
from milkglass.core.profiles.burley import Burley
from milkglass.core.profiles.choose import albedo_for, profiles
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.profiles.gaussians import SKIN, skin
from milkglass.core.profiles.photon_beam import PhotonBeam, multiple_scattering, reflectance, single_scattering
from milkglass.core.profiles.radial import hankel
from milkglass.core.profiles.registry import PROFILES
from milkglass.core.profiles.table import TableProfile
from milkglass.core.transport import ewald
from milkglass.viewer.files.images import read_channels

RADII = np.geomspace(0.02, 8.0, 25)
TABLE = tuple(
    TableProfile(tuple(RADII), tuple(0.1 * np.exp(-RADII / d) + 0.01 * np.exp(-RADII))) for d in (0.7, 0.5, 0.3)
)
RAMP = TableProfile((0.0, 0.5, 1.0, 2.0, 3.0), (0.2, 0.1, 0.05, 0.0, 0.0))
OF = functools.partial(profiles, table=TABLE)
SKIN1 = materials.lookup("skin1")
EVERY = [OF(SKIN1, name)[1] for name in PROFILES] + [
    RAMP,
    BetterDipole(1.0, 0.7, 1.3),
    PhotonBeam(1.0, 0.7, 1.3),
    PhotonBeam(0.3, 0.7, 1.0),
]
NAMES = [*PROFILES, "ramp", "better, white", "beam, white", "beam, dark"]


def integral(f, edges) -> float:
    return sum(quad(f, a, b, epsabs=0.0, epsrel=1e-10, limit=200)[0] for a, b in itertools.pairwise(edges))


def edges_to(r, e, profile):
    """Pieces of [0, r] on which R_d is smooth."""
    kinks = [np.sqrt(k * k - e * e) for k in getattr(profile, "radii", ()) if k > e]
    inner = np.geomspace(1e-8, r, 40)
    return np.unique(np.concatenate([[0.0], inner, [k for k in kinks if k < r]]))


@pytest.mark.parametrize("e", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("profile", EVERY, ids=NAMES)
def test_flux_within_a_disc_is_the_integral(profile, e):
    def ring(r):
        return 2.0 * np.pi * r * float(profile.radial(np.hypot(r, e)))

    for r in (0.2, 2.5):
        found = integral(ring, edges_to(r, e, profile))
        assert float(profile.total_within(r, e)) == pytest.approx(found, rel=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.3])
@pytest.mark.parametrize("profile", EVERY, ids=NAMES)
def test_total_is_all_of_it(profile, e):
    assert float(profile.total_within(np.inf, e)) == pytest.approx(float(profile.total(e)), rel=1e-12)
    far = 1e7 * profile.mean_free_path
    assert float(profile.total_within(far, e)) == pytest.approx(float(profile.total(e)), rel=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.3])
@pytest.mark.parametrize("profile", EVERY, ids=NAMES)
def test_spectrum_is_the_numerical_transform(profile, e):
    k = np.array([1e-3, 0.1, 1.0, 6.0]) / profile.mean_free_path
    kinks = getattr(profile, "radii", ())
    whole = float(profile.total(e))
    numerical = hankel(profile.radial, k, e, profile.mean_free_path, kinks)
    np.testing.assert_allclose(profile.spectrum(k, e), numerical, rtol=0.0, atol=1e-6 * whole)
    assert numerical[0] == pytest.approx(whole, rel=5e-3)  # a tail of 1/r^3 takes the first power of k


@pytest.mark.parametrize("profile", [EVERY[2], EVERY[5], RAMP], ids=["beam", "table", "ramp"])
def test_numerical_transform_is_that_of_a_sum_of_rings(profile):
    """By Bessel's integral over the disc function: F(k) = int k J1(k r) D(r) dr, in another quadrature."""
    from scipy.special import j1

    k = 2.0 / profile.mean_free_path
    nodes, weights = np.polynomial.legendre.leggauss(64)
    edges = np.unique(np.concatenate([edges_to(60.0, 0.0, profile), np.linspace(0.0, 60.0, 600)]))
    half = 0.5 * np.diff(edges)[:, None]
    r = edges[:-1, None] + half * (nodes + 1.0)
    rest = profile.total(0.0) - k * np.sum(half * weights * j1(k * r) * profile.total(r))
    assert float(profile.spectrum(np.array([k]))[0]) == pytest.approx(float(rest), abs=1e-6 * float(profile.total(0.0)))


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.5])
def test_finite_positive_and_falling_whatever_the_albedo(name, eta):
    rho = np.concatenate([[0.0], np.geomspace(1e-7, 1e7, 400)])
    for albedo in (0.0, 1e-6, 0.01, 0.3, 0.8, 0.99, 1.0 - 1e-9, 1.0):
        material = Material("m", (albedo,) * 3, (1.0 - albedo,) * 3, eta)
        for profile in OF(material, name):
            with np.errstate(all="raise", under="ignore"):
                value, total = profile.radial(rho), profile.total(rho)
                within = profile.total_within(rho, 0.3)
            for values in (value, total, within):
                assert np.isfinite(values).all()
                assert (values >= 0.0).all()
            assert (np.diff(value) <= 1e-12 * value[:-1]).all()
            assert (np.diff(total) <= 1e-9 * total[:-1]).all()
            if albedo > 0.0 or name == "table":
                assert not profile.is_black
                assert value[0] > 0.0
                assert 0.0 < float(profile.total(0.0)) < 1.1
                assert np.isfinite([profile.mean_free_path, profile.detail]).all()
                assert min(profile.mean_free_path, profile.detail) > 0.0
            else:
                assert profile.is_black


def test_nothing_to_meet_is_black():
    for name in [*PROFILES][:-1]:
        for sigma_a in (0.0, 1.0):
            assert all(p.is_black for p in profiles(Material("m", (0.0,) * 3, (sigma_a,) * 3, 1.3), name))


@pytest.mark.parametrize("name", [*PROFILES][:4])
def test_object_and_coefficients_scale_together(name):
    rho = np.array([0.01, 0.3, 2.0, 20.0])
    for s in (1e-3, 30.0):
        small = profiles(Material("m", (2.0,) * 3, (0.01,) * 3, 1.4), name)[0]
        large = profiles(Material("m", (2.0 / s,) * 3, (0.01 / s,) * 3, 1.4), name)[0]
        np.testing.assert_allclose(large.radial(s * rho) * s * s, small.radial(rho), rtol=1e-9)
        np.testing.assert_allclose(large.total(s * rho), small.total(rho), rtol=1e-9)


def test_fresnel_moments_are_those_of_the_published_fit():
    """pbrt's polynomials (d'Eon and Irving 2011), good to three digits."""
    for eta in (1.1, 1.3, 1.5, 2.0):
        powers = eta ** np.arange(6.0)
        first = np.dot([-4.61686, 11.1136, -10.4646, 5.11455, -1.27198, 0.12746], powers)
        assert internal_moments(eta)[0] == pytest.approx(2.0 * first, abs=4e-3)
    assert internal_moments(1.0) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_better_dipole_in_the_letters_of_its_paper():
    albedo, eta, rho = 0.95, 1.4, 1.7
    two_c1, three_c2 = internal_moments(eta)
    D, sigma_a = (2.0 * (1.0 - albedo) + albedo) / 3.0, 1.0 - albedo
    s, A = np.sqrt(sigma_a / D), (1.0 + three_c2) / (1.0 - two_c1)
    expected = 0.0
    for z, sign in ((1.0, 1.0), (-1.0 - 4.0 * A * D, -1.0)):
        d = np.hypot(rho, z)
        phi = np.exp(-s * d) / (4.0 * np.pi * D * d)
        flux = z * (1.0 + s * d) * np.exp(-s * d) / (4.0 * np.pi * d**3)
        expected += sign * (0.25 * (1.0 - two_c1) * phi + 0.5 * (1.0 - three_c2) * flux)
    assert float(BetterDipole(albedo, 1.0, eta).radial(rho)) == pytest.approx(albedo**2 * expected, rel=1e-12)


def test_without_absorption_dipoles_return_all_light():
    for eta in (1.0, 1.3, 2.5):
        assert float(BetterDipole(1.0, 0.4, eta).total(0.0)) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("x", [1e-4, 0.01, 1.0, 20.0])
def test_photon_beam_is_its_integrals(x):
    a, eta = 0.97, 1.3
    two_c1, three_c2 = internal_moments(eta)
    D = (2.0 - a) / 3.0
    s, z_b = np.sqrt((1.0 - a) / D), 2.0 * D * (1.0 + three_c2) / (1.0 - two_c1)

    def deep(z):
        dr, dv, zv = np.hypot(x, z), np.hypot(x, z + 2.0 * z_b), z + 2.0 * z_b
        phi = (np.exp(-s * dr) / dr - np.exp(-s * dv) / dv) / D
        flux = z * (1 + s * dr) * np.exp(-s * dr) / dr**3 + zv * (1 + s * dv) * np.exp(-s * dv) / dv**3
        return np.exp(-z) * -np.expm1(-2.0 * (dr + z)) * (0.25 * (1 - two_c1) * phi + 0.5 * (1 - three_c2) * flux)

    expected = a * a / (4.0 * np.pi) * integral(deep, [0.0, 0.1 * x, x, 10.0 * x, max(20.0 * x, 60.0)])
    assert float(multiple_scattering(np.array([x]), a, eta)[0]) == pytest.approx(expected, rel=1e-6)

    def once(t):  # pbrt's form: along the beam, beyond the depth from which light is reflected back totally
        d = np.hypot(x, t)
        cosine = np.sqrt(np.maximum(0.0, 1.0 - (eta * x / d) ** 2))
        return a * np.exp(-(t + d)) / d**2 * float(transmittance(eta, cosine)) * (t / d) / (4.0 * np.pi)

    start = x * np.sqrt(eta**2 - 1.0)
    near = start + np.array([0.0, 0.01, 0.1, 1.0, 10.0, 100.0]) * x
    expected = integral(once, [*near[near < 40.0 + start], 41.0 + start])
    assert float(single_scattering(np.array([x]), a, eta)[0]) == pytest.approx(expected, rel=1e-6)
    whole = float(multiple_scattering(np.array([x]), a, eta)[0]) + expected
    assert float(PhotonBeam(a, 1.0, eta).radial(x)) == pytest.approx(whole, rel=1e-6)


def test_photon_beam_total_without_a_table():
    for albedo in (0.01, 0.5, 0.97, 1.0):
        assert reflectance(albedo, 1.4) == pytest.approx(float(PhotonBeam(albedo, 3.0, 1.4).total(0.0)), rel=1e-6)


def test_burley_is_as_published():
    """Christensen and Burley 2015: A s (exp(-s r / l) + exp(-s r / (3 l))) / (8 pi l r), equations 3 and 5."""
    for albedo, s in ((0.8, 1.05), (0.5, 1.85 - 0.5 + 7.0 * 0.027), (0.2, 1.85 - 0.2 + 7.0 * 0.216)):
        r, length = 0.9, 1.7
        expected = albedo * s * (np.exp(-s * r / length) + np.exp(-s * r / (3.0 * length))) / (8.0 * np.pi * length * r)
        assert float(Burley(albedo, length).radial(r)) == pytest.approx(expected, rel=1e-12)
        assert float(Burley(albedo, length).total(0.0)) == pytest.approx(albedo, rel=1e-12)
        # their equation 11, the cumulative distribution
        cdf = 1.0 - 0.25 * np.exp(-s * r / length) - 0.75 * np.exp(-s * r / (3.0 * length))
        assert float(Burley(albedo, length).total_within(r)) == pytest.approx(albedo * cdf, rel=1e-12)


def test_skin_is_as_published():
    """GPU Gems 3, chapter 14: six Gaussians whose weights are a white."""
    np.testing.assert_allclose(np.sum([row[1:] for row in SKIN], axis=0), 1.0, atol=1e-9)
    means = []
    for channel in range(3):
        profile = skin(channel, 0.6)
        assert float(profile.total(0.0)) == pytest.approx(0.6, rel=1e-12)
        found = integral(lambda r, p=profile: 2 * np.pi * r * r * float(p.radial(r)), np.linspace(0.0, 20.0, 9)) / 0.6
        assert found == pytest.approx(np.sqrt(np.pi / 2) * sum(w[1 + channel] * w[0] ** 0.5 for w in SKIN), rel=1e-8)
        means.append(found)
    assert means[0] > 4.0 * means[1] > 4.0 * means[2]  # red bleeds furthest


def test_standard_dipole_is_still_the_default():
    assert profiles(SKIN1) == dipoles(SKIN1)


@pytest.mark.parametrize("profile", EVERY, ids=NAMES)
def test_split_of_ewald_keeps_the_total(profile):
    """Long range and local term together return all light of an evenly lit plane."""
    s = 1.3 * profile.mean_free_path
    table = ewald.long_range(profile, s, 4.0 * s)
    for e in (0.0, 1.5 * s):
        smooth = float(profile.total(e)) - float(ewald.local_table(profile, s)(e))
        # far outside the window R_L is R_d, so the disc's flux differs by what the rim bends
        disc = integral(lambda r, e=e: 2 * np.pi * r * float(table(np.hypot(r, e))), np.linspace(0.0, 3.5 * s, 12))
        beyond = float(profile.total(np.hypot(3.5 * s, e)))
        assert disc + beyond == pytest.approx(smooth, abs=0.01 * float(profile.total(0.0)))


@pytest.mark.parametrize("profile", EVERY, ids=NAMES)
def test_texel_means_sum_to_the_flux(profile):
    texel = 2.0 * profile.mean_free_path
    means = texel_means(profile, 0.0, texel, 6)
    assert np.isfinite(means).all()
    whole = texel**2 * (4.0 * means.sum() - 2.0 * means[0].sum() - 2.0 * means[:, 0].sum() + means[0, 0])
    inner, outer = (float(profile.total_within(r)) for r in (5.5 * texel, 5.5 * np.sqrt(2.0) * texel))
    assert inner * (1 - 5e-4) <= whole <= outer * (1 + 5e-4)  # a kink costs the rule of 32 nodes so much


def test_a_profile_in_the_registry_is_chosen_by_name(monkeypatch):
    monkeypatch.setitem(PROFILES, "exponential", "tests.support.exponential")
    assert profiles(SKIN1, "exponential")[1].total(0.0) == pytest.approx(float(SKIN1.alpha_prime[1]) ** 2)
    assert albedo_for(0.25, 1.3, "exponential") == pytest.approx(0.5)


NEW_PROFILE = """
import sys
from milkglass.core.profiles import registry
registry.PROFILES["exponential"] = "tests.support.exponential"
from milkglass.viewer.commands.cli import main
from milkglass.viewer.scene.settings_docs import settings_markdown
assert "`gaussians`, `table`, `exponential`" in settings_markdown()
assert "scipy" not in sys.modules
picture = ["--image-size", "32x24", "--samples", "1", "--transport", "layered", "--output", sys.argv[1]]
sys.exit(main(["render", sys.argv[2], "--profile", "exponential", *picture]))
"""


@pytest.mark.slow
@pytest.mark.gl
def test_a_profile_in_the_registry_is_in_help_and_pictures(model, tmp_path):
    command = [sys.executable, "-c", NEW_PROFILE, str(tmp_path / "a.exr"), str(model)]
    run = subprocess.run(command, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert read_channels(tmp_path / "a.exr")["exitance.R"].max() > 0.0
