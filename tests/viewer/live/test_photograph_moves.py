"""Every setting that moves a photograph or its object runs again exactly the parts that it declares to move."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.stages import Part
from milkglass.viewer.live.job import Finished
from milkglass.viewer.live.photograph import PhotographDeveloper
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.gpu_composite import PhotoPass
from milkglass.viewer.photograph.object import ObjectRequest
from milkglass.viewer.render.picture import PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.scene import START, Change, changed
from milkglass.viewer.scene.settings import TABLES, PhotoSettings
from tests.support.photographing import ball_photo, small_photo
from tests.support.waiting import DEADLINE

SETTINGS = {
    f"{name}.{key}": declared
    for name, table in TABLES.items()
    for key, declared in settings_of(table).items()
    if {Part.OBJECT, Part.PHOTOGRAPH} & {*declared.moves} or table is PhotoSettings
}
VALUES = {
    "photo.depth_strength": 1.5, "photo.depth_smoothing": 0.4, "photo.behind": "seen", "model.size_mm": 80.0,
    "display.key": 0.3, "display.exposure": 1.0, "display.white": 2.0,
}  # fmt: skip


class Desk:
    """A photograph drawn as a window draws it, without the window's waiting."""

    def __init__(self, context, photo):
        self.renderer, self.work = Renderer(context), PhotoWork(photo)
        self.developer = PhotographDeveloper(self.work, PhotoPass(context, photo))

    def draw(self, scene):
        """Draw a scene; returns the parts that ran."""
        before = self.work.object
        self.work.update(scene)
        self.work.wait(DEADLINE)
        self.work.update(scene)
        renderer, placed = self.renderer, self.work.placed(scene)
        renderer.stages.begin()
        renderer.transport_stages.begin()
        lit = renderer.light(placed)
        scattered = renderer.scatter(lit)
        finished = Finished(lit, renderer.gather(lit, scattered), scattered)
        shown = self.developer.placed(placed, lit)
        self.developer.develop(renderer, shown, lit, finished, PictureRequest())
        ran = {stage.part for stage in renderer.timings}
        return ran if self.work.object is before else ran | {Part.OBJECT}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("photograph")


@pytest.fixture(scope="module")
def desk(context, folder):
    desk = Desk(context, small_photo(folder))
    yield desk
    desk.work.close()


@pytest.fixture(scope="module")
def depth(folder):
    """A file of the ball's own depth, mm."""
    _, _, normals = ball_photo()
    np.save(folder / "depth.npy", (20.0 * normals[..., 2]).astype(np.float32))
    return folder / "depth.npy"


def reached(declared) -> set[Part]:
    """What a change runs: a new object is another mesh, and a photograph has no tone map."""
    moves = {*declared.moves} | ({Part.SHAPE} if Part.OBJECT in declared.moves else set())
    return set().union(*(part.downstream for part in moves)) - {Part.DISPLAY, Part.GROUND}  # which a photograph has not


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_runs_again_what_it_moves(desk, depth, few_rays, name):
    scene = replace(START, lights=(), environment=replace(START.environment, occluded=True))
    scene = changed(scene, [Change("transport", "resolution", 16, "")])
    table, key = name.split(".")
    value = str(depth) if name == "photo.depth" else VALUES[name]
    desk.draw(scene)
    assert desk.draw(changed(scene, [Change(table, key, value, name)])) == reached(SETTINGS[name])


def test_a_scene_drawn_again_runs_nothing(desk):
    scene = changed(replace(START, lights=()), [Change("transport", "resolution", 16, "")])
    desk.draw(scene)
    assert not desk.draw(replace(scene))


def test_an_object_is_asked_for_by_the_settings_that_declare_to_move_it():
    for table, settings in TABLES.items():
        for key, declared in settings_of(settings).items():
            name = f"{table}.{key}"
            if name in VALUES:
                other = changed(START, [Change(table, key, VALUES[name], name)])
                is_another = ObjectRequest.of(other, 1) != ObjectRequest.of(START, 1)
                assert is_another == (Part.OBJECT in declared.moves), name
    assert ObjectRequest.of(START, 2) != ObjectRequest.of(START, 1)
