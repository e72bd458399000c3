"""The error of what is on screen: the numbers of the report, when they are measured, and when they are not."""

import gc
import logging
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.viewer.error.report import error_report
from milkglass.viewer.error.visible import DEFAULT_POINTS, measure
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.live.error import LARGEST, THREADS, Cancelled, LiveError
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import apply_set
from milkglass.viewer.scene.settings import MaterialSettings, ModelSettings, TransportSettings
from milkglass.viewer.session.session import DEFAULT_ERROR_POINTS
from tests.support.driving import Driver, small_scene, write_knot
from tests.support.solids import ball, mesh_of
from tests.support.waiting import DEADLINE

POINTS = 40
EWALD = TransportSettings("ewald", error_target=0.02)
BLACK = MaterialSettings(sigma_s_prime=(0.0,) * 3, sigma_a=(1.0,) * 3)


@pytest.fixture
def driver(context, model):
    driver = Driver(small_scene(model))
    driver.session.view.error_points = POINTS
    yield driver
    driver.close()


def measured(driver: Driver):
    """The result of a settled measurement of what is on screen."""
    driver.session.view.measure = True
    driver.settle()
    error = driver.app.error
    assert (error.progress, error.trouble, error.outdated) == (None, None, False)
    return error.result


class HeldMeasurement:
    """Holds measurements where they first look whether to go on, until they are given up or let go."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reached, self.go, self.looks = threading.Event(), threading.Event(), []

        def held(seen, mesh, light, material, progress, *rest):
            def look(share: float) -> None:
                self.looks.append(share)
                self.reached.set()
                while not self.go.wait(0.01):
                    progress(share)
                progress(share)

            return measure(seen, mesh, light, material, look, *rest)

        monkeypatch.setattr("milkglass.viewer.error.visible.measure", held)


def start(driver: Driver):
    """Begin a measurement that takes seconds, and return its future."""
    driver.settle()
    driver.session.view.error_points, driver.session.view.measure = 2000, True
    driver.frames(1)
    assert driver.app.error.progress is not None
    return driver.app.error._job.future


# The numbers


def probe(path):
    write_exr(path, {c: np.random.default_rng(3).random((16, 32), np.float32) for c in "RGB"})
    return f"environment.path={path}"


@pytest.mark.slow
@pytest.mark.parametrize("case", ["layered", "ewald", "environment", "large"])
def test_numbers_are_those_of_the_report(driver, context, few_rays, tmp_path, case):
    size = (700, 300) if case == "large" else (72, 64)
    scene = replace(driver.session.scene, transport=EWALD) if case in ("ewald", "environment") else driver.session.scene
    assignments = [probe(tmp_path / "probe.exr")] if case == "environment" else []
    driver.session.put(apply_set(scene, [f"display.image_size=[{size[0]},{size[1]}]", *assignments]))
    result = measured(driver)
    assert result.size == ((LARGEST, 219) if case == "large" else size)
    scene = replace(driver.session.scene, display=replace(driver.session.scene.display, image_size=result.size))
    report = error_report(Renderer(context), scene, points=POINTS, seed=0)
    assert result.error.deviation == report.deviation
    assert result.quality.predicted_error == report.content["transport"]["predicted_error"]
    assert result.error.n_sources == report.content["reference"]["sources"]


def test_as_many_points_as_the_report_takes():
    assert DEFAULT_ERROR_POINTS == DEFAULT_POINTS


# When it measures


def test_off_costs_nothing(driver):
    driver.settle()
    error = driver.app.error
    assert error.progress is None
    assert error.result is None
    assert error._worker is None


@pytest.mark.slow
def test_separate_bodies_are_measured_each_alone(driver, context, tmp_path):
    two = mesh_of(ball(1.0), ball(1.0, (2.1, 0.0, 0.0)))
    trimesh.Trimesh(two.vertices, two.faces, vertex_normals=two.normals, process=False).export(tmp_path / "two.ply")
    scene = replace(
        driver.session.scene,
        transport=EWALD,
        lights=(DirectionalLight((1.0, 0.0, 0.0)),),  # one ball is in the other's shadow
        model=ModelSettings(path=tmp_path / "two.ply", size_mm=20.0),
    )
    deviations = []
    for bodies in ("joined", "separate"):
        driver.session.put(replace(scene, model=replace(scene.model, bodies=bodies)))
        deviations.append(measured(driver).error.deviation)
        report = error_report(Renderer(context), driver.session.scene, points=POINTS, seed=0)
        assert report.deviation.rms == pytest.approx(deviations[-1].rms, rel=1e-9)
        assert max(deviations[-1].rms) < 0.02
    assert deviations[0] != deviations[1]


@pytest.mark.slow
def test_measuring_leaves_the_picture_and_its_stages_alone(driver, context):
    picture = driver.picture()
    measured(driver)
    assert np.array_equal(driver.picture(), picture)
    assert driver.stages() == set()
    assert driver.app.next_frame() is None  # nothing goes on

    def objects() -> int:
        gc.collect()
        driver.frame()
        return sum(type(each).__module__ == "moderngl" for each in gc.get_objects())

    before = objects()
    for points in (50, 60, 70):
        driver.session.view.error_points = points
        driver.settle()
        assert len(driver.app.error.result.error.reference) == points
    assert objects() == before


def test_what_exitance_does_not_depend_on_leaves_the_numbers_as_they_are(driver):
    result = measured(driver)
    driver.session.put(apply_set(driver.session.scene, ["display.key=0.4", "specular.strength=1", "display.white=2"]))
    driver.settle()
    assert driver.app.error.result is result


@pytest.mark.slow
def test_a_change_makes_numbers_old_until_the_picture_rests_again(driver):
    first = measured(driver)
    driver.session.edit("material", name="ketchup")
    driver.frames(1)
    error = driver.app.error
    assert error.outdated
    assert error.result is first
    assert error.progress is None  # the picture is not at rest yet
    driver.settle()
    second = error.result
    assert not error.outdated
    assert second.error.deviation != first.error.deviation
    assert second.dots.lies_in(driver.view.shown)
    driver.session.undo()
    driver.settle()
    assert error.result.error.deviation == first.error.deviation


def test_it_does_not_measure_while_a_button_is_held(driver):
    from milkglass.viewer.gui.events import MouseButton, MouseMoved

    place = (20.0, 20.0)
    driver.send(MouseMoved(*place), MouseButton("left", True))
    driver.session.view.measure = True
    driver.frames(60)
    assert driver.view.at_rest()
    assert driver.app.error.progress is None
    driver.send(MouseButton("left", False))
    assert driver.app.error.progress is not None or driver.app.error.result is not None


@pytest.mark.parametrize("change", ["material.name=ketchup", "camera.zoom=2", "model.size_mm=60", "points", "off"])
def test_a_change_ends_the_measurement_at_its_next_look(driver, change, monkeypatch):
    held = HeldMeasurement(monkeypatch)
    future = start(driver)
    assert held.reached.wait(DEADLINE)
    if change == "points":
        driver.session.view.error_points = POINTS
    elif change == "off":
        driver.session.view.measure = False
    else:
        driver.session.put(apply_set(driver.session.scene, [change]))
    driver.app.error.follow(driver.view.shown, POINTS if change == "points" else None if change == "off" else 2000)
    with pytest.raises(Cancelled):
        future.result(DEADLINE)
    assert len(held.looks) <= THREADS  # each thread's first one
    held.go.set()
    driver.session.view.error_points = POINTS
    driver.settle()
    assert (driver.app.error.trouble, driver.app.error.result is None) == (None, change == "off")


@pytest.mark.slow
def test_undo_and_another_model_while_it_measures(driver, tmp_path):
    expected = measured(driver).error.deviation
    scene = driver.session.scene
    driver.session.edit("material", name="ketchup")
    start(driver)
    driver.session.undo()
    driver.session.view.error_points = POINTS
    assert measured(driver).error.deviation == expected
    start(driver)
    driver.session.edit("model", path=str(write_knot(tmp_path / "other.stl")))
    driver.session.view.error_points = POINTS
    other = measured(driver)
    assert driver.view.shown.model.path == tmp_path / "other.stl"
    assert other.dots.lies_in(driver.view.shown)
    driver.session.put(scene)
    assert measured(driver).error.deviation == expected


@pytest.mark.slow
def test_a_measurement_looks_often_whether_to_go_on(driver, monkeypatch):
    """So that giving it up takes a small share of it, whatever else the machine does."""
    looks, enough = [], threading.Event()

    def counted(seen, mesh, light, material, progress, *rest):
        def look(share: float) -> None:
            looks.append(share)
            if share > 0.1:
                enough.set()
            progress(share)

        return measure(seen, mesh, light, material, look, *rest)

    monkeypatch.setattr("milkglass.viewer.error.visible.measure", counted)
    start(driver)
    assert enough.wait(DEADLINE)
    assert np.diff([0.0, *looks]).max() <= 0.05


def test_the_window_closes_while_it_measures(context, model, monkeypatch):
    held = HeldMeasurement(monkeypatch)
    driver = Driver(small_scene(model))
    future = start(driver)
    assert held.reached.wait(DEADLINE)
    driver.close()
    assert future.done()
    assert isinstance(future.exception(), Cancelled)


# What cannot be measured


def test_no_object_in_the_picture_is_a_sentence(driver):
    driver.session.put(apply_set(driver.session.scene, ["camera.target_mm=[5000,0,0]"]))
    driver.session.view.measure = True
    driver.settle()
    assert driver.app.error.trouble.startswith("the picture does not show the object")
    assert driver.app.error.result is None
    driver.session.put(apply_set(driver.session.scene, ["camera.target_mm=[0,0,0]"]))
    measured(driver)


@pytest.mark.parametrize("dark", ["black material", "no light"])
def test_where_no_light_leaves_there_is_no_error(driver, dark):
    scene = driver.session.scene
    driver.session.put(replace(scene, lights=()) if dark == "no light" else replace(scene, material=BLACK))
    result = measured(driver)
    assert result.is_dark
    assert result.error.deviation.rms == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("place", ["the thread", "the picture"])
def test_an_unforeseen_error_is_shown_once_and_the_window_goes_on(driver, monkeypatch, caplog, place):
    calls = []

    def broken(*_, **__):
        calls.append(1)
        raise RuntimeError("a bad day")

    with monkeypatch.context() as patch:
        patch.setattr(
            "milkglass.viewer.error.visible.measure"
            if place == "the thread"
            else "milkglass.viewer.live.error.surface_of",
            broken,
        )
        driver.session.view.measure = True
        driver.settle()
        driver.frames(5)
        assert driver.app.error.trouble == "the measurement failed: a bad day"
        assert len(calls) == 1
    assert [record.levelno for record in caplog.records] == [logging.ERROR]
    driver.session.edit("material", name="ketchup")
    measured(driver)


def test_an_input_error_is_its_own_sentence(driver, monkeypatch):
    def full(*_):
        raise InputError("the GPU has no memory left")

    with monkeypatch.context() as patch:
        patch.setattr("milkglass.viewer.live.error.surface_of", full)
        driver.session.view.measure = True
        driver.settle()
    assert driver.app.error.trouble == "the GPU has no memory left"


def test_nothing_is_measured_before_there_is_a_picture(context, model, monkeypatch):
    error = LiveError(context, lambda: None)
    driver = Driver(small_scene(model))
    monkeypatch.setattr(driver.view.live, "finished", None)
    error.follow(driver.view.shown, POINTS)
    assert error.update(driver.view.shown, driver.view.live, at_rest=True)  # it is outdated now
    assert error.progress is None
    error.close()
    monkeypatch.undo()
    driver.close()


@pytest.mark.slow
def test_progress_wakes_the_window_and_is_whole(driver, monkeypatch):
    woken, shares = [], []
    driver.app.error._wake = lambda: woken.append(1)

    def slow(seen, mesh, light, material, progress, *rest):
        def told(share: float) -> None:
            time.sleep(0.02)
            shares.append(share)
            progress(share)

        return measure(seen, mesh, light, material, told, *rest)

    monkeypatch.setattr("milkglass.viewer.error.visible.measure", slow)
    measured(driver)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert 2 <= len(woken) <= len(shares) + 3
