"""What a terminal shows of a command: progress while it works, and the stages of a picture afterwards."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

    from milkglass.viewer.render.picture import Frame, Still

SHARE = re.compile(r"(.*): (\d+) %")


def teller(progress: "Progress", task: "TaskID") -> Callable[[str], None]:
    """Return what shows the words of a step; those that end with a percentage, `...: 37 %`, as a bar of their own."""
    bar = progress.add_task("", total=100, visible=False)  # a bar that has had a length never loses it again

    def tell(words: str) -> None:
        found = SHARE.fullmatch(words)
        progress.update(task, visible=not found)
        if found:
            progress.update(bar, description=found[1], completed=int(found[2]), visible=True)
        else:
            progress.update(bar, visible=False)
            progress.update(task, description=words)

    return tell


@contextmanager
def progress_bar(console: "Console") -> Iterator[Callable[[str], None]]:
    """Show steps on a terminal while they last, and nothing anywhere else."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield teller(progress, progress.add_task("starting", total=None))


def show_frame(frame: "Frame | Still") -> None:
    """Print what each stage of a picture took, ms, and how fine its transport was."""
    from rich.console import Console
    from rich.table import Table

    table = Table("stage", box=None, pad_edge=False)
    table.add_column("ms", justify="right")
    for stage, milliseconds in frame.timings.items():
        table.add_row(stage, f"{milliseconds:.1f}")
    console = Console()
    console.print(table)
    for sentence in (frame.quality.summary, *frame.remarks):
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
