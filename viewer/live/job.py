"""Transport of one light in a worker thread: shown on the way where it is solved in steps, and given up in good time.

Every job has its own previews and its own word on whether it is wanted, so that none can be taken for another's.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.grid.layers import deposit
from milkglass.core.stages import Stage, Timings
from milkglass.core.transport.base import Scattered
from milkglass.core.transport.diffusion.solver import TOLERANCE
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.renderer import Renderer


@dataclass(frozen=True, eq=False)
class Finished:
    """Scattered light that is drawn, and the lighting that it was computed for.

    Attributes
    ----------
    lit : LitScene
        The light that it is of.
    gather : Gather
        The volume that pixels read.
    scattered : Scattered
    complete : bool
        Whether nothing better is on the way.
    """

    lit: LitScene
    gather: Gather
    scattered: Scattered
    complete: bool = True

    def incoming(self) -> Float32:
        """Return the flux on the layers, (3, n_layers, height, width)."""
        lit, flux = self.lit, self.lit.flux
        if lit.unscattered is not None and not self.scattered.estimates_unscattered:
            flux = flux + lit.unscattered.light.flux
        return deposit(lit.grid, lit.transport.weights(lit.grid, lit.coordinates), flux)

    def outgoing(self) -> Float32:
        """Return exitance on the layers as of `core.transport.base.Scattered.on_layers`."""
        return self.scattered.on_layers()


# Relative residual from which on a solution may be seen: pixels magnify it a few times, to 1 % rms. At 0.005 shadows
# have coloured stains yet; what a start of other light gives is black and blue, worse than the volume before.
PRESENTABLE = 2e-3
PREVIEW_SECONDS = 0.15  # between solutions that are shown on the way
SHARES = 20  # of the progress that is shown
SURFACE_STAGES = {Stage.RAYS, Stage.BOUNDARY}  # run once a mesh and grid, which a drag keeps


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a transport job, final or on the way.

    Attributes
    ----------
    lit : LitScene
        The light that it is of.
    scattered : Scattered
    timings : Timings
        Empty on the way.
    complete : bool
        Whether it is all that can be had, not on the way or given up for newer light.
    seen_after : float
        Seconds until a solution could be seen.
    """

    lit: LitScene
    scattered: Scattered
    timings: Timings
    complete: bool
    seen_after: float = np.inf

    @property
    def is_presentable(self) -> bool:
        """Whether it may be seen."""
        return self.complete or _is_presentable(self.scattered)

    @property
    def seconds(self) -> float | None:
        """Return the seconds of transport in a drag on this grid until it may be seen; None where this cannot tell."""
        if not self.complete:
            return None
        if self.lit.quality.facts.solves:
            known = Stage.SOLUTION in self.timings and not SURFACE_STAGES & self.timings.keys()
            return self.seen_after if known else None
        if Stage.CONVOLUTION not in self.timings:
            return None
        return 1e-3 * sum(ms for stage, ms in self.timings.items() if stage is not Stage.WEIGHTS)


class TransportJob:
    """Transport of one light in a worker, which begins at once.

    Parameters
    ----------
    worker : Executor
        Of one thread.
    renderer, lit
    wake : callable
        Called from the worker when there is something to take.
    until_seen : bool
        Whether it ends as soon as there is something to see, so that drawing it has the processor to itself.

    Attributes
    ----------
    share : float, optional
        How far a solution is, [0, 1]; None where transport does not say.
    """

    def __init__(
        self,
        worker: Executor,
        renderer: Renderer,
        lit: LitScene,
        wake: Callable[[], object],
        *,
        until_seen: bool = False,
    ) -> None:
        self._renderer, self.lit, self._wake = renderer, lit, wake
        self._superseded, self._unwanted = threading.Event(), threading.Event()
        if until_seen:
            self._superseded.set()
        self._preview: Scattered | None = None
        self._shown: Scattered | None = None
        self._shown_at, self._gave_up = -np.inf, False
        self.share: float | None = None  # that is done, where a solution tells
        self._began, self._seen_after = 0.0, np.inf
        self.future: Future[Outcome] = worker.submit(self._scatter)
        self.future.add_done_callback(lambda _: wake())

    def supersede(self, *, at_once: bool) -> None:
        """Tell it that newer light waits: it ends `at_once` (another model's), else as soon as it may be seen."""
        self._superseded.set()
        if at_once:
            self._unwanted.set()

    def preview(self) -> Outcome | None:
        """Return the newest solution on the way, once."""
        solution, self._preview = self._preview, None  # one that comes in between is followed by others, or the end
        return None if solution is None else Outcome(self.lit, solution, {}, complete=False)

    def _scatter(self) -> Outcome:
        """Run in the worker: nothing here touches OpenGL."""
        stages = self._renderer.transport_stages
        stages.begin()
        self._began = time.perf_counter()
        scattered = self._renderer.scatter(self.lit, self._go_on)
        self._seen_after = min(self._seen_after, time.perf_counter() - self._began)
        return Outcome(self.lit, scattered, dict(stages.timings), not self._gave_up, self._seen_after)

    def _go_on(self, solution: Scattered) -> bool:
        """Show the first solution that may be seen at once and some of the later ones; give up in good time."""
        presentable = _is_presentable(solution)
        self._tell(max(solution.residuals))
        self._gave_up = self._unwanted.is_set() or (presentable and self._superseded.is_set())
        now = time.perf_counter()
        if presentable:
            self._seen_after = min(self._seen_after, now - self._began)
        new = solution is not self._shown  # bodies have nothing better together while one of them goes on
        if presentable and new and not self._gave_up and now - self._shown_at > PREVIEW_SECONDS:
            _ = solution.volume  # summed here, not where it is drawn
            self._shown_at, self._shown, self._preview = now, solution, solution
            self._wake()
        return not self._gave_up

    def _tell(self, residual: float) -> None:
        """Say how far a solution is whose relative residual falls from 1, and have the window look now and then."""
        share = min(1.0, float(np.log(max(residual, TOLERANCE)) / np.log(TOLERANCE))) if residual < 1.0 else 0.0
        before, self.share = self.share, share
        if before is None or int(SHARES * share) != int(SHARES * before):
            self._wake()


def _is_presentable(scattered: Scattered) -> bool:
    return max(scattered.residuals) <= PRESENTABLE
