"""Constants of diffusion: published values, the transcendental equation solved another way, limits and extremes."""

import numpy as np
import pytest
from scipy.integrate import quad

from milkglass.core.material import library as materials, medium
from milkglass.core.material.medium import Medium, curvature_factor, extrapolation_factor, media


def reflectance_from_inside(eta: float, mu: float) -> float:
    """Fresnel's sines and tangents (Born and Wolf), not the quotients of cosines that `core.material.fresnel` has."""
    inside = np.arccos(mu)
    if eta * np.sin(inside) >= 1.0:
        return 1.0
    outside = np.arcsin(eta * np.sin(inside))
    if inside < 1e-6:
        return ((eta - 1.0) / (eta + 1.0)) ** 2
    less, more = inside - outside, inside + outside
    return 0.5 * ((np.sin(less) / np.sin(more)) ** 2 + (np.tan(less) / np.tan(more)) ** 2)


@pytest.mark.parametrize(("eta", "published"), [(1.3, 2.340532), (1.4, 2.948493), (1.5, 3.627933)])
def test_extrapolation_factor_as_published(eta, published):
    assert extrapolation_factor(eta) == pytest.approx(published, abs=6e-7)


@pytest.mark.parametrize("eta", [1.0001, 1.1, 1.33, 1.7, 2.5, 3.0])
def test_extrapolation_factor_is_that_of_the_integrals(eta):
    critical = np.sqrt(1.0 - 1.0 / eta**2)

    def moment(power):
        points = [critical, min(1.0, critical + 1e-3), min(1.0, critical + 0.03)]
        return quad(lambda mu: reflectance_from_inside(eta, mu) * mu**power, 0.0, 1.0, points=points, limit=500)[0]

    expected = (1.0 + 3.0 * moment(2)) / (1.0 - 2.0 * moment(1))
    assert extrapolation_factor(eta) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("g", [0.0, 0.3, 0.9, 0.999])
def test_the_scaled_phase_function_has_the_moments_of_the_measured_one(g):
    """Legendre moments of Henyey and Greenstein's are g^n: with the peak three of them stay, and so does diffusion."""
    cosine, weights = np.polynomial.legendre.leggauss(200)
    whole = Medium(2.0, 0.7, 1.33, g=g)
    scaled, scattering = whole.delta_eddington(), 2.0 / (1.0 - g)
    peak, rest = scattering - scaled.sigma_s, 0.5 * (1.0 + 3.0 * scaled.cosine * cosine)
    for n in range(3):
        of_rest = np.sum(weights * rest * np.polynomial.legendre.Legendre.basis(n)(cosine))
        assert peak + scaled.sigma_s * of_rest == pytest.approx(scattering * g**n, rel=1e-12)
    assert scaled.sigma_s * (1.0 - scaled.cosine) == pytest.approx(whole.sigma_s_prime, rel=1e-14)
    assert (scaled.sigma_t - whole.sigma_a, scaled.albedo) == pytest.approx(
        (scaled.sigma_s, scaled.sigma_s / scaled.sigma_t)
    )
    isotropic = whole.delta_eddington(0.0)
    assert (isotropic.sigma_t, isotropic.cosine) == (whole.sigma_t_prime, 0.0)
    assert (whole.diffusion, whole.bending(0.3)) == (
        Medium(2.0, 0.7, 1.33).diffusion,
        Medium(2.0, 0.7, 1.33).bending(0.3),
    )


def test_without_an_interface_nothing_is_reflected():
    assert extrapolation_factor(1.0) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("albedo", [0.2, 0.3, 0.5, 0.8, 0.9, 0.97, 0.99, 0.999, 0.99999])
def test_fluence_falls_as_in_transport(albedo):
    """sigma / s_t' = k, where a' / 2 int dmu / (1 - k mu) over [-1, 1] = 1: here the integral."""
    k = Medium(albedo, 1.0 - albedo, 1.3).attenuation
    near = [1.0 - 10.0**-power for power in range(1, 6)]  # the integrand rises steeply to mu = 1
    share = quad(lambda mu: 1.0 / (1.0 - k * mu), -1.0, 1.0, points=near, limit=500)[0]
    assert 0.5 * albedo * share == pytest.approx(1.0, rel=1e-8)


def test_known_eigenvalues_of_transport():
    """Discrete eigenvalues nu = 1 / k of isotropic scattering (Case and Zweifel 1967, table of kappa_0)."""
    for albedo, k in ((0.9, 0.525430), (0.8, 0.710412), (0.5, 0.957504)):
        assert Medium(albedo, 1.0 - albedo, 1.3).attenuation == pytest.approx(k, abs=2e-6)


