"""What of light from all around collides before it leaves: closed forms of a ball and of a plate."""

import numpy as np
import pytest

from milkglass.core.material.fresnel import reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from tests.support.diffusing import samples_of
from tests.support.solids import ball, block, mesh_of

ETA, RADIUS, THICKNESS = 1.33, 10.0, 1.0


def placed(mesh, resolution=24) -> Boundary:
    transport = DiffusionTransport(resolution=resolution)
    grid = transport.grid(mesh, np.eye(3))
    return transport.boundary(mesh, samples_of(mesh, resolution), grid, Depths(mesh))


def colliding(chords):
    """Share that collides where all chords of a path have one length, in mean free paths, by its cosine inside."""
    mu = (np.arange(20000) + 0.5) / 20000
    mirrored, kept = reflectance(ETA, mu), np.exp(-chords(np.sqrt(1.0 - (1.0 - mu * mu) / ETA**2)))
    share = 1.0 - (1.0 - mirrored) * kept / (1.0 - mirrored * kept)
    return np.average(share, weights=mu * (1.0 - mirrored))


@pytest.fixture(scope="module")
def sphere():
    return placed(mesh_of(ball(RADIUS, subdivisions=5)))


@pytest.fixture(scope="module")
def plate():
    return placed(mesh_of(block((60.0, 60.0, THICKNESS))))


@pytest.mark.parametrize("mean_free_path", [5.0, 30.0, 300.0])
def test_in_a_ball(sphere, mean_free_path):
    found = sphere.collisions.of(Medium(1.0 / mean_free_path, 0.0, ETA))
    expected = colliding(lambda inside: 2.0 * RADIUS / mean_free_path * inside)
    # Flat faces keep some light in that a ball lets out.
    assert np.average(found.share, weights=sphere.patches.areas) == pytest.approx(expected, abs=0.003)
    assert found.share.std() < 0.02


@pytest.mark.parametrize("optical_thickness", [0.1, 1.0, 4.0])
def test_in_the_middle_of_a_plate(plate, optical_thickness):
    medium = Medium(0.9 * optical_thickness / THICKNESS, 0.1 * optical_thickness / THICKNESS, ETA)
    found, (x, y, _) = plate.collisions.of(medium), np.abs(plate.patches.points.T)
    middle = np.maximum(x, y) < 15.0
    expected = colliding(lambda inside: optical_thickness / inside)
    assert found.share[middle].mean() == pytest.approx(expected, rel=0.015)
    # Light that enters at the rim has far to go.
    assert found.share[np.maximum(x, y) > 29.999].mean() > expected
    assert (found.curved <= found.share).all()


def test_all_collides_in_dense_matter(sphere):
    assert sphere.collisions.of(Medium(4.0, 0.1, ETA)) is None
