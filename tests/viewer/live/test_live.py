"""Pictures while the scene changes: only what changed runs, the worker's results are whole and in the end right."""

import gc
import resource
import threading
from dataclasses import replace

import numpy as np
import pytest

from milkglass.viewer.files.images import write_exr
from milkglass.viewer.live.draft import Cost
from milkglass.viewer.scene.scene import apply_set
from tests.support.driving import PICTURE, headless_picture, write_knot
from tests.support.waiting import DEADLINE

PIXELS = {"gbuffer", "composite", "exposure", "tone map"}
VOLUME = {"convolution", "layer volume"} | PIXELS
KERNEL = {"spectra", "pixel terms", "pixel tables"} | VOLUME
LIGHT_1 = {"irradiance of light 1", "flux", "deposit"} | VOLUME
LIT = {"irradiance of light 2"} | LIGHT_1
LAYERS = {"layer depth", "weights", "deposit"} | KERNEL
SHADOWS = {"shadow of light 1", "shadow of light 2", "light 1", "light 2"}
OWN = ["material.sigma_s_prime=[1.0,2.0,3.0]", "material.sigma_a=[0.1,0.2,0.3]", "material.eta=1.61"]  # jade's eta
DEPENDS = {
    "display.key": (["display.key=0.3"], {"tone map"}),
    "display.white": (["display.white=2.0"], {"tone map"}),
    "display.exposure": (["display.exposure=1"], {"tone map"}),
    "display.transform": (["display.transform=agx"], {"tone map"}),
    "display.background": (["display.background=#112233"], {"tone map"}),
    "specular.strength": (["specular.strength=0.7"], PIXELS),
    "specular.shininess": (["specular.shininess=20"], PIXELS),
    "material.sigma": (OWN, KERNEL),
    "material.eta": (["material.eta=1.4"], KERNEL | LIT),
    "camera.zoom": (["camera.zoom=2"], PIXELS),
    "camera.orthographic": (["camera.orthographic=true"], PIXELS),
    "camera.target_mm": (["camera.target_mm=[5,0,0]"], PIXELS),
    "camera.view_angle_deg": (["camera.view_angle_deg=50"], PIXELS),
    "camera.azimuth_deg": (["camera.azimuth_deg=50"], LAYERS),
    "camera.elevation_deg": (["camera.elevation_deg=40"], LAYERS),
    "camera.roll_deg": (["camera.roll_deg=30"], LAYERS),
    "material.name": (["material.name=ketchup"], KERNEL | LIT),  # eta differs too
    "transport.layers": (["transport.layers=6"], LAYERS | {"transport"}),
    "transport.resolution": (["transport.resolution=48"], LAYERS | LIT | {"transport", "samples", "sample buffers"}),
    "model.size_mm": (
        ["model.size_mm=60"],
        LAYERS | LIT | SHADOWS | {"model", "samples", "sample buffers"},
    ),
}


@pytest.mark.parametrize("name", DEPENDS)
def test_exactly_the_stages_that_depend_on_a_parameter_run(driver, name):
    assignments, expected = DEPENDS[name]
    driver.session.put(apply_set(driver.session.scene, assignments))
    assert driver.stages() == expected
    assert driver.stages() == set()  # and nothing runs again


@pytest.mark.slow
def test_the_environment_runs_its_own_stages_and_what_follows(driver, few_rays, tmp_path):
    write_exr(tmp_path / "probe.exr", {c: np.random.default_rng(3).random((16, 32), np.float32) for c in "RGB"})
    lights = 'lights=[{kind="directional",direction=[1.0,0.0,0.0]}]'
    driver.session.put(apply_set(driver.session.scene, [lights, f"environment.path={tmp_path}/probe.exr"]))
    driver.settle()
    scene = driver.session.scene
    moved = {"environment light", "irradiance of light 2", "flux", "deposit"} | VOLUME
    for assignments, expected in (
        (["environment.rotation_deg=40"], moved | {"occlusion"}),
        (["environment.intensity=3"], moved),
        (["display.background=environment"], {"background", "tone map"}),
        (["display.background=environment", "display.background_blur_deg=20"], {"background", "tone map"}),
    ):
        driver.session.put(apply_set(driver.session.scene, assignments))
        assert driver.stages() == expected, assignments
    driver.session.put(scene)


def test_one_light_leaves_the_others_alone(driver):
    first, second = driver.session.scene.lights
    driver.session.edit_lights((replace(first, irradiance=(1.0, 2.0, 3.0)), second))
    assert driver.stages() == LIGHT_1 | {"light 1"}  # a shadow knows no brightness


def test_orbiting_an_object_fixed_grid_convolves_nothing(driver):
    driver.session.edit("transport", method="ewald")
    driver.settle()
    driver.session.put(apply_set(driver.session.scene, ["camera.azimuth_deg=75", "camera.elevation_deg=40"]))
    assert driver.stages() == PIXELS


