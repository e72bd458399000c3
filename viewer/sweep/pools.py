"""Who makes the pictures of a sweep: this process, others of this machine, or a cluster's workers."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeVar

from milkglass.core.errors import InputError
from milkglass.core.threads import AtOnce
from milkglass.viewer.render import memory

T = TypeVar("T")

ROWS = 8  # of a task: its worker keeps what they share for the next
ANSWER_SECONDS = 10  # within which a scheduler answers, or is not there


@dataclass(frozen=True)
class Pool:
    """Workers that make pictures.

    Attributes
    ----------
    executor : Executor
        Hands them tasks.
    size : callable
        Returns how many workers there are by now.
    rows : int
        Most pictures of a task.
    ahead : int
        Tasks a worker that are handed out.
    """

    executor: Executor
    size: Callable[[], int] = lambda: 1
    rows: int = ROWS
    ahead: int = 3


Pools = Callable[[], AbstractContextManager[Pool]]


def in_processes(workers: int) -> Pools:
    """Return what makes pools of so many processes; of one, this process itself does the work."""
    if workers == 1:
        return lambda: nullcontext(Pool(AtOnce(), rows=1, ahead=1))

    @contextmanager
    def processes() -> Iterator[Pool]:
        context = multiprocessing.get_context("spawn")  # drivers do not survive a fork
        pool, before = _Processes(workers, context, _begin_worker), multiprocessing.active_children()
        try:
            yield Pool(pool, lambda: workers)
        except BaseException:  # an interrupt above all: nobody waits for pictures on the way
            for process in set(multiprocessing.active_children()) - set(before):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)

    return processes


def on_cluster(address: str) -> Pools:
    """Return what makes the pool of a Dask cluster, whose workers may come and go; see `in_processes`.

    Raises
    ------
    InputError
        Without the extra; the pool, where no scheduler answers, it goes, or its workers die again and again.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise InputError("--scheduler needs the extra: pip install 'milkglass[cluster]'") from None

    @contextmanager
    def cluster() -> Iterator[Pool]:
        try:
            client = Client(address, timeout=ANSWER_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(f"--scheduler {address}: no scheduler answers ({type(error).__name__})") from error
        try:
            yield Pool(client.get_executor(pure=False), lambda: len(client.nthreads()))
        except KilledWorker as error:
            raise killed(1 + error.allowed_failures) from error
        except (CancelledError, OSError) as error:
            raise InputError(
                f"the scheduler at {address} has gone; what was made stays, and the next call goes on"
            ) from error
        finally:
            client.close()

    return cluster


def killed(times: int) -> InputError:
    """Return what is said of a picture at which workers die."""
    return InputError(
        f"the processes that render were killed {times} times at the same picture, most often for want of memory; "
        "fewer --workers, or smaller pictures"
    )


class _Processes(ProcessPoolExecutor):
    """Processes that end in the middle of a task where they are asked to, and leave no half-written file."""

    def submit(self, work: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """See `Executor`."""
        return super().submit(_until_asked_to_end, work, *args, **kwargs)


def _until_asked_to_end(work: Callable[..., T], /, *args: Any, **kwargs: Any) -> T:
    try:
        return work(*args, **kwargs)
    except SystemExit:  # which the executor would take for a result, and go on
        os._exit(128 + signal.SIGTERM)


def _begin_worker() -> None:
    """Leave interrupts to the process that hands out work, end with it, and share one heap among threads."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    memory.share_heap()


def _end(number: int, _: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _end_with_parent() -> None:
    """Wait until the process that hands out work is gone, however that went; the executor would wait for more."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
