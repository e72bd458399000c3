"""Cost of light between parts of an object with `diffusion`: changes with it and without, rays, and memory.

Changes are timed in turns, and rays relative to the bake of an environment's visibility on the same mesh, by processor
time: other load changes it less than it changes waiting.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from milkglass.core.light.bake import bake
from milkglass.core.light.crossing import cast_crossings, few_crossings
from milkglass.core.light.exchange import cast_hits
from milkglass.core.material.medium import media
from milkglass.core.transport.base import Scattered
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import CrossingsOf
from milkglass.viewer.assets.visibility import refine
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import ProcessRow, Timing, process_row, relit
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.live.job import PRESENTABLE
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import MaterialSettings, TransportSettings

SIZE_MM = 30.0  # of the object
MATERIALS = "marble", "skim milk"
SAME_ETA = 1.4
SLIDER_STEP = 1.02  # factor on all coefficients by a step of a slider
SETTINGS = "off", "on"  # of `transport.exchange`
SHOWN, SOLVED, DRAWN = "first shown", "solved", "drawn"
INSIDE = "unscattered+once+often"  # `transport.light_paths` without the mirror, whose rays come with the exchange
N_RAYS, N_CHANGES, N_PROCESSES = 3 + len(MATERIALS), 12, 5  # rows, for progress bars
WANTED_RATIOS = {SHOWN: 1.1, SOLVED: 1.6, DRAWN: 1.6}  # of processor time, at most
WANTED_SHARE, WANTED_MEGABYTES, WANTED_MIRROR = 1.0 / 3.0, 150.0, 400.0  # of all rays, of a process: at most


@dataclass(frozen=True)
class ChangeRow:
    """Times of a change, without light between parts and with it.

    Attributes
    ----------
    change, until : str
    off, on : Timing
        From the change until the first solution that the window shows, the last one, or its picture.
    cpu_ratio : float
        Median ratio of processor times, on over off.
    products : (2,) ints
        Convolutions of all channels, off and on, medians.
    flux : (2,) floats
        What leaves by the first solution that is shown over what does by the last, off and on, medians.
    """

    change: str
    until: str
    off: Timing
    on: Timing
    cpu_ratio: float
    products: tuple[int, int]
    flux: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Median ratio of successive times, on over off, which other load affects equally."""
        return float(np.median(np.divide(self.on.times, self.off.times)))


@dataclass(frozen=True)
class RaysRow:
    """Processor time of rays from n vertices of a refined mesh, s; `share` is that of the visibility bake."""

    rays: str
    vertices: int
    seconds: float
    share: float


def at_size(scene: Scene, exchange: str | None = None) -> Scene:
    """Return a scene with its object `SIZE_MM` large and the default transport."""
    transport = TransportSettings(exchange=exchange)
    return replace(scene, model=replace(scene.model, size_mm=SIZE_MM), transport=transport)


def change_rows(scene: Scene, repeats: int) -> Iterator[ChangeRow]:
    """Yield times of changes of a scene's object, in steps as the window has them, and until they are drawn."""
    renderers = [(Renderer(headless_context()), at_size(scene, exchange)) for exchange in SETTINGS]
    for renderer, without_change in renderers:
        renderer.draw(_of_material(without_change, 0, 1.0))
    for change, apply in CHANGES.items():
        # The first is a warm-up: allocations and plans of the change.
        rounds = [[_measured(renderer, apply(at, i)) for renderer, at in renderers] for i in range(repeats + 1)][1:]
        times = np.array(rounds)  # (repeats, off and on, what `_measured` returns)
        off, on = (int(np.median(products)) for products in times[..., 6].T)
        fluxes = float(np.median(times[:, 0, 7])), float(np.median(times[:, 1, 7]))
        for until, waiting, processor in ((SHOWN, 0, 3), (SOLVED, 1, 4), (DRAWN, 2, 5)):
            of_off, of_on = (Timing(tuple(column)) for column in times[..., waiting].T)
            cpu_ratio = float(np.median(times[:, 1, processor] / times[:, 0, processor]))
            yield ChangeRow(change, until, of_off, of_on, cpu_ratio, (off, on), fluxes)


