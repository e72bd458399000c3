"""`milkglass bench`: speed against error, as tables, CSV files and a plot.

Parts: speed as ratios within one run (`viewer.bench.speed`, `viewer.bench.photo`), the transport relative to bare
transforms (`viewer.bench.yardsticks`), solutions of `diffusion` (`viewer.bench.solving`), light between parts
(`viewer.bench.exchange`), the window (`viewer.bench.window`), clear and murky matter (`viewer.bench.sight`), many
pictures beside a command for each (`viewer.bench.sweep`), error of
the transport against equation (1) (`viewer.bench.error`), sums over samples at the same error (`viewer.bench.rivals`),
error of the whole renderer (`viewer.bench.chain`), of an occluded environment (`viewer.bench.occlusion`), and of all
methods relative to photons (`viewer.bench.transport`).
"""

import os
import tempfile
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import Progress

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.threads import one_blas_thread
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.bench import (
    chain as bench_chain,
    error as bench_error,
    error_report as bench_error_report,
    exchange as bench_exchange,
    occlusion as bench_occlusion,
    photo as bench_photo,
    report as bench_report,
    rivals as bench_rivals,
    sight as bench_sight,
    solving as bench_solving,
    speed as bench_speed,
    sweep as bench_sweep,
    transport as bench_transport,
    transport_report as bench_transport_report,
    window as bench_window,
    yardsticks as bench_yardsticks,
)
from milkglass.viewer.bench.error import MATERIALS
from milkglass.viewer.bench.lights import LIGHTS
from milkglass.viewer.bench.schemes import DEFAULT, EWALD, FIXED_NODES, LAYERED, PAPER, Scheme
from milkglass.viewer.bench.shapes import SHAPES
from milkglass.viewer.files.builtin import builtin_model
from milkglass.viewer.files.model import load_model
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DisplaySettings, ModelSettings

T = TypeVar("T")


@dataclass(frozen=True)
class Plan:
    """Selection of the benchmark; parts whose tuple is empty are skipped."""

    # speed
    convolutions: tuple[int, ...] = (4, 8)  # layers
    side: int = 256  # texels of their maps, unpadded
    repeats: int = 25
    frames: tuple[Scheme, ...] = (PAPER, LAYERED[1], DEFAULT)
    image_size: tuple[int, int] = (1024, 1024)
    frame_repeats: int = 7
    processes: tuple[Scheme, ...] = (PAPER, DEFAULT)
    process_repeats: int = 3
    photographs: tuple[int, ...] = (1024,)  # pixels a side
    window_repeats: int = 24
    sight_repeats: int = 5  # clear and murky matter
    swept: tuple[int, ...] = (60, 200)  # frames of a turntable, and materials
    sweep_commands: int = 4  # single ones beside them
    # the transport relative to bare transforms, on shapes and on the model of the scene
    yardsticks: tuple[str, ...] = ("ball", "plate", "knot", "scene")
    yardstick_repeats: int = 15
    solved: tuple[str, ...] = ("ball", "knot", "washer, 10 mm", "dish, 3 mm", "scene")
    solved_repeats: int = 9
    # light between parts of the scene's model
    exchange_repeats: int = 7
    exchange_processes: int = 3
    # error of the transport; a given model is added to these shapes
    schemes: tuple[Scheme, ...] = (*LAYERED, *EWALD, *FIXED_NODES)
    shapes: tuple[str, ...] = tuple(SHAPES)
    materials: tuple[str, ...] = MATERIALS
    lights: tuple[str, ...] = tuple(LIGHTS)
    points: int = 200
    # sums over samples compared with the transport: shape, material, light
    rivals: tuple[tuple[str, str, str], ...] = (("knot", "marble", "back"), ("ball", "skim milk", "front"))
    # error of the renderer: shape, material, light
    pictures: tuple[tuple[str, str, str], ...] = (
        ("ball", "skim milk", "front"),
        ("knot", "marble", "back"),
        ("plate", "marble", "back"),
    )
    picture_schemes: tuple[Scheme, ...] = (PAPER, LAYERED[1], LAYERED[5], DEFAULT)
    # error of the occluded environment on the scene's model
    occluded_points: int = 1000
    # error relative to photons
    methods: tuple[Scheme, ...] = bench_transport.METHODS
    solids: tuple[str, ...] = tuple(bench_transport.SHAPES)
    media: tuple[str, ...] = bench_transport.MATERIALS
    photons: int = 100_000  # of each light and mean free path: noise of 2 to 3 % a region, 0.3 to 0.6 % of an rms


FULL = Plan()
QUICK = Plan(
    occluded_points=0,
    repeats=8,
    frames=(PAPER, DEFAULT),
    frame_repeats=2,
    process_repeats=1,
    window_repeats=0,
    sight_repeats=0,
    swept=(3, 3),
    sweep_commands=1,
    yardsticks=("knot",),
    yardstick_repeats=5,
    solved=("knot",),
    solved_repeats=3,
    exchange_repeats=2,
    exchange_processes=0,
    schemes=(*LAYERED[:3], DEFAULT, *FIXED_NODES[:2]),
    shapes=("knot", "plate"),
    materials=("marble", "skim milk"),
    points=60,
    rivals=FULL.rivals[:1],
    pictures=FULL.pictures[1:2],
    picture_schemes=(PAPER, LAYERED[1], DEFAULT),
    solids=("ball, 16 mm",),
    media=("albedos",),
    photons=30_000,
)


