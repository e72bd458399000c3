"""Display transforms against their published formulas and values, and what all of them keep to."""

import sys
from importlib import import_module

import numpy as np
import pytest

from milkglass.core.display import srgb
from milkglass.core.errors import InputError
from milkglass.viewer.display import aces, agx
from milkglass.viewer.display.registry import TRANSFORMS, transform

GREYS = np.geomspace(1e-6, 1e4, 200)[:, None] * np.ones(3)


def linear(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_greys_stay_grey_rise_and_end_between_black_and_white(name):
    shown = transform(name).encoded(GREYS, 3.0)
    assert np.ptp(shown, axis=1).max() < 1e-3
    assert np.all(np.diff(shown[:, 1]) >= -1e-6)
    assert np.all((shown >= 0.0) & (shown <= 1.0))
    assert shown[0].max() < 0.002
    assert shown[-1].min() > 0.998
    np.testing.assert_array_equal(transform(name).encoded(np.zeros(3), 3.0), 0.0)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_middle_grey_stays_in_the_middle(name):
    assert 0.09 < linear(transform(name).encoded(np.full(3, 0.18), 3.0))[1] < 0.23


@pytest.mark.parametrize(
    ("exposed", "expected"),
    [
        ((0.5, 0.3, 0.2), (0.46, 0.26, 0.16)),  # colours of materials, less what a dielectric mirrors
        ((0.04, 0.04, 0.04), (0.01, 0.01, 0.01)),  # 6.25 x^2
        ((0.8, 0.8, 0.8), (0.76, 0.76, 0.76)),
        # peak 1.96 to 1 - 0.24^2 / 1.44 = 0.96, the others with it to 0.96 / 1.96 and 0.48; then 3 / 23 of the way to
        # 0.96: 1 - 1 / (0.15 + 1)
        ((2.0, 1.04, 1.02), (0.96, 0.551127, 0.542609)),
    ],
)
def test_khronos_neutral_by_hand(exposed, expected):
    """The specification's formula, worked out on paper."""
    np.testing.assert_allclose(linear(transform("neutral").encoded(exposed, 1.0)), expected, atol=2e-5)


def published_neutral(rgb):
    """The specification's listing, a colour at a time."""
    start, desaturation = 0.8 - 0.04, 0.15
    darkest = min(rgb)
    rgb = np.array(rgb) - (darkest - 6.25 * darkest * darkest if darkest < 0.08 else 0.04)
    peak = max(rgb)
    if peak < start:
        return rgb
    d = 1.0 - start
    new = 1.0 - d * d / (peak + d - start)
    g = 1.0 - 1.0 / (desaturation * (peak - new) + 1.0)
    return (1.0 - g) * rgb * new / peak + g * new


def published_agx_sigmoid(x):
    """The polynomial that shaders use, of degree 6 (Wrensch 2023)."""
    return 15.5 * x**6 - 40.14 * x**5 + 31.96 * x**4 - 6.868 * x**3 + 0.4298 * x**2 + 0.1191 * x - 0.00232


def test_khronos_neutral_is_its_listing():
    colours = 10.0 ** np.random.default_rng(0).uniform(-3.0, 1.5, (1000, 3))
    expected = srgb([published_neutral(colour) for colour in colours])
    np.testing.assert_allclose(transform("neutral").encoded(colours, 1.0), expected, atol=1e-12)


def test_agx_sigmoid_is_what_the_published_polynomial_fits():
    share = np.linspace(0.0, 1.0, 1001)
    assert np.abs(agx.sigmoid(share) - published_agx_sigmoid(share)).max() < 0.006
    np.testing.assert_allclose(agx.sigmoid(np.array([0.0, agx.PIVOT[0], 1.0])), [0.0, agx.PIVOT[1], 1.0], atol=1e-12)
    step = 1e-6
    around = agx.sigmoid(agx.PIVOT[0] + np.array([-step, step]))
    assert (around[1] - around[0]) / (2.0 * step) == pytest.approx(agx.SLOPE, rel=1e-6)


def test_agx_matrices_keep_white_and_undo_each_others_spaces():
    for matrix in (agx.TO_REC2020, agx.FROM_REC2020, agx.INSET, agx.OUTSET):
        np.testing.assert_allclose(matrix.sum(axis=0), 1.0, atol=2e-4)
    np.testing.assert_allclose(agx.TO_REC2020 @ agx.FROM_REC2020, np.eye(3), atol=2e-4)


def test_agx_bleaches_bright_colours():
    red = transform("agx").encoded(np.array([0.2, 2.0, 20.0])[:, None] * [1.0, 0.05, 0.05], 1.0)
    saturation = 1.0 - red.min(axis=1) / red.max(axis=1)
    assert np.all(np.diff(saturation) < -0.1)


def test_aces_puts_middle_grey_at_ten_of_a_hundred_nits():
    """Academy, ACES 2.0 Output Transform."""
    np.testing.assert_allclose(linear(transform("aces").encoded(np.full(3, 0.18), 1.0)), 0.1, atol=5e-4)


def test_an_openimageio_without_aces_is_told_in_a_sentence(monkeypatch):
    monkeypatch.setattr(aces, "CONFIGURATION", "ocio://cg-config-v9.9.9_aces-v9.0_ocio-v9.9")
    with pytest.raises(InputError, match=r"needs an OpenImageIO that carries ACES 2.0, not \d"):
        transform("aces").encoded(np.ones(3), 1.0)


def test_a_new_transform_is_a_file_and_a_line(monkeypatch):
    name = "tests_negative"
    module = type(sys)(name)
    module.TRANSFORM = type(
        "Negative",
        (import_module("milkglass.viewer.display.base").Transform,),
        {"encoded": lambda self, exposed, white: 1.0 - np.minimum(exposed, 1.0)},
    )()
    monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(TRANSFORMS, "negative", name)
    assert transform("negative").table()[0, 0, 0] == pytest.approx([1.0, 1.0, 1.0])
