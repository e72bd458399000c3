"""`milkglass bench`: speed against error, as tables, CSV files and a plot.

Five parts: speed as ratios within one run (`viewer.bench_speed`), the window (`viewer.bench_window`), error of the
transport against equation (1) (`viewer.bench_error`), sums over samples at the same error (`viewer.bench_rivals`) and
error of the whole renderer (`viewer.bench_chain`).
"""

import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

from viewer import bench_chain, bench_error, bench_report, bench_rivals, bench_speed, bench_window
from viewer.bench_error import EWALD, LAYERED, LIGHTS, MATERIALS, PAPER, Scheme
from viewer.bench_shapes import SHAPES
from viewer.scene import Scene
from viewer.settings import DisplaySettings, ModelSettings

T = TypeVar("T")

DEFAULT = EWALD[0]


@dataclass(frozen=True)
class Plan:
    """What is measured; a part whose tuple is empty is left out."""

    # speed
    convolutions: tuple[int, ...] = (4, 8)  # layers
    side: int = 256  # texels of their maps, unpadded
    repeats: int = 25
    frames: tuple[Scheme, ...] = (PAPER, LAYERED[1], DEFAULT)
    image_size: tuple[int, int] = (1024, 1024)
    frame_repeats: int = 7
    processes: tuple[Scheme, ...] = (PAPER, DEFAULT)
    process_repeats: int = 3
    window: tuple[Scheme, ...] = (LAYERED[1], DEFAULT)
    window_repeats: int = 24
    # error of the transport
    schemes: tuple[Scheme, ...] = (*LAYERED, *EWALD)
    shapes: tuple[str, ...] = tuple(SHAPES)
    materials: tuple[str, ...] = MATERIALS
    lights: tuple[str, ...] = tuple(LIGHTS)
    points: int = 300
    # sums over samples beside the transport: shape, material, light
    rivals: tuple[tuple[str, str, str], ...] = (("knot", "marble", "back"), ("ball", "skim milk", "front"))
    # error of the renderer: shape, material, light
    pictures: tuple[tuple[str, str, str], ...] = (
        ("ball", "skim milk", "front"),
        ("knot", "marble", "back"),
        ("plate", "marble", "back"),
    )
    picture_schemes: tuple[Scheme, ...] = (PAPER, LAYERED[1], LAYERED[4], DEFAULT)


FULL = Plan()
QUICK = Plan(
    repeats=8,
    frames=(PAPER, DEFAULT),
    frame_repeats=3,
    process_repeats=1,
    window=(),
    schemes=(*LAYERED[:5], *EWALD[:2]),
    shapes=("knot", "plate"),
    materials=("marble", "skim milk"),
    points=100,
    rivals=FULL.rivals[:1],
    pictures=FULL.pictures[1:2],
)


def run(quick: bool, output: Path | None, model: Path | None = None) -> None:
    """Measure and report on stdout.

    Parameters
    ----------
    quick : bool
        A small selection in under a minute.
    output : Path, optional
        Folder for CSV files, the tables as Markdown and the plot.
    model : Path, optional
        Mesh of the frames; the built-in sculpture without one.

    Raises
    ------
    InputError
        A folder that cannot be written to, an unusable model, no OpenGL driver.
    """
    run_plan(QUICK if quick else FULL, output, model)


def run_plan(plan: Plan, output: Path | None, model: Path | None = None) -> None:
    """Measure what `plan` says; see `run`."""
    report = bench_report.Report(output)
    scene = Scene(model=ModelSettings(path=model), display=DisplaySettings(image_size=plan.image_size))
    _speed(plan, scene, report)
    _errors(plan, report)
    report.finish()


def _speed(plan: Plan, scene: Scene, report: bench_report.Report) -> None:
    if plan.convolutions:
        threads = os.cpu_count() or 1
        found = bench_speed.convolution_rows(plan.convolutions, plan.side, threads, plan.repeats)
        count = len(plan.convolutions) * len(bench_speed.EFFORTS)
        bench_report.report_convolution(report, _watched(found, count, "layer convolution"))
    what = scene.model.path.name if scene.model.path else "built-in sculpture"
    size = "{} x {}".format(*plan.image_size)
    frames: list[bench_speed.FrameRow] = []
    for scheme in plan.frames:
        rows = bench_speed.frame_rows(_with(scene, scheme), f"{what}, {size}, {scheme}", plan.frame_repeats)
        frames += _watched(rows, len(bench_speed.CHANGES), f"frames, {scheme}")
    if frames:
        bench_report.report_frames(report, frames)
    if plan.processes:
        with tempfile.TemporaryDirectory() as folder:
            processes = (
                bench_speed.process_row(_with(scene, s), f"{what}, {size}, {s}", Path(folder), plan.process_repeats)
                for s in plan.processes
            )
            bench_report.report_processes(report, _watched(processes, len(plan.processes), "first picture"))
    window: list[bench_window.WindowRow] = []
    for scheme in plan.window:
        found_rows = bench_window.window_rows(_with(scene, scheme), f"{what}, {size}, {scheme}", plan.window_repeats)
        window += _watched(found_rows, bench_window.COUNT, f"window, {scheme}")
    if window:
        bench_window.report_window(report, window)


def _errors(plan: Plan, report: bench_report.Report) -> None:
    if plan.schemes:
        sets = plan.schemes, plan.shapes, plan.materials, plan.lights
        count = len(plan.schemes) * len(plan.shapes) * len(plan.materials) * len(plan.lights)
        errors = _watched(bench_error.error_rows(*sets, plan.points), count, "error of the transport")
        bench_report.report_errors(report, errors)
    if plan.rivals:
        rivals = bench_rivals.rival_rows(plan.rivals, DEFAULT, plan.points)
        count = len(plan.rivals) * (len(bench_rivals.TOLERANCES) + 2)
        bench_rivals.report_rivals(report, _watched(rivals, count, "sums over samples"))
    if plan.pictures:
        pictures = bench_chain.chain_rows(plan.picture_schemes, plan.pictures, plan.points)
        count = len(plan.picture_schemes) * len(plan.pictures)
        bench_report.report_chain(report, _watched(pictures, count, "error of the renderer"))


def _with(scene: Scene, scheme: Scheme) -> Scene:
    return replace(scene, transport=scheme.settings)


def _watched(rows: Iterable[T], count: int, what: str) -> list[T]:
    """Collect rows behind a progress bar, which shows on a terminal only."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        return list(progress.track(rows, total=count, description=what))
