"""A plane below an object: what leaves a ball for it, the sky that the ball keeps from it, and what it gives back."""

import threading

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.light.ground import (
    RAYS,
    SIDE,
    GroundExchange,
    GroundMirror,
    GroundPlane,
    GroundReturn,
    Horizon,
    cast_from_ground,
    upward_directions,
)
from milkglass.core.light.probe import Probe, irradiance_direct
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
    glow = np.asarray(rays.glow(1.0, np.zeros(len(BALL.faces), int), 1, np.pi).sum(axis=1)).ravel()
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
    glow = np.asarray(rays.glow(eta, np.zeros(len(slab.faces), int), 1).sum(axis=1)).ravel()
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


def test_the_plane_gives_back_what_a_sphere_sees_of_a_disc(below):
    """Radiance 1 within a circle, seen from vertices without an interface, by other rays."""
    plane, rays = below
    places = plane.places().astype(np.float64)
    radius, rng = 2.0 * RADIUS, np.random.default_rng(3)
    disc = (np.hypot(places[:, 0], places[:, 2]) < radius).astype(np.float32)
    received = rays.returning.matrix(1.0) @ disc
    for vertex in rng.choice(len(BALL.vertices), 40, replace=False):
        point, normal = BALL.vertices[vertex].astype(np.float64), BALL.normals[vertex].astype(np.float64)
        towards = rng.normal(size=(20000, 3))
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True) + normal
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        end = point + (plane.height - point[1]) / towards[:, 1:2] * towards
        expected = np.pi * np.mean((towards[:, 1] < 0.0) & (np.hypot(end[:, 0], end[:, 2]) < radius))
        assert received[vertex] == pytest.approx(expected, abs=0.04 * np.pi)


def test_below_the_horizon_a_probe_is_the_plane(below):
    latlong = np.zeros((32, 64, 3), np.float32)
    latlong[:16], latlong[16:] = (1.0, 2.0, 3.0), 100.0
    horizon = Horizon.of(Probe.from_pixels(latlong))
    np.testing.assert_allclose(horizon.irradiance, np.pi * np.array([1.0, 2.0, 3.0]), rtol=2e-3)
    probe = horizon.over(np.array([0.5, 0.0, 1.0]))
    expected = Probe.from_pixels(np.where(np.arange(32)[:, None, None] < 16, latlong, [0.5, 0.0, 1.0]).astype("f4"))
    np.testing.assert_allclose(probe.latlong, expected.latlong)
    np.testing.assert_allclose(probe.sh, expected.sh, atol=1e-5)
    dark = Horizon.of(None).over(np.ones(3)).latlong
    np.testing.assert_allclose(
        irradiance_direct(dark, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], 1.0), [[np.pi] * 3, [0.5 * np.pi] * 3], rtol=0.01
    )


def test_a_white_plane_below_a_white_slab_keeps_all_light_between_them():
    """On a contact nothing escapes: exitance 1 comes back whole, by an interface that mirrors, too."""
    slab = cube(20.0)
    plane = GroundPlane.below(slab, 0.0)
    ground = GroundExchange(cast_from_ground(slab, plane), (1.0, 0.5, 0.0))
    under = np.abs(plane.places()[:, [0, 2]]).max(axis=1) < 8.0
    returned = GroundReturn(ground, 1.5, np.zeros(len(slab.faces), int), 1)
    mirror = GroundMirror(ground, 1.5)
    assert mirror.lit(np.ones(SIDE**2, np.float32), 2).max() == 1.0
    # F_r of a diffuse light at 1.5, 0.0918, once and twice more.
    np.testing.assert_allclose(mirror.lit(np.ones(SIDE**2, np.float32), 0)[under], 1.1, rtol=0.01)
    assert returned.irradiance(2, np.ones(1, np.float32)).max() == 0.0
    # The corners of the lower face see a quarter of the plane below it, and more that is dark here.
    assert (returned.irradiance(0, np.ones(1, np.float32))[slab.normals[:, 1] < -0.9] > 0.1).all()
