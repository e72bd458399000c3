"""The error of what is on screen, measured in a thread of its own whenever the picture has come to rest.

The thread that owns OpenGL calls `LiveError.update` for each frame and never waits. It draws what is measured once, by
passes of its own; the sum that takes seconds touches no OpenGL and ends within a fraction of one when it is not wanted.
"""

import logging
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.stages import Part, Stages
from milkglass.core.threads import AtOnce
from milkglass.core.transport.base import Scattered
from milkglass.core.transport.quality import Quality
from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.gl.context import leave_framebuffer
from milkglass.viewer.live.dependence import light_key
from milkglass.viewer.live.job import Finished
from milkglass.viewer.live.live import Live
from milkglass.viewer.live.worker import Worker
from milkglass.viewer.passes.ground import GroundPass
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.shading import Shading
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.keys import Key
from milkglass.viewer.scene.scene import Scene

if TYPE_CHECKING:
    from milkglass.core.reference.equation import Occluder
    from milkglass.core.reference.transport_error import PhotonReference
    from milkglass.viewer.error.photons import PhotonError
    from milkglass.viewer.error.point_exitance import Evaluate
    from milkglass.viewer.error.visible import VisibleError

LOG = logging.getLogger("milkglass")
Surface = tuple[Float32, Float32, Float32]  # alpha, position and exitance, see `Shading.surface`

LARGEST = 512  # pixels along the longer side of the picture that points are chosen from
THREADS = max(1, (os.cpu_count() or 1) - 1)  # of the sum: one core is left to what draws
WAKE_SECONDS = 0.1  # between frames that only show progress
PHOTONS = 100_000  # of each light and mean free path: a noise of 4 % of each of 150 regions
ROUNDS = 5  # that they walk in; after each there are numbers
SEEDS_A_ROUND = 1000  # a walk of each light and mean free path takes one


@dataclass(frozen=True)
class Question:
    """What a measurement depends on: where the points lie in the view, what lights them, how many they are."""

    place: Key
    light: Key
    points: int

    @classmethod
    def of(cls, scene: Scene, points: int) -> "Question":
        """Take what exitance in a scene's picture depends on."""
        return cls(_place(scene), light_key(scene), points)


def _place(scene: Scene) -> Key:
    return scene.moving(Part.SHAPE, Part.VIEW)


@dataclass(frozen=True, eq=False)
class Dots:
    """Places of a picture with what was found there.

    Attributes
    ----------
    of : Question
    rows, columns : (n,) int
        Row 0 at the top.
    size : (width, height)
        Of the picture that was measured, pixels.
    covered : int
        How many of them show the object.
    exitance, reference : (n, 3) float64
        M of the picture and of the reference.
    shares : (n, 3) float64
        The error, over the rms of the reference.
    noise : (n, 3) float64 or None
        Standard error of the reference, over the same, where it has one: the error is what is beyond it.
    """

    of: Question
    rows: Ints
    columns: Ints
    size: tuple[int, int]
    covered: int
    exitance: Array
    reference: Array
    shares: Array
    noise: Array | None

    @property
    def values(self) -> Array:
        """The error of the worst channel, (n,)."""
        return np.asarray(self.shares.max(axis=1))

    def lies_in(self, scene: Scene) -> bool:
        """Whether they lie where they were measured in a scene's picture."""
        return self.of.place == _place(scene)


@dataclass(frozen=True, eq=False)
class Measured:
    """A finished measurement.

    Attributes
    ----------
    of : Question
    error : VisibleError
    size : (width, height)
        Of the picture that was measured, pixels.
    covered : int
        How many of them show the object.
    quality : Quality
        Of the transport.
    seconds : float
    """

    of: Question
    error: "VisibleError"
    size: tuple[int, int]
    covered: int
    quality: Quality
    seconds: float

    @property
    def dots(self) -> Dots:
        """The points, with what was found there."""
        found, points = self.error, self.error.points
        places = points.rows, points.columns, self.size, self.covered
        return Dots(self.of, *places, points.exitance, found.reference, found.shares, None)

    @property
    def is_dark(self) -> bool:
        """Whether no light leaves the surface, so that there is nothing to compare."""
        return not self.error.reference.any() and not self.error.points.exitance.any()