# Name of a part -> the fields of `Plan` without which it is skipped.
PARTS = {
    "convolution": ("convolutions",),
    "frames": ("frames",),
    "photographs": ("photographs",),
    "processes": ("processes",),
    "window": ("window_repeats",),
    "sight": ("sight_repeats",),
    "sweep": ("swept",),
    "yardsticks": ("yardsticks",),
    "solving": ("solved",),
    "exchange": ("exchange_repeats", "exchange_processes"),
    "error": ("schemes",),
    "rivals": ("rivals",),
    "chain": ("pictures",),
    "occlusion": ("occluded_points",),
    "transport": ("methods",),
}


def run(output: Path | None, model: Path | None = None, *, quick: bool, only: Collection[str] = PARTS) -> None:
    """Run the benchmark and report on stdout.

    Parameters
    ----------
    output : Path, optional
        Folder for CSV files, the tables as Markdown and the plot.
    model : Path, optional
        Mesh of the frames, whose error is measured too, relative to photons where it is closed; without one the frames
        are of the built-in sculpture.
    quick : bool
        Whether to run a small selection.
    only : names of PARTS
        Parts to run; one that the small selection lacks is run in full.

    Raises
    ------
    InputError
        For parts that do not exist, a folder that cannot be written to, an invalid model, or no OpenGL driver.
    """
    run_plan(of_parts(QUICK if quick else FULL, only), output, model)


def of_parts(plan: Plan, only: Collection[str]) -> Plan:
    """Return a plan of some parts alone; see `run`."""
    unknown = [name for name in only if name not in PARTS]
    if unknown or not only:
        raise InputError(f"--only {','.join(unknown)}: choose parts of the benchmark from {', '.join(PARTS)}")
    if set(only) == set(PARTS):
        return plan
    fields: dict[str, Any] = {}
    for name, of_part in PARTS.items():
        is_empty = not any(getattr(plan, field) for field in of_part)
        for field in of_part:
            full = getattr(FULL, field)
            fields[field] = type(full)() if name not in only else full if is_empty else getattr(plan, field)
    return replace(plan, **fields)


@one_blas_thread()
def run_plan(plan: Plan, output: Path | None, model: Path | None = None) -> None:
    """Run the benchmark of a plan; see `run`."""
    report = bench_report.BenchReport(output)
    scene = Scene(model=ModelSettings(path=model), display=DisplaySettings(image_size=plan.image_size))
    models = _models(model, scene)
    _speed(plan, scene, report)
    _yardsticks(plan, scene, models, report)
    _exchange(plan, scene, report)
    _errors(plan, models, report)
    if plan.occluded_points:
        bench_occlusion.report_occlusion(report, scene, plan.occluded_points)
    _photons(plan, models, report)
    report.finish()


def _models(model: Path | None, scene: Scene) -> dict[str, Callable[[], Mesh]]:
    """Return the given model, in the size of the scene, by its name; empty without one."""
    if model is None:
        return {}
    mesh, _ = load_model(model, scene.model.size_mm, scene.model.up)
    return {f"{model.stem}, {scene.model.size_mm:g} mm": lambda: mesh}


def _yardsticks(
    plan: Plan, scene: Scene, models: dict[str, Callable[[], Mesh]], report: bench_report.BenchReport
) -> None:
    size = scene.model.length_mm
    scene_models = models or {f"sculpture, {size:g} mm": lambda: builtin_model(size)}

    def selected(names: tuple[str, ...]) -> dict[str, Callable[[], Mesh]]:
        available = SHAPES | bench_transport.SHAPES
        return {name: available[name] for name in names if name in available} | (
            scene_models if "scene" in names else {}
        )

    if plan.yardsticks:
        shapes = selected(plan.yardsticks)
        rows = bench_yardsticks.yardstick_rows(shapes, DEFAULT, plan.yardstick_repeats)
        bench_yardsticks.report_yardsticks(report, _collected(rows, len(shapes), "beside bare transforms"))
    if plan.solved:
        shapes = selected(plan.solved)
        solving = bench_solving.solving_rows(shapes, plan.solved_repeats)
        count = len(shapes) * len(bench_solving.NODES)
        bench_solving.report_solving(report, _collected(solving, count, "solutions of diffusion"))


def _exchange(plan: Plan, scene: Scene, report: bench_report.BenchReport) -> None:
    if plan.exchange_repeats:
        rays = _collected(bench_exchange.rays_rows(scene), bench_exchange.N_RAYS, "rays between parts")
        bench_exchange.report_rays(report, rays)
        changes = bench_exchange.change_rows(scene, plan.exchange_repeats)
        bench_exchange.report_changes(report, _collected(changes, bench_exchange.N_CHANGES, "light between parts"))
    if plan.exchange_processes:
        with tempfile.TemporaryDirectory() as folder:
            name = _object_name(scene)
            processes = bench_exchange.process_rows(scene, name, Path(folder), plan.exchange_processes)
            bench_exchange.report_memory(report, _collected(processes, bench_exchange.N_PROCESSES, "memory"))


