"""Speed of `diffusion`: time to the solution for another material, a step of its slider, and another light.

Transport alone, from flux at the samples to the fluence of every patch, until the first solution that the window shows
and until the last.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.material import fresnel, library as materials
from milkglass.core.material.medium import Medium, media
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.choice import DIFFUSION_NODES
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem, Solution
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.live.job import PRESENTABLE

MIN_SAMPLES = 20_000  # there are up to four times as many, since triangles are halved to an edge
NODES = (40, DIFFUSION_NODES)
MATERIALS = "marble", "skim milk"
SLIDER_STEP = 1.02  # factor on all coefficients by a step of a slider
LIGHTS = (0.3, -0.5, -0.8), (-0.7, -0.2, 0.5)
CHANGES = "another material", "a step of a slider", "another light"


@dataclass(frozen=True)
class SolvingRow:
    """Median times of one object.

    Attributes
    ----------
    shape : str
    nodes, patches, samples : int
        Number of nodes along the object, of patches and of samples.
    times : dict
        Change -> (ms to the first solution that is shown, ms to the last, matvecs of the slowest channel).
    """

    shape: str
    nodes: int
    patches: int
    samples: int
    times: dict[str, tuple[float, float, int]]


def solving_rows(shapes: dict[str, Callable[[], Mesh]], repeats: int) -> Iterator[SolvingRow]:
    """Yield times of every shape with each of NODES, where no case repeats a solved one."""
    for shape, make in shapes.items():
        mesh = make()
        samples = surface_samples(mesh, 1.2 * float(np.sqrt(mesh.area / MIN_SAMPLES)))
        for nodes in NODES:
            yield _row(shape, mesh, samples, nodes, repeats)


def report_solving(report: BenchReport, rows: Sequence[SolvingRow]) -> None:
    """Report times, and write them to `solving.csv`."""
    report.table(
        "`diffusion` until the first picture / until it is solved, ms",
        ["object, nodes, patches, samples", *CHANGES],
        (
            [
                f"{row.shape}, {row.nodes}, {row.patches:,}, {row.samples:,}",
                *(f"{first:.0f} / {last:.0f}" for first, last, _ in row.times.values()),
            ]
            for row in rows
        ),
    )
    report.csv(
        "solving.csv",
        [
            {"shape": row.shape, "nodes": row.nodes, "patches": row.patches, "samples": row.samples, "changed": changed}
            | {"first_ms": first, "solved_ms": last, "products": products}
            for row in rows
            for changed, (first, last, products) in row.times.items()
        ],
    )


def _row(shape: str, mesh: Mesh, samples: SurfaceSamples, nodes: int, repeats: int) -> SolvingRow:
    transport, stages = DiffusionTransport(resolution=nodes), Stages()
    grid = transport.grid(mesh, np.eye(3))

    def solve(light: EnteringLight, channels: Sequence[Medium]) -> tuple[float, float, int]:
        shown_at: list[float] = []
        start = time.perf_counter()

        def keep_solving(solution: Solution) -> bool:
            if not shown_at and max(solution.residuals) <= PRESENTABLE:
                _ = solution.volume
                shown_at.append(time.perf_counter())
            return True

        solution = transport.solve(Problem(mesh, samples, grid, [light], channels), stages, keep_solving)
        end = time.perf_counter()
        return 1e3 * ((shown_at or [end])[0] - start), 1e3 * (end - start), max(solution.convolutions)

    eta = materials.lookup(MATERIALS[0]).eta
    lights = [_light(samples, towards, eta) for towards in LIGHTS]
    media_pair = [media(materials.lookup(name)) for name in MATERIALS]
    solve(lights[0], media_pair[0])
    results: dict[str, list[tuple[float, float, int]]] = {change: [] for change in CHANGES}
    for i in range(1, repeats + 1):
        # From one material to the other and back, with other coefficients each time, so that no kernel is cached.
        changed_media, initial_media = (
            _scaled(channels, SLIDER_STEP ** (2 * i)) for channels in (media_pair[1], media_pair[0])
        )
        results[CHANGES[0]].append(solve(lights[0], changed_media))
        solve(lights[0], initial_media)
        results[CHANGES[1]].append(solve(lights[0], _scaled(initial_media, SLIDER_STEP)))
        results[CHANGES[2]].append(solve(lights[1], _scaled(initial_media, SLIDER_STEP)))
        solve(lights[0], initial_media)
    times = {}
    for change, measured in results.items():
        first, last, products = np.median(np.array(measured), axis=0)
        times[change] = float(first), float(last), int(products)
    return SolvingRow(shape, nodes, len(stages.kept(Stage.BOUNDARY)[1].patches), len(samples), times)  # type: ignore[index]


def _scaled(channels: Sequence[Medium], factor: float) -> list[Medium]:
    return [Medium(factor * medium.sigma_s_prime, factor * medium.sigma_a, medium.eta) for medium in channels]


def _light(samples: SurfaceSamples, towards: tuple[float, float, float], eta: float) -> EnteringLight:
    """Return a directional light of unit irradiance, without shadows."""
    direction = np.array(towards) / np.linalg.norm(towards)
    cosine = np.maximum(-samples.normals.astype(np.float64) @ direction, 0.0)
    flux = cosine * fresnel.transmittance(eta, cosine) * samples.areas
    return EnteringLight(np.repeat(flux[:, None], 3, axis=1).astype(np.float32), direction=tuple(direction))
