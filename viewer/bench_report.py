"""What the benchmark found, as tables on the terminal, Markdown, CSV files and a plot."""

import csv
import io
import os
import secrets
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from core.errors import InputError
from viewer.bench_chain import ChainRow
from viewer.bench_error import PAPER, ErrorRow, Scheme
from viewer.bench_speed import ConvolutionRow, FrameRow, ProcessRow, Timing
from viewer.deviation import Deviation

TARGETS = {4: 2.0, 8: 3.0}  # layers -> wanted ratio to the bare transforms
LIGHT_STAGES = ("deposit", "convolution")  # what transport does anew when a light changes
UNLIMITED = 10_000  # columns in a pipe, where no line may break
NO_PLOT = 'The plot needs matplotlib: pip install "milkglass[bench]".'


class Report:
    """Collects tables as they are ready.

    Parameters
    ----------
    folder : Path, optional
        Where `save` puts files; made if it is not there.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._markdown: list[str] = []
        self._console = Console()
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"--output {folder}: cannot make the folder ({error.strerror})") from error
            self._write(folder / "bench.md", b"")  # refused now rather than after minutes

    def table(self, title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Show a table and keep it for the Markdown file; the first column is text, the others numbers."""
        table = Table(box=box.MARKDOWN)
        for i, heading in enumerate(headings):
            table.add_column(heading, justify="right" if i else "left")
        for row in rows:
            table.add_row(*row)
        plain = Console(file=io.StringIO(), width=UNLIMITED)
        with plain.capture() as captured:
            plain.print(table)
        text = "\n".join(line.strip() for line in captured.get().splitlines() if line.strip())
        self._markdown.append(f"### {title}\n\n{text}\n")
        if self._console.is_terminal:
            table.box = box.SIMPLE_HEAD
            self._console.print(f"\n[bold]{title}[/bold]", table, sep="\n")
        else:
            self.say(f"\n{title}\n\n{text}")

    def say(self, text: str) -> None:
        """Print a line."""
        self._console.out(text, highlight=False)

    def csv(self, name: str, rows: Sequence[dict[str, object]]) -> None:
        """Write a file of rows with the same keys."""
        if self._folder is not None and rows:
            text = io.StringIO(newline="")
            writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
            self._write(self._folder / name, text.getvalue().encode())

    def plot(self, name: str, rows: Sequence[ErrorRow]) -> None:
        """Draw error against time, or say what that needs."""
        if self._folder is None:
            return
        try:
            picture = error_plot(rows)
        except ImportError:
            self.say(NO_PLOT)
        else:
            self._write(self._folder / name, picture)

    def finish(self) -> None:
        """Write the tables as Markdown."""
        if self._folder is not None:
            self._write(self._folder / "bench.md", "\n".join(self._markdown).encode())

    def _write(self, path: Path, content: bytes) -> None:
        """Write a whole file or none."""
        temporary = path.with_name(f".{secrets.token_hex(8)}{path.suffix}")
        try:
            temporary.write_bytes(content)
            os.replace(temporary, path)
        except OSError as error:
            raise InputError(f"{path} cannot be written ({error.strerror})") from error
        finally:
            temporary.unlink(missing_ok=True)


def report_convolution(report: Report, rows: Sequence[ConvolutionRow]) -> None:
    """Layer convolution beside the bare transforms of the same padded maps."""
    report.table(
        "Layer convolution of three channels, ms (minimum / median)",
        ["layers", "planner", "threads", "convolution", "bare transforms", "ratio", "wanted"],
        (
            [
                f"{r.layers} x {r.side}",
                r.effort.removeprefix("FFTW_"),
                str(r.threads),
                _pair(r.convolution),
                _pair(r.bare),
                f"{r.ratio:.2f}",
                f"{TARGETS[r.layers]:g}" if r.layers in TARGETS else "",
            ]
            for r in rows
        ),
    )
    report.csv(
        "convolution.csv",
        [
            {"layers": r.layers, "side": r.side, "threads": r.threads, "effort": r.effort, "ratio": r.ratio}
            | _csv_timing("convolution", r.convolution)
            | _csv_timing("bare", r.bare)
            for r in rows
        ],
    )


