"""Wide lamps and surroundings for photons: irradiance in closed form, and the lights that they are limits of."""

import numpy as np
import pytest

from milkglass.core.light.probe import Probe, irradiance_direct
from milkglass.core.material import fresnel
from milkglass.core.reference.photon_lights import Beam, Surroundings
from milkglass.core.reference.photon_shapes import ClosedMesh, Slab, Sphere
from milkglass.core.reference.photons import walk
from milkglass.viewer.scene.camera import world_to_probe
from tests.support.shapes import ball, cube
from tests.support.skies import sky

ETA = 1.3
ALL = np.arange(3)


def entered(light, solid, photons: int = 100_000) -> np.ndarray:
    """E dA of R, G and B that enters the bins, F_t included: (n_bins, 3)."""
    flux = np.zeros((len(solid.areas), 3))
    for channels, direction, irradiance in light.walks(ALL):
        tally = walk(solid, 20.0, [0.0], ETA, direction, photons)
        flux[:, channels] += tally.entered[:, None] * irradiance
    return flux


@pytest.mark.parametrize("angle", [2.0, 40.0, 180.0])
def test_a_disc_has_its_irradiance_on_what_faces_it(angle) -> None:
    light = Beam((0.0, 0.0, -2.0), (1.0, 2.0, 0.5), angle)
    ((channels, direction, irradiance),) = light.walks(ALL)
    directions = direction.drawn(np.random.default_rng(0), 100_000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=0), 1.0, rtol=1e-9)
    assert (-directions[2]).min() >= np.cos(0.5 * np.radians(angle)) - 1e-9
    np.testing.assert_allclose(-directions[2].mean() * irradiance, light.irradiance, rtol=0.01)
    np.testing.assert_array_equal(channels, ALL)


def test_half_of_all_directions_light_a_slab_as_all_around_do() -> None:
    found = entered(Beam((0.0, 0.0, -1.0), angle_deg=180.0), Slab(3.0))
    assert found[0] == pytest.approx(fresnel.hemispherical_transmittance(ETA), rel=0.01)
    assert not found[1].any()


@pytest.mark.parametrize("solid", [Sphere(2.0), ClosedMesh(ball(4.0, subdivisions=3)), ClosedMesh(cube(4.0))])
def test_a_small_disc_is_a_beam(solid) -> None:
    direction = (0.2, 0.3, 0.9)
    sharp, disc = (entered(Beam(direction, angle_deg=angle), solid).sum(axis=0) for angle in (0.0, 0.1))
    np.testing.assert_allclose(disc, sharp, rtol=0.01)


def sides() -> tuple[ClosedMesh, np.ndarray]:
    """A cube with a bin for each side, and their normals."""
    mesh = cube(4.0)
    normals, side = np.unique(np.round(mesh.normals[mesh.faces[:, 0]]), axis=0, return_inverse=True)
    return ClosedMesh(mesh, side.ravel()), normals.astype(np.float64)


def test_white_surroundings_are_light_from_all_around() -> None:
    solid, _ = sides()
    white = Surroundings(np.full((16, 32, 3), 1.0 / np.pi, np.float32), np.eye(3))
    around = walk(solid, 20.0, [0.0], ETA, None, 100_000).entered
    np.testing.assert_allclose(entered(white, solid), np.repeat(around[:, None], 3, axis=1), rtol=0.03)


def test_a_turned_sky_lights_faces_as_the_probe_says() -> None:
    probe = Probe.from_pixels(sky(((0.3, 0.6, -0.5), 30.0, (30.0, 20.0, 5.0)), height=32))
    turn, (solid, normals) = world_to_probe(75.0), sides()
    found = entered(Surroundings(probe.latlong, turn, 2.0), solid) / solid.areas[:, None]
    wanted = 2.0 * irradiance_direct(probe.latlong, normals @ turn, ETA)
    np.testing.assert_allclose(found, wanted, rtol=0.03, atol=0.01 * wanted.max())
