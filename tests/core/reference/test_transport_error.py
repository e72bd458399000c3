"""Errors against photons, of transports that are made up and whose error is known."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.library import Material
from milkglass.core.reference.photon_lights import Beam
from milkglass.core.reference.photon_shapes import Sphere
from milkglass.core.reference.photons import walk
from milkglass.core.reference.regions import find_regions
from milkglass.core.reference.transport_error import (
    PhotonReference,
    between_parts_error,
    photon_reference,
    transport_error,
)
from tests.support.shapes import ball, cube, plate
from tests.support.solids import block, mesh_of, sheet

MILKY = Material("milky", (0.98, 0.95, 1.9), (0.02, 0.05, 0.1), 1.3)  # R and G share sigma_t'
ABOVE = Beam((0.0, 0.0, 2.0))


@pytest.fixture(scope="module")
def small() -> Mesh:
    return ball(8.0, subdivisions=3)


@pytest.fixture(scope="module")
def truth(small) -> PhotonReference:
    return photon_reference(small, MILKY, [ABOVE], regions=60, n_photons=60_000)


def same_regions(other: PhotonReference, factor: float = 1.0):
    """Make a transport of what photons said once before: samples and regions repeat themselves."""
    return lambda points, normals: factor * other.exitance[other.regions.of_sample]


@pytest.mark.parametrize("make", [ball, plate, cube])
def test_regions_are_of_a_size_and_cover_the_surface(make) -> None:
    mesh = make()
    regions = find_regions(mesh, 150)
    assert len(regions.areas) == 150
    assert regions.areas.sum() == pytest.approx(mesh.area, rel=1e-5)
    assert regions.samples.areas.sum() == pytest.approx(mesh.area, rel=1e-4)
    assert regions.areas.max() < 3.0 * mesh.area / 150
    assert set(regions.of_sample.tolist()) == set(range(150))


def test_regions_are_not_bent_around_edges() -> None:
    regions = find_regions(plate(20.0, 1.0, 10), 200)
    normals = regions.samples.normals
    mean = regions.mean(normals)
    np.testing.assert_allclose(np.linalg.norm(mean, axis=1), 1.0, rtol=1e-5)


def test_a_mesh_of_few_regions_keeps_its_solid() -> None:
    mesh = cube()
    divided = find_regions(mesh, 100).mesh
    assert divided.volume == pytest.approx(mesh.volume, rel=1e-6)


def test_truth_of_a_ball_is_that_of_the_sphere(truth) -> None:
    assert truth.lost < 1e-3
    assert truth.dark.mean() == pytest.approx(0.5, abs=0.1)
    np.testing.assert_array_equal(truth.entered[:, 0], truth.entered[:, 1])
    sphere = walk(Sphere(4.0), 1.0, MILKY.alpha_prime[:2], 1.3, ABOVE.direction, 60_000, seed=9)
    flux = truth.regions.areas @ truth.exitance[:, :2]
    np.testing.assert_allclose(flux, sphere.scattered.mean(axis=0).sum(axis=0), rtol=0.02)


def test_the_truth_itself_has_no_error_but_noise(small, truth) -> None:
    again = photon_reference(small, MILKY, [ABOVE], regions=60, n_photons=60_000, seed=77)
    error = transport_error(truth, same_regions(again))
    assert all(0.005 < noise < 0.05 for noise in error.noise)
    # The rms still holds the noise of one of the two.
    assert all(rms < 1.5 * noise for rms, noise in zip(error.rms, error.noise, strict=True))
    assert all(abs(b) < 6.0 * e for b, e in zip(error.bias, error.bias_error, strict=True))
    assert all(abs(b) < 6.0 * e for b, e in zip(error.dark, error.dark_error, strict=True))
    assert all(0.0 < e < 0.02 for e in (*error.bias_error, *error.dark_error))


@pytest.mark.parametrize("factor", [0.5, 1.25])
def test_a_factor_is_a_bias_and_an_rms(truth, factor) -> None:
    error = transport_error(truth, same_regions(truth, factor))
    np.testing.assert_allclose(error.bias, factor - 1.0, rtol=1e-4)
    np.testing.assert_allclose(error.dark, factor - 1.0, rtol=1e-4)
    np.testing.assert_allclose(error.rms, abs(factor - 1.0), rtol=0.02)


def test_points_and_normals_are_those_of_the_surface(truth) -> None:
    def inspect(points, normals):
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 4.0, rtol=0.02)
        np.testing.assert_allclose(np.einsum("ij,ij->i", points, normals), 4.0, rtol=0.02)
        return np.zeros((len(points), 3))

    error = transport_error(truth, inspect)
    np.testing.assert_allclose(error.bias, -1.0)


def test_lights_add_and_colours_scale(small) -> None:
    def flux(*lights: Beam) -> np.ndarray:
        found = photon_reference(small, MILKY, lights, regions=20, n_photons=20_000)
        return found.regions.areas @ found.exitance

    one = flux(ABOVE)
    np.testing.assert_allclose(flux(Beam((0.0, 0.0, 2.0), (1.0, 2.0, 0.0))), one * [1.0, 2.0, 0.0], rtol=1e-9)
    np.testing.assert_allclose(flux(ABOVE, Beam((0.0, 1.0, 0.0))), 2.0 * one, rtol=0.03)


def test_a_black_channel_has_no_error(small) -> None:
    black = Material("black", (1.0, 0.0, 0.0), (0.1, 1.0, 0.0), 1.3)
    error = transport_error(
        photon_reference(small, black, [ABOVE], regions=20, n_photons=5_000),
        lambda points, normals: np.zeros((len(points), 3)),
    )
    assert error.bias[0] == -1.0
    assert np.isnan(error.bias[1:]).all()


def test_where_all_is_lit_there_is_no_dark_side(small) -> None:
    around = [Beam(tuple(s * axis)) for s in (1.0, -1.0) for axis in np.eye(3)]
    truth = photon_reference(small, MILKY, around, regions=20, n_photons=2_000)
    assert not truth.dark.any()
    assert np.isnan(transport_error(truth, same_regions(truth)).dark).all()


def test_progress_rises_over_all_walks(small) -> None:
    shares: list[float] = []
    photon_reference(small, MILKY, [ABOVE], regions=20, n_photons=2_000, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.fixture(scope="module")
def between() -> PhotonReference:
    mesh = mesh_of(block((6.0, 6.0, 2.0), (0.0, 0.0, 2.0)), block((6.0, 6.0, 2.0), (0.0, 0.0, -2.0)))
    return photon_reference(mesh, MILKY, [ABOVE], regions=60, n_photons=30_000, between_parts=True)


def test_one_walk_judges_transport_alone_and_all_light(between) -> None:
    alone = transport_error(between, same_regions(between))
    assert alone.rms == (0.0, 0.0, 0.0)
    assert not between.whole.again.any()
    missing = transport_error(between.whole, same_regions(between))
    assert all(bias < -0.05 for bias in missing.bias)
    assert transport_error(between.whole, same_regions(between.whole)).rms == (0.0, 0.0, 0.0)


def test_light_between_parts_has_an_error_of_its_own(between) -> None:
    alone, whole = same_regions(between), same_regions(between.whole)
    absent, right = between_parts_error(between, alone, alone), between_parts_error(between, alone, whole)
    flux = [between.regions.areas @ reference.exitance for reference in (between, between.whole)]
    np.testing.assert_allclose(absent.share, 1.0 - flux[0] / flux[1], rtol=1e-6)
    assert all(0.3 * share < rms < 3.0 * share for rms, share in zip(absent.rms, absent.share, strict=True))
    assert all(0.0 < noise < 0.25 * rms for noise, rms in zip(absent.noise, absent.rms, strict=True))
    assert max(right.rms) == 0.0
    assert right.share == absent.share
    # An error of transport alone is not one of light between parts.
    same = between_parts_error(between, same_regions(between, 1.5), lambda *at: whole(*at) + 0.5 * alone(*at))
    assert max(same.rms) < 1e-6


def test_a_convex_object_has_no_light_between_parts(small) -> None:
    found = photon_reference(small, MILKY, [ABOVE], regions=20, n_photons=5_000, between_parts=True)
    assert not found.again.any()
    error = between_parts_error(found, same_regions(found), same_regions(found))
    assert error.share == error.rms == error.noise == (0.0, 0.0, 0.0)


def test_open_meshes_are_refused() -> None:
    with pytest.raises(InputError, match="closed"):
        photon_reference(mesh_of(sheet(0.0)), MILKY, [ABOVE], regions=4, n_photons=100)
