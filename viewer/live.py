"""A scene drawn while it changes: files and transport in a worker thread, every frame with the newest finished volume.

The thread that owns OpenGL calls `Live.draw` for each frame and never waits. It lights the scene as it is now, hands the
light to the worker if the worker is free, and draws with the newest volume that came back: perhaps of the material of a
moment ago, never of two at once, and always replaced as soon as the newer one is there.
"""

import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from core.layers import deposit, tent_matrix
from viewer.assets import Assets
from viewer.camera import place_camera
from viewer.composite_pass import Gather
from viewer.frame import Renderer
from viewer.lighting import LitScene, sample_spacing
from viewer.picture import Picture
from viewer.scene import Scene
from viewer.settings import CameraSettings

Float32 = npt.NDArray[np.float32]

KEEP = 3  # models, probes and sets of samples that undo finds again at once
DRAFT_SECONDS = 0.1  # transport that takes longer gets fewer texels while something moves
SMALLEST_DRAFT = 32  # texels
DRAFT_TURN_DEG = 25.0  # how far an old volume may be turned before an orbit replaces it


@dataclass(frozen=True)
class Quality:
    """How well a frame is drawn: `draft` while something moves; antialiasing samples of a pixel."""

    draft: bool = False
    samples: int = 1


@dataclass(frozen=True, eq=False)
class Finished:
    """Transport that came back: the light it is of, the volume that is drawn, the maps behind it."""

    lit: LitScene
    gather: Gather
    exitance: Float32


