"""Transport `diffusion` while the scene changes: solved in steps, interrupted, and in the end what a render gives."""

import threading
import time
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from milkglass.core.transport.diffusion import solver as diffusion
from milkglass.core.transport.diffusion.solver import NESTED, TOLERANCE, DiffusionTransport
from milkglass.viewer.error import photons
from milkglass.viewer.error.photons import N_REGIONS
from milkglass.viewer.error.report import error_report
from milkglass.viewer.live.draft import Cost, Detail
from milkglass.viewer.live.error import ROUNDS, surface_of
from milkglass.viewer.live.job import PRESENTABLE
from milkglass.viewer.live.rays import RaysJob
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import apply_set
from milkglass.viewer.scene.settings import TransportSettings
from milkglass.viewer.window.panel.transport import chosen, solved
from milkglass.viewer.window.replay import Headless
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene, write_pair
from tests.support.waiting import DEADLINE, wait_until

PIXELS = {"gbuffer", "composite", "exposure", "tone map"}
SOURCES = {f"sources of {channel}" for channel in "RGB"}
SOLVED = {"solution", "layer volume", "mean fluence"} | SOURCES | PIXELS
MOVED = {"shadow of light 1", "light 1", "irradiance of light 1", "flux", "flux of light 1", "entry of light 1"}
OWN = ["material.sigma_s_prime=[1.0,2.0,3.0]", "material.sigma_a=[0.1,0.2,0.3]", "material.eta=1.61"]  # jade's eta
MATERIALS = ("jade", "ketchup", "Skimmilk", "marble", "Skin1")
SECTIONS = ("Error", "Model")


def with_diffusion(model, resolution=24):
    return replace(small_scene(model), transport=TransportSettings(method="diffusion", resolution=resolution))


@pytest.fixture
def driver(context, model):
    driver = Driver(with_diffusion(model))
    yield driver
    driver.close()


def put(driver, *assignments):
    driver.session.put(apply_set(driver.session.scene, assignments))


def turn_light(driver, *direction):
    first, second = driver.session.scene.lights
    lights = (replace(first, direction=direction), second)
    driver.session.edit_lights(lights)


def is_as_rendered(driver) -> bool:
    """Whether the window at rest shows what `milkglass render` makes of its scene.

    Both are solved to a residual from other starts, and so differ by it: in 8 bits by one step, rarely two.
    """
    picture = driver.picture()
    off = np.abs(picture.astype(int) - headless_picture(driver.session.scene, PICTURE))
    finished = driver.view.live.finished
    return finished.complete and max(finished.scattered.residuals) <= TOLERANCE and off.max() <= 2


class Steps:
    """Holds a solution between its steps until it may go on, and keeps all residuals that were reached."""

    def __init__(self, monkeypatch, live) -> None:
        monkeypatch.setattr(diffusion, "ROUND_PRODUCTS", 1)  # of two products one round would often be all
        self._live, self.gate = live, threading.Semaphore(0)
        self.residuals: list[float] = []
        scatter = live.renderer.scatter

        def stepped(lit, go_on):
            def held(solution):
                goes_on = go_on(solution)
                self.residuals.append(max(solution.residuals))
                return goes_on and self.gate.acquire(timeout=DEADLINE)

            return scatter(lit, held)

        monkeypatch.setattr(live.renderer, "scatter", stepped)

    def go(self, count=1) -> None:
        """Let steps be taken, and wait until they are or there are no more."""
        before, job = len(self.residuals), self._live.job
        for _ in range(count):
            self.gate.release()
        wait_until(lambda: len(self.residuals) >= before + count or job.future.done())

    def wait(self, count=1) -> None:
        """Wait until so many steps were reached."""
        wait_until(lambda: len(self.residuals) >= count)

    def end(self) -> None:
        """Hold nothing any more."""
        self.gate.release(10_000)


