"""`milkglass sweep`: many pictures of a scene file, with a progress bar, resumable."""

from pathlib import Path

import typer

from milkglass.core.errors import InputError
from milkglass.viewer.sweep import pools, run as running
from milkglass.viewer.sweep.sweep import MOST_PICTURES, Sweep
from milkglass.viewer.sweep.work import Finished


def run(
    file: str, output: str, workers: int, scheduler: str | None, shard: str | None, *, dry: bool, yes: bool
) -> None:
    """Make the pictures of a sweep file that are not there yet; with `dry`, say what that would take."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    sweep, folder = Sweep.load(file), Path(output)
    share = running.Shard() if shard is None else running.Shard.parse(shard)
    if sweep.count > MOST_PICTURES and not (yes or dry):
        raise InputError(f"{file} has {sweep.count:,} pictures; add --yes if that is meant")
    if dry:
        typer.echo(said_of(running.estimate(sweep, folder), workers))
        return
    where = pools.in_processes(workers) if scheduler is None else pools.on_cluster(scheduler)
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("looking for what is there", total=None)

        def tell(_: Finished) -> None:
            progress.advance(task)

        progress.update(task, description="rendering", total=running.count_missing(sweep, folder, share))
        count = running.run(sweep, folder, where, share, tell)
    typer.echo(f"{count} of {sweep.count} pictures made; they and index.csv are in {folder}.")


def said_of(found: running.Estimate, workers: int) -> str:
    """Return an estimate in a sentence."""
    size = f"{found.size / 1e9:.1f} GB" if found.size >= 1e9 else f"{found.size / 1e6:.1f} MB"
    by = "one worker" if workers == 1 else f"{workers} workers with a core each"
    time = spoken(found.seconds / workers)
    return f"{found.pictures:,} pictures, {found.missing:,} of them to be made: about {time} by {by}, {size} in all."


def spoken(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"
