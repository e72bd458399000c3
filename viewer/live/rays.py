"""What rays find on the scene's mesh, baked in a thread of its own while the window does without it."""

import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.material.medium import Medium, media
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import (
    CrossingsOf,
    FewCrossingsOf,
    GroundRaysOf,
    HitsOf,
    VisibilityOf,
    model_source,
)
from milkglass.viewer.assets.visibility import needs_visibility
from milkglass.viewer.live.worker import Worker
from milkglass.viewer.render.matter import is_clear
from milkglass.viewer.scene.scene import Scene

RaySource = HitsOf | FewCrossingsOf | CrossingsOf | VisibilityOf | GroundRaysOf

LOG = logging.getLogger(__name__)
STEPS = 50  # of the progress that is shown


class RaysJob:
    """Keeps what rays tell of light between parts, of the environment, then of the ground, on its way.

    For one thread, the one that draws.

    Given up where they are not wanted any longer.

    Parameters
    ----------
    assets : Assets
        Where they come from and stay.
    wake : callable
        Called from the worker when there is something to see.

    Attributes
    ----------
    progress : float, optional
        Share that is done of what is cast now, None where nothing is.
    casting : str
        What that is.
    """

    def __init__(self, assets: Assets, wake: Callable[[], object]) -> None:
        self.progress: float | None = None
        self.casting = ""
        self._assets, self._wake = assets, wake
        self._worker = Worker("rays")
        self._wanted: tuple[RaySource, ...] = ()  # that were last asked for
        self._cancelled = threading.Event()
        self._future: Future[None] | None = None

    @property
    def busy(self) -> bool:
        """Whether something is being baked."""
        return self._future is not None and not self._future.done()

    def follow(self, scene: Scene) -> None:
        """Bake for a scene whose mesh is loaded, what it needs of that; else give up."""
        wanted = tuple(source for source in self._sources(scene) if not self._assets.has(source))
        if wanted == self._wanted or (self.busy and wanted == self._wanted[-len(wanted) :] and wanted):
            return
        self._cancelled.set()
        self._wanted, self.progress = wanted, None
        if wanted:
            self._cancelled, self.progress = threading.Event(), 0.0
            self._future = self._worker.submit(self._bake, wanted, self._cancelled)
            self._future.add_done_callback(lambda _: self._wake())

    def found(self, scene: Scene) -> tuple[RaySource, ...]:
        """Return what has been found by now, on which light depends beside the scene."""
        if not self._assets.has(model_source(scene.model)):
            return ()
        return tuple(source for source in self._sources(scene) if self._assets.has(source))

    def wait(self, timeout: float) -> None:
        """Wait for what is being baked."""
        if self._future is not None:
            self._future.exception(timeout)

    def stop(self) -> None:
        """Give up, and wait for nothing."""
        self._cancelled.set()
        self._worker.stop()

    def close(self) -> None:
        """Give up and free the thread."""
        self.stop()
        self._worker.close()

    def _sources(self, scene: Scene) -> tuple[RaySource, ...]:
        """Return what rays are to find for a scene whose mesh is loaded, the first one first."""
        model = self._assets.model(scene.model)
        mesh = model.mesh
        settings = self._assets.possible(scene.transport, mesh, separate=scene.separate)
        matter, between = media(scene.material.resolve()), list[RaySource]()
        kinds = [matter]
        if mesh.kinds is not None and settings.facts.follows_sight:
            kinds += [media(material.resolve()) for _, material in scene.scattering_parts]
        if settings.exchanges and not all(is_clear(settings.facts, of_kind, mesh) for of_kind in kinds):
            between = [HitsOf(mesh), *(self._through(mesh, kinds) if settings.facts.solves else ())]
        has_ground = scene.ground.on and scene.environment.occluded  # which is around too
        around: tuple[RaySource, ...] = ()
        if has_ground or needs_visibility(scene.environment):
            around = (VisibilityOf(mesh),)
        below: tuple[RaySource, ...] = (
            (GroundRaysOf(mesh, scene.ground.gap_mm + model.lift),) if scene.ground.on else ()
        )
        return (*between, *around, *below)

    def _through(self, mesh: Mesh, matter: Sequence[Sequence[Medium]]) -> list[RaySource]:
        """Return a few rays through matter and, once they are there, the many that they ask for."""
        test = FewCrossingsOf(mesh)
        through = CrossingsOf.of(mesh, matter, self._assets.get(test)) if self._assets.has(test) else None
        return [test] if through is None else [test, through]

    def _bake(self, wanted: tuple[RaySource, ...], cancelled: threading.Event) -> None:
        """Run in the worker."""

        def report(share: float) -> None:
            step = int(STEPS * share) / STEPS
            if not cancelled.is_set() and step != self.progress:
                self.progress = step
                self._wake()

        for source in wanted:
            self.casting = source.CASTING
            try:
                self._assets.get(replace(source, progress=report, cancelled=cancelled))
            except BakeCancelled:
                return
            except Exception:  # the window goes on without
                LOG.exception("rays could not be cast")
            self._wake()
        if not cancelled.is_set():
            self.progress = None