def _measured(renderer: Renderer, scene: Scene) -> tuple[float, ...]:
    """Return ms until `SHOWN`, `SOLVED`, `DRAWN`, the same of processor time, products of all channels, flux ratio."""
    start, shown = (time.perf_counter(), time.process_time()), list[tuple[float, float]]()
    first: list[Scattered] = []

    def now() -> tuple[float, float]:
        return 1e3 * (time.perf_counter() - start[0]), 1e3 * (time.process_time() - start[1])

    def keep_solving(scattered: Scattered) -> bool:
        if not shown and max(scattered.residuals) <= PRESENTABLE:
            _ = scattered.volume
            shown.append(now())
            first.append(scattered)
        return True

    with current(renderer.context) as context:
        lit = renderer.light(scene)
        scattered = renderer.scatter(lit, keep_solving)
        renderer.gather(lit, scattered)
        solved = now()
        renderer.draw(scene)
        context.finish()
        moments = [(*shown, solved)[0], solved, now()]
    waiting, processor = zip(*moments, strict=True)
    leaving = [float(part.on_layers().sum(dtype=np.float64)) for part in ((*first, scattered)[0], scattered)]
    return *waiting, *processor, float(sum(scattered.convolutions)), leaving[0] / leaving[1]


def _of_material(scene: Scene, i: int, factor: float, eta: float | None = None) -> Scene:
    """Return the scene with one of `MATERIALS`, coefficients times a factor, perhaps of another index."""
    material = MaterialSettings(name=MATERIALS[i % len(MATERIALS)]).resolve()
    (a, b, c), (d, e, f) = (tuple(factor * x for x in of) for of in (material.sigma_s_prime, material.sigma_a))
    settings = MaterialSettings(sigma_s_prime=(a, b, c), sigma_a=(d, e, f), eta=eta or material.eta)
    return replace(scene, material=settings)


# Coefficients are others each time, so that no kernel is cached.
CHANGES: dict[str, Callable[[Scene, int], Scene]] = {
    "a step of a slider": lambda scene, i: _of_material(scene, 0, SLIDER_STEP ** (i + 1)),
    "another material": lambda scene, i: _of_material(scene, i, SLIDER_STEP ** (i + 1), SAME_ETA),
    "... of another index": lambda scene, i: _of_material(scene, i, SLIDER_STEP ** (i + 1)),
    "another light": lambda scene, i: relit(_of_material(scene, 0, 1.0), i),
}


def rays_rows(scene: Scene) -> Iterator[RaysRow]:
    """Yield processor times of all rays that a scene's object needs once: those of the visibility bake first."""
    mesh, _ = Assets().mesh(at_size(scene).model)
    fine = refine(mesh).mesh
    baked, few = _processor_seconds(lambda: bake(fine)), few_crossings(fine)

    def row(rays: str, cast: Callable[[], object]) -> RaysRow:
        seconds = _processor_seconds(cast)
        return RaysRow(rays, len(fine.vertices), seconds, seconds / baked)

    yield RaysRow("an environment's visibility", len(fine.vertices), baked, 1.0)
    yield row("between parts", lambda: cast_hits(fine))
    yield row("a few through its matter", lambda: few_crossings(fine))
    for name in MATERIALS:
        source = CrossingsOf.of(mesh, [media(MaterialSettings(name=name).resolve())], few)
        if source is not None:
            eta, needed = source.etas[0], source.needed
            yield row(
                f"through its matter, {name}",
                lambda eta=eta, needed=needed: cast_crossings(fine, eta, needed.reach, needed.rays),  # type: ignore[misc]
            )


