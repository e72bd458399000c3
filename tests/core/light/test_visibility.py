"""The occluded environment against rays in float64, in furnaces and in cavities."""

import threading

import numpy as np
import pytest

from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.refine import refined
from milkglass.core.light.bake import LIFTS, RAYS_AT_A_TIME, bake, directions_for, plane_normals
from milkglass.core.light.casting import THREADS, BakeCancelled
from milkglass.core.light.harmonics import basis, rotated
from milkglass.core.light.probe import Probe, irradiance_table, irradiance_zonal, lookup, to_probe_frame
from milkglass.core.light.visibility import BLOCK_POINTS, MIN_UNOCCLUDED, Sight, blocks, phong_zonal, transfer
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.files.model import load_model
from milkglass.viewer.files.radiance import read_radiance
from tests.support.occluding import Places, irradiance, rms
from tests.support.shapes import ball, cube, torus_knot
from tests.support.solids import ball as part, block, mesh_of

ETA = 1.5
WHITE = np.ones((16, 32, 3), np.float32)


@pytest.fixture(scope="module")
def knot():
    """A mesh that is in its own way, what its vertices see, and places on it."""
    mesh = torus_knot()
    return mesh, transfer(bake(mesh)), Places(mesh, 150)


def occluded(mesh, visibility, places, probe, rotation, eta=ETA):
    """E at places by interpolated shares, (n, 3)."""
    shares = visibility.shares(rotated(probe.sh, rotation))[mesh.faces[places.faces]]
    whole = lookup(irradiance_table(probe.sh, eta), to_probe_frame(places.normals, rotation))
    return whole * np.einsum("nk,nkc->nc", places.weights, shares)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [ball, cube])
def test_a_convex_object_in_a_white_furnace_loses_nothing(shape):
    fine = refined(shape(), 4.0).mesh
    visibility = transfer(bake(fine))
    probe = Probe.from_pixels(WHITE)
    np.testing.assert_array_equal(visibility.shares(probe.sh), 1.0)
    # so that E is the hemispherical transmittance integral, whatever the normal
    expected = irradiance_zonal(ETA)[0]
    places = Places(fine, 200)
    np.testing.assert_allclose(occluded(fine, visibility, places, probe, 30.0), expected, rtol=1e-5)


@pytest.mark.slow
def test_the_faces_of_a_coarse_round_object_are_not_in_their_own_way():
    """Shading normals there look below the faces' planes, by up to 20 degrees."""
    fine = refined(ball(subdivisions=1), 2.0).mesh
    assert (plane_normals(fine) != 0.0).any(axis=1).mean() > 0.3
    shares = transfer(bake(fine)).shares(Probe.from_pixels(sky_pixels()).sh)
    assert shares.min() > 0.97
    assert shares.mean() > 0.998


@pytest.mark.slow
def test_a_closed_cavity_is_dark():
    mesh = mesh_of(part(10.0, subdivisions=2), part(8.0, subdivisions=2, inverted=True))
    shares = transfer(bake(mesh)).shares(Probe.from_pixels(sky_pixels()).sh)
    inside = np.linalg.norm(mesh.vertices, axis=1) < 9.0
    assert shares[inside].max() == 0.0
    assert shares[~inside].min() == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("eta", "limit"), [(1.0, 0.035), (1.3, 0.03), (1.5, 0.03), (2.0, 0.03)])
def test_irradiance_is_that_of_rays_whatever_eta(knot, eta, limit):
    (mesh, visibility, places), probe = knot, Probe.from_pixels(sky_pixels())
    rotations = [0.0, 30.0, 150.0]
    expected = irradiance(mesh, places, sky_pixels(), eta, rotations)
    actual = [occluded(mesh, visibility, places, probe, rotation, eta) for rotation in rotations]
    assert rms(actual, expected) < limit
    unoccluded = [lookup(irradiance_table(probe.sh, eta), to_probe_frame(places.normals, a)) for a in rotations]
    assert rms(unoccluded, expected) > 0.15  # there is something to find


@pytest.mark.slow
def test_flux_into_the_object_is_that_of_rays(knot):
    (mesh, visibility, _), probe = knot, Probe.from_pixels(sky_pixels())
    places = Places(mesh, 400)
    expected = irradiance(mesh, places, sky_pixels(), ETA).sum(axis=1)
    actual = occluded(mesh, visibility, places, probe, 0.0).sum(axis=0)
    np.testing.assert_allclose(actual, expected[0], rtol=0.01)


@pytest.mark.slow
def test_a_scan_under_uffizi(data_dir):
    mesh, _ = load_model(data_dir / "meshes" / "dragon_100k.ply", 100.0, "y")
    pixels = read_radiance(data_dir / "hdr" / "uffizi_latlong_1200x600.hdr")
    places, visibility, probe = Places(mesh, 500), transfer(bake(mesh)), Probe.from_pixels(pixels)
    rotations = np.arange(0.0, 360.0, 72.0)
    expected = irradiance(mesh, places, pixels, ETA, rotations)
    for rotation, reference in zip(rotations, expected, strict=True):
        assert rms(occluded(mesh, visibility, places, probe, rotation), reference) < 0.035


