"""The progress bar of `milkglass render`."""

from io import StringIO

import pytest
from rich.console import Console
from rich.progress import Progress

from milkglass.viewer.commands.terminal import progress_bar, progress_callback


def test_a_percentage_moves_the_bar():
    progress = Progress(console=Console(file=StringIO()))
    task = progress.add_task("starting", total=None)
    tell = progress_callback(progress, task)

    def shown():
        (one,) = [task for task in progress.tasks if task.visible]
        return one.description, one.completed, one.total

    tell("casting rays: 37 %")
    assert shown() == ("casting rays", 37, 100)
    tell("drawing")
    assert shown() == ("drawing", 0, None)


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_bar_is_there_on_terminals_only(is_terminal):
    written = StringIO()
    with progress_bar(Console(file=written, force_terminal=is_terminal, width=80)) as tell:
        tell("casting rays: 50 %")
    assert ("casting rays" in written.getvalue()) is is_terminal
    assert ("━" in written.getvalue()) is is_terminal
