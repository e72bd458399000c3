"""What clear and murky matter costs beside dense matter: rays of sight, light within, and memory.

Times are processor time of all threads, of the same scene in several materials, in turns within one run.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import Timing, process_row
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.job import PRESENTABLE
from milkglass.viewer.live.live import Live
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings, MaterialSettings

CLEAR, MURKY, DENSE = "Apple Juice", "Head & Shoulders Shampoo", "marble"
AROUND = "overcast"
TURN_DEG = 2.0  # of the camera in a frame of an orbit
SLIDER_STEP = 1.02  # factor on scattering by a step of a slider
FEW = 4  # pixels along a square that shares a ray of sight
DRAG, DRAFT = "a frame of an orbit", "a draft of what rays of sight find"
FIRST_RAYS, ALL_RAYS = "rays of sight of a pixel in 16", "rays of sight of all pixels"
FIRST_LIGHT, ALL_LIGHT, MEMORY = "a material: its first picture", "a material: all light", "peak memory, MB"
N_ROWS = 7
WANTED = {DRAFT: "300 ms", FIRST_RAYS: "300 ms", ALL_RAYS: "6 s", FIRST_LIGHT: "2.5", MEMORY: "400 MB more"}


@dataclass(frozen=True)
class SightRow:
    """Processor times, ms, or MB, of one thing in one kind of matter, and of the same without what this needs."""

    case: str
    material: str
    measured: Timing
    beside: Timing

    @property
    def ratio(self) -> float:
        """Median of the one over that of the other."""
        return self.measured.median / self.beside.median


def sight_rows(scene: Scene, folder: Path, repeats: int) -> Iterator[SightRow]:
    """Yield what a scene's object costs in clear and murky matter, in light from all around; files in `folder`."""
    clear, murky, dense = (_of(scene, name) for name in (CLEAR, MURKY, DENSE))
    with current(headless_context()):
        yield SightRow(DRAG, CLEAR, _orbit(clear, repeats), _orbit(dense, repeats))
        without, draft, few, full = _rays(clear, repeats)
        yield SightRow(DRAFT, CLEAR, _less(draft, without), without)
        yield SightRow(FIRST_RAYS, CLEAR, _less(few, without), without)
        yield SightRow(ALL_RAYS, CLEAR, _less(full, without), without)
        (first, last), (first_without, last_without) = _slider(murky, repeats)
        yield SightRow(FIRST_LIGHT, MURKY, first, first_without)
        yield SightRow(ALL_LIGHT, MURKY, last, last_without)
    peaks = [process_row(part, "", folder, 1).megabytes for part in (murky, dense)]
    yield SightRow(MEMORY, MURKY, *(Timing((peak,)) for peak in peaks))


def report_sight(report: BenchReport, rows: Sequence[SightRow]) -> None:
    """Report what clear and murky matter costs, and write it to `sight.csv`."""
    report.table(
        "Clear and murky matter, processor time in ms, minimum / median",
        ["case, material", "", "without, or of dense matter", "ratio", "wanted"],
        (
            [
                f"{row.case}, {row.material}",
                *(f"{times.minimum:.0f} / {times.median:.0f}" for times in (row.measured, row.beside)),
                f"{row.ratio:.2f}",
                WANTED.get(row.case, ""),
            ]
            for row in rows
        ),
    )
    report.csv(
        "sight.csv",
        [
            {
                "case": row.case,
                "material": row.material,
                "median": row.measured.median,
                "median_without": row.beside.median,
                "ratio": row.ratio,
            }
            for row in rows
        ],
    )


def _of(scene: Scene, material: str) -> Scene:
    return replace(scene, material=MaterialSettings(name=material), environment=EnvironmentSettings(builtin=AROUND))


def _milliseconds(task: Callable[[], object]) -> float:
    start = time.process_time()
    task()
    return 1e3 * (time.process_time() - start)


def _less(times: Timing, less: Timing) -> Timing:
    return Timing(tuple(a - b for a, b in zip(times.times, less.times, strict=True)))


def _turned(scene: Scene, i: int) -> Scene:
    return replace(scene, camera=replace(scene.camera, azimuth_deg=scene.camera.azimuth_deg + TURN_DEG * i))


def _orbit(scene: Scene, repeats: int) -> Timing:
    """Return times of frames while the camera is dragged."""
    context = headless_context()
    with closing(Live(context, lambda: None)) as live:

        def drawn(scene: Scene, detail: Detail) -> None:
            live.draw(scene, detail)
            context.finish()

        while not live.is_settled(scene):
            live.wait()
            drawn(scene, Detail())
        frames = [_milliseconds(lambda i=i: drawn(_turned(scene, i), Detail(draft=True))) for i in range(repeats + 1)]  # type: ignore[misc]
    return Timing(tuple(frames[1:]))


def _rays(scene: Scene, repeats: int) -> tuple[Timing, Timing, Timing, Timing]:
    """Return times of pictures after a turn of the camera: without rays of sight, drafted, with a few, with all."""
    renderer = Renderer(headless_context())
    lit = renderer.light(scene)
    gather = renderer.gather(lit, renderer.scatter(lit))
    times: tuple[list[float], ...] = [], [], [], []
    requests = (
        PictureRequest(path_step=0),
        PictureRequest(drafts_sight=True),
        PictureRequest(path_step=FEW),
        PictureRequest(),
    )
    for i in range(repeats + 1):
        turned = _turned(scene, i)
        lit = renderer.light(turned)
        for request, elapsed in zip(requests, times, strict=True):

            def draw(lit: LitScene = lit, turned: Scene = turned, request: PictureRequest = request) -> None:
                renderer.shade(turned, lit, gather, request)
                renderer.context.finish()

            elapsed.append(_milliseconds(draw))
    without, draft, few, full = (Timing(tuple(elapsed[1:])) for elapsed in times)
    return without, draft, few, full


def _slider(scene: Scene, repeats: int) -> tuple[tuple[Timing, Timing], ...]:
    """Return times of transport until a first and the last solution, with and without light within, in turns."""
    renderers = [Renderer(headless_context()) for _ in range(2)]
    times: list[tuple[list[float], list[float]]] = [([], []), ([], [])]
    material = scene.material.resolve()
    for i in range(repeats + 1):
        red, green, blue = (SLIDER_STEP**i * value for value in material.sigma_s_prime)
        settings = MaterialSettings(
            sigma_s_prime=(red, green, blue), sigma_a=material.sigma_a, eta=material.eta, g=material.g
        )
        for k, (renderer, (first, last)) in enumerate(zip(renderers, times, strict=True)):
            lit = renderer.light(replace(scene, material=settings))
            begun, ended = _scattered(renderer, lit if k == 0 else replace(lit, beams=None))
            first.append(begun)
            last.append(ended)
    return tuple((Timing(tuple(first[1:])), Timing(tuple(last[1:]))) for first, last in times)


def _scattered(renderer: Renderer, lit: LitScene) -> tuple[float, float]:
    """Return the times until a solution may be seen and until all light is found, ms."""
    seen: list[float] = []
    start = time.process_time()

    def go_on(solution: object) -> bool:
        if not seen and max(solution.residuals) <= PRESENTABLE:  # type: ignore[attr-defined]
            seen.append(time.process_time())
        return True

    renderer.scatter(lit, go_on)
    end = time.process_time()
    return 1e3 * ((seen or [end])[0] - start), 1e3 * (end - start)
