"""The pipeline, top to bottom: a scene becomes a picture.

`Renderer.draw` is the table of core/README.md: light (OpenGL) -> scatter (CPU) -> gather and shade (OpenGL). Every
stage inside states what it depends on and runs only when that changed, so a renderer that is kept (the window's, a
benchmark's) computes only what a new scene needs.
"""

import functools
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Concatenate, ParamSpec, TypeVar

import moderngl
import numpy as np

from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.probe import Probe
from milkglass.core.stages import Stage, Stages, Timings
from milkglass.core.threads import AtOnce, one_blas_thread
from milkglass.core.transport.base import GoOn, Scattered
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.files.record import Record
from milkglass.viewer.gl.context import check_image_size, current, free_dropped, headless_context, leave_framebuffer
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.ground import GroundPass
from milkglass.viewer.render import memory
from milkglass.viewer.render.ground import Ground
from milkglass.viewer.render.lighting import Lighting, Progress
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.paths import Paths
from milkglass.viewer.render.picture import Frame, Picture, PictureRequest, Still, read_frame, read_still
from milkglass.viewer.render.shading import Shading
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

P = ParamSpec("P")
T = TypeVar("T")


def render(scene: Scene, *, samples: int = 4, seed: int = 0, progress: Progress | None = None) -> Frame:
    """Render a scene without a window, in any thread: several take turns.

    Parameters
    ----------
    scene : Scene
    samples : int
        Antialiasing samples of a pixel, >= 1.
    seed : int
        Of their pattern; >= 0.
    progress : callable, optional
        Called with a few words as each long step begins.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        Unusable files or values, GPU limits, no OpenGL driver; one sentence each. Also in a process that was forked
        from one that had drawn: drivers do not survive that.
    """
    with current(headless_context()):
        drawn = _drawn(scene, samples, seed, progress, parts=True)
        return read_frame(*drawn, last=True, record=Record.of(scene, samples, seed))


def render_image(scene: Scene, *, samples: int = 4, seed: int = 0, progress: Progress | None = None) -> Still:
    """Render the tone-mapped picture alone, in five sixths of the memory; otherwise as `render`."""
    with current(headless_context()):
        drawn = _drawn(scene, samples, seed, progress, parts=False)
        return read_still(*drawn, record=Record.of(scene, samples, seed))


def _drawn(scene: Scene, samples: int, seed: int, progress: Progress | None, *, parts: bool) -> tuple[Picture, Timings]:
    """Draw a picture and let go of all that is behind it, before it is read back: the peak of memory is lower."""
    memory.check_size(scene.display.image_size, layers=parts)
    renderer = Renderer()
    request = PictureRequest(pixel_offsets(samples, seed), parts=parts)
    picture = renderer.draw(scene, request, progress=progress, last=True)
    return picture, renderer.timings


def _in_turn(method: Callable[Concatenate["Renderer", P], T]) -> Callable[Concatenate["Renderer", P], T]:
    """Have the renderer's context current while a method runs, and no longer: the next call may be another thread's."""

    @functools.wraps(method)
    @one_blas_thread()
    def run(self: "Renderer", /, *args: P.args, **kwargs: P.kwargs) -> T:
        with current(self.context):
            return method(self, *args, **kwargs)

    return run


