"""Pictures beside traced paths: refusals, the arithmetic of the comparison, and a ball where Mitsuba is installed."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.commands import cli
from milkglass.viewer.error import path_traced
from milkglass.viewer.files import images
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.settings import MaterialSettings
from tests.support.rendering import FRONT, scene_of
from tests.support.shapes import ball


def test_without_mitsuba_one_sentence_names_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert cli.main(["render", "--output", "a.png", "--path-traced", "b.exr"]) == 2
    assert capsys.readouterr().err == 'milkglass: --path-traced needs Mitsuba 3: pip install "milkglass[mitsuba]".\n'
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("scene", "name", "expected"),
    [
        (scene_of(), "a.png", "must end in .exr"),
        (scene_of(), "picture.exr", "would write over --output"),
        (scene_of(lights=()), "a.exr", "directional lights only"),
        (scene_of(lights=(DirectionalLight(FRONT), PointLight((0.0, 0.0, 50.0)))), "a.exr", "remove the point lights"),
        (scene_of("camera.orthographic=true"), "a.exr", "perspective cameras only"),
    ],
)
def test_what_cannot_be_traced_is_refused(tmp_path, scene, name, expected):
    with pytest.raises(InputError, match=expected):
        path_traced.check(scene, tmp_path / name, [str(tmp_path / "picture.exr")])


def test_noise_is_taken_off():
    rng = np.random.default_rng(0)
    truth = 1.0 + rng.random((240, 240, 3))
    halves = truth + rng.normal(0.0, 2.0, (2, 240, 240, 3))
    used = np.ones((240, 240), np.bool_)
    found = path_traced.compare(1.1 * truth, halves, used)
    np.testing.assert_allclose(found.rms, 0.1, atol=0.02)
    np.testing.assert_allclose(found.ratio, 1.1, atol=0.01)
    np.testing.assert_allclose(found.noise, 2.0 / np.sqrt(2.0) / 20.0 / 1.5, rtol=0.2)
    used[:, :200] = False  # there may be anything
    halves[:, :, :200] = 1e3
    np.testing.assert_allclose(path_traced.compare(1.1 * truth, halves, used).ratio, 1.1, atol=0.03)
    with pytest.raises(InputError, match="too little of the object"):
        path_traced.compare(truth, halves, np.zeros((240, 240), np.bool_))


@pytest.mark.slow
def test_a_ball_is_what_paths_say(renderer_of, tmp_path):
    pytest.importorskip("mitsuba", reason="the path tracer is an extra")
    scene = scene_of("transport.method=diffusion", "display.image_size=[48, 48]", method="ewald")
    material = MaterialSettings(name=None, sigma_s_prime=(0.45, 0.47, 0.49), sigma_a=(0.05, 0.03, 0.01), eta=1.3)
    scene, mesh = replace(scene, material=material), ball()
    frame = renderer_of(mesh).render(scene)
    found = path_traced.trace(scene, mesh, frame, tmp_path / "paths.exr", 1024)
    assert all(rms < max(0.1, 3.0 * noise) for rms, noise in zip(found.rms, found.noise, strict=True))
    np.testing.assert_allclose(found.ratio, 1.0, atol=0.08)
    assert "difference.R" in images.read_channels(tmp_path / "paths.exr")
