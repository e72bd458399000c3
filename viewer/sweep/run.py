"""A sweep from beginning to end: what is missing is made, wherever that is, and gathered."""

import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.core.threads import AtOnce
from milkglass.viewer.render import memory
from milkglass.viewer.sweep import ledger, sheet
from milkglass.viewer.sweep.contents import content_hash
from milkglass.viewer.sweep.sweep import Sweep
from milkglass.viewer.sweep.work import Finished, Task, make

ROWS = 8  # of a task: its worker keeps what they share for the next
AHEAD = 3  # tasks a worker that are handed out
MOST_DEATHS = 3  # of workers, with no picture between

Executors = Callable[[], AbstractContextManager[Executor]]
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


def in_processes(workers: int) -> Executors:
    """Return what makes executors of so many processes; of one, this process itself does the work."""
    if workers == 1:
        return lambda: nullcontext(AtOnce())
    context = multiprocessing.get_context("spawn")  # drivers do not survive a fork
    return lambda: ProcessPoolExecutor(workers, context, _begin_worker)


def on_cluster(address: str) -> Executors:
    """Return what makes the executor of a Dask cluster; raise `InputError` without the extra."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs the extra: pip install 'milkglass[cluster]'") from None
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--scheduler {address}: no scheduler answers there ({type(error).__name__})") from error
    return lambda: nullcontext(client.get_executor())


def run(
    sweep: Sweep,
    folder: Path,
    executors: Executors = in_processes(1),
    workers: int = 1,
    shard: Shard = Shard(),
    tell: Tell = lambda _: None,
) -> int:
    """Make all pictures of a shard that are not there as they are to be, then gather the indices; return their number.

    Parameters
    ----------
    executors : callable
        Makes a context of an executor, again where its workers died.
    workers : int
        Of it.
    tell : callable
        Told of each picture that was made.

    Raises
    ------
    InputError
        What is wrong with a picture, a file or the folder; what was made before stays, and the next call goes on.
    """
    sheet.check_film(sweep.output.animation, sweep.files)
    ledger.begin(sweep, folder)
    count, deaths = 0, 0
    while True:
        before = count
        try:
            with executors() as executor:
                for one in _finished(executor, tasks(sweep, folder, shard), AHEAD * workers):
                    count += 1
                    tell(one)
            break
        except BrokenProcessPool as error:
            deaths = deaths + 1 if count == before else 1
            if deaths == MOST_DEATHS:
                raise InputError(
                    f"the processes that render were killed {deaths} times at the same picture, most often for want of "
                    "memory; fewer --workers, or smaller pictures"
                ) from error
    rows = ledger.gather(sweep, folder)
    if sweep.output.sheet:
        sheet.write_sheet(folder, rows, sweep.title)
    if sweep.output.animation is not None and sweep.turntable is not None:
        sheet.write_films(folder, rows, sweep.turntable.frames, sweep.output.animation, sweep.output.frames_per_second)
    return count


def tasks(sweep: Sweep, folder: Path, shard: Shard = Shard()) -> Iterator[Task]:
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
            content = content_hash(sweep, row)
            if not ledger.is_finished(folder, index, content):
                left.append((row, content))
        while left:
            yield Task(tuple(left[:ROWS]), sweep.files, output.samples, output.seed, folder)
            left = left[ROWS:]


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
        task = Task(tuple((row, "") for row in rows), sweep.files, sweep.output.samples, sweep.output.seed, target)
        pictures = {one.index: one for one in make(task)}
    anew = pictures[groups[-1][0]].seconds  # of another state, where there is one: the first also starts everything
    again = pictures[groups[0][1]].seconds if len(groups[0]) > 1 else anew
    seconds = (anew + (len(groups[0]) - 1) * again) / len(groups[0])
    size = sum(one.size for one in pictures.values()) / len(pictures)
    return Estimate(sweep.count, todo, seconds * todo, size * sweep.count)


def _finished(executor: Executor, work: Iterator[Task], ahead: int) -> Iterator[Finished]:
    """Hand out work, as much ahead as workers need, and yield what is made as it comes; the first failure ends it."""
    running: set[Future[list[Finished]]] = set()
    try:
        while True:
            running |= {executor.submit(make, task) for task in islice(work, ahead - len(running))}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield from future.result()
    finally:
        for future in running:
            future.cancel()


def _begin_worker() -> None:
    """Leave interrupts to the process that hands out work, and share one heap among threads."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    memory.share_heap()
