"""Light-probe maps: direction conventions, solid angles and resampling."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.light import probe as env

AXES = np.array([[0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]], np.float64)


def random_directions(count, seed=7):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def noise_probe(height, seed=3):
    """Radiance with a strong highlight, so that a shift or flip cannot go unnoticed."""
    pixels = np.random.default_rng(seed).random((height, 2 * height, 3), np.float32)
    pixels[height // 4, height // 3] *= 200.0
    return pixels


def test_latlong_anchors():
    uv = env.direction_to_latlong(AXES)
    np.testing.assert_allclose(uv[2:], [[0.75, 0.5], [0.25, 0.5], [1.0, 0.5], [0.5, 0.5]], atol=1e-15)
    np.testing.assert_array_equal(uv[:2], [[0.5, 0.0], [0.5, 1.0]])


def test_angular_anchors():
    uv = env.direction_to_angular(AXES)
    expected = [[0, 0.5], [0, -0.5], [0.5, 0], [-0.5, 0], [1, 0], [0, 0]]
    np.testing.assert_allclose(uv, expected, atol=1e-15)


def test_directions_follow_the_published_formulas():
    d = random_directions(500)
    x, y, z = d.T
    r = np.arccos(-z) / np.pi / np.sqrt(x**2 + y**2)
    np.testing.assert_allclose(env.direction_to_angular(d), np.stack([x * r, y * r], axis=1), atol=1e-12)
    u, v = env.direction_to_latlong(d).T
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    formula = [np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)]
    np.testing.assert_allclose(np.stack(formula, axis=1), d, atol=1e-14)


@pytest.mark.parametrize(
    ("to_uv", "to_direction"),
    [
        (env.direction_to_latlong, env.latlong_to_direction),
        (env.direction_to_angular, env.angular_to_direction),
    ],
)
def test_directions_round_trip(to_uv, to_direction):
    near_axes = AXES + 1e-7 * random_directions(6)
    d = np.concatenate([random_directions(1000), AXES, near_axes])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    back = to_direction(to_uv(d))
    np.testing.assert_allclose(back, d, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1.0, atol=1e-14)


def test_rotation_is_r_y_of_minus_a():
    a = np.radians(37.0)
    # R_y(a) carries +z towards +x; directions are rows, so its transpose, R_y(-a), stands on the left.
    r_y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    d = random_directions(50)
    np.testing.assert_allclose(env.to_probe_frame(d, 37.0), (r_y.T @ d.T).T, atol=1e-15)
    u, rotated_u = (env.direction_to_latlong(v)[:, 0] for v in (d, env.to_probe_frame(d, 37.0)))
    np.testing.assert_allclose((rotated_u - u) % 1.0, 37.0 / 360.0, atol=1e-12)


# Projections


@pytest.mark.parametrize(
    ("shape", "expected"),
    [((600, 1200, 3), "latlong"), ((599, 1200, 3), "latlong"), ((1000, 1000, 3), "angular")],
)
def test_projection_is_told_by_the_aspect(shape, expected):
    assert env.detect_projection(np.zeros(shape, np.float32)) == expected


@pytest.mark.parametrize("shape", [(480, 640, 3), (1200, 600, 3), (4, 8), (4, 8, 4), (1, 2, 3), (0, 0, 3)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(InputError, match="probe"):
        env.detect_projection(np.zeros(shape, np.float32))


@pytest.mark.parametrize("shape", [(64, 128, 3), (101, 101, 3), (64, 64, 3)])
def test_solid_angles_cover_the_sphere(shape):
    directions, d_omega = env.solid_angles(np.zeros(shape, np.float32))
    assert d_omega.sum() == pytest.approx(4 * np.pi, rel=1e-3 if shape[0] == shape[1] else 1e-13)
    np.testing.assert_allclose(d_omega @ directions, 0.0, atol=5e-3)


@pytest.mark.parametrize(("old", "new"), [(40, 10), (37, 16), (33, 32), (16, 37)])
def test_resampling_conserves_flux(old, new):
    pixels = noise_probe(old)
    result = env.resample_latlong(pixels, new)
    assert result.shape == (new, 2 * new, 3)
    assert result.dtype == np.float32
    flux = [(p.reshape(-1, 3) * env.solid_angles(p)[1][:, None]).sum(axis=0) for p in (pixels, result)]
    np.testing.assert_allclose(flux[1], flux[0], rtol=1e-6)
    assert pixels.min() <= result.min()
    assert result.max() <= pixels.max()


def test_resampling_by_two_weights_rows_by_solid_angle():
    pixels = noise_probe(8)
    bands = -np.diff(np.cos(np.pi * np.arange(9) / 8)).reshape(4, 2, 1, 1)
    pairs = pixels.reshape(4, 2, 8, 2, 3).mean(axis=3)
    weighted = (pairs * bands).sum(axis=1) / bands.sum(axis=1)
    np.testing.assert_allclose(env.resample_latlong(pixels, 4), weighted, rtol=1e-6)
    assert np.abs(pairs.mean(axis=1) - weighted).max() > 1e-3  # the test can tell the two apart


def test_angular_map_becomes_the_same_directions():
    # radiance = a smooth function of direction, so that every texel can be checked
    n = 400
    directions, _ = env.solid_angles(np.zeros((n, n, 3), np.float32))
    angular = (1.5 + directions).reshape(n, n, 3).astype(np.float32)
    latlong = env.angular_to_latlong(angular, 50)
    expected = 1.5 + env.solid_angles(latlong)[0].reshape(50, 100, 3)
    np.testing.assert_allclose(latlong, expected, atol=0.02)


@pytest.mark.parametrize("n", [16, 100, 333])
def test_text_around_the_disc_never_enters(n):
    rng = np.random.default_rng(1)
    clean = rng.random((n, n, 3), np.float32)
    _, d_omega = env.solid_angles(clean)
    outside = (d_omega == 0.0).reshape(n, n)
    written = clean.copy()
    written[outside] = 1e6
    assert outside.mean() == pytest.approx(1 - np.pi / 4, abs=0.03)
    for function in (
        lambda p: env.angular_to_latlong(p, n // 2),
        lambda p: env.irradiance_direct(p, AXES, 1.3),
    ):
        np.testing.assert_array_equal(function(written), function(clean))