@pytest.mark.parametrize(("albedo", "apart"), [(0.9, 0.0125), (0.97, 6e-3), (0.999, 2.1e-4), (1.0, 1e-12)])
def test_near_grosjean_where_little_is_absorbed(albedo, apart):
    of = Medium(2.0 * albedo, 2.0 * (1.0 - albedo), 1.3)
    grosjean = (2.0 * of.sigma_a + of.sigma_s_prime) / (3.0 * of.sigma_t_prime**2)
    assert of.diffusion == pytest.approx(grosjean, rel=apart)


@pytest.mark.parametrize("branch", [1e-5, 1.0 - medium.SMALLEST_ALBEDO])
def test_no_step_between_the_branches(branch):
    below, above = (
        medium.asymptotic_diffusion(branch * (1.0 - 1e-9)),
        medium.asymptotic_diffusion(branch * (1.0 + 1e-9)),
    )
    assert above == pytest.approx(below, rel=1e-8)


def test_diffusion_rises_with_absorption():
    absorbed = np.concatenate([np.geomspace(1e-9, 0.5, 500), np.linspace(0.5, 1.0, 500)])
    found = np.array([medium.asymptotic_diffusion(float(share)) for share in absorbed])
    # Between a third of a mean free path and all of it (where sigma is 1 / mfp').
    assert np.all(np.diff(found) >= -1e-12)
    assert found[0] == pytest.approx(1.0 / 3.0)
    assert found[-1] == 1.0


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.0, 2.5, 3.0])
def test_finite_for_every_albedo_and_index(eta):
    for absorbed in (0.0, 1e-300, 1e-16, 1e-6, 1e-5, 0.1, 0.5, 0.94, 0.999, 1.0):
        for scale in (1e-6, 1.0, 1e6):
            of = Medium(scale * (1.0 - absorbed), scale * absorbed, eta)
            values = np.array([of.diffusion, of.attenuation, of.extrapolation_factor, of.mean_free_path])
            assert np.isfinite(values).all()
            assert of.diffusion > 0.0
            assert of.extrapolation_factor >= 1.0 - 1e-12
            # In mean free paths nothing knows the scale.
            assert of.diffusion * scale == pytest.approx(Medium(1.0 - absorbed, absorbed, eta).diffusion, rel=1e-9)


def test_nothing_to_meet():
    clear = Medium(0.0, 0.0, 1.3)
    assert clear.is_black
    assert clear.albedo == 0.0
    assert clear.mean_free_path == float("inf")
    assert (clear.diffusion, clear.attenuation) == (float("inf"), 0.0)


def test_channels_of_a_material():
    red, green, blue = media(materials.lookup("marble"))
    assert (green.sigma_s_prime, green.sigma_a, green.eta) == (2.62, 0.0041, 1.5)
    assert red.sigma_s_prime < green.sigma_s_prime < blue.sigma_s_prime
    # Grosjean's D is 3e-4 off here; the document's value is his.
    assert green.diffusion == pytest.approx(0.127226, rel=5e-4)
    assert green.attenuation == pytest.approx(0.179516, rel=5e-4)


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.0])
def test_curvature_factor_is_that_of_the_integral(eta):
    """Of (1 - 3 mu^2) / 2 coming down after reflection, less what should; 1/4 without an interface."""
    critical = np.sqrt(1.0 - 1.0 / eta**2)
    points = [p for p in (critical, critical + 1e-3, critical + 0.03) if 0.0 < p < 1.0]

    def mean(of):
        return quad(lambda mu: reflectance_from_inside(eta, mu) * mu * of(mu), 0.0, 1.0, points=points, limit=500)[0]

    expected = 2.0 * (0.125 + mean(lambda mu: 0.5 - 1.5 * mu * mu)) / (1.0 - 2.0 * mean(lambda mu: 1.0))
    assert curvature_factor(eta) == pytest.approx(expected, rel=1e-5)


def test_extrapolation_around_cavities_and_in_balls():
    """Of photons from deep inside, in mean free paths, less a plane's: cavity of radius 7, without an interface."""
    of = Medium(1.0, 0.0, 1.0)
    flat = 2.0 * of.extrapolation_factor * of.diffusion
    assert flat * (of.bending(-2.0 / 7.0) - 1.0) == pytest.approx(0.779 - 0.710, abs=0.005)
    assert curvature_factor(1.0) == pytest.approx(0.25, abs=1e-12)


def test_a_curved_surface_has_an_extrapolation_factor_too():
    curvatures = np.array([-1e9, -1.0, -0.1, 0.0, 0.1, 1.0, 1e9])
    for of in (Medium(1.0, 0.0, 1.0), Medium(2.0, 0.1, 1.3), Medium(1e-300, 0.0, 3.0), Medium(1e300, 1.0, 1.5)):
        found = of.bending(curvatures)
        assert np.isfinite(found).all()
        assert found.min() > 0.5
        assert found.max() < 2.0
        assert found[3] == 1.0
        assert (np.diff(found) <= 0.0).all()