def report_frames(report: Report, rows: Sequence[FrameRow]) -> None:
    """One table a setting: stages down, changes across."""
    for setting in dict.fromkeys(r.setting for r in rows):
        frames = [r for r in rows if r.setting == setting]
        longest = max(frames, key=lambda r: len(r.stages))
        stages = dict.fromkeys([*longest.stages, *(s for r in frames for s in r.stages)])
        body = [[stage, *(f"{r.stages[stage]:.1f}" if stage in r.stages else "" for r in frames)] for stage in stages]
        totals = ["frame, minimum / median", *(_pair(r.total) for r in frames)]
        report.table(f"Frame after a change, {setting}, ms", ["stage", *(r.change for r in frames)], [*body, totals])
    report.csv(
        "frames.csv",
        [
            {"setting": r.setting, "change": r.change, "stage": stage, "ms": ms}
            for r in rows
            for stage, ms in {**r.stages, "frame": r.total.median, "frame, minimum": r.total.least}.items()
        ],
    )


def report_processes(report: Report, rows: Sequence[ProcessRow]) -> None:
    """First picture from the start of the process."""
    report.table(
        "milkglass render, from the start of the process to the file",
        ["setting", "seconds, minimum / median", "peak memory, MB"],
        ([r.setting, f"{r.time.least / 1e3:.1f} / {r.time.median / 1e3:.1f}", f"{r.megabytes:.0f}"] for r in rows),
    )
    report.csv(
        "processes.csv", [{"setting": r.setting, "peak_mb": r.megabytes} | _csv_timing("run", r.time) for r in rows]
    )


def report_errors(report: Report, rows: Sequence[ErrorRow]) -> None:
    """Error of each scheme by shape and light, over materials; times as ratios to the paper's setting."""
    lights, shapes = (list(dict.fromkeys(values)) for values in zip(*((r.light, r.shape) for r in rows), strict=True))
    times = scheme_times(rows)
    paper = times.get(PAPER, next(iter(times.values())))

    def line(scheme: Scheme, value: Callable[[Deviation], float], over: Callable[[list[float]], float]) -> list[str]:
        def cell(shape: str, light: str) -> str:
            found = [r for r in rows if (r.scheme, r.shape, r.light) == (scheme, shape, light)]
            return f"{100.0 * over([value(r.deviation) for r in found]):.3g}"

        ratios = (f"{ms / base:.2f}" for ms, base in zip(times[scheme], paper, strict=True))
        return [str(scheme), *("/".join(cell(shape, light) for light in lights) for shape in shapes), *ratios]

    measures: list[tuple[str, Callable[[Deviation], float], Callable[[list[float]], float]]] = [
        ("rms, % of the rms exitance, worst channel of the worst material", lambda d: max(d.rms), max),
        ("rms, %, worst channel of the median material", lambda d: max(d.rms), lambda v: float(np.median(v))),
        ("99th percentile, % of the rms exitance, worst channel and material", lambda d: max(d.p99), max),
    ]
    headings = [*(f"{shape} {'/'.join(lights)}" for shape in shapes), "time, new light", "time, all anew"]
    for title, value, over in measures:
        lines = [line(scheme, value, over) for scheme in times]
        report.table(f"Error against equation (1): {title}", ["transport", *headings], lines)
    report.say(f"Time 1 is {paper[0]:.1f} ms for new light, {paper[1]:.1f} ms for all of transport anew.")
    stages = list(dict.fromkeys(stage for r in rows for stage in r.timings))
    report.csv("error.csv", [_csv_scheme(r) | {f"{s}_ms": r.timings.get(s, 0.0) for s in stages} for r in rows])
    report.plot("error.png", rows)


