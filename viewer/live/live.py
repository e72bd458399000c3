"""A scene drawn while it changes: files and transport in a worker thread, frames with the newest finished volume.

The thread that owns OpenGL calls `Live.draw` for each frame and never waits. It lights the scene as it is now, hands
the light to the worker if the worker is free, and draws with the newest volume that came back: perhaps of the material
of a moment ago, never of two at once, and always replaced as soon as the newer one is there.
"""

from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import replace
from typing import Any, NamedTuple

import moderngl

from milkglass.core.stages import Part, Stage, Timings, Unfinished
from milkglass.core.transport.base import GoOn, Scattered
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import LobesOf
from milkglass.viewer.live.dependence import (
    Drag,
    LitFor,
    files,
    looks_of,
    missing_file,
    most_sources,
    radiance_of,
    scene_sources,
    turn_deg,
)
from milkglass.viewer.live.developer import Developer, ToneMap
from milkglass.viewer.live.draft import (
    AT_REST,
    AT_VERTICES,
    BY_PIXELS,
    DRAFTED_STEPS,
    DRAWN,
    FEW_RAYS,
    PATH_STEPS,
    Cost,
    Detail,
    allowance,
    draft_resolution,
)
from milkglass.viewer.live.job import Finished, TransportJob
from milkglass.viewer.live.rays import RaysJob
from milkglass.viewer.live.worker import Worker
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import SCATTERED, Picture, PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import model_camera, pixel_offsets
from milkglass.viewer.scene.keys import Key
from milkglass.viewer.scene.scene import Scene


class Doing(NamedTuple):
    """What is computed now, and the share of it that is done, None where that is unknown."""

    text: str
    share: float | None


KEEP = 3  # models, probes and sets of samples that undo finds again at once
DRAFT_TURN_DEG = 25.0  # how far an old volume may be turned before an orbit replaces it