@pytest.mark.parametrize(
    ("assignments", "expected"),
    [
        (["display.key=0.3"], {"tone map"}),
        (["specular.strength=0.7"], PIXELS),
        (["camera.zoom=2"], PIXELS),
        (["camera.azimuth_deg=75", "camera.elevation_deg=40", "camera.roll_deg=10"], PIXELS),
        (OWN, SOLVED | {"spectra", "pixel terms", "pixel tables"}),
    ],
)
def test_exactly_the_stages_that_depend_on_a_parameter_run(driver, assignments, expected):
    put(driver, *assignments)
    assert driver.stages() == expected
    assert driver.stages() == set()


def test_one_light_leaves_the_entry_of_the_others_alone(driver):
    turn_light(driver, 0.3, 0.2, 1.0)
    assert driver.stages() == SOLVED | MOVED
    assert driver.stages() == set()


def test_what_makes_the_first_picture_better_begins_once_it_is_drawn(context, model, monkeypatch):
    """Until then neither more nodes are solved nor rays cast: drawing has the processor to itself."""
    begun: list[tuple[str, bool]] = []
    with closing(Headless(with_diffusion(model, NESTED))) as window:
        live = window.app.view.live
        channels, follow = DiffusionTransport._channels, RaysJob.follow

        def solving(transport, problem, stages):
            begun.append(("half" if problem.is_preliminary else "all", live.picture is not None))
            return channels(transport, problem, stages)

        def casting(job, scene):
            begun.append(("rays", live.picture is not None))
            follow(job, scene)

        monkeypatch.setattr(DiffusionTransport, "_channels", solving)
        monkeypatch.setattr(RaysJob, "follow", casting)
        window.settle()
        assert begun[0] == ("half", False)
        assert {("all", True), ("rays", True)} <= set(begun)
        assert {is_drawn for what, is_drawn in begun if what != "half"} == {True}
        assert live.is_settled(window.app.view.shown)


@pytest.mark.slow
def test_a_solution_on_the_way_shows_once_it_may_be_seen_and_is_no_rest(driver, monkeypatch):
    live = driver.view.live
    before, steps = live.finished, Steps(monkeypatch, live)
    turn_light(driver, -1.0, 0.3, -0.5)
    driver.frames(2)
    steps.wait()
    while steps.residuals[-1] > PRESENTABLE:
        driver.frames(1)
        assert live.finished is before  # what a start of another light gives is worse than the volume before
        steps.go()
    driver.frames(2)
    assert live.finished is not before
    assert max(live.finished.scattered.residuals) == steps.residuals[-1] > TOLERANCE
    assert not live.finished.complete
    assert "on the way" in solved(live.finished.scattered, complete=live.finished.complete)
    assert not driver.app.at_rest()
    steps.end()
    assert is_as_rendered(driver)
    assert solved(live.finished.scattered, complete=True).startswith("solved: R to ")
    np.testing.assert_equal(sorted(steps.residuals, reverse=True), steps.residuals)


def test_newer_light_ends_a_solution_that_may_be_seen_and_it_is_no_rest(driver, monkeypatch):
    live = driver.view.live
    steps = Steps(monkeypatch, live)
    turn_light(driver, -1.0, 0.3, -0.5)
    driver.frames(2)
    steps.wait()
    first, learnt = live.lit, live.cost
    turn_light(driver, 1.0, 0.3, -0.5)
    driver.frames(2)
    while live.job is not None and live.job.lit is first:
        assert steps.residuals[-1] > TOLERANCE
        assert len(steps.residuals) < 40
        steps.go(1)
        time.sleep(0.02)
        driver.frames(1)
    assert live.finished.lit is first
    assert not live.finished.complete
    assert TOLERANCE < max(live.finished.scattered.residuals) <= PRESENTABLE
    assert live.cost == learnt  # from solutions that were carried through alone
    assert not live.is_settled(driver.view.shown)
    steps.end()
    assert is_as_rendered(driver)
    assert live.cost != learnt


