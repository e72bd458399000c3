import numpy as np
import pytest

from milkglass.core.light.blur import blurred


def test_no_blur_is_the_map_itself_and_a_constant_stays_constant():
    rng = np.random.default_rng(1)
    latlong = rng.random((32, 64, 3), np.float32)
    assert blurred(latlong, 0.0) is latlong
    constant = np.full((32, 64, 3), 0.7, np.float32)
    assert blurred(constant, 10.0) == pytest.approx(constant, rel=1e-5)


def test_blur_turns_with_the_map_and_mirrors_with_it():
    latlong = np.random.default_rng(2).random((32, 64, 3), np.float32)
    soft = blurred(latlong, 8.0)
    assert blurred(np.roll(latlong, 13, axis=1), 8.0) == pytest.approx(np.roll(soft, 13, axis=1), abs=1e-5)
    assert blurred(latlong[::-1], 8.0) == pytest.approx(soft[::-1], abs=1e-5)
    assert soft.std() < 0.5 * latlong.std()


def test_a_lamp_at_the_horizon_becomes_a_gaussian_of_the_width_asked_for():
    height, sigma = 180, 6.0
    latlong = np.zeros((height, 2 * height, 3), np.float32)
    latlong[height // 2 - 1 : height // 2 + 1, height] = 1.0
    soft = blurred(latlong, sigma)[:, :, 0]
    degrees = np.arange(2 * height) - height
    for offset in (3, 6, 12):
        expected = np.exp(-0.5 * (offset / sigma) ** 2)
        row = soft[height // 2]
        assert row[degrees == offset][0] / row[degrees == 0][0] == pytest.approx(expected, rel=0.02)
    assert soft.sum() == pytest.approx(2.0, rel=0.01)


def test_a_lamp_near_a_pole_shines_over_it():
    latlong = np.zeros((64, 128, 3), np.float32)
    latlong[1, 10] = 100.0
    soft = blurred(latlong, 6.0)
    assert soft[1, 74].min() > 0.3 * soft[1, 10].max()
    assert soft.min() >= 0.0