class Live:
    """Draws scenes in one OpenGL context.

    Parameters
    ----------
    context : moderngl.Context
    wake : callable
        Called from the worker thread when something is ready: draw again.
    assets : Assets, optional
        Shared with another `Live` of the same context.
    developer : Developer, optional
        Makes the picture of what is lit; a tone map if not given.
    """

    def __init__(
        self,
        context: moderngl.Context,
        wake: Callable[[], object],
        assets: Assets | None = None,
        developer: Developer | None = None,
    ) -> None:
        self._developer = developer or ToneMap()
        self.assets = assets or Assets(KEEP)
        self.assets.bakes = False
        self.rays = RaysJob(self.assets, wake)
        self._sight = Worker("sight", wake)
        self.renderer = Renderer(context, assets=self.assets, worker=self._sight)
        self.finished: Finished | None = None
        self.picture: Picture | None = None
        self.current = False  # whether the last picture is of the scene asked for, not of one before it
        self.spreading = False  # whether the last frame left something to do for the next one
        self.awaited: Future[Any] | None = None  # what that waits for, where it is on its way
        self.while_moving = ""  # a sentence on how rays of sight are spared then, where there are any
        self.stage_times: Timings = {}  # ms, of the last time that each ran
        self.ran: Timings = {}  # ms, of the stages of the last frame that ran any
        self._wake = wake
        self._worker = Worker("transport")
        self.job: TransportJob | None = None  # what the worker scatters now
        self._load: Future[None] | None = None
        self._read_share = 0.0  # of the sources of what is loaded that are there
        self._failed: Scene | None = None  # whose files could not be read, so that they are not tried every frame
        self._ready: Scene | None = None  # the newest scene whose files are there
        self._looks: Key = ()  # what the last picture depends on, but for its quality
        self._traced: Key = ()  # what its radiance does
        self._step = 1  # how finely rays of sight were followed for it, pixels
        self._whole: tuple[int, tuple[int, int]] | None = None  # samples and size of the radiance that is there
        self._lit: LitScene | None = None
        self._lit_for: LitFor | None = None
        self._shadows: Key | None = None  # what all of the sub-lights there are were cast for
        self._sent: LitScene | None = None
        self.cost: Cost | None = None  # of transport in a drag
        self._drag: Drag | None = None

    @property
    def lit(self) -> LitScene | None:
        """The lighting of the scene last drawn, of a draft perhaps; None before there is any."""
        return self._lit

    @property
    def loading(self) -> bool:
        """Whether files are being read or sampled."""
        return self._load is not None

    @property
    def shown(self) -> Scene | None:
        """The newest scene whose files are there, which is what pictures are of."""
        return self._ready

    def doing(self, scene: Scene) -> Doing | None:
        """Return what goes on until a scene is seen as it is; None where nothing is computed that takes long."""
        if self.loading:
            name = missing_file(scene, self.assets)
            return Doing("the surface is sampled" if name is None else f"loading {name}", self._read_share)
        if self.job is not None:
            return Doing("light spreads", self.job.share)
        if self.rays.progress is not None:
            return Doing(self.rays.casting, self.rays.progress)
        return None

    def give_up(self) -> None:
        """Leave what is computed to its end, for a scene that is not wanted any longer."""
        self._load = None
        if self.job is not None:
            self.job.supersede(at_once=True)

    @property
    def working(self) -> bool:
        """Whether the worker has something to do, or the next frame."""
        return self.spreading or self.job is not None or self._load is not None or self.rays.busy

    def draw(
        self, scene: Scene, detail: Detail, show: str = "radiance", exposure_for: float | None = None
    ) -> Picture | None:
        """Draw the newest state of a scene; None while there is nothing to show yet.

        Raises
        ------
        InputError
            The scene's files or values cannot be used; raised once, by the frame that finds out.
        """
        if detail.draft:
            self.renderer.stages.abandon(Stage.COMPOSITE)  # rays of another view, before a frame of this one
        self.renderer.stages.begin(None if detail.draft or detail.at_once else allowance())
        newest = self._newest(scene, detail)
        if newest is None:
            return None
        drawn, lit, gather = newest
        looks: Key = (*looks_of(drawn, lit), self.finished, show, exposure_for, detail.alone)
        # A draft of what is shown already would take the processor from the worker, and show nothing new.
        if not (detail.draft and looks == self._looks and self.picture is not None):
            part = show if show in SCATTERED else ""
            radiance = *radiance_of(drawn, lit), self.finished, part
            step, samples, size = (
                self._path_step(drawn, lit, detail, radiance),
                detail.samples,
                drawn.display.image_size,
            )
            whole = self._whole if step == 1 and self.while_moving and self._traced == radiance else None
            if whole is not None and (detail.draft or (whole[0] > samples and whole[1] == size)):
                samples, size = whole  # exposure moves alone
                drawn = replace(drawn, display=replace(drawn.display, image_size=size))
            self._whole, is_first = None, self.picture is None
            try:
                request = PictureRequest(
                    pixel_offsets(samples),
                    show,
                    exposure_for=exposure_for,
                    quick=not detail.at_once,
                    path_step=step or 1,
                    drafts_sight=step == 0,
                    ground=not detail.alone,
                    at_vertices=detail.draft,
                )
                self.picture = self._developer.develop(self.renderer, drawn, lit, gather, request)
                self._traced, self._step, self._whole = radiance, step, (samples, size)
                unfinished = step != 1 and not detail.draft
            except Unfinished as left:
                unfinished, self.awaited = True, left.awaited
            if unfinished:
                looks = ()
            if unfinished or is_first:  # rays, and what makes it better, begin with the next frame
                self._go_on()
        self._looks = looks
        self._count(self.renderer.stages.timings)
        return self.picture

    def _path_step(self, scene: Scene, lit: LitScene, detail: Detail, radiance: Key) -> int:
        """Return how finely a frame follows rays of sight: ever more so while radiance is the same; 0 for a draft."""
        self.while_moving = ""
        paths = None if detail.at_once else self.renderer.paths(scene, lit)
        if paths is None or (paths.tree is None and not paths.at_rest):
            return 1
        drafted = AT_REST if paths.at_rest else DRAWN
        steps, self.while_moving = (DRAFTED_STEPS, drafted) if paths.is_drafted else (PATH_STEPS, FEW_RAYS)
        if detail.draft and self._traced == radiance and self._step == 1 and self._whole is not None:
            return 1
        if detail.draft or self._traced != radiance:
            return steps[0]
        following = steps.index(self._step) + 1 if self._step in steps else 0
        return steps[min(following, len(steps) - 1)]

    def refine(self, scene: Scene, samples: int, show: str = "radiance") -> bool:
        """Draw some of the samples of a pixel; True when `draw` with so many will find all of them there."""
        self.renderer.stages.begin(allowance())
        newest = self._newest(scene, Detail(samples=samples))
        done = True
        if newest is not None:
            drawn, lit, finished = newest
            try:
                request = PictureRequest(pixel_offsets(samples), show, at_vertices=True)
                self.renderer.advance(drawn, lit, finished.gather, request)
            except Unfinished as left:
                done, self.awaited, self._whole = False, left.awaited, None
        self._count(self.renderer.stages.timings)
        return done

    def serves_at_vertices(self, scene: Scene) -> bool:
        """Whether the next frame of a drag is drawn from light at the vertices, which takes little at any size."""
        found = self._shown_as(scene)
        return found is not None and self.renderer.serves_at_vertices(*found)

    @property
    def on_a_move(self) -> str:
        """Return a sentence on how the picture is drawn while the camera moves."""
        found = None if self._ready is None else self._shown_as(self._ready)
        if found is None:
            return ""
        why = self.renderer.pixels_alone(*found)
        return f"{BY_PIXELS}{why}" if why else AT_VERTICES

    def _shown_as(self, scene: Scene) -> tuple[Scene, LitScene, Gather] | None:
        """Return a scene with the light that its camera sees now; None where another camera is the picture's."""
        done = self.finished
        if done is None or self._lit is None or self._developer.placed(scene, done.lit) is not scene:
            return None
        lit = done.lit if done.lit.quality.facts.solves else self._lit
        camera = model_camera(scene.camera, lit.model.whole, scene.display.image_size)
        return scene, replace(lit, camera=camera), done.gather

    def _newest(self, scene: Scene, detail: Detail) -> tuple[Scene, LitScene, Finished] | None:
        """Light the scene and keep the worker busy; returns what can be drawn now."""
        self._collect()
        self.current, self.spreading, self.awaited = False, False, None
        drawn = self._latest_ready(scene, detail)
        if drawn is None:
            return None
        if self.picture is not None:  # until then it has the processor to itself
            self.rays.follow(drawn)
        lit = self._light(drawn, detail)
        self.current = drawn is scene and not self.spreading
        if self.finished is None or self.picture is not None:  # else what comes after it begins with the next frame
            self._submit(lit)
        if self.finished is None:
            return None
        old = self.finished.lit
        if lit.model is not old.model or lit.bodies is not old.bodies or lit.quality.facts.solves:
            lit = old  # the first volume of a new model, its bodies or other light is on the way
        placed = self._developer.placed(drawn, lit)
        if placed is None:
            self._submit(lit)
            return None
        camera = model_camera(placed.camera, lit.model.whole, placed.display.image_size)
        return placed, replace(lit, camera=camera), self.finished

    def is_settled(self, scene: Scene) -> bool:
        """Whether what was drawn last is of this scene at full quality, with nothing more to come."""
        return (
            not self.working
            and self.finished is not None
            and self.finished.complete
            and self._lit is not None
            and self._sent is self._lit
            and self.finished.lit is self._lit
            and self._lit_for == LitFor.of(scene, rays=self.rays.found(scene))
        )

    def wait(self, timeout: float = 600.0) -> None:
        """Wait for what the worker does now; for tests and replays, never for a window."""
        if self._load is not None:
            self._load.exception(timeout)
        if self.job is not None:
            self.job.future.exception(timeout)
        if self.awaited is not None:
            wait([self.awaited], timeout)
        self.rays.wait(timeout)

    def stop(self) -> None:
        """Give up what is computed, and wait for nothing."""
        self.renderer.stages.abandon()
        if self.job is not None:
            self.job.supersede(at_once=True)
        self.rays.stop()
        for worker in self._sight, self._worker:
            worker.stop()

    def close(self) -> None:
        """Have the workers give up, and free them."""
        self.stop()
        self.rays.close()
        for worker in self._sight, self._worker:
            worker.close()

    # files

    def _latest_ready(self, scene: Scene, detail: Detail) -> Scene | None:
        """Return the scene if its files are loaded; else start loading them and stay with the last one."""
        if self._load is not None and self._load.done():
            load, self._load = self._load, None
            load.result()  # raises what loading raised
        if self._has_files(scene, detail):
            self._ready, self._failed = scene, None
        elif self._load is None and (self._failed is None or files(self._failed) != files(scene)):
            self._load = self._worker.submit(self._read, scene)
            self._load.add_done_callback(lambda _: self._wake())
        if self._ready is None or self._ready is scene:
            return self._ready
        display = replace(self._ready.display, image_size=scene.display.image_size)
        return replace(self._ready, camera=scene.camera, display=display)

    def _has_files(self, scene: Scene, detail: Detail) -> bool:
        return all(self.assets.has(source) for source in scene_sources(scene, self.assets, draft=detail.draft))

    def _read(self, scene: Scene) -> None:
        self._failed, count = scene, most_sources(scene)
        for i, source in enumerate(scene_sources(scene, self.assets)):
            self._read_share = min(1.0, i / count)
            self._wake()
            self.assets.get(source)
        if scene.environment.given:
            lobes = self.assets.get(LobesOf(self.assets.surround(scene.environment)[1]))
            if scene.gloss.strength > 0.0:
                lobes.prepare(scene.gloss.shininess)
        self._failed = None

    # light and transport

    def _light(self, scene: Scene, detail: Detail) -> LitScene:
        """Light the scene, unless the light that there is will do."""
        asked = LitFor.of(scene, rays=self.rays.found(scene))
        if self._lit is not None and self._will_do(self._lit, asked, detail):
            return self._lit
        if self._lit is not None and self._is_begun(asked) and self._awaits_first(self._lit):
            if self.job is None:
                self._go_on()
            return self._lit  # better shadows, or what rays have found by now, would make the first picture later
        scene, is_coarse = self._coarsened(scene, asked, detail)
        self.assets.accept_finer = detail.draft
        shadows = scene.key(Part.LIGHT)
        few = detail.draft and shadows != self._shadows  # a dragged material keeps the soft shadows that there are
        try:
            lit = self.renderer.light(scene, draft=few)
        except Unfinished:
            self._go_on()
            if self._lit is not None and (self._is_drafted(asked) or shadows == self._shadows):
                return self._lit  # until all is there; a draft would replace maps that are as they should be
            few = True
            with self.renderer.stages.at_once():
                lit = self.renderer.light(scene, draft=True)
        self._shadows = None if few else shadows
        self._lit_for = replace(asked, drafted=is_coarse or few)
        return self._take(lit)

    def _will_do(self, lit: LitScene, asked: LitFor, detail: Detail) -> bool:
        """Tell whether the light that there is may be drawn with; a job that another waits for is told so."""
        kept = self._lit_for
        if kept is None:
            return False
        if asked.is_turned(kept):
            near = detail.draft and turn_deg(asked.camera, kept.camera) < DRAFT_TURN_DEG
            return near or asked == kept
        if detail.draft and lit.quality.facts.solves and self.job is not None:
            # Lit when it can be solved for: until then the processor is the worker's.
            self.job.supersede(at_once=asked.shape != kept.shape)
            return True
        return False

    def _coarsened(self, scene: Scene, asked: LitFor, detail: Detail) -> tuple[Scene, bool]:
        """Return the scene with the resolution of a drag, if this is one and another was asked for, and whether."""
        if not detail.draft:
            self._drag = None
        if not detail.draft or (self._lit_for is not None and asked.is_turned(self._lit_for)):
            return scene, False
        resolution = self._draft_resolution(scene)
        if resolution is None:
            return scene, False
        order = scene.transport.assignment or (self._lit.quality.assignment if self._lit is not None else None)
        return replace(scene, transport=replace(scene.transport, resolution=resolution, assignment=order)), True

    def _is_drafted(self, asked: LitFor) -> bool:
        return self._lit_for is not None and asked.is_drafted(self._lit_for)

    def _is_begun(self, asked: LitFor) -> bool:
        """Tell whether the light that there is lacks no more than better shadows and what rays find."""
        return self._lit_for is not None and asked.is_drafted(replace(self._lit_for, rays=asked.rays))

    def _awaits_first(self, lit: LitScene) -> bool:
        """Tell whether the first picture, or the first light in a new model, is on the way."""
        return self.picture is None or self.finished is None or self.finished.lit.model is not lit.model

    def _take(self, lit: LitScene) -> LitScene:
        """Keep new light, unless it is the same to transport; a job of other light is told so."""
        if self._lit is None or not lit.is_same_light(self._lit):
            if self.job is not None:
                self.job.supersede(at_once=self._lit is not None and lit.model is not self._lit.model)
            self._lit = lit
        return self._lit

    def _draft_resolution(self, scene: Scene) -> int | None:
        """As `live.draft.draft_resolution`, once a drag: the grid stays and all weights on it, even of a material."""
        if self.cost is None or self._lit is None:
            return None
        if self._drag is None or not self._drag.is_of(scene):
            chosen = draft_resolution(scene, self._lit.quality, self.cost)
            self._drag = Drag.of(scene, chosen)
        return self._drag.resolution

    def scatter(self, lit: LitScene, go_on: GoOn) -> Scattered:
        """Scatter other light than is shown, in the thread of transport, and wait for it, in any other thread."""
        return self._worker.submit(self.renderer.scatter, lit, go_on).result()

    def _submit(self, lit: LitScene) -> None:
        if self.job is None and self._sent is not lit:
            self._sent = lit
            is_first = self.finished is None
            self.job = TransportJob(self._worker, self.renderer, lit, self._wake, until_seen=is_first)

    def _collect(self) -> None:
        """Take what the worker has, finished or on the way."""
        if (job := self.job) is None:
            return
        if done := job.future.done():
            self.job = None
        outcome = job.future.result() if done else job.preview()
        if outcome is None:
            return
        if done and not outcome.complete:
            self._sent = None  # where the light comes back, it is solved after all
        lit = outcome.lit
        if outcome.is_presentable:
            gather = self.renderer.gather(lit, outcome.scattered)
            self.finished = Finished(lit, gather, outcome.scattered, outcome.complete)
        if outcome.seconds is not None:
            self.cost = Cost(outcome.seconds, lit.quality.resolution, lit.grid.n_layers)
        self.renderer.stages.timings.update(outcome.timings)

    def _go_on(self) -> None:
        """Have the next frame drawn for what this one left, at once or when that is there which it waits for."""
        self.spreading = True
        if self.awaited is None:
            self._wake()

    def _count(self, timings: Timings) -> None:
        if timings:
            self.ran = dict(timings)
            self.stage_times.update(timings)


def solves(live: Live) -> bool:
    """Whether what is shown is the solution of an equation, of no profile."""
    return live.finished is not None and live.finished.lit.quality.facts.solves
