"""The builtin probes."""

import numpy as np
import pytest

from milkglass.core.light.presets import CAMERA_AZIMUTH_DEG, PRESETS, preset
from milkglass.core.light.probe import Probe, irradiance_table
from milkglass.core.light.sources import extract_sources
from milkglass.viewer.scene.settings import BUILTIN_PROBES, CameraSettings
from tests.support.counting import calls, peak_bytes

LAMPS = {"studio": 2, "backlight": 2, "window": 2, "overcast": 0}


def test_settings_and_tests_know_all_of_them():
    assert tuple(PRESETS) == BUILTIN_PROBES == tuple(LAMPS)
    assert CameraSettings().azimuth_deg == CAMERA_AZIMUTH_DEG


@pytest.mark.parametrize("name", PRESETS)
def test_the_strong_parts_of_a_preset_are_lamps(name):
    latlong = preset(name)
    assert latlong.dtype == np.float32
    assert latlong.shape == (256, 512, 3)
    assert np.isfinite(latlong).all()
    assert latlong.min() >= 0.0
    sources, rest = extract_sources(Probe.from_pixels(latlong))
    assert len(sources) == LAMPS[name]
    assert rest.latlong.max() < 16.0


@pytest.mark.parametrize("name", PRESETS)
def test_what_a_preset_costs_grows_as_its_pixels(name):
    """No loop over them, and a few numbers for each."""
    few, many = (calls(lambda height=height: preset(name, height)) for height in (64, 256))
    assert many == few
    assert peak_bytes(lambda: preset(name)) < 200 * 256 * 512


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_the_same_light_at_any_resolution(name):
    coarse, fine = (irradiance_table(Probe.from_pixels(preset(name, height)).sh, 1.5) for height in (128, 512))
    assert coarse == pytest.approx(fine, abs=float(0.01 * fine.max()))


def test_the_backlight_comes_from_behind():
    sources, _ = extract_sources(Probe.from_pixels(preset("backlight")))
    azimuth = np.radians(CAMERA_AZIMUTH_DEG)
    camera = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    assert all(np.array(source.direction) @ camera < -0.4 for source in sources)


def test_the_overcast_sky_is_three_times_as_bright_overhead():
    latlong = preset("overcast", 512)
    assert latlong[0, 0] == pytest.approx(3.0 * latlong[246, 0], rel=0.2)
    assert latlong[-1].max() < 0.5 * latlong[0].min()
