"""A sweep from beginning to end: what is missing is made, wherever that is, and gathered."""

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.viewer.sweep import ledger, sheet
from milkglass.viewer.sweep.contents import content_hash
from milkglass.viewer.sweep.pools import ROWS, Pool, Pools, in_processes, killed
from milkglass.viewer.sweep.sweep import Sweep
from milkglass.viewer.sweep.work import Finished, Task, make, of_row

MOST_DEATHS = 3  # of workers, with no picture between

Tell = Callable[[Finished], None]


@dataclass(frozen=True)
class Shard:
    """One of several equal shares of a sweep, for machines that know nothing of each other.

    Attributes
    ----------
    number : int
        From 1.
    count : int
    """

    number: int = 1
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Return the shard of "2/8"; raise `InputError` for what is none."""
        number, _, count = text.partition("/")
        if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
            raise InputError(f"--shard {text} is none; write I/N such as 2/8, I from 1 to N")
        return cls(int(number), int(count))


@dataclass(frozen=True)
class Estimate:
    """What a sweep will take.

    Attributes
    ----------
    pictures, missing : int
        In all, and of those the ones that are not there.
    seconds : float
        For the missing ones, of one worker.
    size : float
        Bytes of all.
    """

    pictures: int
    missing: int
    seconds: float
    size: float


def run(
    sweep: Sweep,
    folder: Path,
    pools: Pools = in_processes(1),
    shard: Shard = Shard(),
    tell: Tell = lambda _: None,
) -> int:
    """Make all pictures of a shard that are not there as they are to be, then gather the indices; return their number.

    Parameters
    ----------
    folder : Path
        That all workers see by the same name.
    pools : callable
        Makes a context of workers, again where they died.
    tell : callable
        Told of each picture that was made.

    Raises
    ------
    InputError
        What is wrong with a picture, a file or the folder; what was made before stays, and the next call goes on.
    """
    sheet.check_film(sweep.output.animation, sweep.files)
    folder = folder.absolute()  # workers may have other working directories
    ledger.begin(sweep, folder)
    count, deaths = 0, 0
    while True:
        before = count
        try:
            with pools() as pool:
                for one in _finished(pool, tasks(sweep, folder, shard, pool.rows)):
                    count += 1
                    tell(one)
            break
        except BrokenProcessPool as error:
            deaths = deaths + 1 if count == before else 1
            if deaths == MOST_DEATHS:
                raise killed(deaths) from error
    rows = ledger.gather(sweep, folder)
    if sweep.output.sheet:
        sheet.write_sheet(folder, rows, sweep.title)
    if sweep.output.animation is not None and sweep.turntable is not None:
        sheet.write_films(folder, rows, sweep.turntable.frames, sweep.output.animation, sweep.output.frames_per_second)
    return count


def tasks(sweep: Sweep, folder: Path, shard: Shard = Shard(), rows: int = ROWS) -> Iterator[Task]:
    """Yield the work that is left of a shard, a few pictures each; those of one state follow each other."""
    output, number = sweep.output, 0
    by_group = sweep.groups_count >= 4 * shard.count  # else shares are of the pictures of each group
    for group, indices in enumerate(sweep.groups()):
        if by_group and group % shard.count != shard.number - 1:
            continue
        left = []
        for number, index in enumerate(indices):
            if not by_group and number * shard.count // len(indices) != shard.number - 1:
                continue
            row = sweep.row(index)
            try:
                content = content_hash(sweep, row)
            except InputError as error:
                raise of_row(row, error) from error
            if not ledger.is_finished(folder, index, content):
                left.append((row, content))
        while left:
            yield Task(tuple(left[:rows]), sweep.files, output.samples, output.seed, folder, output.measured)
            left = left[rows:]


def count_missing(sweep: Sweep, folder: Path, shard: Shard = Shard()) -> int:
    """Return the number of pictures of a shard that are not there as they are to be."""
    return sum(len(task.rows) for task in tasks(sweep, folder, shard))


def estimate(sweep: Sweep, folder: Path) -> Estimate:
    """Return what a sweep will take, by three of its pictures."""
    todo = count_missing(sweep, folder)
    groups = list(islice(sweep.groups(), 2))
    shown = [groups[0][0], *groups[0][1:2], *(group[0] for group in groups[1:])]
    with tempfile.TemporaryDirectory(prefix="milkglass-") as temporary:
        target = Path(temporary)
        ledger.begin(sweep, target)
        rows = [sweep.row(index) for index in shown]
        output = sweep.output
        task = Task(tuple((row, "") for row in rows), sweep.files, output.samples, output.seed, target, output.measured)
        pictures = {one.index: one for one in make(task)}
    anew = pictures[groups[-1][0]].seconds  # of another state, where there is one: the first also starts everything
    again = pictures[groups[0][1]].seconds if len(groups[0]) > 1 else anew
    seconds = (anew + (len(groups[0]) - 1) * again) / len(groups[0])
    size = sum(one.size for one in pictures.values()) / len(pictures)
    return Estimate(sweep.count, todo, seconds * todo, size * sweep.count)


def _finished(pool: Pool, work: Iterator[Task]) -> Iterator[Finished]:
    """Hand out work, as much ahead as workers need, and yield what is made as it comes; the first failure ends it."""
    running: set[Future[list[Finished]]] = set()
    try:
        while True:
            ahead = pool.ahead * max(1, pool.size())
            running |= {pool.executor.submit(make, task) for task in islice(work, max(0, ahead - len(running)))}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield from future.result()
    finally:
        for future in running:
            future.cancel()
