"""Display transform: known values of sRGB and of the photographic operator."""

import numpy as np
import pytest

from milkglass.core import display as tonemap


def test_srgb_known_values() -> None:
    linear = [0.0, 0.0031308, 0.21404114048, 0.5, 1.0, 7.0, -1.0]
    expected = [0.0, 0.04044994, 0.5, 0.7353569830524495, 1.0, 1.0, 0.0]
    np.testing.assert_allclose(tonemap.srgb(linear), expected, atol=1e-6)


def test_the_white_point_becomes_white_and_hue_is_kept() -> None:
    grey = tonemap.tone_map([3.0, 3.0, 3.0], 1.0, 3.0)
    np.testing.assert_allclose(grey, 1.0, atol=1e-12)
    colour = tonemap.tone_map([0.4, 0.2, 0.1], 1.0, 3.0)
    np.testing.assert_allclose(colour / colour[2], [4.0, 2.0, 1.0], atol=1e-12)


def test_log_average_of_a_constant_is_nearly_the_constant_at_any_scale() -> None:
    for scale in (1e-6, 1.0, 1e6):
        values = np.full((5, 5), scale)
        assert tonemap.log_average(values, np.ones((5, 5))) == pytest.approx(scale * (1 + tonemap.LOG_FLOOR), rel=1e-12)


def test_log_average_ignores_what_is_not_the_object_and_survives_darkness() -> None:
    values, coverage = np.array([2.0, 100.0]), np.array([1.0, 0.0])
    assert tonemap.log_average(values, coverage) == pytest.approx(2.02, rel=1e-12)
    assert tonemap.log_average(np.zeros(4), np.ones(4)) == 0.0
    assert tonemap.log_average(np.ones(4), np.zeros(4)) == 0.0
    assert np.isfinite(tonemap.log_average(np.array([0.0, 1.0]), np.ones(2)))