class Live:
    """Draws scenes in one OpenGL context.

    Parameters
    ----------
    context : moderngl.Context
    wake : callable
        Called from the worker thread when something is ready: draw again.
    assets : Assets, optional
        Shared with another `Live` of the same context.
    """

    def __init__(
        self, context: moderngl.Context, wake: Callable[[], object], assets: Assets | None = None
    ) -> None:
        self.assets = assets or Assets(KEEP)
        self.renderer = Renderer(context, assets=self.assets)
        self.finished: Finished | None = None
        self.stage_times: dict[str, float] = {}  # ms, of the last time that each ran
        self.ran: dict[str, float] = {}  # ms, of the stages of the last frame that ran any
        self._wake = wake
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="transport")
        self._job: Future[Any] | None = None
        self._load: Future[None] | None = None
        self._ready: Scene | None = None  # the newest scene whose files are there
        self._lit: LitScene | None = None
        self._lit_for: tuple[object, CameraSettings, bool] | None = None
        self._sent: LitScene | None = None
        self._cost = 0.0  # seconds of transport a texel

    @property
    def loading(self) -> bool:
        """Whether files are being read or sampled."""
        return self._load is not None

    @property
    def working(self) -> bool:
        """Whether the worker has something to do."""
        return self._job is not None or self._load is not None

    def draw(
        self, scene: Scene, quality: Quality, show: str = "radiance", exposure_for: float | None = None
    ) -> Picture | None:
        """Draw the newest state of a scene; None while there is nothing to show yet.

        Raises
        ------
        InputError
            The scene's files or values cannot be used; raised once, by the frame that finds out.
        """
        self.renderer.stages.begin()
        self._collect()
        drawn = self._latest_ready(scene, quality)
        if drawn is None:
            return None
        lit = self._light(drawn, quality)
        self._submit(lit)
        if self.finished is None:
            return None
        if lit.model is not self.finished.lit.model:  # its first volume is on the way: the old model until then
            lit = self.finished.lit
        camera = place_camera(drawn.camera, lit.model.mesh.radius, drawn.display.image_size)
        picture = self.renderer.shade(
            drawn, replace(lit, camera=camera), self.finished.gather,
            samples=quality.samples, parts=show != "radiance", show=show, exposure_for=exposure_for,
        )  # fmt: skip
        self._count(self.renderer.stages.timings)
        return picture

    def is_settled(self, scene: Scene) -> bool:
        """Whether what was drawn last is of this scene at full quality, with nothing more to come."""
        return (
            not self.working
            and self.finished is not None
            and self._lit is not None
            and self._sent is self._lit
            and self.finished.lit is self._lit
            and self._lit_for == (_lighting_key(scene), _turned(scene.camera), False)
        )

    def wait(self, timeout: float = 60.0) -> None:
        """Wait for what the worker does now; for tests and replays, never for a window."""
        for future in (self._load, self._job):
            if future is not None:
                future.exception(timeout)

    def incoming(self) -> Float32 | None:
        """Flux on the layers, (3, n_layers, height, width), of the volume that is drawn."""
        if self.finished is None:
            return None
        lit = self.finished.lit
        return deposit(lit.grid, tent_matrix(lit.grid, lit.coordinates), lit.flux)

    def close(self) -> None:
        """Let the worker finish and free it."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    # files

    def _latest_ready(self, scene: Scene, quality: Quality) -> Scene | None:
        """Return the scene if its files are loaded; else start loading them and stay with the last one."""
        if self._load is not None and self._load.done():
            load, self._load = self._load, None
            load.result()  # raises what loading raised
        if self._has_files(scene, quality):
            self._ready = scene
        elif self._load is None:
            self._load = self._start(lambda: self._read(scene))
        if self._ready is None:
            return None
        if self._ready is scene:
            return scene
        size = scene.display.image_size
        waiting = replace(self._ready, camera=scene.camera)
        return replace(waiting, display=replace(self._ready.display, image_size=size))

    def _has_files(self, scene: Scene, quality: Quality) -> bool:
        if not self.assets.has_mesh(scene.model):
            return False
        probe = scene.environment.path
        if probe is not None and not self.assets.has_probe(probe):
            return False
        mesh, _ = self.assets.mesh(scene.model)
        return quality.draft or self.assets.has_samples(mesh, sample_spacing(mesh, scene.transport))

    def _read(self, scene: Scene) -> None:
        mesh, _ = self.assets.mesh(scene.model)
        if scene.environment.path is not None:
            self.assets.probe(scene.environment.path)
        self.assets.samples(mesh, sample_spacing(mesh, scene.transport))

    # light and transport

    def _light(self, scene: Scene, quality: Quality) -> LitScene:
        """Light the scene, unless the light that there is will do."""
        key, camera = _lighting_key(scene), _turned(scene.camera)
        if self._lit is not None and self._lit_for is not None:
            same_light = key == self._lit_for[0]
            if same_light and quality.draft and _angle(camera, self._lit_for[1]) < DRAFT_TURN_DEG:
                return self._lit
            if same_light and camera == self._lit_for[1] and not self._lit_for[2]:
                return self._lit
        coarse = self._draft_resolution(scene) if quality.draft else scene.transport.resolution
        drafted = coarse < scene.transport.resolution
        if drafted:
            scene = replace(scene, transport=replace(scene.transport, resolution=coarse))
        lit = self.renderer.light(scene)
        if self._lit is None or not _same_light(lit, self._lit):
            self._lit = lit
        self._lit_for = (key, camera, drafted)
        return self._lit

    def _draft_resolution(self, scene: Scene) -> int:
        """Return how many texels transport may have to be done in time."""
        settings = scene.transport
        seconds = self._cost * settings.layers * settings.resolution**2
        if seconds <= DRAFT_SECONDS:
            return settings.resolution
        fitting = int(settings.resolution * math.sqrt(DRAFT_SECONDS / seconds))
        return min(settings.resolution, max(SMALLEST_DRAFT, fitting // 8 * 8))

    def _submit(self, lit: LitScene) -> None:
        if self._job is None and self._sent is not lit:
            self._sent = lit
            self._job = self._start(lambda: self._scatter(lit))

    def _scatter(self, lit: LitScene) -> tuple[LitScene, Float32, dict[str, float], float]:
        """Run in the worker: nothing here touches OpenGL."""
        stages = self.renderer.transport_stages
        stages.begin()
        start = time.perf_counter()
        exitance = self.renderer.scatter(lit)
        return lit, exitance, dict(stages.timings), time.perf_counter() - start

    def _collect(self) -> None:
        """Take what the worker has finished."""
        if self._job is None or not self._job.done():
            return
        job, self._job = self._job, None
        lit, exitance, timings, seconds = job.result()
        self.finished = Finished(lit, self.renderer.gather(lit, exitance), exitance)
        if "convolution" in timings:
            self._cost = seconds / (lit.grid.n_layers * max(lit.grid.width, lit.grid.height) ** 2)
        self.renderer.stages.timings.update(timings)

    def _start(self, work: Callable[[], Any]) -> Future[Any]:
        future = self._worker.submit(work)
        future.add_done_callback(lambda _: self._wake())
        return future

    def _count(self, timings: dict[str, float]) -> None:
        if timings:
            self.ran = dict(timings)
            self.stage_times.update(timings)


def _lighting_key(scene: Scene) -> tuple[object, ...]:
    """Everything that light and transport depend on, but for where the camera stands."""
    environment = scene.environment
    return scene.model, scene.material.resolve(), scene.effective_lights(), environment, scene.transport


def _turned(camera: CameraSettings) -> CameraSettings:
    """Return what turns the layers, out of a camera."""
    return CameraSettings(
        azimuth_deg=camera.azimuth_deg, elevation_deg=camera.elevation_deg, roll_deg=camera.roll_deg
    )


def _angle(a: CameraSettings, b: CameraSettings) -> float:
    """Largest difference of the angles, degrees."""
    turn = abs(a.azimuth_deg - b.azimuth_deg) % 360.0
    return max(min(turn, 360.0 - turn), abs(a.elevation_deg - b.elevation_deg), abs(a.roll_deg - b.roll_deg))


def _same_light(a: LitScene, b: LitScene) -> bool:
    """Whether transport would have the same work: stages return the very same arrays where nothing changed."""
    return (
        a.model is b.model
        and a.transport is b.transport
        and a.grid == b.grid
        and a.coordinates is b.coordinates
        and a.flux is b.flux
        and a.profiles == b.profiles
        and a.sources == b.sources
    )