def test_coming_back_to_light_that_was_interrupted_solves_it(driver, monkeypatch):
    live = driver.view.live
    steps, start = Steps(monkeypatch, live), driver.session.scene
    turn_light(driver, -1.0, 0.3, -0.5)
    driver.frames(2)
    steps.wait()
    for scene in (start, driver.session.scene, start, driver.session.scene):
        driver.session.put(scene)
        driver.frames(1)
        steps.go(2)
    steps.end()
    assert is_as_rendered(driver)


@pytest.mark.slow
def test_another_model_ends_a_solution_at_once_and_draws_nothing_of_it(driver, monkeypatch, tmp_path):
    live = driver.view.live
    other = tmp_path / "other.ply"
    trimesh.creation.torus(1.0, 0.4, 24, 12).export(other)
    driver.drop(other)
    driver.key("left_ctrl", "z")
    driver.settle()
    before, steps = live.finished, Steps(monkeypatch, live)
    turn_light(driver, -1.0, 0.3, -0.5)
    driver.frames(2)
    steps.wait()
    assert steps.residuals[-1] > PRESENTABLE
    put(driver, f"model.path={other}")
    driver.frames(2)
    job = live.job
    steps.go(1)
    job.future.result(DEADLINE)
    assert len(steps.residuals) == 2
    driver.frames(1)
    assert live.finished is before
    steps.end()
    assert is_as_rendered(driver)
    assert live.finished.lit.model.mesh is live.assets.mesh(driver.session.scene.model)[0]


def test_a_preview_does_not_outlive_the_end_of_its_solution(driver, monkeypatch):
    """It may come in at the very moment that the end is taken."""
    live = driver.view.live
    put(driver, *OWN)
    driver.frames(1)
    live.wait()
    job = live.job
    assert job.future.done()
    job._preview = job.future.result().scattered
    driver.settle()
    assert live.finished.complete
    assert live.job is None
    assert is_as_rendered(driver)


@pytest.mark.slow
def test_a_history_of_changes_ends_in_the_picture_of_their_sum(driver):
    rng = np.random.default_rng(5)
    methods = ("diffusion", "ewald", "layered")
    for i in range(80):
        kind = rng.integers(7)
        if kind == 0:
            put(driver, f"material.name={rng.choice(MATERIALS)}")
        elif kind == 1:
            put(driver, f"camera.azimuth_deg={rng.uniform(-180, 180):.2f}")
        elif kind in (2, 3):
            turn_light(driver, *(float(x) for x in rng.normal(size=3)))
        elif kind == 4:
            put(driver, f"transport.resolution={rng.choice([20, 24, 32])}")
        elif kind == 5:
            put(driver, f"transport.method={rng.choice(methods)}")
        else:
            put(driver, f"model.size_mm={rng.choice([20, 60])}", f"model.bodies={rng.choice(['joined', 'separate'])}")
        driver.frames(int(rng.integers(1, 4)))
        if i % 40 == 39:
            put(driver, "transport.method=diffusion")
            assert is_as_rendered(driver)
    for method in (*methods, "diffusion"):
        put(driver, f"transport.method={method}")
        off = np.abs(driver.picture().astype(int) - headless_picture(driver.session.scene, PICTURE))
        assert off.max() <= 2, method


@pytest.mark.slow
def test_a_drag_with_fewer_nodes_keeps_the_surface_on_the_grid_of_the_picture(driver, monkeypatch):
    put(driver, "transport.resolution=64")
    driver.settle()
    live = driver.view.live
    kept = live.finished.scattered.boundary
    live.cost = Cost(20.0, 64, live.finished.lit.grid.n_layers)  # as if it were slow here
    driver.drag(driver.place("material.sigma_a.R"), (30.0, 0.0))
    assert live.lit.quality.resolution < 64
    driver.settle()
    assert live.finished.scattered.boundary is kept
    assert is_as_rendered(driver)


