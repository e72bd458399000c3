"""The occluded environment in pictures: pixels, samples and bodies, headless and in the window."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.light.bake import bake
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.light.probe import Probe, irradiance_zonal
from milkglass.viewer.assets import visibility
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.bench.occlusion import occlusion_errors
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.settings import EnvironmentSettings, ModelSettings
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene, write_pair
from tests.support.occluding import around, irradiance, places_of, rms, shaded_ball, write_probe
from tests.support.rendering import MeshRenderer, inside, scene_of
from tests.support.shapes import ball
from tests.support.solids import ball as part, mesh_of
from tests.support.waiting import wait_until

ETA = 1.5


@pytest.fixture(scope="module")
def sky(tmp_path_factory):
    return write_probe(tmp_path_factory.mktemp("probe") / "sky.exr", sky_pixels())


@pytest.mark.slow
def test_a_white_furnace_is_even(context, tmp_path):
    white = write_probe(tmp_path / "white.exr", np.ones((16, 32, 3), np.float32))
    frame = MeshRenderer(context, ball()).render(around(scene_of(), white), samples=1)
    np.testing.assert_allclose(frame.irradiance[inside(frame)], irradiance_zonal(ETA)[0], rtol=2e-3)


@pytest.mark.slow
def test_pixels_and_samples_have_the_irradiance_of_rays(context, sky):
    mesh, rng = shaded_ball(), np.random.default_rng(3)
    renderer = MeshRenderer(context, mesh)
    scene = around(scene_of("camera.elevation_deg=20"), sky, rotation_deg=30.0, intensity=0.5)
    frame, lit = renderer.render(scene, samples=1), renderer.light(scene)
    seen = np.argwhere(inside(frame))
    seen = tuple(rng.choice(seen, 150, replace=False).T)
    some = rng.choice(len(lit.samples), 150, replace=False)
    for where, actual in (
        (places_of(frame.position[seen].astype(float), frame.normal[seen].astype(float)), frame.irradiance[seen]),
        (
            places_of(lit.samples.points[some].astype(float), lit.samples.normals[some].astype(float)),
            lit.flux[some] / lit.samples.areas[some, None],
        ),
    ):
        expected = 0.5 * irradiance(mesh, where, sky_pixels(), ETA, [30.0])[0]
        assert rms(actual, expected) < 0.05
    without = renderer.render(replace(scene, environment=replace(scene.environment, occluded=False)), samples=1)
    ratio = frame.irradiance[seen].sum() / without.irradiance[seen].sum()
    assert ratio < 0.95
    assert (frame.irradiance[seen] <= without.irradiance[seen] * (1.0 + 1e-5)).all()


@pytest.mark.slow
def test_lamps_of_a_probe_and_its_rest_together_have_the_irradiance_of_rays(context):
    """Shadow maps for what is taken out of it, visibility for what stays."""
    renderer, window = MeshRenderer(context, shaded_ball()), EnvironmentSettings(builtin="window")
    scene = replace(scene_of(), lights=(), environment=window)
    assert len(renderer.light(scene).sources) > 1
    for error, flux in occlusion_errors(renderer, scene, 300, [0.0, 120.0]):
        assert error < 0.06
        assert abs(flux) < 0.015
    without = replace(scene, environment=replace(window, occluded=False))
    ((error, flux),) = occlusion_errors(renderer, without, 300, [0.0])
    assert error > 0.06
    assert flux > 0.025


def test_what_no_scene_needs_is_not_baked(context, sky, monkeypatch):
    monkeypatch.setattr(visibility, "bake", lambda *_: pytest.fail("rays were cast"))
    renderer = MeshRenderer(context, mesh_of(part(3.3)))
    for settings in ({"occluded": False}, {"intensity": 0.0}):
        renderer.render(around(scene_of(), sky, **settings), samples=1)
        assert "visibility" not in renderer.timings
    renderer.render(scene_of(), samples=1)


@pytest.mark.slow
def test_another_light_or_turn_bakes_nothing_again(context, sky, few_rays, tmp_path):
    renderer = MeshRenderer(context, ball())
    renderer.render(around(scene_of(), sky), samples=1)
    other = write_probe(tmp_path / "other.exr", sky_pixels()[::-1])
    for scene in (around(scene_of(), sky, rotation_deg=90.0), around(scene_of(), other)):
        renderer.render(scene, samples=1)
        assert "occlusion" in renderer.timings
        assert "visibility" not in renderer.timings


@pytest.mark.slow
def test_separate_bodies_are_in_each_others_way(context, sky, few_rays, tmp_path):
    pair = write_pair(tmp_path / "pair.ply")
    frames = [
        Renderer(context).render(
            around(replace(scene_of(method="ewald"), model=ModelSettings(path=pair, bodies=bodies)), sky), samples=1
        )
        for bodies in ("joined", "separate")
    ]
    np.testing.assert_allclose(frames[0].irradiance, frames[1].irradiance, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_progress_is_told(context, sky, few_rays):
    said = []
    MeshRenderer(context, mesh_of(part(2.2, subdivisions=2))).render(
        around(scene_of(), sky), samples=1, progress=said.append
    )
    assert any("shadows: 100 %" in words for words in said)


def held(monkeypatch):
    """Let rays wait until told: (go, asked) events."""
    go, asked = threading.Event(), threading.Event()

    def wait(mesh, progress, cancelled):
        asked.set()
        while not go.wait(0.01):
            if cancelled.is_set():
                raise BakeCancelled
        return bake(mesh, progress, cancelled)

    monkeypatch.setattr(visibility, "bake", wait)
    monkeypatch.setattr("milkglass.viewer.assets.visibility.cached_sight", lambda _: None)
    return go, asked


def frames_until(driver, condition):
    wait_until(condition, lambda: (driver.frames(1), time.sleep(0.005)))


@pytest.mark.slow
def test_the_window_shows_the_object_before_rays_are_back(context, model, sky, few_rays, monkeypatch):
    driver = Driver(small_scene(model))
    try:
        go, asked = held(monkeypatch)
        scene = around(driver.session.scene, sky)
        driver.session.put(scene)
        live = driver.view.live
        frames_until(driver, lambda: asked.is_set() and live.current and live.finished is not None)
        frames_until(driver, lambda: any(source.kind == 2 for source in live.finished.lit.sources))
        assert [source.occlusion for source in live.finished.lit.sources] == [None]
        assert not driver.app.at_rest()
        go.set()
        picture = driver.picture()
        assert all(source.occlusion is not None for source in live.finished.lit.sources)
        difference = np.abs(picture.astype(int) - headless_picture(scene, PICTURE))
        assert np.percentile(difference, 99.5) <= 2
    finally:
        driver.close()


@pytest.mark.parametrize("how", ["closing", "switching off", "another mesh"])
def test_the_window_gives_rays_up_at_once(context, model, sky, monkeypatch, how, tmp_path):
    driver = Driver(around(small_scene(model), sky, occluded=False))
    closed = False
    try:
        _, asked = held(monkeypatch)
        scene = driver.session.scene
        driver.session.put(replace(scene, environment=replace(scene.environment, occluded=True)))
        frames_until(driver, asked.is_set)
        job = driver.view.live.rays
        future = job._future
        if how == "closing":
            driver.close()
            closed = True
        elif how == "switching off":
            driver.session.put(scene)
            frames_until(driver, future.done)
        else:
            other = replace(driver.session.scene, model=ModelSettings(path=write_pair(tmp_path / "pair.ply")))
            driver.session.put(other)
            frames_until(driver, future.done)
        assert future.done()  # and the rays were never let go
    finally:
        if not closed:
            driver.close()


@pytest.mark.slow
def test_a_probe_of_one_colour_is_occluded_in_it(context, few_rays, tmp_path):
    red = np.zeros((16, 32, 3), np.float32)
    red[..., 0] = 1.0
    path = write_probe(tmp_path / "red.exr", red)
    frame = MeshRenderer(context, shaded_ball()).render(around(scene_of(), path), samples=1)
    assert np.isfinite(frame.irradiance).all()
    assert frame.irradiance[..., 1:].max() == 0.0
    assert Probe.from_pixels(red).mean_radiance[0] == pytest.approx(1.0)
