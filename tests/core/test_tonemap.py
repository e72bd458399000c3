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


def test_log_average_of_a_constant_is_the_constant_at_any_scale() -> None:
    for scale in (1e-30, 1.0, 1e30):
        assert tonemap.log_average(np.full((5, 5), scale), np.ones((5, 5))) == pytest.approx(scale, rel=1e-12)


def test_log_average_is_weighted_by_what_is_lit() -> None:
    """Weights L / (L + mean): of 1 and 4, whose mean is 2.5, they are 1 / 3.5 and 4 / 6.5."""
    weights = np.array([1.0 / 3.5, 4.0 / 6.5])
    expected = np.exp(weights[1] * np.log(4.0) / weights.sum())
    assert tonemap.log_average([1.0, 4.0], [1.0, 1.0]) == pytest.approx(expected, rel=1e-12)


def test_deep_shadow_does_not_drag_the_log_average_down() -> None:
    """Of an object of which half is lit by 1, the other half may be as dark as it likes."""
    for shadow in (1e-2, 1e-4, 1e-8, 0.0):
        values = np.array([1.0, shadow])
        assert 0.85 < tonemap.log_average(values, np.ones(2)) <= 1.0


def test_a_highlight_counts_by_its_area() -> None:
    """One of 1 % at a thousand times the rest's luminance, eleven times the mean, moves the average by a third."""
    values = np.r_[np.ones(990), np.full(10, 1000.0)]
    assert 1.0 < tonemap.log_average(values, np.ones(1000)) < 2.3


def test_log_average_ignores_what_is_not_the_object_and_survives_darkness() -> None:
    values, coverage = np.array([2.0, 100.0]), np.array([1.0, 0.0])
    assert tonemap.log_average(values, coverage) == pytest.approx(2.0, rel=1e-12)
    assert tonemap.log_average(np.zeros(4), np.ones(4)) == 0.0
    assert tonemap.log_average(np.ones(4), np.zeros(4)) == 0.0
    for wrong in (np.nan, np.inf, -1.0):
        assert tonemap.log_average([2.0, wrong], np.ones(2)) == pytest.approx(2.0, rel=1e-12)