@pytest.mark.slow
def test_what_is_not_there_is_not_shared():
    """A black probe, and one that shines where a point cannot look, leave no NaN."""
    visibility = transfer(bake(ball(subdivisions=2)))
    assert np.isfinite(visibility.shares(np.zeros((1089, 3)))).all()
    below = np.zeros((64, 128, 3), np.float32)
    below[40:] = 1.0
    shares = visibility.shares(Probe.from_pixels(below).sh)
    assert ((shares >= 0.0) & (shares <= 1.0)).all()
    assert MIN_UNOCCLUDED < 1e-3


@pytest.mark.slow
def test_a_lobe_sees_what_is_free():
    """A ball over a block: the block's top reflects the sky beside the ball, and below it the ball."""
    mesh = refined(mesh_of(block((40.0, 2.0, 40.0)), part(8.0, (0.0, 10.0, 0.0))), 2.5).mesh
    visibility = transfer(bake(mesh))
    up = np.broadcast_to([0.0, 1.0, 0.0], mesh.vertices.shape)
    shares = visibility.lobe_shares(up, 80.0)
    top = (np.abs(mesh.vertices[:, 1] - 1.0) < 1e-3) & (mesh.normals[:, 1] > 0.9)
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2])
    assert shares[top & (radius < 2.0)].max() < 0.05
    assert shares[top & (radius > 18.0)].min() > 0.9
    assert ((shares >= 0.0) & (shares <= 1.0)).all()


def test_phong_factors_are_integrals():
    mu = (np.arange(200_000) + 0.5) / 200_000
    for shininess in (1.0, 7.0, 80.0):
        lobe = mu**shininess
        expected = [(lobe * np.polynomial.legendre.Legendre.basis(ell)(mu)).sum() / lobe.sum() for ell in range(7)]
        np.testing.assert_allclose(phong_zonal(shininess, 6), np.maximum(expected, 0.0), atol=1e-6)


def test_a_probe_is_turned_in_its_coefficients():
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sh = rng.normal(size=(81, 3))
    turned = basis(to_probe_frame(directions, 77.0), 8) @ sh
    np.testing.assert_allclose(basis(directions, 8) @ rotated(sh, 77.0), turned, atol=1e-12)


def test_the_same_mesh_gives_the_same_bits():
    mesh = ball(subdivisions=3)
    assert np.array_equal(bake(mesh).bits, bake(mesh).bits)


def test_small_meshes_get_more_rays_and_large_ones_fewer():
    assert [directions_for(n) for n in (100, 12_000, 50_000, 200_000, 10**6)] == [4096, 2048, 1024, 512, 256]
    sight = Sight(np.tile(np.float32([0, 1, 0]), (3, 1)), np.zeros((3, 32), np.uint8))
    assert transfer(sight, 4).unoccluded.shape == (3, 25)


def test_few_rays_are_cast_between_two_looks_at_whether_to_go_on(monkeypatch):
    """So that giving up takes as long as they do, whatever else the machine does: 0.02 s of a processor."""
    rays, seen, cancelled = [], [], threading.Event()
    cast = RayMesh.occluded

    def count(self, origins, directions):
        (seen if cancelled.is_set() else rays).append(len(origins))
        return cast(self, origins, directions)

    monkeypatch.setattr(RayMesh, "occluded", count)
    with pytest.raises(BakeCancelled):
        bake(ball(subdivisions=6), lambda share: cancelled.set() if share > 0.05 else None, cancelled)
    # One start at each lift; the one that each thread was at when it was given up, and the next that had passed.
    assert max(rays) <= 1.02 * RAYS_AT_A_TIME  # half of all directions are above a horizon, nearly
    assert len(seen) <= 2 * len(LIFTS) * THREADS
    assert len(rays) > 5


def test_harmonics_are_given_up_between_few_points():
    sight, asked = Sight(ball(subdivisions=4).normals, np.zeros((2562, 32), np.uint8)), []

    def check():
        asked.append(1)
        if len(asked) == 3:
            raise BakeCancelled

    visibility = transfer(sight, 4)
    for made in (lambda: transfer(sight, check=check), lambda: visibility.blocked(check)):
        asked.clear()
        with pytest.raises(BakeCancelled):
            made()
        assert len(asked) == 3
    assert max(len(points) for _, points in blocks(10**5)) <= BLOCK_POINTS


def test_progress_ends_at_one():
    shares = []
    bake(ball(subdivisions=2), shares.append)
    assert max(shares) == 1.0
