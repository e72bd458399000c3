"""Light between parts in pictures: what it lights, what it costs to change, and how the window shows it."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.light.exchange import cast_hits
from milkglass.core.light.mirror import Mirror
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance
from milkglass.core.stages import Part, Stage
from milkglass.core.transport.diffusion.solver import NESTED
from milkglass.viewer.assets import exchange
from milkglass.viewer.render import exchange as lighting
from milkglass.viewer.render.exchange import coarse, lamp_rays
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import MaterialSettings
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene, write_pair
from tests.support.occluding import write_probe
from tests.support.rendering import MeshRenderer, inside
from tests.support.solids import ball, block, mesh_of, plates
from tests.support.waiting import wait_until

SETTINGS = (
    "display.image_size=[96, 96]", "camera.azimuth_deg=15", "camera.elevation_deg=30", "transport.resolution=32",
    "material.name=marble",
)  # fmt: skip


def corner():
    """A floor and a wall, one body: the wall is lit from the front, the floor by the wall."""
    return mesh_of(
        block((20.0, 3.0, 20.0), (0.0, -8.5, 0.0)), block((20.0, 20.0, 3.0), (0.0, 0.0, -11.5)),
    )  # fmt: skip


def scene(*assignments: str) -> Scene:
    return replace(apply_set(Scene(), [*SETTINGS, *assignments]), lights=(DirectionalLight((0.0, -0.2, 1.0)),))


@pytest.fixture(scope="module")
def renderer(context):
    return MeshRenderer(context, corner())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["diffusion", "ewald", "layered"])
def test_a_lit_wall_lights_the_floor(renderer, method):
    settings = f"transport.method={method}", "model.bodies=joined"
    off, on = (renderer.render(scene(*settings, f"transport.exchange={state}"), samples=1) for state in ("off", "on"))
    floor = inside(off) & (off.normal[..., 1] > 0.9)
    assert on.irradiance[floor].mean() > 5.0 * off.irradiance[floor].mean()
    assert on.exitance[floor].mean() > 1.4 * off.exitance[floor].mean()
    wall = inside(off) & (off.normal[..., 2] > 0.9)
    assert 1.0 < on.exitance[wall].mean() / off.exitance[wall].mean() < 1.5
    rough = on.irradiance[floor]
    assert np.abs(np.diff(np.sort(rough[:, 1]))).max() < 0.2 * rough.max()  # no speckle


@pytest.mark.slow
def test_separate_bodies_light_each_other(renderer):
    off, on = (renderer.render(scene(f"transport.exchange={state}"), samples=1) for state in ("off", "on"))
    joined = renderer.render(scene("model.bodies=joined"), samples=1)
    floor = inside(off) & (off.normal[..., 1] > 0.9)
    assert on.exitance[floor].mean() > 1.4 * off.exitance[floor].mean()
    assert on.irradiance[floor].mean() == pytest.approx(joined.irradiance[floor].mean(), rel=0.05)


@pytest.mark.parametrize("bodies", ["joined", "separate"])
def test_without_light_all_is_black(renderer, bodies):
    dark = replace(scene(f"model.bodies={bodies}"), lights=())
    frame = renderer.render(dark, samples=1)
    assert not frame.radiance.any()


def test_methods_choose_and_a_setting_decides():
    assert [scene(f"transport.method={name}").transport.exchanges for name in ("diffusion", "ewald", "layered")] == [
        True, False, False,
    ]  # fmt: skip
    assert not scene("transport.exchange=off").transport.exchanges
    assert scene("transport.method=layered", "transport.exchange=on").transport.exchanges


@pytest.mark.slow
def test_a_convex_object_is_drawn_as_without(context):
    renderer = MeshRenderer(context, mesh_of(ball(10.0)))
    off, on = (renderer.render(scene(f"transport.exchange={state}"), samples=1) for state in ("off", "on"))
    np.testing.assert_array_equal(on.radiance, off.radiance)


@pytest.mark.slow
def test_changes_run_what_depends_on_them(renderer):
    start = scene()
    renderer.render(start, samples=1)
    orbit = replace(start, camera=replace(start.camera, azimuth_deg=40.0))
    assert not {stage for stage in renderer.render(orbit, samples=1).timings if stage.part == Part.TRANSPORT}
    other = replace(orbit, material=MaterialSettings(name="skim milk"))
    rays = Stage.EXCHANGE_RAYS, Stage.EXCHANGE, Stage.MIRROR
    assert not set(rays) & set(renderer.render(other, samples=1).timings)
    turned = replace(other, lights=(DirectionalLight((0.3, -0.2, 1.0)),))
    assert not set(rays) & set(renderer.render(turned, samples=1).timings)


def test_paths_through_matter_are_followed_where_it_is_thin(context):
    """Two sheets of .2 mm: marble, of free paths of .3 mm, lets light through; what is as thick as a floor does not."""
    sheets = MeshRenderer(context, plates(thickness=0.2))
    assert sheets.light(scene()).exchange.crossings is not None
    assert MeshRenderer(context, plates(thickness=4.0, gap=4.0)).light(scene()).exchange.crossings is None


def test_what_surfaces_mirror_of_other_light_is_found_after_the_first_picture(context, monkeypatch):
    """Until then it is the last light's, as bright as the light is now; a change of colour leaves only that to find."""
    renderer, followed, seen = MeshRenderer(context, corner()), [], []
    monkeypatch.setattr(lighting, "lamp_rays", lambda *given: followed.append(1) or lamp_rays(*given))
    start = scene(f"transport.resolution={NESTED}", "model.bodies=joined", "transport.method=diffusion")

    def pictures(*lights):
        followed.clear()
        seen.clear()
        lit = renderer.light(replace(start, lights=lights))
        last = renderer.scatter(lit, lambda solution: seen.append((solution, len(followed))) or True)
        return seen[0], [lit.entering_again(scattered) for scattered in (seen[0][0], last)]

    (first, before), (known, settled) = pictures(DirectionalLight((0.0, -0.2, 1.0), (1.0, 1.0, 1.0)))
    assert first.grid != renderer.light(start).grid
    assert (before, len(followed)) == (0, 1)
    assert known is None
    (_, before), (known, brighter) = pictures(DirectionalLight((0.0, -0.2, 1.0), (3.0, 2.0, 1.0)))
    assert (before, len(followed)) == (0, 1)
    np.testing.assert_allclose(brighter, settled * (3.0, 2.0, 1.0), rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(known, brighter, rtol=0.01, atol=1e-3)
    pictures()  # in the dark
    (first, _), (known, settled) = pictures(DirectionalLight((0.0, 0.2, 1.0)))
    assert known is None or np.isfinite(known).all()
    assert np.isfinite(first.volume).all()
    assert settled.any()


@pytest.mark.slow
def test_rays_are_cast_once_a_mesh(context, monkeypatch, tmp_path):
    monkeypatch.setattr("milkglass.viewer.assets.ray_cache.cache_folder", lambda: tmp_path)
    casts = []
    monkeypatch.setattr(exchange, "cast_hits", lambda *given: casts.append(1) or cast_hits(*given))
    first, second = (MeshRenderer(context, corner()).render(scene(), samples=1) for _ in range(2))
    assert len(casts) == 1
    np.testing.assert_array_equal(first.radiance, second.radiance)


@pytest.mark.slow
def test_surroundings_in_the_mirror_are_those_of_the_probe(context, tmp_path):
    """In a white sky the floor before a black wall has F_r of the wall from it: more than without, and by that much."""
    white = write_probe(tmp_path / "white.exr", np.ones((16, 32, 3), np.float32))
    around = replace(
        scene(), material=MaterialSettings(sigma_s_prime=(1.0,) * 3, sigma_a=(50.0,) * 3, eta=1.5), lights=(),
        environment=replace(Scene().environment, path=white),
    )  # fmt: skip
    renderer = MeshRenderer(context, corner())
    lit = renderer.light(around)
    mirrored, eta = lit.unscattered.irradiance, lit.eta
    floor = (lit.surface.refined.mesh.normals[:, 1] > 0.99) & (np.abs(lit.surface.refined.mesh.vertices[:, 0]) < 5.0)
    assert 0.0 < mirrored[floor].mean() < 0.5 * np.pi * (1.0 - hemispherical_transmittance(eta)) * 1.5
    np.testing.assert_allclose(mirrored[:, 0], mirrored[:, 2], rtol=1e-5)


def test_a_lamp_is_mirrored_onto_the_floor(renderer):
    """All that a wall mirrors of a lamp, F_r of what arrives, falls on the floor before it or leaves."""
    lit = renderer.light(scene())
    lamp, eta = lit.sources[0], lit.eta
    light = DirectionalLight((0.0, 0.6, 0.8))
    samples = lit.samples
    cosines = np.maximum(samples.normals @ np.array([0.0, 0.6, 0.8]), 0.0)
    heights = samples.points[:, 1] + 7.0
    wall = (samples.normals[:, 2] > 0.9) & (samples.points[:, 2] < -9.0) & (heights > 0.1) & (heights < 4.0)
    entering = (cosines * (1.0 - reflectance(eta, cosines)) * wall)[:, None] * np.ones(3)
    surface = lit.surface.refined.mesh
    mirror = Mirror(surface)
    rays = lamp_rays(light, entering.astype(np.float32), samples, eta)
    found = mirror.irradiance(mirror.mirrored(*rays, eta))
    assert lamp.sub_lights == 1
    sides = [surface.vertices[surface.faces[:, i]] - surface.vertices[surface.faces[:, 0]] for i in (1, 2)]
    areas = np.bincount(surface.faces.ravel(), np.repeat(np.linalg.norm(np.cross(*sides), axis=1) / 6.0, 3))
    arrived = float((cosines * reflectance(eta, cosines) * wall) @ samples.areas)
    fallen = float(areas @ found[:, 0])
    assert fallen == pytest.approx(arrived * (1.0 - float(reflectance(eta, 0.6))), rel=0.03)


def test_a_coarse_probe_keeps_its_mean():
    texels = np.random.default_rng(0).random((128, 256, 3))
    assert coarse(texels).shape == (32, 64, 3)
    np.testing.assert_allclose(coarse(texels).mean(axis=(0, 1)), texels.mean(axis=(0, 1)))


@pytest.mark.slow
def test_the_window_shows_the_object_before_rays_are_back(context, tmp_path, monkeypatch):
    go, asked = threading.Event(), threading.Event()

    def wait(mesh, rays, progress, cancelled):
        asked.set()
        wait_until(lambda: go.is_set() or cancelled.is_set())
        return cast_hits(mesh, rays, progress, cancelled)

    monkeypatch.setattr(exchange, "cast_hits", wait)
    monkeypatch.setattr("milkglass.viewer.assets.ray_cache.RayCache.read", lambda *_: None)
    start = small_scene(write_pair(tmp_path / "pair.ply"))
    off, on = (replace(start.transport, method="diffusion", exchange=state) for state in ("off", "on"))
    start = replace(start, transport=on)
    driver = Driver(replace(start, transport=off))
    try:
        driver.session.put(start)
        live = driver.view.live
        wait_until(
            lambda: asked.is_set() and live.current and live.finished is not None and live.finished.complete,
            lambda: (driver.frames(1), time.sleep(0.005)),
        )
        assert live.finished.lit.exchange is None
        assert not driver.app.at_rest()
        go.set()
        picture = driver.picture()
        assert live.finished.lit.exchange is not None
        difference = np.abs(picture.astype(int) - headless_picture(start, PICTURE))
        assert np.percentile(difference, 99.5) <= 2
    finally:
        go.set()
        driver.close()
