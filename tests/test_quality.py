"""Choice of layers and resolution: from settings, or from an error target."""

import numpy as np
import pytest

from core import materials
from core.dipole import dipoles
from core.ewald import predicted_error
from core.materials import Material
from tests.shapes import ball, plate
from viewer.quality import COARSEST, DEFAULT_ERROR_TARGET, FINEST, choose_quality, sample_spacing
from viewer.settings import TransportSettings

BALL = ball(subdivisions=2)  # 20 mm


def profiles(sigma_s_prime: float, sigma_a: float = 0.01):
    return dipoles(Material("test", (sigma_s_prime,) * 3, (sigma_a,) * 3, 1.3, "test"))


def ewald(**settings) -> TransportSettings:
    return TransportSettings(method="ewald", **settings)


def test_the_default_is_two_per_cent():
    default = choose_quality(TransportSettings(), profiles(2.0), BALL)
    assert default == choose_quality(ewald(error_target=0.02), profiles(2.0), BALL)
    assert default.error_target == DEFAULT_ERROR_TARGET == 0.02
    assert (default.method, default.layers, default.warning) == ("ewald", None, None)


@pytest.mark.parametrize("name", ["marble", "skimmilk", "wholemilk", "jade", "skin1"])
def test_smaller_targets_never_take_fewer_nodes(name):
    found = [
        choose_quality(ewald(error_target=t), dipoles(materials.lookup(name)), BALL)
        for t in (0.5, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001)
    ]
    assert np.all(np.diff([q.resolution for q in found]) >= 0)
    assert np.all(np.diff([q.predicted_error for q in found]) <= 0.0)
    assert all(COARSEST <= q.resolution <= FINEST for q in found)


def test_a_target_is_met_by_prediction_or_there_is_a_warning():
    for sigma_s_prime in np.geomspace(1e-3, 1e3, 25):
        for target in (0.1, 0.02, 0.01, 0.005):
            quality = choose_quality(ewald(error_target=target), profiles(float(sigma_s_prime)), BALL)
            met = quality.predicted_error <= target
            assert (quality.warning is None) == met
            assert met or quality.resolution == FINEST


def test_the_warning_is_one_sentence_with_both_errors_and_the_fix():
    warning = choose_quality(ewald(error_target=0.01), profiles(50.0), BALL).warning
    assert warning is not None
    assert f"{FINEST} nodes" in warning
    assert "instead of 1 %" in warning
    assert "set transport.resolution" in warning
    assert "\n" not in warning
    assert ". " not in warning


def test_a_resolution_wins_over_a_target_and_still_predicts():
    quality = choose_quality(ewald(resolution=50, error_target=0.01), profiles(2.0), BALL)
    assert (quality.resolution, quality.error_target, quality.warning) == (50, None, None)
    assert quality.predicted_error == pytest.approx(predicted_error(20.0 / 49.0, profiles(2.0)[0].detail), rel=1e-3)


def test_layers_are_kept():
    assert choose_quality(ewald(layers=7), profiles(2.0), BALL).layers == 7


def test_layered_promises_nothing():
    quality = choose_quality(TransportSettings(method="layered"), profiles(2.0), BALL)
    assert (quality.method, quality.layers, quality.resolution) == ("layered", 8, 128)
    assert quality.predicted_error is None
    assert quality.warning is None
    chosen = choose_quality(TransportSettings(method="layered", layers=4, resolution=256), profiles(2.0), BALL)
    assert (chosen.layers, chosen.resolution) == (4, 256)


def test_an_object_and_its_medium_scaled_together_take_the_same_nodes():
    large = ball(2000.0, 2)
    for target in (0.05, 0.02, 0.01):
        one = choose_quality(ewald(error_target=target), profiles(2.0, 0.02), BALL)
        other = choose_quality(ewald(error_target=target), profiles(0.02, 0.0002), large)
        assert one.resolution == other.resolution
        assert one.predicted_error == pytest.approx(other.predicted_error, rel=1e-5)


def test_the_finest_channel_decides_and_black_ones_do_not_count():
    def mixed(*sigma_s_prime: float):
        return dipoles(Material("test", sigma_s_prime, (0.01,) * 3, 1.3, "test"))

    fine = choose_quality(ewald(), mixed(2.5, 2.5, 2.5), BALL)
    assert choose_quality(ewald(), mixed(0.1, 1.0, 2.5), BALL) == fine
    assert choose_quality(ewald(), mixed(2.5, 0.0, 0.0), BALL) == fine
    black = choose_quality(ewald(), mixed(0.0, 0.0, 0.0), BALL)
    assert (black.resolution, black.warning) == (COARSEST, None)


def test_samples_serve_every_material_of_the_settings():
    """About two a texel of the finest layers that a target may ask for, whatever the material."""
    for mesh in (BALL, plate()):
        assert sample_spacing(mesh, ewald()) == sample_spacing(mesh, ewald(error_target=0.001))
        assert sample_spacing(mesh, ewald()) == pytest.approx(1.5 * 20.0 / (FINEST - 1), rel=1e-5)
        assert sample_spacing(mesh, ewald(resolution=40)) == pytest.approx(1.5 * 20.0 / 39.0, rel=1e-5)
