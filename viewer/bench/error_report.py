"""Report of the error sweep: tables by shape and light, reliability of predictions, a CSV file and the plot."""

from collections.abc import Callable, Sequence

import numpy as np

from milkglass.core.reference.deviation import Deviation
from milkglass.core.stages import AnyStage, Stage
from milkglass.viewer.bench.error import ErrorRow
from milkglass.viewer.bench.plot import error_plot
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.schemes import PAPER, Scheme

LIGHT_STAGES = (Stage.DEPOSIT, Stage.CONVOLUTION)  # stages of transport that run when a light changes

Reduction = Callable[[list[float]], float]


def report_errors(report: BenchReport, rows: Sequence[ErrorRow]) -> None:
    """Report the error of each scheme by shape and light, over materials, and times relative to the paper's setting."""
    lights, shapes = (list(dict.fromkeys(values)) for values in zip(*((r.light, r.shape) for r in rows), strict=True))
    times = scheme_times(rows)
    paper = times.get(PAPER, next(iter(times.values())))

    def line(scheme: Scheme, value: Callable[[Deviation], float], reduce: Reduction) -> list[str]:
        rows_of_scheme = [r for r in rows if r.scheme == scheme]

        def cell(shape: str, light: str) -> str:
            return _two_digits(
                100.0 * reduce([value(r.deviation) for r in rows_of_scheme if (r.shape, r.light) == (shape, light)])
            )

        ratios = (f"{ms / base:.2f}" for ms, base in zip(times[scheme], paper, strict=True))
        memory = f"{max(r.megabytes for r in rows_of_scheme):.0f}"
        return [str(scheme), *(" / ".join(cell(shape, light) for light in lights) for shape in shapes), *ratios, memory]

    measures: list[tuple[str, Callable[[Deviation], float], Reduction]] = [
        ("rms, % of the rms exitance, worst channel of the worst material", lambda d: max(d.rms), max),
        ("rms, %, worst channel of the median material", lambda d: max(d.rms), lambda v: float(np.median(v))),
        ("99th percentile, % of the rms exitance, worst channel and material", lambda d: max(d.p99), max),
    ]
    headings = [*shapes, "time, new light", "time, all anew", "MB"]
    for title, value, reduce in measures:
        lines = [line(scheme, value, reduce) for scheme in times]
        report.table(
            f"Error against equation (1): {title}; light: {' / '.join(lights)}", ["transport", *headings], lines
        )
    report.say(f"Time 1 is {paper[0]:.1f} ms for new light, {paper[1]:.1f} ms for all of transport anew.")
    report_predictions(report, rows)
    stages = list(dict.fromkeys(stage for r in rows for stage in r.timings))
    report.csv("error.csv", [csv_row(r, stages) for r in rows])
    report.plot("error.png", lambda: error_plot(rows, {scheme: light for scheme, (light, _) in times.items()}))


def report_predictions(report: BenchReport, rows: Sequence[ErrorRow]) -> None:
    """Report how often the error was below `Quality.predicted_error`, and the largest ratio of the two."""
    lines = []
    for scheme in dict.fromkeys(r.scheme for r in rows):
        pairs = [(r, r.quality.predicted_error) for r in rows if r.scheme == scheme]
        shares = [(row.rms / predicted, row, predicted) for row, predicted in pairs if predicted]
        if not shares:
            continue
        largest, worst, predicted = max(shares, key=lambda share: share[0])
        n_within = sum(share <= 1.0 for share, _, _ in shares)
        excess = f"{worst.shape}, {worst.material}, {worst.light}: {100 * worst.rms:.2g} % for {100 * predicted:.2g} %"
        lines.append(
            [
                str(scheme),
                f"{n_within} of {len(shares)}, {100.0 * n_within / len(shares):.0f} %",
                f"{np.median([share for share, _, _ in shares]):.2f}",
                f"{largest:.2f}" + (f" ({excess})" if largest > 1.0 else ""),
            ]
        )
    if lines:
        headings = ["transport", "runs within the prediction", "error / prediction, median", "largest"]
        report.table("Predicted error against measured rms, worst channel", headings, lines)


def csv_row(row: ErrorRow, stages: Sequence[AnyStage]) -> dict[str, object]:
    """Return the columns of a run in error.csv."""
    quality = row.quality
    return {
        "transport": quality.method,
        "scheme": str(row.scheme),
        "layers": row.n_layers,
        "resolution": quality.resolution,
        "assignment": quality.assignment,
        "error_target": row.scheme.error_target or "",
        "shape": row.shape,
        "material": row.material,
        "light": row.light,
        "rms": row.rms,
        "p99": max(row.deviation.p99),
        "predicted_error": "" if quality.predicted_error is None else quality.predicted_error,
        **row.deviation.columns(),
        **{f"{stage}_ms": row.timings.get(stage, 0.0) for stage in stages},
        "memory_mb": row.megabytes,
    }


def scheme_times(rows: Sequence[ErrorRow]) -> dict[Scheme, tuple[float, float]]:
    """Return scheme -> ms of transport for new light, and for all of its stages: medians over the runs."""
    times = {}
    for scheme in dict.fromkeys(r.scheme for r in rows):
        runs = [r.timings for r in rows if r.scheme == scheme]
        stages = dict.fromkeys(stage for timings in runs for stage in timings)
        median = {stage: float(np.median([t[stage] for t in runs if stage in t])) for stage in stages}
        times[scheme] = sum(median.get(stage, 0.0) for stage in LIGHT_STAGES), sum(median.values())
    return times


def _two_digits(value: float) -> str:
    """Return a value rounded to two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