@pytest.mark.slow
def test_a_thousand_random_changes_end_in_the_picture_of_their_sum(driver, context):
    rng = np.random.default_rng(7)
    materials = ("jade", "ketchup", "Skimmilk", "marble", "Skin1")

    def change() -> None:
        scene, kind = driver.session.scene, rng.integers(8)
        if kind == 0:
            scene = apply_set(scene, [f"material.name={rng.choice(materials)}"])
        elif kind == 1:
            scene = apply_set(scene, [f"camera.azimuth_deg={rng.uniform(-180, 180):.3f}"])
        elif kind == 2:
            scene = apply_set(scene, [f"display.key={rng.uniform(0.05, 0.5):.4f}"])
        elif kind == 3:
            scene = apply_set(scene, [f"transport.layers={rng.integers(1, 6)}"])
        elif kind == 4:
            scene = apply_set(scene, [f"transport.resolution={rng.choice([24, 32])}"])
        elif kind == 5:
            direction = tuple(float(x) for x in rng.normal(size=3))
            scene = replace(scene, lights=(replace(scene.lights[0], direction=direction), scene.lights[1]))
        elif kind == 6:
            scene = apply_set(scene, [f"specular.shininess={rng.uniform(1, 200):.2f}"])
        else:
            scene = apply_set(scene, [f"transport.method={rng.choice(['layered', 'ewald'])}"])
        driver.session.put(scene)

    def objects() -> int:
        """Objects of OpenGL that are alive. (Mesa never gives a name out twice: names would tell nothing.)"""
        gc.collect()
        driver.frame()
        assert not context.objects  # what was dropped has been freed
        return sum(type(each).__module__ == "moderngl" for each in gc.get_objects())

    counts, memory = [], []
    for i in range(1000):
        change()
        if i % 4 == 0:
            driver.frames(1)
        if i % 250 == 249:
            driver.settle()
            counts.append(objects())
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    picture = driver.picture()
    assert context.error == "GL_NO_ERROR"
    assert max(counts[1:]) - min(counts[1:]) <= 5  # programs are linked when a case of them is first drawn
    assert memory[-1] - memory[0] < 60_000  # KiB
    expected = headless_picture(driver.session.scene, PICTURE)
    assert picture.shape == expected.shape
    assert np.abs(picture.astype(int) - expected).max() <= 1


@pytest.mark.slow
def test_old_volume_keeps_the_picture_alive_until_the_new_one_is_there(driver, monkeypatch):
    live, gate = driver.view.live, threading.Event()
    scatter = live.renderer.scatter

    def slow(lit, *how):
        gate.wait(DEADLINE)
        return scatter(lit, *how)

    monkeypatch.setattr(live.renderer, "scatter", slow)
    before = live.finished
    for name in ("ketchup", "marble", "Skimmilk"):
        driver.session.edit("material", name=name)
        driver.frames(2)
        assert live.working
        assert live.finished is before
        assert driver.view.picture is not None
    gate.set()
    driver.settle()
    assert live.finished.lit.profiles == live.lit.profiles
    assert np.abs(driver.picture().astype(int) - headless_picture(driver.session.scene, PICTURE)).max() <= 1


def test_missing_model_and_bad_probe_leave_the_scene_as_it_was(driver, tmp_path):
    scene, picture = driver.session.scene, driver.picture()
    (tmp_path / "bad.ply").write_text("no mesh")
    (tmp_path / "bad.hdr").write_text("no probe")
    for wrong, word in (("bad.ply", "bad.ply"), ("bad.hdr", "bad.hdr"), ("none.ply", "not a file"), ("a.txt", "a.txt")):
        driver.drop(tmp_path / wrong)
        assert any(word in text for text in driver.app.messages), wrong
        assert driver.session.scene == scene
    assert np.array_equal(driver.picture(), picture)


def test_an_unforeseen_error_is_shown_and_the_window_goes_on(driver, monkeypatch, caplog):
    scene = driver.session.scene

    def broken(scene, **options):
        raise RuntimeError("the driver has a bad day")

    with monkeypatch.context() as patch:
        patch.setattr(driver.view.live.renderer, "light", broken)
        driver.session.edit("material", name="ketchup")
        driver.frames(2)
    assert driver.session.scene == scene
    assert driver.app.messages == ["the driver has a bad day"]
    driver.session.edit("material", name="ketchup")
    driver.settle()
    assert driver.view.live.is_settled(driver.view.shown)


def test_file_deleted_while_open_does_not_matter(driver, model, tmp_path):
    other = write_knot(tmp_path / "other.ply")
    driver.drop(other)
    other.unlink()
    picture = driver.picture()
    driver.session.edit("material", name="ketchup")
    driver.settle()
    driver.key("left_ctrl", "z")
    assert np.array_equal(driver.picture(), picture)
    driver.drop(other)
    assert "not a file" in driver.app.messages[-1]


@pytest.mark.slow
def test_moved_slider_is_drawn_with_fewer_texels_and_settles_to_all(driver):
    driver.session.edit("transport", resolution=256, layers=24)
    driver.settle()
    live = driver.view.live
    live.cost = Cost(5.0, 256, 24)  # as if transport were slow here
    driver.drag(driver.place("material.sigma_a.R"), (30.0, 0.0))
    drafts = live.lit.quality.resolution
    driver.settle()
    assert drafts < 256
    assert live.finished.lit.quality.resolution == 256


@pytest.mark.slow
def test_a_dragged_material_leaves_the_processor_to_the_worker_until_its_volume_is_there(driver, monkeypatch):
    from milkglass.viewer.gui.events import MouseButton, MouseMoved

    live, gate = driver.view.live, threading.Event()
    scatter = live.renderer.scatter

    def slow(lit, *how):
        gate.wait(DEADLINE)
        return scatter(lit, *how)

    driver.picture()
    monkeypatch.setattr(live.renderer, "scatter", slow)
    place, before = driver.place("material.sigma_a.R"), live.finished
    driver.send(MouseMoved(*place), MouseButton("left", True), frames=1)
    for step in range(20):  # 0.4 s, twice as long as a draft stays without a worker
        driver.send(MouseMoved(place[0] + min(step, 3), place[1]), frames=1)
        assert not live.renderer.stages.timings.keys() & PIXELS
    assert live.working
    assert driver.view.detail.draft
    gate.set()
    live.wait()
    driver.frames(1)
    assert live.finished is not before
    assert live.renderer.stages.timings.keys() >= {"composite", "tone map"}
    driver.send(MouseButton("left", False))
    assert np.array_equal(driver.picture(), headless_picture(driver.session.scene, PICTURE))
