"""A few pictures of a sweep, where they are made: in any process, on any machine; what is known is in files."""

import functools
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milkglass.core.errors import InputError
from milkglass.viewer.sweep import ledger
from milkglass.viewer.sweep.axes import LABEL
from milkglass.viewer.sweep.outputs import OUTPUTS, files_of
from milkglass.viewer.sweep.studio import Studio
from milkglass.viewer.sweep.sweep import Row


@dataclass(frozen=True)
class Task:
    """A few pictures to make, most often of one state of light and material.

    Attributes
    ----------
    rows : tuple of (Row, str)
        With the hash of each, in their order.
    kinds : tuple of str
        Of `viewer.sweep.outputs.OUTPUTS`.
    samples, seed : int
    folder : Path
    measured : bool
        Whether the error of each is measured.
    """

    rows: tuple[tuple[Row, str], ...]
    kinds: tuple[str, ...]
    samples: int
    seed: int
    folder: Path
    measured: bool = False


@dataclass(frozen=True)
class Finished:
    """What a task returns of a picture: little, since all else is in files.

    Attributes
    ----------
    index : int
    seconds : float
    size : int
        Bytes of its files.
    """

    index: int
    seconds: float
    size: int


_turns = threading.Lock()  # of threads, as a cluster's workers may have several: the studio knows one picture at a time


def make(task: Task) -> list[Finished]:
    """Make the pictures of a task and write their files, each picture's row last."""
    with _turns:
        return _made(task)


def _made(task: Task) -> list[Finished]:
    studio, finished = process_studio(), []
    linear = any(OUTPUTS[kind].linear for kind in task.kinds)
    for row, content in task.rows:
        start, path = time.perf_counter(), task.folder / row.name
        try:
            shot = studio.shot(row.scene, task.samples, task.seed, linear=linear, series=row.series)
        except InputError as error:
            raise of_row(row, error) from error
        path.parent.mkdir(parents=True, exist_ok=True)
        more: dict[str, Any] = {}
        for kind in task.kinds:
            more |= OUTPUTS[kind].write(path, shot.frame)
        columns, note = studio.measured(shot, task.seed) if task.measured else ({}, "")
        more |= columns
        more["seconds"] = round(time.perf_counter() - start, 3)
        files = files_of(row.name, task.kinds)
        ledger.write_row(task.folder, row, content, files, shot, more, note)
        size = sum((task.folder / file).stat().st_size for file in files)
        finished.append(Finished(row.index, more["seconds"], size))
    return finished


def of_row(row: Row, error: InputError) -> InputError:
    """Return what is wrong with a picture, with what it is called."""
    label = f" ({row.values[LABEL]})" if LABEL in row.values else ""
    return InputError(f"picture {row.index}{label} of the sweep: {error}")


@functools.cache
def process_studio() -> Studio:
    """Return the studio of this process."""
    return Studio()