class Renderer:
    """Renders scenes in one OpenGL context and keeps what the next scene can use again, in any thread.

    Parameters
    ----------
    context : moderngl.Context, optional
        The process's own without a window if not given.
    effort : str
        FFTW's planner flag, see `core.grid.convolution.LayerConvolver`.
    assets : Assets, optional
        Where meshes and probes come from, and stay for the next scene.
    worker : Executor, optional
        What follows rays of sight while stages with an allowance are left for other work.
    tolerance : float, optional
        Relative residual at which transport that solves ends, in the place of its usual one: pictures of a material are
        then as alike, whatever was drawn before.
    """

    def __init__(
        self,
        context: moderngl.Context | None = None,
        effort: str = "FFTW_ESTIMATE",
        assets: Assets | None = None,
        worker: Executor | None = None,
        tolerance: float | None = None,
    ) -> None:
        self.context = context = context or headless_context()
        # Two sets of stages, because transport may run in a thread of its own.
        self.stages, self.transport_stages = Stages(finish=context.finish), Stages()
        with current(context):
            ground = GroundPass(context)
            self._lighting = Lighting(
                context, self.stages, self.transport_stages, effort, assets or Assets(), ground, tolerance
            )
            self._shading = Shading(context, self.stages, ground, worker or AtOnce())

    @property
    def timings(self) -> Timings:
        """Return the times of the stages that ran for the last picture."""
        return {**self.stages.timings, **self.transport_stages.timings}

    @_in_turn
    def render(self, scene: Scene, *, samples: int = 4, seed: int = 0, progress: Progress | None = None) -> Frame:
        """Render a scene and read everything back; see `render`."""
        picture = self.draw(scene, PictureRequest(pixel_offsets(samples, seed), parts=True), progress=progress)
        return read_frame(picture, self.timings, record=Record.of(scene, samples, seed))

    @_in_turn
    def draw(
        self,
        scene: Scene,
        request: PictureRequest = PictureRequest(),
        *,
        progress: Progress | None = None,
        last: bool = False,
        tinted: bool = True,
        draft: bool = False,
    ) -> Picture:
        """Render a scene and leave the picture on the GPU.

        If it is the `last`, what is kept for the next goes before the pixels come: less memory at the peak. Not
        `tinted`, exitance is that of equation (1), without what the surface's colours do to light that leaves. A
        `draft` has fewer sub-lights, see `light`.
        """
        say = progress or (lambda _: None)
        self.stages.begin()
        self.transport_stages.begin()
        lit, gather = self._scattered(scene, say, draft=draft)
        lit = lit if tinted else lit.without_tint()
        ground = self._lighting.ground(scene, lit)
        if last:
            self._let_go_of_transport(lit)
        paths = self._paths(scene, lit, request, say)
        if last:
            lit = self._for_pixels(lit)
            memory.give_back()
        say("drawing")
        return self._shade(scene, lit, gather, request, ground, paths, last=last)

    def start_cold(self) -> None:
        """Have the next solution start from nothing: its picture is that of a new renderer, to the bit."""
        self._lighting.start_cold()
        for solved in (Stage.SOLUTION, Stage.BODIES):
            self.transport_stages.forget(solved)

    def _scattered(self, scene: Scene, say: Progress, *, draft: bool) -> tuple[LitScene, Gather]:
        """Light a scene and have it scattered; nothing else of that stays on the stack."""
        lit = self.light(scene, say, draft=draft)
        say("scattering light through the layers")
        return lit, self.gather(lit, self.scatter(lit))

    def _let_go_of_transport(self, lit: LitScene) -> None:
        """Let go of all that was kept for another solution."""
        self.stages.clear()
        self.transport_stages.clear()
        self._lighting.release()
        lit.transport.release()

    def _for_pixels(self, lit: LitScene) -> LitScene:
        """Return what pixels need of a lit scene, and let go of the rest."""
        free_dropped(self.context)
        none = np.empty((0, 3), np.float32)
        samples = SurfaceSamples(none, none, none[:, 0])
        return replace(
            lit, coordinates=none, flux=none, lights=(), samples=samples, exchange=None, unscattered=None, beams=None
        )

    @_in_turn
    def light(self, scene: Scene, progress: Progress = lambda _: None, *, draft: bool = False) -> LitScene:
        """Load, sample and light a scene, as a draft with fewer sub-lights: all that transport needs, on the CPU."""
        check_image_size(self.context, scene.display.image_size)
        leave_framebuffer(self.context)  # what was drawn last may be replaced
        return self._lighting.light(scene, progress, draft=draft)

    @one_blas_thread()
    def scatter(self, lit: LitScene, go_on: GoOn | None = None) -> Scattered:
        """Scatter light inside the object; `go_on` as of `core.transport.base.Transport.scatter`.

        Uses no OpenGL, so any one thread may run it.
        """
        return lit.transport.scatter(lit.entering, self.transport_stages, go_on)

    @_in_turn
    def gather(self, lit: LitScene, scattered: Scattered) -> Gather:
        """Upload what `scatter` returned as the volume that pixels read."""
        return self._lighting.gather(lit, scattered)

    @_in_turn
    def shade(self, scene: Scene, lit: LitScene, gather: Gather, request: PictureRequest = PictureRequest()) -> Picture:
        """Draw the scene through its camera from a volume, which may be of an older camera or light."""
        paths = self._paths(scene, lit, request)
        return self._shade(scene, lit, gather, request, self._lighting.ground(scene, lit), paths)

    def paths(self, scene: Scene, lit: LitScene) -> Paths | None:
        """Return the rays of sight of a lit scene while something moves; None where its transport follows none."""
        return self._lighting.paths(scene, lit, moves=True)

    def _paths(
        self, scene: Scene, lit: LitScene, request: PictureRequest, say: Progress = lambda _: None
    ) -> Paths | None:
        moves = request.drafts_sight
        return self._lighting.paths(scene, lit, say, moves=moves) if request.path_step > 0 else None

    def _shade(
        self,
        scene: Scene,
        lit: LitScene,
        gather: Gather,
        request: PictureRequest,
        ground: Ground | None,
        paths: Paths | None,
        *,
        last: bool = False,
    ) -> Picture:
        is_seen = scene.display.background == "environment"
        behind = self._lighting.probe(scene.environment) if is_seen else None
        return self._shading.shade(scene, lit, gather, request, behind, ground, paths, last=last)

    def serves_at_vertices(self, scene: Scene, lit: LitScene, gather: Gather) -> bool:
        """Whether `shade` draws a picture that may be `at_vertices` so."""
        return self._shading.serves_at_vertices(scene, lit, gather, self.paths(scene, lit))

    def pixels_alone(self, scene: Scene, lit: LitScene, gather: Gather) -> str:
        """Return why pictures are not drawn from light at the vertices while the camera moves; empty where they are."""
        return self._shading.pixels_alone(scene, lit, gather, self.paths(scene, lit))

    @_in_turn
    def advance(self, scene: Scene, lit: LitScene, gather: Gather, request: PictureRequest) -> None:
        """Draw some of the samples of a pixel ahead of `shade`.

        Raises
        ------
        Unfinished
            Until `shade` will find all of them there.
        """
        ground, paths = self._lighting.ground(scene, lit), self._paths(scene, lit, request)
        self._shading.advance(scene, lit, gather, request, ground, paths)

    def probe(self, environment: EnvironmentSettings) -> Probe:
        """Return the light probe of an environment that has one."""
        return self._lighting.probe(environment)

    def parted(self, environment: EnvironmentSettings) -> PartedProbe | None:
        """Return the sources of an environment's probe that shine as lamps, and the rest; None where no light is."""
        return self._lighting.parted(environment)

    @_in_turn
    def pick(self, pixel: tuple[int, int]) -> tuple[float, float, float] | None:
        """Return the world position (mm) that the last picture shows at a pixel (column, row from the top), or None."""
        return self._shading.pick(pixel)
