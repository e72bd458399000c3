"""Speed of `diffusion`: how long another material, a step of its slider and another light take to be solved.

The transport alone, from flux at the samples to the fluence of every patch, until the first solution that the window
shows and until the last.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.material import fresnel
from milkglass.core.material import library as materials
from milkglass.core.material.medium import Medium, media
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.choice import DIFFUSION_NODES
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Solution
from milkglass.viewer.bench.report import Report
from milkglass.viewer.live.job import PRESENTABLE

SAMPLES = 20_000  # least of them; there are up to four times as many, for triangles are halved to an edge
NODES = (40, DIFFUSION_NODES)
MATERIALS = "marble", "skim milk"
STEP = 1.02  # of all coefficients: a slider's
LIGHTS = (0.3, -0.5, -0.8), (-0.7, -0.2, 0.5)
CHANGES = "another material", "a step of a slider", "another light"


@dataclass(frozen=True)
class SolvingRow:
    """Medians for one object.

    Attributes
    ----------
    shape : str
    nodes, patches, samples : int
    times : dict
        What changed -> (ms to the first solution that is shown, ms to the last, products of the slowest channel).
    """

    shape: str
    nodes: int
    patches: int
    samples: int
    times: dict[str, tuple[float, float, int]]


def solving_rows(shapes: dict[str, Callable[[], Mesh]], repeats: int) -> Iterator[SolvingRow]:
    """Time every shape with each of NODES; nothing that has been solved before comes again."""
    for shape, make in shapes.items():
        mesh = make()
        samples = surface_samples(mesh, 1.2 * float(np.sqrt(mesh.area / SAMPLES)))
        for nodes in NODES:
            yield _row(shape, mesh, samples, nodes, repeats)


def report_solving(report: Report, rows: Sequence[SolvingRow]) -> None:
    """Show times, and write them to `solving.csv`."""
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

    def solve(light: EnteringLight, of: Sequence[Medium]) -> tuple[float, float, int]:
        shown: list[float] = []
        start = time.perf_counter()

        def go_on(solution: Solution) -> bool:
            if not shown and max(solution.residuals) <= PRESENTABLE:
                _ = solution.volume
                shown.append(time.perf_counter())
            return True

        solution = transport.solve(mesh, samples, grid, [light], of, stages, go_on)
        end = time.perf_counter()
        return 1e3 * ((shown or [end])[0] - start), 1e3 * (end - start), max(solution.convolutions)

    eta = materials.lookup(MATERIALS[0]).eta
    lights = [_light(samples, way, eta) for way in LIGHTS]
    both = [media(materials.lookup(name)) for name in MATERIALS]
    solve(lights[0], both[0])
    found: dict[str, list[tuple[float, float, int]]] = {change: [] for change in CHANGES}
    for i in range(1, repeats + 1):
        # From one material to the other and back, a little further each time: the kernels are new ones.
        there, back = (_scaled(each, STEP ** (2 * i)) for each in (both[1], both[0]))
        found[CHANGES[0]].append(solve(lights[0], there))
        solve(lights[0], back)
        found[CHANGES[1]].append(solve(lights[0], _scaled(back, STEP)))
        found[CHANGES[2]].append(solve(lights[1], _scaled(back, STEP)))
        solve(lights[0], back)
    times = {}
    for change, each in found.items():
        first, last, products = np.median(np.array(each), axis=0)
        times[change] = float(first), float(last), int(products)
    return SolvingRow(shape, nodes, len(stages.kept(Stage.BOUNDARY)[1].patches), len(samples), times)  # type: ignore[index]


def _scaled(of: Sequence[Medium], factor: float) -> list[Medium]:
    return [Medium(factor * each.sigma_s_prime, factor * each.sigma_a, each.eta) for each in of]


def _light(samples: SurfaceSamples, way: tuple[float, float, float], eta: float) -> EnteringLight:
    """Directional light of unit irradiance, without shadows."""
    direction = np.array(way) / np.linalg.norm(way)
    cosine = np.maximum(-samples.normals.astype(np.float64) @ direction, 0.0)
    flux = cosine * fresnel.transmittance(eta, cosine) * samples.areas
    return EnteringLight(np.repeat(flux[:, None], 3, axis=1).astype(np.float32), direction=tuple(direction))
