"""What diffusion lacks of a half space's light: its closed forms, photons, and a ball of dark matter."""

import numpy as np
import pytest

from milkglass.core.material import adding, fresnel
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering, mean_cosine
from milkglass.core.material.single_scattering import reflectance_at
from milkglass.core.reference.photon_shapes import Slab, Sphere
from milkglass.core.reference.photons import walk
from milkglass.core.transport.diffusion.green import local_green
from milkglass.core.transport.diffusion.half_space import gain, returned
from milkglass.core.transport.diffusion.pixels import tables
from tests.support.diffusing import collimated, diffuse, samples_of, slab
from tests.support.shapes import ball

DARK = Medium(0.1, 0.9, 1.3), Medium(0.3, 0.7, 1.3), Medium(0.5, 0.5, 1.3)
DEEP = np.full(1, np.inf)


@pytest.mark.parametrize("outside", [1.0, 0.5, 0.1])
def test_photons_return_from_any_slant(outside):
    """A slab of 25 mean free paths is a half space to dark matter."""
    albedos, eta = (0.3, 0.9), 1.4
    inside = np.sqrt(1.0 - (1.0 - outside**2) / eta**2)
    towards = np.sqrt(1.0 - outside**2), 0.0, -outside
    found = walk(Slab(25.0), 1.0, albedos, eta, towards, 60_000, seed=2)
    for i, albedo in enumerate(albedos):
        shares = found.scattered[:, 0, i] / found.entered.sum()
        error = shares.std(ddof=1) / np.sqrt(len(shares))
        assert error < 0.02 * shares.mean()
        assert abs(shares.mean() - reflectance_at(np.array([inside]), albedo, eta)[0]) < 4.0 * error


@pytest.mark.parametrize("medium", DARK)
def test_what_diffusion_returns_is_that_of_a_thick_slab(medium):
    depths, weights = first_scattering(DEEP)
    for cosine in (0.7, 1.0):
        thick, _ = slab(medium, 40.0, cosine * depths[0], weights[0])
        assert returned(medium, np.array([cosine]))[0] == pytest.approx(thick, rel=1e-9)


@pytest.mark.parametrize("eta", [1.3, 1.5])
def test_the_ratio_is_next_to_1_where_it_fades_out(eta):
    cosines = np.linspace(np.sqrt(1.0 - 1.0 / eta**2), 1.0, 7)
    for albedo, least in ((0.9, 0.02), (0.99, 0.005), (1.0, 1e-6)):
        medium = Medium(albedo, 1.0 - albedo, eta)
        ratio = reflectance_at(cosines, albedo, eta) / returned(medium, cosines)
        np.testing.assert_allclose(ratio, 1.0, atol=least)
        assert (gain(medium, cosines, np.full(7, np.inf)) == 1.0).all()
    np.testing.assert_allclose(gain(Medium(0.8999, 0.1001, eta), cosines, np.full(7, np.inf)), 1.0, atol=1e-4)


@pytest.mark.parametrize("medium", DARK)
def test_a_half_space_returns_what_it_does_and_a_film_as_diffusion_has_it(medium):
    cosine = np.array([0.8, 0.93])
    expected = reflectance_at(cosine, medium.albedo, medium.eta)
    np.testing.assert_allclose(gain(medium, cosine, DEEP) * returned(medium, cosine), expected, rtol=1e-3)
    np.testing.assert_allclose(gain(medium, cosine, np.array([0.01])), 1.0, atol=1e-6)


@pytest.mark.parametrize("albedo", [0.1, 0.5, 0.7])
def test_matter_that_scatters_forward_returns_less(albedo):
    cosine, scattering = np.array([0.8, 0.93]), albedo / (1.0 - 0.9)
    medium = Medium(albedo, 1.0 - albedo, 1.33, g=0.9)
    expected = adding.reflectance_at(cosine, scattering / (scattering + 1.0 - albedo), 0.9, 1.33)
    np.testing.assert_allclose(gain(medium, cosine, DEEP) * returned(medium, cosine), expected, rtol=3e-3)
    np.testing.assert_allclose(gain(medium, cosine, np.array([0.01])), 1.0, atol=1e-6)


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5])
def test_light_from_all_around_is_that_of_its_mean_cosine(eta):
    """Pixels and patches have it so; without a boundary grazing light is lacking most, and the mean with it."""
    outside = (np.arange(400) + 0.5) / 400
    inside = np.maximum(np.sqrt(1.0 - (1.0 - outside**2) / eta**2), 1e-3)
    entering = outside * fresnel.transmittance(eta, outside)
    for albedo in (0.1, 0.5, 0.7):
        medium = Medium(albedo, 1.0 - albedo, eta)
        mean = np.average(reflectance_at(inside, albedo, eta), weights=entering)
        at_mean = np.array([mean_cosine(eta)])
        assert (gain(medium, at_mean, DEEP) * returned(medium, at_mean))[0] == pytest.approx(
            mean, rel=0.005 if eta > 1.0 else 0.05
        )


def test_pixels_count_light_as_patches_do():
    """Of the table's factor over that of a medium of no lack, thick and thin."""
    medium, reach, s = DARK[1], 8.0, 0.5
    equation = tables(reach, DARK, s)
    critical = equation.least_cosine
    cosines, thickness = np.linspace(critical, 1.0, len(equation.front)), reach * 20 / 47
    depths, weights = first_scattering(thickness / cosines)
    plain = medium.albedo * np.sum(weights * local_green(medium, s, depths * cosines[:, None]), axis=1)
    factor = gain(medium, cosines, thickness / cosines)
    np.testing.assert_allclose(equation.front[:, 20, 1], factor * plain, rtol=1e-4)


@pytest.mark.slow
def test_a_ball_of_dark_matter_against_a_photon_walk():
    """Of 30 mean free paths: 1 to 2 %, where diffusion alone lacks 8 to 17 %."""
    radius = 30.0
    mesh = ball(2.0 * radius)
    samples = samples_of(mesh)
    found = diffuse(mesh, DARK, light=collimated(samples, eta=1.3), samples=samples)
    truth = walk(Sphere(radius), 1.0, [m.albedo for m in DARK], 1.3, (0.0, 0.0, 1.0), 200_000, seed=4)
    patches = found.patches
    mu = patches.points[:, 2] / np.linalg.norm(patches.points, axis=1)
    bins = np.clip((0.5 * (1.0 - mu) * 16).astype(int), 0, 15)
    for channel in range(3):
        M = np.bincount(bins, patches.areas * found.exitance(channel), 16) / np.bincount(bins, patches.areas, 16)
        expected = truth.exitance[:, channel]
        assert np.linalg.norm(M - expected) < 0.035 * np.linalg.norm(expected)
        assert M.sum() == pytest.approx(expected.sum(), rel=0.03)
