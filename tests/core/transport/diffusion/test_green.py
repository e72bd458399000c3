"""Green's function of diffusion in two parts, against quadrature of what defines them."""

import numpy as np
import pytest
from scipy.integrate import quad

from milkglass.core.material.medium import Medium
from milkglass.core.transport import ewald
from milkglass.core.transport.diffusion import green
from milkglass.core.transport.diffusion.green import local_green, local_slope, smooth_green

S = 0.35  # mm
MARBLE = Medium(2.62, 0.0041, 1.5)
MEDIA = {
    "marble G": MARBLE,
    "no absorption": Medium(2.62, 0.0, 1.5),
    "hardly any": Medium(2.62, 1e-13, 1.5),
    "ketchup B": Medium(0.03, 1.45, 1.3),
    "opaque": Medium(1.0, 150.0, 1.3),  # sigma s = 53
}


def integral(function, *points):
    """Over the window about 0, with breaks where the integrand has them."""
    reach = 9.0 * S
    inner = [p for p in points if -reach < p < reach]
    return quad(function, -reach, reach, points=[*inner, 0.0], limit=2000, epsabs=1e-13, epsrel=1e-11)[0]


def green_on_a_line(medium, r):
    """Int w(t) sgn(r - t) exp(-sigma |r - t|) dt."""
    sigma = medium.attenuation
    near = [] if sigma == 0.0 else [r - 5.0 / sigma, r + 5.0 / sigma, r - 30.0 / sigma, r + 30.0 / sigma]
    return integral(lambda t: ewald.window(t, S) * np.sign(r - t) * np.exp(-sigma * abs(r - t)), r, *near)


@pytest.mark.parametrize("name", MEDIA)
@pytest.mark.parametrize("r", [0.01, 0.2, 0.5, 1.0, 1.7])
def test_smooth_part_is_the_filtered_function(name, r):
    medium = MEDIA[name]
    expected = green_on_a_line(medium, r) / (4.0 * np.pi * medium.diffusion * r)
    largest = float(smooth_green(medium, S, 0.0))
    assert float(smooth_green(medium, S, r)) == pytest.approx(
        expected, rel=1e-8, abs=2e-7 * largest
    )  # sigma s = 50 costs digits


@pytest.mark.parametrize("name", MEDIA)
def test_smooth_part_at_its_own_place(name):
    """The quotient's limit: the slope of the integral, 2 w(0) - sigma int w(t) exp(-sigma |t|) dt."""
    medium = MEDIA[name]
    sigma = medium.attenuation
    near = [] if sigma == 0.0 else [-5.0 / sigma, 5.0 / sigma]
    slope = 2.0 * float(ewald.window(0.0, S))
    slope -= sigma * integral(lambda t: ewald.window(t, S) * np.exp(-sigma * abs(t)), *near)
    assert float(smooth_green(medium, S, 0.0)) == pytest.approx(slope / (4.0 * np.pi * medium.diffusion), rel=1e-5)


@pytest.mark.parametrize("name", MEDIA)
def test_no_step_near_the_origin(name):
    r = S * np.array([0.0, 0.5e-4, 1e-4, 1.01e-4, 2e-4, 1e-3])
    values = smooth_green(MEDIA[name], S, r)
    np.testing.assert_allclose(values, values[0], rtol=1e-5)


@pytest.mark.parametrize("name", ["marble G", "no absorption"])
def test_smooth_part_is_the_function_itself_far_away(name):
    medium = MEDIA[name]
    for r in (3.0, 10.0, 50.0):
        # Up to the window's transform at the imaginary frequency of the tail: 1 + (sigma s)^6 / 48.
        whole = np.exp(-medium.attenuation * r) / (4.0 * np.pi * medium.diffusion * r)
        assert float(smooth_green(medium, S, r)) == pytest.approx(whole, rel=1e-6)


def plane(medium, e):
    """G integrated over a plane at distance e, less the constant that is infinite without absorption."""
    sigma = medium.attenuation
    share = -e if sigma == 0.0 else np.expm1(-sigma * e) / sigma
    return share / (2.0 * medium.diffusion)


@pytest.mark.parametrize("name", MEDIA)
@pytest.mark.parametrize("e", [0.0, 0.1, 0.35, 0.9, 1.4])
def test_local_part_is_what_the_window_takes(name, e):
    medium = MEDIA[name]
    near = [] if medium.attenuation == 0.0 else [e - 5.0 / medium.attenuation, e + 5.0 / medium.attenuation]
    expected = plane(medium, e) - integral(lambda t: ewald.window(t, S) * plane(medium, abs(e - t)), e, *near)
    # LEAST_DECAY stands for no absorption: 1e-8 is what the difference of large numbers leaves of it.
    largest = abs(float(local_green(medium, S, 0.0)))
    assert float(local_green(medium, S, e)) == pytest.approx(expected, abs=3e-7 * largest)


