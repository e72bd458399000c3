"""Prefiltered Phong lobes against direct integrals in float64."""

import numpy as np
import pytest

from milkglass.core.light import probe as env
from milkglass.core.light.harmonics import zonal_coefficients
from milkglass.core.light.highlights import LobeFilter, lobe_zonal
from milkglass.core.light.probe import Probe
from milkglass.viewer.files.radiance import read_radiance
from tests.support.rendering import relative_rms
from tests.support.skies import SPOTS, directions, sky

AXES = np.concatenate([np.eye(3), -np.eye(3)])


def lobe_means(latlong, mirrors, shininess):
    """(n + 1) / 2 pi int L max(0, r.w)^n dw by direct summation: (m, 3) float64."""
    towards, d_omega = env.solid_angles(latlong)
    flux = latlong.reshape(-1, 3) * d_omega[:, None]
    means = np.empty((len(mirrors), 3))
    for i, mirror in enumerate(mirrors):
        cosine = towards @ mirror
        near = cosine > np.exp(-40.0 / shininess)  # elsewhere the lobe is less than 1e-17
        means[i] = np.exp(shininess * np.log(cosine[near])) @ flux[near]
    return means * (shininess + 1.0) / (2.0 * np.pi)


def assert_filters(latlong):
    mirrors, lobes = np.concatenate([directions(24), AXES]), LobeFilter(Probe.from_pixels(latlong))
    for shininess in (1.0, 2.5, 12.0, 80.0, 300.0, 1200.0, 2000.0):
        found = env.lookup(lobes.filtered(shininess), mirrors)
        assert np.all(relative_rms(found, lobe_means(latlong, mirrors, shininess)) < 0.02), shininess


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uffizi_latlong_1200x600.hdr", "galileo_latlong_1024x512_derived.hdr"])
def test_a_measured_probe_under_a_lobe(data_dir, name):
    path = data_dir / "hdr" / name
    if not path.exists():
        pytest.skip(f"{name} is absent")
    assert_filters(read_radiance(path))


@pytest.mark.slow
def test_a_lamp_in_the_sky_under_a_lobe():
    assert_filters(sky(SPOTS[1], ((0.1, 1.0, 0.0), 12.0, (5.0, 5.0, 7.0)), height=384))


@pytest.mark.slow
@pytest.mark.parametrize("shininess", [1.0, 80.0, 1279.0, 1e5])
def test_a_white_sky_stays_white(shininess):
    filtered = LobeFilter(Probe.from_pixels(np.full((64, 128, 3), 0.7, np.float32))).filtered(shininess)
    assert filtered == pytest.approx(0.7, rel=1e-4)


@pytest.mark.parametrize("shininess", [1.0, 6.0, 7.5, 80.0])
def test_coefficients_of_the_lobe(shininess):
    nodes, weights = np.polynomial.legendre.leggauss(300)
    mu = 0.5 * (nodes + 1.0)
    kernel = 0.5 * weights * (shininess + 1.0) / (2.0 * np.pi) * mu**shininess
    assert lobe_zonal(shininess, 24) == pytest.approx(zonal_coefficients(mu, kernel, 24), abs=1e-9)


def test_the_poles_have_one_value():
    probe = Probe.from_pixels(np.random.default_rng(3).random((64, 128, 3), np.float32))
    for shininess in (10.0, 1e4):
        filtered = LobeFilter(probe).filtered(shininess)
        for row in (filtered[0], filtered[-1]):
            assert np.ptp(row, axis=0).max() < 1e-4
