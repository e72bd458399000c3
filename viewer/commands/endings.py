"""How a command ends that neither did what was asked nor was asked wrongly: signals, full disks, our own errors."""

import contextlib
import errno
import os
import secrets
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import platformdirs

from milkglass import __version__
from milkglass.viewer.scene.given_file import reason_of


@contextlib.contextmanager
def terminated() -> Iterator[None]:
    """End by an exception where a batch system or `kill` asks for the end, so that no half-written file stays.

    Outside the main thread nothing is done; a window handles signals by itself.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def of_system(error: OSError) -> str | None:
    """Return the sentence of what the system refused, "" for what needs none, None for what is our error.

    A pipe whose reader has gone, as of `milkglass materials | head`, needs no words.
    """
    if error.errno == errno.EPIPE:
        _close_stdout()
        return ""
    if error.filename is not None:
        return f"{os.fsdecode(error.filename)}: {reason_of(error)}; check the path, its permissions and the free space"
    if error.errno in (errno.ENOSPC, errno.EIO, errno.EDQUOT):
        _close_stdout()
        return f"the output could not be written ({reason_of(error)}); make room, or send it elsewhere"
    return None


def of_program(error: Exception) -> str:
    """Write the traceback of an exception to a file, and return the sentence that names both."""
    words = f"milkglass {__version__}, Python {sys.version}\n{' '.join(sys.argv)}\n\n"
    words += "".join(traceback.format_exception(error))
    name = f"error-{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}.log"
    for folder in (Path(platformdirs.user_log_dir("milkglass", appauthor=False)), Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(words, encoding="utf-8", errors="backslashreplace")
        except OSError:
            continue
        place = f"details are in {folder / name}, please report them"
        break
    else:
        place = "--debug shows where"
    said = f"{type(error).__name__}: {reason_of(error)}"
    return f"this is an error of milkglass, not of what you gave it ({said}); {place}"


def _close_stdout() -> None:
    """Send what is left to be printed nowhere: Python would fail with it once more as it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
