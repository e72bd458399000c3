"""What of light from all around collides before it leaves: closed forms of a ball and of a plate."""

import numpy as np
import pytest

from milkglass.core.geometry.rays import RayMesh
from milkglass.core.material.fresnel import reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from tests.support.diffusing import samples_of
from tests.support.solids import ball, block, mesh_of

ETA, RADIUS, THICKNESS = 1.33, 10.0, 1.0
ETAS = 1.0, 1.33, 1.5, 1.8


def placed(mesh, resolution=24) -> Boundary:
    transport = DiffusionTransport(resolution=resolution)
    grid = transport.grid(mesh, np.eye(3))
    return transport.boundary(mesh, samples_of(mesh, resolution), grid, Depths(mesh))


def colliding(chords, eta=ETA):
    """Share that collides where all chords of a path have one length, in mean free paths, by its cosine inside."""
    mu = (np.arange(20000) + 0.5) / 20000
    mirrored, kept = reflectance(eta, mu), np.exp(-chords(np.sqrt(1.0 - (1.0 - mu * mu) / eta**2)))
    share = 1.0 - (1.0 - mirrored) * kept / (1.0 - mirrored * kept)
    return np.average(share, weights=mu * (1.0 - mirrored))


@pytest.fixture(scope="module")
def sphere():
    return placed(mesh_of(ball(RADIUS, subdivisions=5)))


@pytest.fixture(scope="module")
def plate():
    return placed(mesh_of(block((60.0, 60.0, THICKNESS))))


@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize("mean_free_path", [5.0, 30.0, 300.0])
def test_in_a_ball(sphere, mean_free_path, eta):
    found = sphere.collisions.of(Medium(1.0 / mean_free_path, 0.0, eta))
    expected = colliding(lambda inside: 2.0 * RADIUS / mean_free_path * inside, eta)
    # Flat faces keep some light in that a ball lets out.
    assert np.average(found.share, weights=sphere.patches.areas) == pytest.approx(expected, abs=0.0035)
    assert found.share.std() < 0.02


@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize("optical_thickness", [0.1, 1.0, 4.0])
def test_in_the_middle_of_a_plate(plate, optical_thickness, eta):
    medium = Medium(0.9 * optical_thickness / THICKNESS, 0.1 * optical_thickness / THICKNESS, eta)
    found, (x, y, _) = plate.collisions.of(medium), np.abs(plate.patches.points.T)
    middle = np.maximum(x, y) < 15.0
    expected = colliding(lambda inside: optical_thickness / inside, eta)
    # What has been reflected twice leaves at once: more of it does at higher indices.
    assert found.share[middle].mean() == pytest.approx(expected, rel=0.015 if eta <= ETA else 0.028)
    if eta >= ETA:  # light that enters at the rim has far to go, bent as it is
        assert found.share[np.maximum(x, y) > 29.999].mean() > expected
    assert (found.curved <= found.share).all()


def test_all_collides_in_dense_matter(sphere):
    assert sphere.collisions.of(Medium(4.0, 0.1, ETA)) is None


def test_another_index_takes_no_other_rays(monkeypatch):
    """Ways through matter are the mesh's: an index says which of them light takes, and where it leaves."""
    boundary, cast = placed(mesh_of(ball(RADIUS, subdivisions=3)), 12), []
    for query in ("first", "occluded"):
        whole = getattr(RayMesh, query)
        monkeypatch.setattr(
            RayMesh, query, lambda *arguments, whole=whole: (cast.append(len(arguments[1])), whole(*arguments))[1]
        )
    boundary.collisions.of(Medium(0.05, 0.0, 1.5))
    rays = len(cast)
    assert rays > 0
    shares = [boundary.collisions.of(Medium(0.05, 0.0, eta)).share.mean() for eta in (1.3, 1.4)]
    assert len(cast) == rays
    assert shares[0] < shares[1]  # a higher index keeps light in


def test_light_towards_the_object_itself_goes_straight_across():
    """Below a small block it crosses a plate where that is thinnest, along its normal: less of it collides."""
    boundary = placed(mesh_of(block((40.0, 40.0, THICKNESS)), block((3.0, 3.0, 1.0), (0.0, 0.0, 3.0))))
    found, patches = boundary.collisions.of(Medium(1.0 / THICKNESS, 0.0, ETA)), boundary.patches
    x, y, z = patches.on_surface.T
    beneath, behind = (np.hypot(x, y) < 2.0) & (np.abs(z - 0.5) < 1e-3), (z < -0.499) & (np.hypot(x, y) < 10.0)
    np.testing.assert_allclose(found.towards[behind], 1.0, rtol=1e-6)  # which see no part of the object
    straight = (1.0 - 0.98 * np.exp(-1.0)) / colliding(lambda inside: 1.0 / inside)  # along the normal but for F_r
    assert beneath.any()
    assert ((found.towards > straight) & (found.towards < 0.98))[beneath].all()


@pytest.mark.parametrize("eta", ETAS)
def test_without_matter_next_to_nothing_collides_and_all_is_finite(plate, eta):
    found = plate.collisions.of(Medium(0.0, 0.0, eta))  # light that the plate keeps in has no end, and no free path
    assert all(np.isfinite(part.astype(np.float32)).all() for part in found)
    middle = np.abs(plate.patches.points[:, :2]).max(axis=1) < 15.0
    assert np.abs(found.share[middle]).max() < 0.02
