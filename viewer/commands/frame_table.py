"""What `milkglass render --verbose` tells of a picture: the time of each stage, and how fine transport was."""

from rich.console import Console
from rich.table import Table

from milkglass.viewer.render.picture import Frame, Still


def show(frame: Frame | Still) -> None:
    """Print it."""
    table = Table("stage", box=None, pad_edge=False)
    table.add_column("ms", justify="right")
    for stage, milliseconds in frame.timings.items():
        table.add_row(stage, f"{milliseconds:.1f}")
    console = Console()
    console.print(table)
    for sentence in (frame.quality.summary, *frame.remarks):
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
