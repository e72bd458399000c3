"""Output of commands on a terminal: progress, and the stages of a finished picture."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

    from milkglass.viewer.render.picture import Frame, Still

PERCENTAGE = re.compile(r"(.*): (\d+) %")


def progress_callback(progress: "Progress", task: "TaskID") -> Callable[[str], None]:
    """Return a function that shows the text of a step, as a bar where it ends with a percentage, `...: 37 %`."""
    bar = progress.add_task("", total=100, visible=False)  # a separate bar, since a bar cannot lose its length again

    def show(words: str) -> None:
        match = PERCENTAGE.fullmatch(words)
        progress.update(task, visible=not match)
        if match:
            progress.update(bar, description=match[1], completed=int(match[2]), visible=True)
        else:
            progress.update(bar, visible=False)
            progress.update(task, description=words)

    return show


@contextmanager
def progress_bar(console: "Console") -> Iterator[Callable[[str], None]]:
    """Show steps on a terminal while the context lasts, and nothing if the console is no terminal."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress_callback(progress, progress.add_task("starting", total=None))


def show_frame(frame: "Frame | Still") -> None:
    """Print the time of each stage of a picture, ms, and a summary of its transport."""
    from rich.console import Console
    from rich.table import Table

    table = Table("stage", box=None, pad_edge=False)
    table.add_column("ms", justify="right")
    for stage, milliseconds in frame.timings.items():
        table.add_row(stage, f"{milliseconds:.1f}")
    console = Console()
    console.print(table)
    exposed = f"The log-average of the object's radiance is {frame.log_average:.4g} (display.average)."
    for sentence in (frame.quality.summary, exposed, *frame.parts, *frame.remarks):
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
