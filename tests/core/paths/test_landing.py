"""Light that comes through clear matter onto a plane below it."""

import numpy as np
import pytest

from milkglass.core.light.ground import GroundPlane
from milkglass.core.paths.emission import Ball, parallel
from milkglass.core.paths.landing import landed
from milkglass.core.paths.surface import Surface
from tests.support import solids

RADIUS, GAP = 10.0, 4.0
MESH = solids.mesh_of(solids.ball(RADIUS, subdivisions=5))
PLANE = GroundPlane.below(MESH, GAP)
LIGHT = parallel((0.0, 1.0, 0.0), (1.0, 2.0, 4.0), Ball.around(MESH), 60_000)


def disc(irradiance: np.ndarray, radius: float) -> np.ndarray:
    """Mean irradiance within a circle below the ball, (3,)."""
    places, areas = PLANE.places(), PLANE.areas()[:, None]
    within = np.hypot(places[:, 0], places[:, 2]) < radius
    return (irradiance * areas)[within].sum(axis=0) / areas[within].sum()


def test_light_through_what_does_not_bend_it_falls_as_without():
    found = landed(Surface.of(MESH, 1.0), LIGHT, PLANE, of_lamp=True).irradiance(PLANE, np.zeros((1, 3)))
    np.testing.assert_allclose(disc(found, 8.0), [1.0, 2.0, 4.0], rtol=0.02)
    assert not disc(found, 14.0).max() > 4.0 * (RADIUS / 14.0) ** 2 * 1.1


def test_matter_takes_away_by_the_way_through_it():
    extinctions = np.array([0.0, 0.05, 0.2])
    found = landed(Surface.of(MESH, 1.0), LIGHT, PLANE, of_lamp=True).irradiance(PLANE, extinctions[None])
    r = np.linspace(0.0, 5.0, 200)
    through = np.exp(-2.0 * extinctions * np.sqrt(RADIUS**2 - r[:, None] ** 2))
    expected = np.trapezoid(2.0 * r[:, None] * through, r, axis=0) / 25.0
    np.testing.assert_allclose(disc(found, 5.0), [1.0, 2.0, 4.0] * expected, rtol=0.03)


@pytest.mark.parametrize("of_lamp", [True, False])
def test_a_ball_of_glass_gathers_light_and_loses_none(of_lamp):
    found = landed(Surface.of(MESH, 1.5), LIGHT, PLANE, of_lamp=of_lamp)
    irradiance = found.irradiance(PLANE, np.zeros((1, 3)))
    assert disc(irradiance, 2.0)[0] > 5.0
    flux = found.power.sum(axis=0, dtype=np.float64) / (np.pi * RADIUS**2)
    # What is mirrored first goes down where the ball is met beyond 45 degrees; the rest leaves upwards or far away.
    assert 0.8 < flux[0] < 1.0
    np.testing.assert_allclose((irradiance * PLANE.areas()[:, None]).sum(axis=0), np.pi * RADIUS**2 * flux, rtol=0.02)
    if of_lamp:
        without = landed(Surface.of(MESH, 1.5), LIGHT, PLANE, of_lamp=False)
        assert without.power.sum() < found.power.sum()
