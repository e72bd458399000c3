"""Rays of sight in the window: few while something moves, and at rest the picture that `render` draws."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.paths.tree import PathsSuperseded, Tree
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.live.draft import AT_VERTICES, DRAFTED_STEPS, Detail
from milkglass.viewer.render.picture import read_image
from milkglass.viewer.render.tracing import Tracing
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import ModelSettings
from tests.support import solids
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene
from tests.support.skies import sky


@pytest.fixture
def clear(context, few_rays, model):
    planes = dict(zip("RGB", np.moveaxis(sky(height=32), -1, 0), strict=True))
    write_exr(model.with_name("sky.exr"), planes)
    settings = [f"environment.path={model.with_name('sky.exr')}", "display.background=environment"]
    driver = Driver(
        apply_set(small_scene(model), [*settings, "material.name=apple juice", "transport.method=diffusion"])
    )
    yield driver
    driver.close()


@pytest.mark.slow
def test_a_clear_object_comes_to_rest_as_render_draws_it_and_is_dragged_as_a_draft(clear, monkeypatch):
    driver, traced = clear, []
    steps, draft = Tracing.steps, Tracing.draft

    def counted(self, followed, *arguments):
        if self is driver.view.live.renderer._shading._tracing:
            traced.append((driver.view.detail.draft, followed.step))
        return steps(self, followed, *arguments)

    def drafted(self, *arguments):
        traced.append((driver.view.detail.draft, 0))
        return draft(self, *arguments)

    monkeypatch.setattr(Tracing, "steps", counted)
    monkeypatch.setattr(Tracing, "draft", drafted)
    first = driver.picture()
    np.testing.assert_array_equal(first, headless_picture(driver.session.scene, PICTURE))
    driver.drag((200.0, 200.0), (40.0, 10.0))
    turned = driver.picture()
    assert (turned != first).any()
    np.testing.assert_array_equal(turned, headless_picture(driver.session.scene, PICTURE))
    assert {step for is_draft, step in traced if is_draft} == {0}
    at_rest = [step for is_draft, step in traced if not is_draft]
    assert list(dict.fromkeys(at_rest)) == list(DRAFTED_STEPS[1:])


@pytest.mark.slow
def test_under_lamps_alone_rays_follow_the_first_picture_and_none_what_moves(context, few_rays, model, monkeypatch):
    pair = solids.mesh_of(*(solids.ball(10.0, at=(0.0, y, 0.0), subdivisions=3) for y in (0.0, 21.0)))
    scene = replace(small_scene(model), model=ModelSettings(mesh=pair))
    driver, traced = Driver(apply_set(scene, ["material.name=marble", "transport.method=diffusion"])), []
    steps = Tracing.steps

    def counted(self, followed, *arguments):
        live = driver.view.live
        if self is live.renderer._shading._tracing:
            traced.append((driver.view.detail.draft, followed.step, live.picture is None))
        return steps(self, followed, *arguments)

    def judge(picture):  # the transport is solved from the first picture's on, to its tolerance
        expected = headless_picture(driver.session.scene, PICTURE)
        np.testing.assert_allclose(picture.astype(float), expected.astype(float), atol=1.0)

    monkeypatch.setattr(Tracing, "steps", counted)
    judge(driver.picture())
    driver.drag((200.0, 200.0), (40.0, 10.0))
    assert driver.view.live.on_a_move == AT_VERTICES
    judge(driver.picture())
    driver.close()
    assert set(traced) == {(False, 1, False)}


@pytest.mark.slow
def test_exposure_moves_alone(clear, monkeypatch):
    driver, followed = clear, []
    steps = Tracing.steps
    monkeypatch.setattr(Tracing, "steps", lambda *arguments: followed.append(arguments) or steps(*arguments))
    monkeypatch.setattr(Tracing, "draft", lambda *arguments: followed.append(arguments))
    first = driver.picture()
    scene = driver.view.shown
    brighter = replace(scene, display=replace(scene.display, key=2.0 * scene.display.key))
    assert driver.view.live.draw(brighter, Detail(draft=True)).image.size == PICTURE
    assert read_image(driver.view.live.picture).mean() > first.mean()
    driver.view.live.draw(brighter, Detail())
    assert not followed


@pytest.mark.slow
def test_frames_go_on_while_rays_are_on_their_way_and_what_moves_supersedes_them(clear, monkeypatch):
    driver, live, find, asked, begun = clear, clear.view.live, Tree.find, [], threading.Event()

    def endless(self, sight, go_on, highlights):
        asked.append(go_on)
        begun.set()
        while go_on():
            time.sleep(0.001)
        return find(self, sight, go_on)

    with monkeypatch.context() as patched:
        patched.setattr(Tree, "find", endless)
        for _ in range(100):  # of lights that are spread over frames
            drafted = live.draw(turned(driver, 10.0), Detail())
            if (followed := live.awaited) is not None:
                break
        assert live.draw(turned(driver, 10.0), Detail()) is drafted
        assert live.awaited is followed
        assert begun.wait(60.0)
        live.draw(turned(driver, 20.0), Detail())
        assert not asked[0]()
        with pytest.raises(PathsSuperseded):
            followed.result(60.0)
    driver.settle()


def turned(driver: Driver, by: float) -> Scene:
    """The scene of a window, seen from elsewhere."""
    scene = driver.view.shown
    return replace(scene, camera=replace(scene.camera, azimuth_deg=scene.camera.azimuth_deg + by))