def test_an_open_mesh_falls_back_and_says_so(driver, tmp_path):
    mesh = trimesh.load_mesh(driver.session.scene.model.path, process=False)
    trimesh.Trimesh(mesh.vertices, mesh.faces[len(mesh.faces) // 5 :], process=False).export(tmp_path / "open.ply")
    put(driver, "model.close_holes=false")
    driver.drop(tmp_path / "open.ply")
    live = driver.view.live
    assert live.finished.lit.quality.method == "ewald"
    assert any("needs a closed surface" in text and text.endswith("ewald") for text in driver.app.messages)
    assert driver.app.panel.controls.boxes.keys() >= {"transport.error_target", "transport.assignment"}
    picture = driver.picture()
    put(driver, "transport.method=ewald")
    np.testing.assert_array_equal(driver.picture(), picture)
    put(driver, "transport.method=diffusion")
    driver.drag(driver.place("material.sigma_a.R"), (30.0, 0.0))
    driver.settle()
    assert live.finished.lit.quality.method == "ewald"


@pytest.mark.slow
def test_controls_without_meaning_are_off_and_the_rest_works(driver):
    for section in SECTIONS:
        driver.click(f"section.{section}", 0.3)
    put(driver, "transport.assignment=tent")
    driver.settle()
    scene = driver.session.scene
    driver.click("transport.assignment", 0.3)
    driver.click("transport.assignment", 0.3, button="right")
    assert driver.session.scene == scene
    for name, share in (("transport.layers", 0.1), ("transport.resolution", 0.1), ("transport.error_target", 0.9)):
        driver.click(name, share)
        key = name.split(".")[1]
        assert getattr(driver.session.scene.transport, key) != getattr(scene.transport, key)
        driver.session.put(scene)
    put(driver, "transport.method=ewald")
    driver.settle()
    driver.click("transport.assignment", 0.3)
    assert "transport.assignment=tsc" in driver.app.panel.controls.boxes


def measured_by_photons(driver):
    driver.session.view.measure = True
    driver.settle()
    error = driver.app.error
    assert (error.result, error.trouble, error.progress, error.outdated) == (None, None, None, False)
    return error.walked


@pytest.mark.slow
def test_photons_judge_what_an_equation_gives(context, tmp_path, monkeypatch):
    """The window has what a report has; a turn of the view walks no photons again; ewald has points as before."""
    monkeypatch.setattr("milkglass.viewer.live.error.PHOTONS", 10_000)
    monkeypatch.setattr("milkglass.viewer.live.error.ROUNDS", 1)  # the very photons of the report
    scene = apply_set(with_diffusion(write_pair(tmp_path / "pair.ply")), ["model.size_mm=20"])
    driver = Driver(replace(scene, lights=(DirectionalLight((1.0, 0.5, 1.0)),)))
    driver.session.view.error_points = N_REGIONS
    walked = measured_by_photons(driver)
    renderer = Renderer(driver.app.view.live.renderer.context)
    found = error_report(renderer, driver.view.shown, points=5, photons=10_000).content["transport_error"]
    for name, part in (("whole", walked.error.whole), ("between_parts", walked.error.between_parts)):
        assert part.rms == pytest.approx(found[name]["rms"], abs=0.02)
    assert walked.error.inside.rms == pytest.approx(found["rms"], abs=0.02)
    assert min(walked.error.between_parts.share) > 0.01
    assert is_as_rendered(driver)
    put(driver, "camera.azimuth_deg=40")
    driver.settle()
    turned = driver.app.error.walked
    assert turned.error is walked.error
    assert turned.dots.lies_in(driver.view.shown)
    assert not walked.dots.lies_in(driver.view.shown)
    put(driver, "transport.exchange=off")
    without = measured_by_photons(driver)
    assert without.error.inside.rms == pytest.approx(walked.error.inside.rms, abs=0.02)
    assert max(without.error.between_parts.rms) > 2.0 * max(walked.error.between_parts.rms)
    driver.session.view.error_points = 50
    put(driver, "transport.method=ewald")
    driver.settle()
    error = driver.app.error
    assert (error.trouble, error.walked) == (None, None)
    assert error.result.quality.method == "ewald"
    driver.close()


@pytest.mark.slow
def test_numbers_and_dots_come_after_each_round_of_photons(context, tmp_path, monkeypatch):
    """Two separate bodies; the noise that is said falls with the photons, and the dots lie on what they are of."""
    monkeypatch.setattr("milkglass.viewer.live.error.PHOTONS", 10_000)
    gate, scene = threading.Semaphore(0), with_diffusion(write_pair(tmp_path / "pair.ply"), 16)
    advance = photons.photon_walk

    def held(*args, **kwargs):
        assert gate.acquire(timeout=DEADLINE)
        return advance(*args, **kwargs)

    monkeypatch.setattr(photons, "photon_walk", held)
    driver = Driver(apply_set(scene, ["model.size_mm=20"]))
    driver.session.view.error_points, driver.session.view.measure = 60, True
    driver.frames(2)
    error, found = driver.app.error, []
    for _ in range(2):
        gate.release()
        before = error.walked
        wait_until(lambda before=before: driver.frames(1) or error.walked is not before)
        assert error.progress is not None
        assert "so far transport inside" in driver.app.error_status()
        found.append(error.walked)
    assert [walked.photons for walked in found] == [2_000, 4_000]
    noise = [np.sqrt(np.square(walked.error.noise).mean()) for walked in found]
    assert noise[1] / noise[0] == pytest.approx(np.sqrt(0.5), rel=0.15)
    gate.release(ROUNDS)
    driver.settle()
    dots = error.walked.dots
    assert error.walked.photons == 10_000
    assert 15 < len(dots.rows) < len(error.walked.error.exitance)
    alpha, _, exitance = surface_of(driver.view.live.renderer.context, driver.view.shown, driver.view.live.finished)
    assert (alpha[dots.rows, dots.columns] == 1.0).all()
    assert np.corrcoef(exitance[dots.rows, dots.columns, 1], dots.exitance[:, 1])[0, 1] > 0.95
    drawn = []
    monkeypatch.setattr(driver.app.error_overlay, "draw", lambda dots, *_, **__: drawn.append(dots))
    driver.frames(1)
    assert drawn == [dots]
    driver.click("error.map")
    assert not driver.session.view.error_map
    driver.click("error.points", 0.03)
    assert driver.session.view.error_points != 60
    driver.close()


@pytest.mark.slow
def test_a_walk_of_photons_ends_when_the_light_changes(driver):
    driver.settle()
    driver.session.view.measure = True
    driver.frames(1)
    assert driver.app.error.progress is not None
    turn_light(driver, 0.0, 1.0, 1.0)
    driver.frames(2)
    assert driver.app.error.outdated


@pytest.mark.slow
def test_what_photons_cannot_judge_is_said(driver):
    driver.session.edit_lights((PointLight((0.0, 50.0, 100.0)),))
    driver.key("e")
    driver.settle()
    error = driver.app.error
    assert (error.result, error.walked, error.progress) == (None, None, None)
    assert error.trouble == "not measured: photons come from distant lights only, and the scene has a point light"
    driver.session.edit_lights((DirectionalLight((0.0, 0.0, 1.0)),))
    put(driver, "material.name=sprite")
    driver.settle()
    assert error.trouble.startswith("not measured here: light loses its course about ")
    vessel = SimpleNamespace(detail=None, clear=(1,), matter=(1, 2))
    reason = photons.obstacle(driver.session.scene, vessel)
    assert reason == "photons do not know parts of the model with a material of their own"


def test_costs_and_layers_are_told_and_shown(driver):
    live = driver.view.live
    told = chosen(live.finished, live.stage_times)
    assert "new light in" in told
    assert "a new material in" in told
    assert "new light" not in chosen(live.finished, {})
    finished = live.finished
    incoming, outgoing = finished.incoming(), finished.outgoing()
    assert incoming.shape == outgoing.shape == (3, *finished.lit.grid.shape)
    np.testing.assert_allclose(incoming.sum(axis=(1, 2, 3)), finished.lit.flux.sum(axis=0), rtol=1e-4)
    leaving, entering = outgoing.sum(axis=(1, 2, 3)), incoming.sum(axis=(1, 2, 3))
    assert np.all((leaving > 0.05 * entering) & (leaving < 1.02 * entering))
    pictures = set()
    driver.session.view.layer = 10
    for show in ("beauty", "irradiance", "exitance", "subsurface", "highlight", "normal", "layer in", "layer out"):
        driver.session.view.show = show
        driver.settle()
        shown = driver.view.layer_map
        pixels = driver.picture() if shown is None else np.frombuffer(shown.texture.read(), np.uint8)
        pictures.add(pixels.tobytes())
    assert len(pictures) == 8


def test_the_split_view_compares_two_methods(driver):
    driver.key("k")
    put(driver, "transport.method=ewald")
    driver.key("v")
    driver.settle()
    mine, kept = driver.view.lives()
    assert mine.finished.lit.quality.method == "ewald"
    assert kept.finished.lit.quality.method == "diffusion"
    assert kept.finished.complete


def test_light_that_comes_back_in_a_drag_is_solved_after_all(driver, monkeypatch):
    live, scene = driver.view.live, driver.view.shown
    steps = Steps(monkeypatch, live)
    moved, further = (apply_set(scene, [*OWN[::2], f"material.sigma_a=[{x},0.2,0.3]"]) for x in (0.5, 0.9))
    live.draw(moved, Detail(draft=True))
    steps.wait()
    lit = live.lit
    live.draw(further, Detail(draft=True))
    assert live.lit is lit  # the worker has the processor
    steps.end()
    live.wait()
    live.draw(moved, Detail(draft=True))
    assert live.finished.lit is lit
    live.wait()
    live.draw(moved, Detail())
    live.wait()
    live.draw(moved, Detail())
    assert live.is_settled(moved)
    assert max(live.finished.scattered.residuals) <= TOLERANCE


def test_what_is_seen_through_a_clear_object_is_there_while_it_turns(driver):
    """A few rays stand for the pixels around them; at rest each has its own."""
    clear = "material.sigma_s_prime=[0,0,0]", "material.sigma_a=[0,0.02,0.1]"
    put(driver, *clear, "environment.builtin=studio", "lights=[]", "display.background=#000000")
    driver.settle()
    put(driver, "camera.azimuth_deg=60")
    live, scene = driver.view.live, driver.view.shown
    drafted = read_image(live.draw(scene, Detail(draft=True), exposure_for=1.0)).astype(int)
    assert is_as_rendered(driver)
    full = read_image(live.draw(scene, Detail(samples=4), exposure_for=1.0)).astype(int)
    seen = full.any(axis=2)
    assert drafted[seen].mean() == pytest.approx(full[seen].mean(), rel=0.2)
    assert 1.0 < np.abs(drafted - full)[seen].mean() < 0.5 * full[seen].mean()


@pytest.mark.slow
def test_matter_seen_by_rays_is_at_rest_as_rendered(driver):
    """Light within is found after the surface's, and by a window as by a renderer that never saw the matter before."""
    put(driver, "material.eta=1.33", "material.sigma_s_prime=[0.03,0.05,0.4]", "material.sigma_a=[0.001,0.002,0.003]")
    assert is_as_rendered(driver)
    assert driver.view.live.finished.gather.resolved is not None
    put(driver, "material.name=marble")
    assert is_as_rendered(driver)
    assert driver.view.live.finished.gather.resolved is None
