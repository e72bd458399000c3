"""Choice of layers and resolution: from settings, or from an error target."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.material import library as materials
from milkglass.core.material.fresnel import transmittance
from milkglass.core.material.library import Material
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.transport.accuracy import LIT, SHINING
from milkglass.core.transport.ewald import (
    FINEST,
    LOOSE_TAIL,
    NEAR_TARGET,
    NODES,
    NODES_ASKED_FOR,
    NODES_OUT_OF_REACH,
    TAIL,
    padded_nodes,
)
from milkglass.core.transport.methods import METHODS
from milkglass.core.transport.quality import (
    COARSEST,
    DEFAULT_ERROR_TARGET,
    Quality,
    make_transport,
    sample_spacing,
    survey_spacing,
)
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import RoughnessOf
from milkglass.viewer.scene.settings import TransportSettings
from tests.support.shapes import ball, plate

BALL, PLATE = ball(subdivisions=4), plate()  # 20 mm
ASSETS = Assets(keep=20)


def choose_quality(settings, found, mesh, sharp=True):
    return ASSETS.quality(settings, found, mesh, sharp_light=sharp)


def profiles(sigma_s_prime: float, sigma_a: float = 0.01):
    return dipoles(Material("test", (sigma_s_prime,) * 3, (sigma_a,) * 3, 1.3, "test"))


def ewald(**settings) -> TransportSettings:
    return TransportSettings(method="ewald", **settings)


def nodes(quality, found, mesh) -> int:
    return padded_nodes(make_transport(quality), found, mesh)


def mean_transmittance(n: float) -> float:
    """2 int_0^1 F_t(mu) mu dmu in closed form, n > 1 (Duntley 1942, The optical properties of diffusing materials)."""
    squared = n * n
    mirrored = 0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) ** 2)
    mirrored += squared * (squared - 1.0) ** 2 / (squared + 1.0) ** 3 * np.log((n - 1.0) / (n + 1.0))
    mirrored -= 2.0 * n**3 * (squared + 2.0 * n - 1.0) / ((squared + 1.0) * (n**4 - 1.0))
    mirrored += 8.0 * n**4 * (n**4 + 1.0) / ((squared + 1.0) * (n**4 - 1.0) ** 2) * np.log(n)
    return 1.0 - mirrored


@pytest.mark.parametrize("eta", [1.05, 1.3, 1.33, 1.5, 2.5])
def test_exitance_becomes_radiance_whose_flux_is_exitance_or_by_equation_7(eta):
    of_diffusion, *of_equation_7 = (Quality(name, 8, 64).exit_normalisation(eta) for name in METHODS)
    assert of_equation_7 == [np.pi, np.pi]
    assert of_diffusion == pytest.approx(np.pi * mean_transmittance(eta), rel=1e-9)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = (0.5 * (nodes + 1.0)) ** 2
    leaving = transmittance(eta, mu) / of_diffusion  # of M = 1
    assert 2.0 * np.pi * np.sum(weights * np.sqrt(mu) * leaving * mu) == pytest.approx(1.0, rel=1e-9)


def test_without_a_boundary_nothing_is_normalised():
    assert Quality("diffusion", None, 64).exit_normalisation(1.0) == pytest.approx(np.pi, rel=1e-12)


def test_the_default_is_two_per_cent():
    default = choose_quality(TransportSettings(method="ewald"), profiles(2.0), PLATE)
    assert replace(default, asked_for=True) == choose_quality(ewald(error_target=0.02), profiles(2.0), PLATE)
    assert default.error_target == DEFAULT_ERROR_TARGET == 0.02
    assert (default.method, default.layers, default.assignment, default.warning) == ("ewald", None, "tsc", None)


@pytest.mark.parametrize("name", ["marble", "skimmilk", "wholemilk", "jade", "skin1"])
@pytest.mark.parametrize("mesh", [BALL, PLATE], ids=["ball", "plate"])
def test_smaller_targets_never_take_fewer_nodes(name, mesh):
    found = [
        choose_quality(ewald(error_target=t, assignment="tsc"), dipoles(materials.lookup(name)), mesh)
        for t in (0.5, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001)
    ]
    assert np.all(np.diff([q.resolution for q in found]) >= 0)
    assert np.all(np.diff([q.predicted_error for q in found]) <= 0.0)
    assert found[0].resolution == COARSEST
    assert found[-1].resolution > 2 * COARSEST


def test_a_target_is_met_by_prediction_or_there_is_a_warning_and_the_largest_grid():
    for sigma_s_prime in np.geomspace(1e-3, 1e3, 13):
        for target in (None, 0.05, 0.005):
            found = profiles(float(sigma_s_prime))
            quality = choose_quality(ewald(error_target=target), found, PLATE)
            met = quality.predicted_error <= (target or DEFAULT_ERROR_TARGET)
            assert (quality.warning is None) == met
            near = quality.predicted_error <= NEAR_TARGET * DEFAULT_ERROR_TARGET
            budget = NODES_ASKED_FOR if target else NODES if near else NODES_OUT_OF_REACH
            assert nodes(quality, found, PLATE) <= budget
            finer = replace(quality, resolution=quality.resolution + 12)
            assert met or finer.resolution > FINEST or nodes(finer, found, PLATE) > budget


def test_the_warning_is_one_sentence_with_both_errors_and_the_fix():
    more = "set transport.resolution for more"
    for target, fix in ((None, "set transport.error_target to let it take longer"), (0.02, more), (0.01, more)):
        quality = choose_quality(ewald(error_target=target), profiles(50.0), PLATE)
        warning = quality.warning
        assert warning is not None
        assert warning.startswith(f"{quality.resolution} nodes along the object are too coarse")
        assert f"an error of {100 * (target or 0.02):g} %" in warning
        assert "where light falls" in warning
        assert "where it only shines through" in warning
        assert fix in warning
        assert "\n" not in warning
        assert ". " not in warning


def test_a_resolution_wins_over_a_target_and_still_predicts():
    quality = choose_quality(ewald(resolution=50, error_target=0.01), profiles(2.0), BALL)
    assert (quality.resolution, quality.error_target, quality.warning) == (50, None, None)
    h, profile = 20.0 / 49.0, profiles(2.0)[0]
    assert quality.predicted_error == pytest.approx(SHINING(profile, h, ASSETS.roughness(BALL)(h)), rel=1e-3)
    assert quality.predicted_lit == pytest.approx(LIT(profile, h, ASSETS.roughness(BALL)(h)), rel=1e-3)
    assert "where light falls" in quality.summary


@pytest.mark.parametrize("sigma_s_prime", [2.0, 50.0])
def test_a_drag_that_holds_the_resolution_keeps_the_transport_of_the_picture_at_rest(sigma_s_prime):
    found = profiles(sigma_s_prime)
    rest = choose_quality(ewald(), found, PLATE)
    held = choose_quality(ewald(resolution=rest.resolution, assignment=rest.assignment), found, PLATE)
    assert held == replace(rest, error_target=None)
    assert rest.tail == {2.0: TAIL, 50.0: LOOSE_TAIL}[sigma_s_prime]


def test_layers_are_kept_and_their_distance_counts():
    few = choose_quality(ewald(layers=7, resolution=60), profiles(2.0), BALL)
    assert few.layers == 7
    assert few.predicted_error > 2.0 * choose_quality(ewald(resolution=60), profiles(2.0), BALL).predicted_error


def test_layered_promises_nothing_and_needs_no_shape():
    assets = Assets()
    quality = assets.quality(TransportSettings(method="layered"), profiles(2.0), BALL, sharp_light=True)
    assert (quality.method, quality.layers, quality.resolution) == ("layered", 8, 128)
    assert quality.predicted_error is None
    assert quality.warning is None
    assert not assets.has(RoughnessOf(BALL))
    chosen = assets.quality(
        TransportSettings(method="layered", layers=4, resolution=256), profiles(2.0), BALL, sharp_light=True
    )
    assert (chosen.layers, chosen.resolution) == (4, 256)


def test_an_object_and_its_medium_scaled_together_take_the_same_nodes():
    large = ball(2000.0, 4)
    for target in (0.05, 0.02, 0.01):
        one = choose_quality(ewald(error_target=target), profiles(2.0, 0.02), BALL)
        other = choose_quality(ewald(error_target=target), profiles(0.02, 0.0002), large)
        assert one.resolution == other.resolution
        assert one.predicted_error == pytest.approx(other.predicted_error, rel=1e-3)


def test_the_finest_channel_decides_and_black_ones_do_not_count():
    def mixed(*sigma_s_prime: float):
        return dipoles(Material("test", sigma_s_prime, (0.01,) * 3, 1.3, "test"))

    fine = choose_quality(ewald(), mixed(2.5, 2.5, 2.5), PLATE)
    assert choose_quality(ewald(), mixed(0.1, 1.0, 2.5), PLATE) == fine
    assert choose_quality(ewald(), mixed(2.5, 0.0, 0.0), PLATE) == fine
    black = choose_quality(ewald(), mixed(0.0, 0.0, 0.0), BALL)
    assert (black.resolution, black.warning) == (COARSEST, None)


def test_rough_shapes_take_more_nodes_than_smooth_ones():
    smooth, rough = (choose_quality(ewald(), profiles(3.0), mesh) for mesh in (BALL, PLATE))
    assert rough.resolution > 1.2 * smooth.resolution


def test_light_without_edges_takes_fewer_nodes():
    sharp, soft = (choose_quality(ewald(), profiles(3.0), PLATE, light) for light in (True, False))
    assert soft.resolution < sharp.resolution
    assert soft.predicted_error == soft.predicted_lit <= 0.02
    assert "shines through" not in soft.summary


def test_tents_where_the_target_leaves_room_for_them():
    assert choose_quality(ewald(error_target=0.1), profiles(2.0), BALL).assignment == "tent"
    assert choose_quality(ewald(error_target=0.02), profiles(2.0), BALL).assignment == "tsc"
    told = choose_quality(ewald(error_target=0.1, assignment="tsc"), profiles(2.0), BALL)
    assert told.assignment == "tsc"
    assert choose_quality(ewald(assignment="tent"), profiles(2.0), BALL).warning is not None
    assert choose_quality(ewald(resolution=40), profiles(2.0), BALL).assignment == "tsc"


def test_samples_serve_every_coarser_grid_and_grow_in_steps():
    """About two a texel of the finest layers."""
    for mesh in (BALL, PLATE):
        assert survey_spacing(mesh) == pytest.approx(1.5 * 20.0 / 79.0, rel=1e-5)
        assert {sample_spacing(mesh, ewald(), n) for n in (32, 50, 80)} == {survey_spacing(mesh)}
        assert len({sample_spacing(mesh, ewald(), n) for n in range(81, 161)}) == 2
        for n in (81, 120, 160, 240):
            assert sample_spacing(mesh, ewald(), n) <= 1.01 * 1.5 * 20.0 / (n - 1)
        assert sample_spacing(mesh, ewald(resolution=40)) == pytest.approx(1.5 * 20.0 / 39.0, rel=1e-5)
        assert sample_spacing(mesh, TransportSettings("layered")) == pytest.approx(1.5 * 20.0 / 127.0, rel=1e-5)
