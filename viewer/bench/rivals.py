"""Sums over surface samples compared with the default transport: time at the same error.

The direct sum and Jensen and Buhler's hierarchical sum (`core.reference.hierarchical`) are over the same samples, on
all cores. They give exitance at single points; a picture needs it at least at the vertices of the mesh, while the
volume of the transport gives it everywhere. Times are those of a new light: the tree is rebuilt, kernels are cached.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.hierarchical import build_tree, tree_exitance
from milkglass.core.stages import Stage
from milkglass.viewer.bench.error import SchemeRun, Target
from milkglass.viewer.bench.lights import LIGHTS
from milkglass.viewer.bench.reference import parallel_exitance
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.shapes import SHAPES

T = TypeVar("T")

TOLERANCES = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
SAMPLE_EDGE = 0.15  # mm; longest edge of a sample's piece: under half the mean free path of the measured materials
STAGES = (Stage.DEPOSIT, Stage.CONVOLUTION)  # of the transport, for a new light


@dataclass(frozen=True)
class RivalRow:
    """Error and times of one method, ms.

    Attributes
    ----------
    fixed : float
        Time that does not depend on the number of points.
    per_point : float
        Time for each point.
    vertices : int
        Number of vertices of the mesh.
    """

    method: str
    deviation: Deviation
    fixed: float
    per_point: float
    vertices: int

    @property
    def at_vertices(self) -> float:
        """Time for exitance at every vertex of the mesh."""
        return self.fixed + self.per_point * self.vertices


def rival_rows(cases: Sequence[tuple[str, str, str]], scheme: Scheme, n_points: int) -> Iterator[tuple[str, RivalRow]]:
    """Yield the name of each case (shape, material, light) with a row for every method."""
    for case in cases:
        yield from ((", ".join(case), row) for row in _rows(*case, scheme, n_points))


def _rows(shape: str, name: str, light_name: str, scheme: Scheme, n_points: int) -> Iterator[RivalRow]:
    target, material, light = Target.of(SHAPES[shape](), n_points), materials.lookup(name), LIGHTS[light_name]
    sources = surface_samples(target.mesh, SAMPLE_EDGE)
    points, profiles = target.points.points, dipoles(material)
    vertices = len(target.mesh.vertices)
    flux = light.irradiance(target.occluder, sources, material.eta) * sources.areas[:, None]
    reference, elapsed = _timed(lambda: parallel_exitance(points, sources.points, flux, profiles))
    yield RivalRow("direct sum", Deviation.of(reference, reference), 0.0, elapsed / n_points, vertices)
    tree, built = _timed(lambda: build_tree(sources.points, flux, sources.areas))

    def summed(tolerance: float) -> Array:
        return _in_parallel(points, lambda share: tree_exitance(share, tree, profiles, tolerance))

    for tolerance in TOLERANCES:
        exitance, elapsed = _timed(partial(summed, tolerance))
        yield RivalRow(
            f"hierarchical, {tolerance:g} sr", Deviation.of(exitance, reference), built, elapsed / n_points, vertices
        )
    run = SchemeRun(scheme, target)
    run.exitance(LIGHTS["front" if light_name == "back" else "back"], material)  # kernels and plans are cached
    deviation = Deviation.of(run.exitance(light, material), reference)
    new_light = sum(run.stages.timings.get(stage, 0.0) for stage in STAGES)
    yield RivalRow(str(scheme), deviation, new_light, 0.0, vertices)


def report_rivals(report: BenchReport, rows: Sequence[tuple[str, RivalRow]]) -> None:
    """Report a table a case, the transport last, and its speed relative to the hierarchical sum of the same error."""
    for case in dict.fromkeys(case for case, _ in rows):
        rows_of_case = [row for name, row in rows if name == case]
        transport_row = rows_of_case[-1]
        report.table(
            f"Exitance of a new light by sums over samples, {case}",
            ["method", "rms, %, worst channel", "ms, 1000 points", "ms, every vertex", "over the transport"],
            (
                [
                    row.method,
                    f"{100.0 * max(row.deviation.rms):.2g}",
                    f"{row.fixed + 1e3 * row.per_point:.0f}",
                    f"{row.at_vertices:.0f}",
                    f"{row.at_vertices / transport_row.at_vertices:.3g}",
                ]
                for row in rows_of_case
            ),
        )
        equally_accurate = fastest_at(rows_of_case, max(transport_row.deviation.rms))
        if equally_accurate is not None:
            factor = equally_accurate.at_vertices / transport_row.at_vertices
            report.say(
                f"For {transport_row.vertices:,} vertices, {transport_row.method} is {factor:.0f} times as fast as the "
                f"hierarchical sum at the same error ({equally_accurate.method})."
            )
    report.csv("rivals.csv", [_csv(case, row) for case, row in rows])


def fastest_at(rows: Sequence[RivalRow], rms: float) -> RivalRow | None:
    """Return the fastest hierarchical sum whose rms error of the worst channel is at most `rms`, or None."""
    accurate = [r for r in rows if r.method.startswith("hierarchical") and max(r.deviation.rms) <= rms]
    return min(accurate, key=lambda row: row.at_vertices, default=None)


def _csv(case: str, row: RivalRow) -> dict[str, object]:
    errors = {f"rms_{c}": value for c, value in zip("rgb", row.deviation.rms, strict=True)}
    times = {"fixed_ms": row.fixed, "per_point_ms": row.per_point, "every_vertex_ms": row.at_vertices}
    return {"case": case, "method": row.method, "vertices": row.vertices, **errors, **times}


def _timed(task: Callable[[], T]) -> tuple[T, float]:
    start = time.perf_counter()
    result = task()
    return result, 1e3 * (time.perf_counter() - start)


def _in_parallel(points: npt.NDArray[np.float32], task: Callable[[npt.NDArray[np.float32]], Array]) -> Array:
    """Return the results of a task on points distributed over all cores."""
    threads = os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        return np.concatenate(list(pool.map(task, np.array_split(points, threads))))