def _object_name(scene: Scene) -> str:
    return scene.model.path.name if scene.model.path else "built-in sculpture"


def _speed(plan: Plan, scene: Scene, report: bench_report.BenchReport) -> None:
    if plan.convolutions:
        threads = os.cpu_count() or 1
        found = bench_speed.convolution_rows(plan.convolutions, plan.side, threads, plan.repeats)
        count = len(plan.convolutions) * len(bench_speed.EFFORTS)
        bench_report.report_convolution(report, _collected(found, count, "layer convolution"))
    model_name = _object_name(scene)
    size = "{} x {}".format(*plan.image_size)
    frames: list[bench_speed.FrameRow] = []
    for scheme in plan.frames:
        rows = bench_speed.frame_rows(
            _with_scheme(scene, scheme), f"{model_name}, {size}, {scheme}", plan.frame_repeats
        )
        frames += _collected(rows, len(bench_speed.CHANGES), f"frames, {scheme}")
    photographs = bench_photo.photo_rows(plan.photographs, plan.frame_repeats)
    edits = _collected(photographs, len(plan.photographs), "edited photographs")
    if frames:
        mesh, _ = Assets().mesh(scene.model)
        turned = bench_occlusion.occlusion_rows(mesh, plan.repeats)
        frames += _collected(turned, bench_occlusion.N_ROWS, "occluded environment")
    if frames or edits:
        bench_report.report_frames(report, [*frames, *edits])
    if plan.processes:
        with tempfile.TemporaryDirectory() as folder:
            processes = (
                bench_speed.process_row(
                    _with_scheme(scene, s), f"{model_name}, {size}, {s}", Path(folder), plan.process_repeats
                )
                for s in plan.processes
            )
            bench_report.report_processes(report, _collected(processes, len(plan.processes), "first picture"))
    if plan.window_repeats:
        window = bench_window.window_rows(scene, plan.window_repeats)
        in_window = _collected(window, bench_window.n_rows(), "window")
        bench_window.report_window(report, f"{model_name}, {size}", in_window)
    if plan.sight_repeats:
        with tempfile.TemporaryDirectory() as folder:
            sight = bench_sight.sight_rows(scene, Path(folder), plan.sight_repeats)
            bench_sight.report_sight(report, _collected(sight, bench_sight.N_ROWS, "clear and murky matter"))
    if plan.swept:
        turns, draws = plan.swept
        with tempfile.TemporaryDirectory() as folder:
            swept = bench_sweep.sweep_rows(scene, turns, draws, plan.sweep_commands, Path(folder))
            many = _collected(swept, bench_sweep.N_ROWS, "many pictures")
        bench_sweep.report_sweep(report, many, plan.sweep_commands)


def _errors(plan: Plan, models: dict[str, Callable[[], Mesh]], report: bench_report.BenchReport) -> None:
    if plan.schemes:
        shapes = {name: SHAPES[name] for name in plan.shapes} | models
        sets = plan.schemes, shapes, plan.materials, plan.lights
        count = len(plan.schemes) * len(shapes) * len(plan.materials) * len(plan.lights)
        errors = _collected(bench_error.error_rows(*sets, plan.points), count, "error of the transport")
        bench_error_report.report_errors(report, errors)
    if plan.rivals:
        rivals = bench_rivals.rival_rows(plan.rivals, DEFAULT, plan.points)
        count = len(plan.rivals) * (len(bench_rivals.TOLERANCES) + 2)
        bench_rivals.report_rivals(report, _collected(rivals, count, "sums over samples"))
    if plan.pictures:
        pictures = bench_chain.chain_rows(plan.picture_schemes, plan.pictures, plan.points)
        count = len(plan.picture_schemes) * len(plan.pictures)
        bench_report.report_chain(report, _collected(pictures, count, "error of the renderer"))


def _photons(plan: Plan, models: dict[str, Callable[[], Mesh]], report: bench_report.BenchReport) -> None:
    if plan.methods:
        closed = {name: make for name, make in models.items() if is_closed(row_sums(make()))}
        for name in models.keys() - closed:
            report.say(f"{name} is not closed, so no photons walk in it.")
        solids = {name: bench_transport.SHAPES[name] for name in plan.solids} | closed
        rows = bench_transport.transport_rows(plan.methods, solids, plan.media, plan.photons)
        count = len(plan.methods) * len(solids) * len(plan.media) * len(bench_transport.LIGHTS)
        bench_transport_report.report_transport(report, _collected(rows, count, "error against transport"))


def _with_scheme(scene: Scene, scheme: Scheme) -> Scene:
    return replace(scene, transport=scheme.settings)


def _collected(rows: Iterable[T], count: int, description: str) -> list[T]:
    """Return the rows of an iterator, with a progress bar on a terminal."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        return list(progress.track(rows, total=count, description=description))