def _processor_seconds(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def process_rows(scene: Scene, name: str, folder: Path, repeats: int) -> Iterator[ProcessRow]:
    """Yield times and memory of `milkglass render` without light between parts, and with it before and after rays.

    First of what the surface lets out, then with its mirror: where parts meet, that has rays of sight of its own.
    `folder` has the files, and the cache of rays where the system lets it be chosen.
    """

    def row(exchange: str, paths: str, setting: str, repeats: int) -> ProcessRow:
        transport = TransportSettings(exchange=exchange, light_paths=paths)
        cache = {"XDG_CACHE_HOME": str(folder)}
        return process_row(
            replace(scene, transport=transport), f"{name}, {setting}", folder, repeats, environment=cache
        )

    yield row("off", INSIDE, "exchange off, no mirror", repeats)
    yield row("on", INSIDE, "on, rays cast, no mirror", 1)
    yield row("on", INSIDE, "on, rays known, no mirror", repeats)
    yield row("off", "auto", "exchange off", repeats)
    yield row("on", "auto", "on, rays known, with rays of the mirror", repeats)


def report_changes(report: BenchReport, rows: Sequence[ChangeRow]) -> None:
    """Report changes with light between parts and without, and write them to `exchange.csv`."""
    report.table(
        f"Light between parts, {SIZE_MM:g} mm: a change until it is shown, solved, drawn; ms, minimum / median",
        ["change, until", "off", "on", "ratio", "ratio of processor time", "wanted", "products, flux off / on"],
        (
            [
                f"{row.change}, {row.until}",
                f"{row.off.minimum:.0f} / {row.off.median:.0f}",
                f"{row.on.minimum:.0f} / {row.on.median:.0f}",
                f"{row.ratio:.2f}",
                f"{row.cpu_ratio:.2f}",
                f"{WANTED_RATIOS[row.until]:g}",
                "{:.3f} / {:.3f}".format(*row.flux) if row.until == SHOWN else "{} / {}".format(*row.products),
            ]
            for row in rows
        ),
    )
    report.csv(
        "exchange.csv",
        [
            {"change": row.change, "until": row.until, "off_ms": row.off.median, "on_ms": row.on.median}
            | {"wall_ratio": row.ratio, "processor_ratio": row.cpu_ratio}
            | {"products_off": row.products[0], "products_on": row.products[1]}
            | {"first_flux_off": row.flux[0], "first_flux_on": row.flux[1]}
            for row in rows
        ],
    )


def report_rays(report: BenchReport, rows: Sequence[RaysRow]) -> None:
    """Report the rays of light between parts beside those of visibility, and write them to `exchange_rays.csv`."""
    report.table(
        f"Rays of light between parts, {rows[0].vertices:,} vertices",
        ["rays", "seconds of processor time", "over the visibility bake"],
        ([row.rays, f"{row.seconds:.2f}", f"{row.share:.2f}"] for row in rows),
    )
    report.say(f"Wanted: at most {WANTED_SHARE:.2f} of the bake.")
    report.csv(
        "exchange_rays.csv",
        [{"rays": row.rays, "vertices": row.vertices, "seconds": row.seconds, "bake_ratio": row.share} for row in rows],
    )


def report_memory(report: BenchReport, rows: Sequence[ProcessRow]) -> None:
    """Report processes beside those without light between parts; write them to `exchange_memory.csv`."""
    without = [next(off.megabytes for off in rows[i::-1] if "exchange off" in off.setting) for i in range(len(rows))]
    report.table(
        "milkglass render with light between parts and without, from the start of the process to the file",
        ["setting", "seconds, minimum / median", "peak memory, MB", "more, MB"],
        (
            [
                row.setting,
                f"{row.time.minimum / 1e3:.1f} / {row.time.median / 1e3:.1f}",
                f"{row.megabytes:.0f}",
                f"{row.megabytes - off:+.0f}",
            ]
            for row, off in zip(rows, without, strict=True)
        ),
    )
    report.say(f"Wanted: at most {WANTED_MEGABYTES:+.0f} MB without the mirror; {WANTED_MIRROR:+.0f} MB with its rays.")
    report.csv(
        "exchange_memory.csv",
        [{"setting": row.setting, "median_ms": row.time.median, "peak_mb": row.megabytes} for row in rows],
    )
