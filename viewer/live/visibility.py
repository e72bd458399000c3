"""Visibility, baked in a thread of its own while the window does without; given up where it is not wanted."""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.bake import BakeCancelled
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import VisibilityOf, model_source
from milkglass.viewer.assets.visibility import needs_visibility
from milkglass.viewer.scene.scene import Scene

LOG = logging.getLogger(__name__)
STEPS = 50  # of the progress that is shown


class VisibilityJob:
    """Keeps the visibility of the scene's mesh on its way; for one thread, the one that draws.

    Parameters
    ----------
    assets : Assets
        Where it comes from and stays.
    wake : callable
        Called from the worker when there is something to see.

    Attributes
    ----------
    progress : float, optional
        Share that is done, None where nothing is being done.
    """

    def __init__(self, assets: Assets, wake: Callable[[], object]) -> None:
        self.progress: float | None = None
        self._assets, self._wake = assets, wake
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="visibility")
        self._mesh: Mesh | None = None  # that was last asked for
        self._cancelled = threading.Event()
        self._future: Future[None] | None = None

    @property
    def busy(self) -> bool:
        """Whether something is being baked."""
        return self._future is not None and not self._future.done()

    def follow(self, scene: Scene) -> None:
        """Bake for a scene whose mesh is loaded, if it needs that; else give up."""
        mesh = self._assets.mesh(scene.model)[0] if needs_visibility(scene.environment) else None
        if mesh is not None and self._assets.has(VisibilityOf(mesh)):
            mesh = None
        if mesh is self._mesh:
            return
        self._cancelled.set()
        self._mesh, self.progress = mesh, None
        if mesh is not None:
            self._cancelled, self.progress = threading.Event(), 0.0
            self._future = self._worker.submit(self._bake, mesh, self._cancelled)
            self._future.add_done_callback(lambda _: self._wake())

    def is_there(self, scene: Scene) -> bool:
        """Whether light is occluded by now: what it depends on beside the scene."""
        return (
            needs_visibility(scene.environment)
            and self._assets.has(model_source(scene.model))
            and self._assets.has(VisibilityOf(self._assets.mesh(scene.model)[0]))
        )

    def wait(self, timeout: float) -> None:
        """Wait for what is being baked."""
        if self._future is not None:
            self._future.exception(timeout)

    def close(self) -> None:
        """Give up and free the thread."""
        self._cancelled.set()
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _bake(self, mesh: Mesh, cancelled: threading.Event) -> None:
        """Run in the worker."""

        def report(share: float) -> None:
            step = int(STEPS * share) / STEPS
            if not cancelled.is_set() and step != self.progress:
                self.progress = step
                self._wake()

        try:
            self._assets.get(VisibilityOf(mesh, report, cancelled))
        except BakeCancelled:
            return
        except Exception:  # the window goes on without
            LOG.exception("visibility of the environment could not be baked")
        if not cancelled.is_set():
            self.progress = None
