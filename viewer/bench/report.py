"""Report of the benchmark: tables on the terminal, Markdown, CSV files and a plot."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from milkglass.core.errors import InputError
from milkglass.viewer.bench.chain import ChainRow
from milkglass.viewer.bench.speed import ConvolutionRow, FrameRow, ProcessRow, Timing
from milkglass.viewer.scene.whole_file import replacement

TARGET_RATIOS = {4: 2.0, 8: 3.0}  # layers -> largest accepted ratio to the bare transforms
UNLIMITED_WIDTH = 10_000  # columns in a pipe, where no line is broken
NO_PLOT = 'The plot needs matplotlib: pip install "milkglass[bench]".'


class BenchReport:
    """Prints tables, and collects them for the files of a folder.

    Parameters
    ----------
    folder : Path, optional
        Folder of the files, created if missing; without it no files are written.

    Raises
    ------
    InputError
        If the folder cannot be created or written to.
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
            self._write(folder / "bench.md", b"")  # fails now rather than after minutes

    def table(self, title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Print a table and add it to the Markdown file; the first column is text, the others numbers."""
        table = Table(box=box.MARKDOWN)
        for i, heading in enumerate(headings):
            table.add_column(heading, justify="right" if i else "left")
        for row in rows:
            table.add_row(*row)
        plain = Console(file=io.StringIO(), width=UNLIMITED_WIDTH)
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
        """Print a line of text on the terminal."""
        self._console.out(text, highlight=False)

    def csv(self, name: str, rows: Sequence[dict[str, object]]) -> None:
        """Write a CSV file of rows with the same keys."""
        if self._folder is not None and rows:
            text = io.StringIO(newline="")
            writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
            self._write(self._folder / name, text.getvalue().encode())

    def plot(self, name: str, draw: Callable[[], bytes]) -> None:
        """Write the PNG picture that `draw` returns, or print that it needs matplotlib."""
        if self._folder is None:
            return
        try:
            picture = draw()
        except ImportError:
            self.say(NO_PLOT)
        else:
            self._write(self._folder / name, picture)

    def finish(self) -> None:
        """Write all tables to the Markdown file."""
        if self._folder is not None:
            self._write(self._folder / "bench.md", "\n".join(self._markdown).encode())

    def _write(self, path: Path, content: bytes) -> None:
        """Write a whole file or none."""
        try:
            with replacement(path) as temporary:
                temporary.write_bytes(content)
        except OSError as error:
            raise InputError(f"{path} cannot be written ({error.strerror})") from error


def report_convolution(report: BenchReport, rows: Sequence[ConvolutionRow]) -> None:
    """Report layer convolution relative to the bare transforms of the same padded maps."""
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
                f"{TARGET_RATIOS[r.layers]:g}" if r.layers in TARGET_RATIOS else "",
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


def report_frames(report: BenchReport, rows: Sequence[FrameRow]) -> None:
    """Report frames in one table a setting, of stages by changes."""
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
            for stage, ms in {**r.stages, "frame": r.total.median, "frame, minimum": r.total.minimum}.items()
        ],
    )


def report_processes(report: BenchReport, rows: Sequence[ProcessRow]) -> None:
    """Report the time and memory of a process from its start to the file of its picture."""
    report.table(
        "milkglass render, from the start of the process to the file",
        ["setting", "seconds, minimum / median", "peak memory, MB"],
        ([r.setting, f"{r.time.minimum / 1e3:.1f} / {r.time.median / 1e3:.1f}", f"{r.megabytes:.0f}"] for r in rows),
    )
    report.csv(
        "processes.csv", [{"setting": r.setting, "peak_mb": r.megabytes} | _csv_timing("run", r.time) for r in rows]
    )


def report_chain(report: BenchReport, rows: Sequence[ChainRow]) -> None:
    """Report the error of whole pictures."""
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
    report.csv(
        "chain.csv",
        [
            {
                "transport": str(r.scheme),
                "shape": r.shape,
                "material": r.material,
                "light": r.light,
                **r.deviation.columns(),
            }
            for r in rows
        ],
    )


def _pair(timing: Timing) -> str:
    return f"{timing.minimum:.1f} / {timing.median:.1f}"


def _channels(values: Sequence[float]) -> str:
    return "/".join(f"{100.0 * value:.3g}" for value in values)


def _csv_timing(name: str, timing: Timing) -> dict[str, object]:
    return {f"{name}_min_ms": timing.minimum, f"{name}_median_ms": timing.median}
