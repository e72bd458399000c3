"""A plane below an object: irradiance of what leaves a ball, and of the sky that the ball keeps from it."""

import threading

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.light.ground import RAYS, SIDE, GroundPlane, cast_from_ground, upward_directions
from milkglass.core.material.fresnel import hemispherical_transmittance
from tests.support.shapes import ball, cube

GAP = 5.0
BALL = ball()
RADIUS = float(BALL.bounds[1, 1])


@pytest.fixture(scope="module")
def below():
    plane = GroundPlane.below(BALL, GAP)
    return plane, cast_from_ground(BALL, plane)


def form_factor(plane: GroundPlane) -> np.ndarray:
    """Share of a place's irradiance that a whole ball above the horizon is the source of: r^2 h / d^3, exact."""
    offsets = -plane.places().astype(np.float64)
    return RADIUS**2 * offsets[:, 1] / np.linalg.norm(offsets, axis=1) ** 3


def test_a_glowing_ball_lights_the_plane_as_its_form_factor_says(below):
    plane, rays = below
    # Without an interface the ball is a diffuse emitter, of radiance M / pi.
    glow = np.asarray(rays.glow(1.0, np.pi, np.zeros(len(BALL.faces), int), 1).sum(axis=1)).ravel()
    expected = form_factor(plane)
    assert expected.max() == pytest.approx((RADIUS / (RADIUS + GAP)) ** 2, rel=1e-3)
    # A ray is 1 / RAYS of the irradiance: no place is off by more than a few of them.
    assert np.abs(glow - expected).max() < 7.0 / RAYS
    assert np.sqrt(np.mean(np.square(glow - expected))) < 1.2 / RAYS
    assert glow.sum() == pytest.approx(expected.sum(), rel=0.01)


def test_flux_of_the_ball_is_its_exitance_with_an_interface_too(below):
    """F_t M / (pi T) has the flux M: below the middle of a wide emitter, E is M less what lies beside it."""
    eta = 1.5
    slab = cube(20.0)
    plane = GroundPlane.below(slab, 0.0)
    rays = cast_from_ground(slab, plane)
    transmittance = hemispherical_transmittance(eta)
    glow = np.asarray(rays.glow(eta, np.pi * transmittance, np.zeros(len(slab.faces), int), 1).sum(axis=1)).ravel()
    under = np.abs(plane.places()[:, [0, 2]]).max(axis=1) < 8.0  # below a face that lies on the plane
    np.testing.assert_allclose(glow[under], 1.0, rtol=5e-3)
    assert not np.unpackbits(rays.free, axis=1)[under].any()


def test_the_share_of_a_uniform_sky_is_what_the_ball_leaves(below):
    plane, rays = below
    shares = rays.visible_share(np.tile([1.0, 2.0, 0.0], (RAYS, 1)))
    assert np.abs(shares[:, 0] - (1.0 - form_factor(plane))).max() < 7.0 / RAYS
    np.testing.assert_array_equal(shares[:, 0], shares[:, 1])
    np.testing.assert_array_equal(shares[:, 2], 1.0)  # no light: nothing is missing


def test_rays_are_distributed_like_their_cosine():
    directions = upward_directions(4096).astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(directions.mean(axis=0), [0.0, 2.0 / 3.0, 0.0], atol=1e-3)


def test_the_map_is_finest_below_the_foot_and_reaches_where_the_plane_ends():
    foot = np.array([[8.0, -20.0, 3.0]], np.float32) + 0.05 * BALL.vertices
    mesh = Mesh(np.concatenate([BALL.vertices, foot]), np.tile(BALL.normals, (2, 1)),
                np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)]))  # fmt: skip
    plane = GroundPlane.below(mesh, 1.0)
    np.testing.assert_allclose(plane.centre, [8.0, 3.0], atol=0.05)
    assert plane.height == pytest.approx(float(mesh.bounds[0, 1]) - 1.0)
    along = plane.places().reshape(SIDE, SIDE, 3)[0, :, 0]
    steps = np.diff(along)
    assert steps.argmin() in (SIDE // 2 - 1, SIDE // 2 - 2)
    assert abs(along[-1] - plane.centre[0]) < plane.reach < abs(along[-1] - plane.centre[0]) + steps[-1]


def test_casting_ends_when_it_is_cancelled(below):
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(BakeCancelled):
        cast_from_ground(BALL, below[0], cancelled=cancelled)