@pytest.mark.parametrize("name", ["marble G", "ketchup B", "opaque"])
@pytest.mark.parametrize("e", [0.0, 0.2, 0.7])
def test_both_parts_together_are_the_plane(name, e):
    """Over a plane: 2 pi int_e^inf G_L(r) r dr + rho(e) = exp(-sigma e) / (2 D sigma)."""
    medium = MEDIA[name]
    far = max(9.0 * S, e + 45.0 / medium.attenuation)
    smooth = quad(lambda r: r * float(smooth_green(medium, S, r)), e, far, points=[3.0 * S], limit=2000, epsrel=1e-11)
    whole = np.exp(-medium.attenuation * e) / (2.0 * medium.diffusion * medium.attenuation)
    at_zero = 1.0 / (2.0 * medium.diffusion * medium.attenuation)
    found = 2.0 * np.pi * smooth[0] + float(local_green(medium, S, e))
    assert found == pytest.approx(whole, abs=1e-7 * at_zero)


@pytest.mark.parametrize("name", MEDIA)
@pytest.mark.parametrize("e", [0.05, 0.35, 0.9])
def test_slope_of_the_local_part(name, e):
    medium = MEDIA[name]
    expected = 0.5 * (green_on_a_line(medium, e) - np.exp(-medium.attenuation * e))
    assert float(local_slope(medium, S, e)) == pytest.approx(expected, abs=2e-5)


def test_published_values():
    """diffusion.md's, by adaptive quadrature of coarse tolerance and Grosjean's D: equal to 1e-3 here."""
    np.testing.assert_allclose(local_green(MARBLE, S, [0.0, 0.2]), [0.4113626, -0.0586595], rtol=1e-3)
    np.testing.assert_allclose(smooth_green(MARBLE, S, [0.5, 1.0, 2.0]), [1.270095, 0.5165169, 0.2184024], rtol=1e-3)


@pytest.mark.parametrize("decay", [1e-9, 1e-5, 1.0, 30.0, 300.0, 3000.0, 1e5])
def test_finite_and_of_one_sign_at_any_decay(decay):
    """Materials reach 1e6 / mm; the smooth part of an opaque one is a small bump, not the noise of a difference."""
    medium = Medium(decay, decay, 1.3) if decay > 1.0 else Medium(1.0, decay**2, 1.3)
    r = np.linspace(0.0, 9.0, 400)
    smooth, local = smooth_green(medium, 1.0, r), local_green(medium, 1.0, r)
    assert np.isfinite(smooth).all()
    assert np.isfinite(local).all()
    assert local[0] > 0.0
    # What is absorbed of a unit source is all of it: s_a int G_L dV = 1.
    if decay > 10.0:
        bump = window_in_space(r) / medium.sigma_a
        assert np.abs(smooth - bump).max() <= 0.02 * bump.max()
        assert float(local_green(medium, 1.0, 0.0)) == pytest.approx(
            0.5 / (medium.diffusion * medium.attenuation) - float(ewald.window(0.0, 1.0)) / medium.sigma_a, rel=1e-3
        )


@pytest.mark.parametrize("part", [smooth_green, local_green])
def test_no_step_where_a_material_counts_as_opaque(part):
    r, edge = S * np.linspace(0.0, 4.0, 50), green.LARGEST_ATTENUATION / S
    below, above = (part(Medium(1e-4 * edge, factor * edge, 1.3), S, r) for factor in (0.999, 1.0005))
    sigma = [Medium(1e-4 * edge, factor * edge, 1.3).attenuation * S for factor in (0.999, 1.0005)]
    assert sigma[0] < green.LARGEST_ATTENUATION < sigma[1]
    assert np.abs(above - below).max() < 5e-3 * np.abs(below).max()


def window_in_space(r):
    """The window in three dimensions, whose transform is exp(-x) (1 + x + x^2 / 2), for s = 1: what a point becomes."""
    u = r * r
    gaussian = np.exp(-0.5 * u) / (2.0 * np.pi) ** 1.5
    return gaussian * (1.0 + (3.0 - u) / 2.0 + (15.0 - 10.0 * u + u * u) / 8.0)
