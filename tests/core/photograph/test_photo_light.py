"""The light on a photographed object: tone curve undone, background filled in, laid over the sphere, fitted."""

import numpy as np
import pytest

from milkglass.core.display import linear, luminance, srgb, tone_map
from milkglass.core.light.probe import Probe, irradiance_table, lookup
from milkglass.core.light.sources import extract_sources
from milkglass.core.photograph.light import MAX_ALBEDO, ShadingFit, fit_shading, fit_surround, without_lamp
from milkglass.core.photograph.surround import MAP_HEIGHT, filled, scene_radiance, surround_map
from tests.support.photographing import ball_photo

SIZE = (MAP_HEIGHT, 2 * MAP_HEIGHT)


def test_the_tone_curve_is_undone() -> None:
    rng = np.random.default_rng(0)
    display = rng.random((50, 3)) * 0.99
    np.testing.assert_allclose(tone_map(scene_radiance(display, 3.0), 1.0, 3.0), display, atol=1e-6)
    np.testing.assert_allclose(srgb(linear(display)), display, atol=1e-6)
    assert luminance(scene_radiance(np.ones((1, 3)), 5.0)) == pytest.approx(5.0, rel=1e-5)


def test_filling_keeps_what_is_known_and_joins_it() -> None:
    values = np.zeros((33, 47, 1)) + np.linspace(1.0, 2.0, 47)[:, None]
    weight = np.ones((33, 47))
    weight[8:25, 15:32] = 0.0
    full = filled(values, weight)
    np.testing.assert_allclose(full[weight == 1.0], values[weight == 1.0].astype(np.float32))
    assert np.abs(full - values).max() < 0.2
    assert not filled(values, np.zeros_like(weight)).any()


def test_a_photograph_lies_over_the_sphere_behind_and_is_mirrored_before() -> None:
    picture = np.zeros((60, 90, 3))
    picture[:30, :, 0], picture[:, :45, 1] = 1.0, 1.0  # red above, green on the left
    around = surround_map(picture, (0.5, 0.5))
    sky = lookup(np.repeat(around, 1, axis=0), np.array([[0.0, 0.8, -0.6], [0.0, 0.8, 0.6], [0.0, -0.8, -0.6]]))
    np.testing.assert_allclose(sky[:, 0], [1.0, 1.0, 0.0], atol=1e-6)
    sides = lookup(around, np.array([[-0.8, 0.1, -0.6], [0.8, 0.1, -0.6], [-0.8, 0.1, 0.6]]))
    np.testing.assert_allclose(sides[:, 1], [1.0, 0.0, 1.0], atol=1e-6)


def shading_of(
    towards: tuple[float, float, float], ambient: float
) -> tuple[ShadingFit, np.ndarray, np.ndarray, np.ndarray]:
    _, mask, normals = ball_photo(120, towards)
    inside = (mask > 0.0) & (normals[..., 2] > 0.2)
    height = normals[..., 2] * 0.3 * 120
    true = ambient + np.maximum(normals @ (np.array(towards) / np.linalg.norm(towards)), 0.0)
    return fit_shading(true, height, inside), true, height, inside


def irradiance_on(light: np.ndarray, shading: ShadingFit) -> np.ndarray:
    """Luminance of the irradiance at the normals that were fitted, without Fresnel."""
    return luminance(lookup(irradiance_table(Probe.from_pixels(light).sh, 1.0), shading.normals))


def test_a_lamp_is_found() -> None:
    towards = np.array([0.5, 0.3, 0.6])
    shading, true, height, inside = shading_of(tuple(towards), 0.1)
    assert shading.lamp is not None
    assert shading.lamp.direction @ towards / np.linalg.norm(towards) > np.cos(np.radians(4.0))
    assert without_lamp(true, height, inside, shading)[inside].std() < 0.25 * true[inside].std()
    (source, *_), rest = extract_sources(Probe.from_pixels(fit_surround(None, shading, SIZE)))
    assert np.array(source.direction) @ shading.lamp.direction > np.cos(np.radians(2.0))
    assert rest.mean_radiance.max() < 0.2 * np.max(source.irradiance)


def test_a_few_highlights_make_no_lamp() -> None:
    """Both fits are judged by the same normals: else which of them the highlights fall on decides."""
    _, mask, normals = ball_photo(200)
    inside = (mask > 0.0) & (normals[..., 2] > 0.2)
    for seed in range(12):
        shiny = np.random.default_rng(seed).random(mask.shape) < 0.01
        light = (0.4 + 0.2 * normals[..., 1]) * np.where(shiny, 6.0, 1.0)
        assert fit_shading(light, normals[..., 2] * 60.0, inside).lamp is None


def test_a_soft_light_is_a_gradient_and_no_lamp() -> None:
    _, mask, normals = ball_photo(120)
    inside = (mask > 0.0) & (normals[..., 2] > 0.2)
    soft, height = 0.4 * (1.0 + 0.5 * normals[..., 1]), normals[..., 2] * 36.0
    shading = fit_shading(soft, height, inside)
    assert shading.lamp is None
    brighter = fit_shading(7.0 * soft, height, inside)
    np.testing.assert_allclose(brighter.gradient, shading.gradient, atol=1e-9)  # over the mean
    rng = np.random.default_rng(3)
    surround = rng.random((*SIZE, 3))
    light = fit_surround(surround, shading, SIZE)
    irradiance = irradiance_on(light, shading)
    matrix = np.concatenate([np.ones((len(irradiance), 1)), shading.normals], axis=1)
    fitted = np.linalg.lstsq(matrix, irradiance, rcond=None)[0]
    np.testing.assert_allclose(fitted[1:] / irradiance.mean(), shading.gradient, atol=0.05)


@pytest.mark.parametrize("surround", [np.full((*SIZE, 3), 0.01), np.zeros((*SIZE, 3)), None, np.full((*SIZE, 3), 50.0)])
def test_light_is_as_strong_as_the_object_is_bright(surround: np.ndarray | None) -> None:
    shading, *_ = shading_of((0.0, 0.0, 1.0), 0.5)
    light = fit_surround(surround, shading, SIZE)
    albedo = np.pi * shading.level / irradiance_on(light, shading).mean()
    assert 0.14 < albedo < 0.87
    if surround is not None and surround.max() == 0.01:
        assert albedo == pytest.approx(MAX_ALBEDO, rel=0.03)  # too dark around: a white object