@dataclass(frozen=True, eq=False)
class Walked:
    """A comparison with photons, over the whole surface.

    Attributes
    ----------
    of : Question
    error : PhotonError
    photons : int
        Of each light and mean free path, so far.
    dots : Dots
        Of the regions that the picture shows.
    seconds : float
        What it took.
    """

    of: Question
    error: "PhotonError"
    photons: int
    dots: Dots
    seconds: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Photons that have walked in a light, and what is compared with them.

    Attributes
    ----------
    key : Key
        The light, and how many regions were asked for.
    reference : PhotonReference
    rounds : int
        How many it has.
    evaluates : pair of callables
        See `viewer.error.photons.evaluated`.
    error : PhotonError
    seconds : float
    """

    key: Key
    reference: "PhotonReference"
    rounds: int
    evaluates: "tuple[Evaluate, Evaluate]"
    error: "PhotonError"
    seconds: float

    @classmethod
    def of(
        cls,
        key: Key,
        reference: "PhotonReference",
        earlier: "Comparison | None",
        evaluates: "Callable[[], tuple[Evaluate, Evaluate]]",
        start: float,
    ) -> "Comparison":
        """Compare with a round of photons and the `earlier` ones, by what is evaluated once; `start`, when it began."""
        from milkglass.viewer.error.photons import photon_error

        if earlier is None:
            found = evaluates()
            return cls(key, reference, 1, found, photon_error(reference, *found), time.perf_counter() - start)
        together = earlier.reference.joined(reference)
        error = photon_error(together, *earlier.evaluates)
        seconds = earlier.seconds + time.perf_counter() - start
        return cls(key, together, earlier.rounds + 1, earlier.evaluates, error, seconds)

    def shown(self, of: Question, surface: Surface, eye: Array) -> Walked:
        """Return it with places in a picture that shows a surface, from an eye, (4,)."""
        from milkglass.viewer.error.photons import seen_regions

        alpha, position, _ = surface
        regions, rows, columns = seen_regions(self.reference.regions, alpha, position, eye)
        error, covered = self.error, int(np.count_nonzero(alpha))
        found = (values[regions] for values in (error.exitance, error.reference.exitance, error.shares, error.noise))
        dots = Dots(of, rows, columns, (alpha.shape[1], alpha.shape[0]), covered, *found)
        return Walked(of, error, self.rounds * (PHOTONS // ROUNDS), dots, self.seconds)


class Cancelled(Exception):  # noqa: N818 (it is no error)
    """The measurement is not wanted any more."""


class _Job:
    """One measurement: what it is of, how far it is, whether it is still wanted."""

    def __init__(self, of: Question, wake: Callable[[], object]) -> None:
        self.of, self.progress = of, 0.0
        self.found: Walked | None = None  # so far
        self.cancelled = threading.Event()
        self.future: Future[Measured] | Future[Walked] | None = None
        self._wake, self._told = wake, time.monotonic()

    def report(self, share: float) -> None:
        """Take how far it is, in the thread that measures."""
        if self.cancelled.is_set():
            raise Cancelled
        self.progress = share
        if time.monotonic() - self._told >= WAKE_SECONDS:
            self._told = time.monotonic()
            self._wake()


class LiveError:
    """Measures the error of what is on screen.

    Parameters
    ----------
    context : moderngl.Context
    wake : callable
        Called from the measuring thread when there is something new to show.

    Attributes
    ----------
    result : Measured or None
        The last one, perhaps of an earlier picture.
    walked : Walked or None
        In its place where transport solves an equation that is not (1); from the first round of photons on.
    trouble : str or None
        Why the picture could not be measured, a sentence.
    outdated : bool
        Whether both are not of the picture on screen.
    """

    def __init__(self, context: moderngl.Context, wake: Callable[[], object]) -> None:
        self.result: Measured | None = None
        self.walked: Walked | None = None
        self.trouble: str | None = None
        self.outdated = False
        self._context, self._wake = context, wake
        self._worker: Worker | None = None
        self._job: _Job | None = None
        self._asked: Question | None = None
        self._answered: Question | None = None
        self._occluder: tuple[Mesh, Occluder] | None = None  # of the last mesh; used by the worker alone
        self._compared: Comparison | None = None  # of the last light; used by the worker alone

    @property
    def dots(self) -> Dots | None:
        """What is known at places of the picture; None before there is a measurement, or light."""
        if self.walked is not None:
            return self.walked.dots if self.walked.dots.reference.any() else None
        return None if self.result is None or self.result.is_dark else self.result.dots

    @property
    def progress(self) -> float | None:
        """How far the measurement is, [0, 1]; None if none runs."""
        return None if self._job is None else self._job.progress

    def follow(self, scene: Scene, points: int | None) -> None:
        """Give up a measurement that is not of the picture that comes next, before the picture is drawn.

        Parameters
        ----------
        scene : Scene
            What is shown, with the size of the picture on screen.
        points : int or None
            How many to measure, None for no measurement.
        """
        self._asked = None if points is None else Question.of(scene, points)
        if self._job is not None and self._job.of != self._asked:
            self._cancel()
        if self._asked is None:
            self._occluder = None

    def update(self, scene: Scene, live: Live, *, at_rest: bool) -> bool:
        """Measure what is shown if that is due; once a frame, after `follow`, by the thread that owns OpenGL.

        Parameters
        ----------
        scene : Scene
            As of `follow`.
        live : Live
            What draws it.
        at_rest : bool
            Whether the picture is at its best and nobody is changing it.

        Returns
        -------
        bool
            Whether there is something new to show.
        """
        asked = self._asked
        was_outdated, news = self.outdated, self._collect()
        self.outdated = asked != self._answered
        if asked is not None and self.outdated and self._job is None and at_rest and live.finished is not None:
            self._start(asked, scene, live, live.finished)
            return True
        return news or self.outdated != was_outdated

    def wait(self, timeout: float) -> None:
        """Wait for what is being measured; for tests and replays, never for a window."""
        if self._job is not None and self._job.future is not None:
            self._job.future.exception(timeout)

    def stop(self) -> None:
        """Give up what is being measured, and wait for nothing."""
        self._cancel()
        if self._worker is not None:
            self._worker.stop()

    def close(self) -> None:
        """Give up what is being measured and free the thread."""
        self.stop()
        if self._worker is not None:
            self._worker.close()

    # one measurement

    def _start(self, asked: Question, scene: Scene, live: Live, finished: Finished) -> None:
        self.trouble = None
        try:
            if finished.lit.quality.facts.uses_profile:
                ground = finished.lit.ground
                shown = scene if ground is None else ground.standing.lit(scene)
                around, surface = live.renderer.parted(shown.environment), surface_of(self._context, scene, finished)
                self._submit(asked, lambda job: self._measure(job, shown, surface, finished, around))
            else:
                self._submit(asked, self._walk_of(scene.floating(), live, finished))
        except Exception as error:
            self._fail(asked, error)

    def _submit(self, asked: Question, work: "Callable[[_Job], Measured] | Callable[[_Job], Walked]") -> None:
        if self._worker is None:
            self._worker = Worker("error")
        self._job = job = _Job(asked, self._wake)
        job.future = self._worker.submit(work, job)  # type: ignore[assignment]
        job.future.add_done_callback(lambda _: self._wake())  # type: ignore[union-attr]

    def _walk_of(self, scene: Scene, live: Live, finished: Finished) -> "Callable[[_Job], Walked]":
        """Return what compares a solution without a ground with photons, in the worker; OpenGL is asked here.

        A round of photons at a time; those of a light that goes on are kept for another view.
        """
        from milkglass.viewer.error.eye import judged_by_eye
        from milkglass.viewer.error.illumination import lights_of
        from milkglass.viewer.error.photons import evaluated, obstacle, photon_walk, unlike_paths

        environment, shown_lit = scene.environment, finished.lit
        lit = shown_lit if shown_lit.ground is None else live.renderer.light(scene)
        is_by_eye, why = judged_by_eye(scene, lit.model.mesh)
        if is_by_eye and unlike_paths(scene, lit) is None:
            raise InputError(f"not measured here: {why}; milkglass render --report compares them, part by part")
        if (reason := obstacle(scene, lit)) is not None:
            raise InputError(f"not measured: {reason}")
        probe = live.renderer.probe(environment) if environment.given else None
        around = live.renderer.parted(environment)
        without = replace(scene, transport=replace(scene.transport, exchange="off"))
        lit_alone = lit if lit.exchange is None else live.renderer.light(without)

        surface, light = surface_of(self._context, scene, finished), light_key(scene)
        eye = model_camera(scene.camera, finished.lit.model.whole, scene.display.image_size).eye

        def evaluates(job: _Job) -> "tuple[Evaluate, Evaluate]":
            def solved(other: LitScene) -> Scattered:
                return live.scatter(other, lambda _: not job.cancelled.is_set())

            shown = alone = lit, finished.scattered if lit is shown_lit else solved(lit)
            if lit_alone is not lit:
                alone = lit_alone, solved(lit_alone)
            return evaluated(shown, alone, lights_of(scene, around, lit))

        def walk(job: _Job) -> Walked:
            job.report(0.0)
            key, kept = (light, job.of.points), self._compared
            walked = kept if kept is not None and kept.key == key else None
            while walked is None or walked.rounds < ROUNDS:
                start, done = time.perf_counter(), 0 if walked is None else walked.rounds
                reference = photon_walk(
                    scene,
                    lit.model.mesh,
                    probe,
                    PHOTONS // ROUNDS,
                    done * SEEDS_A_ROUND,
                    lambda share, done=done: job.report((done + share) / ROUNDS),  # type: ignore[misc]
                    job.of.points if walked is None else walked.reference.regions,
                )
                walked = self._compared = Comparison.of(key, reference, walked, lambda: evaluates(job), start)
                job.found = walked.shown(job.of, surface, eye)
                job.report((done + 1) / ROUNDS)
            return job.found or walked.shown(job.of, surface, eye)

        return walk

    def _measure(
        self, job: _Job, scene: Scene, surface: Surface, finished: Finished, around: PartedProbe | None
    ) -> Measured:
        """Run in the worker: nothing here touches OpenGL."""
        from milkglass.viewer.error.illumination import lights_of, with_reentry
        from milkglass.viewer.error.visible import measure, visible_points

        job.report(0.0)
        start, (alpha, position, exitance) = time.perf_counter(), surface
        seen = visible_points(alpha, position, exitance, job.of.points)
        lit, material = finished.lit, scene.material.resolve()
        light = with_reentry(lights_of(scene, around, lit), lit, finished.scattered)
        mesh = lit.model.mesh
        occluder = self._occluder_of(mesh)
        error = measure(seen, mesh, light, material, job.report, THREADS, occluder, lit.bodies, lit.profiles)
        size, covered = (alpha.shape[1], alpha.shape[0]), int(np.count_nonzero(alpha))
        return Measured(job.of, error, size, covered, lit.quality, time.perf_counter() - start)

    def _occluder_of(self, mesh: Mesh) -> "Occluder":
        """Return what rays are cast against, made once a mesh: no other thread of Python runs while it is made."""
        from milkglass.core.reference.equation import Occluder

        kept = self._occluder
        if kept is None or kept[0] is not mesh:
            kept = self._occluder = mesh, Occluder(mesh)
        return kept[1]

    def _collect(self) -> bool:
        """Take what the worker has finished; True if there was something."""
        job = self._job
        if job is None or job.future is None:
            return False
        if not job.future.done():
            if job.found is None or job.found is self.walked:
                return False
            self.result, self.walked, self._answered = None, job.found, job.of
            return True
        self._job = None
        try:
            found, self._answered = job.future.result(), job.of
            self.result = found if isinstance(found, Measured) else None
            self.walked = found if isinstance(found, Walked) else None
        except Exception as error:  # whatever happens there, the window goes on and says so
            self._fail(job.of, error)
        return True

    def _fail(self, asked: Question, error: Exception) -> None:
        """Say why there is no number, and do not try again until something has changed."""
        if not isinstance(error, InputError):
            LOG.error("the error could not be measured", exc_info=error)
        sentence = " ".join(str(error).split()) or type(error).__name__
        self.trouble = sentence if isinstance(error, InputError) else f"the measurement failed: {sentence}"
        self.result, self.walked, self._answered = None, None, asked

    def _cancel(self) -> None:
        if self._job is not None:
            self._job.cancelled.set()
            self._job = None


def surface_of(context: moderngl.Context, scene: Scene, finished: Finished) -> Surface:
    """Draw what is on screen once more, one sample a pixel and not too large, beside the passes of the picture."""
    width, height = scene.display.image_size
    scale = min(1.0, LARGEST / max(width, height))
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    display = replace(scene.display, image_size=size)
    smaller = replace(scene, display=display, specular=replace(scene.specular, strength=0.0))  # not seen here
    camera = model_camera(scene.camera, finished.lit.model.whole, size)
    try:
        return Shading(context, Stages(), GroundPass(context), AtOnce()).surface(
            smaller, replace(finished.lit, camera=camera), finished.gather
        )
    finally:
        leave_framebuffer(context)  # what was drawn into is gone now