def report_chain(report: Report, rows: Sequence[ChainRow]) -> None:
    """Error of whole pictures."""
    report.table(
        "Error of the whole renderer, % of the rms exitance",
        ["picture", "transport", "rms r/g/b", "99th percentile r/g/b", "mean M / mean reference r/g/b"],
        (
            [
                f"{r.shape}, {r.material}, {r.light}",
                str(r.scheme),
                _channels(r.deviation.rms),
                _channels(r.deviation.p99),
                "/".join(f"{v:.3f}" for v in r.deviation.ratio),
            ]
            for r in rows
        ),
    )
    report.csv("chain.csv", [_csv_scheme(r) for r in rows])


def scheme_times(rows: Sequence[ErrorRow]) -> dict[Scheme, tuple[float, float]]:
    """Scheme -> transport's ms for new light, and for all of its steps: medians over the runs."""
    times = {}
    for scheme in dict.fromkeys(r.scheme for r in rows):
        runs = [r.timings for r in rows if r.scheme == scheme]
        stages = dict.fromkeys(stage for timings in runs for stage in timings)
        median = {stage: float(np.median([t[stage] for t in runs if stage in t])) for stage in stages}
        times[scheme] = sum(median.get(stage, 0.0) for stage in LIGHT_STAGES), sum(median.values())
    return times


def error_plot(rows: Sequence[ErrorRow]) -> bytes:
    """Error against the time of new light, both logarithmic, one panel a light: PNG.

    Raises
    ------
    ImportError
        Without matplotlib.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    times = {scheme: new_light for scheme, (new_light, _) in scheme_times(rows).items()}
    base = times.get(PAPER, next(iter(times.values())))
    lights = list(dict.fromkeys(r.light for r in rows))
    figure = Figure(figsize=(3.6 * len(lights), 3.8), layout="constrained")
    panels = figure.subplots(1, len(lights), sharey=True, squeeze=False)[0]
    for axes, light in zip(panels, lights, strict=True):
        for i, method in enumerate(dict.fromkeys(scheme.method for scheme in times)):
            schemes = [scheme for scheme in times if scheme.method == method]
            x = [times[scheme] / base for scheme in schemes]
            found = [[100.0 * max(r.deviation.rms) for r in rows if (r.scheme, r.light) == (s, light)] for s in schemes]
            middle = np.array([np.median(values) for values in found])
            low, high = (np.array([end(values) for values in found]) for end in (min, max))
            axes.errorbar(x, middle, (middle - low, high - middle), fmt="o", color=f"C{i}", capsize=3, label=method)
            for scheme, place in zip(schemes, zip(x, middle, strict=True), strict=True):
                name = str(scheme).removeprefix(f"{method} ")
                axes.annotate(name, place, xytext=(5, 5), textcoords="offset points", fontsize=8)
        axes.set(xscale="log", yscale="log", title=light, xlabel="time of new light / the paper's 4 x 256")
        axes.grid(visible=True, which="both", alpha=0.25)
        axes.margins(x=0.15)  # room for the names
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_locator(NullLocator())
    panels[0].set_ylabel("rms error of the worst channel, %\n(median and range over shapes and materials)")
    panels[0].legend()
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()


def _pair(timing: Timing) -> str:
    return f"{timing.least:.1f} / {timing.median:.1f}"


def _channels(values: Sequence[float]) -> str:
    return "/".join(f"{100.0 * value:.3g}" for value in values)


def _csv_timing(name: str, timing: Timing) -> dict[str, object]:
    return {f"{name}_min_ms": timing.least, f"{name}_median_ms": timing.median}


def _csv_scheme(row: ErrorRow | ChainRow) -> dict[str, object]:
    deviation = row.deviation
    values = {"rms": deviation.rms, "p99": deviation.p99, "mean_ratio": deviation.ratio}
    return {
        "transport": row.scheme.method,
        "layers": row.scheme.layers or "",
        "resolution": row.scheme.resolution or "",
        "error_target": row.scheme.error_target or "",
        "shape": row.shape,
        "material": row.material,
        "light": row.light,
        **{f"{name}_{c}": value for name, triple in values.items() for c, value in zip("rgb", triple, strict=True)},
    }
