"""A display of the tests' own: two windows that share one share the pointer and the keyboard's focus too."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


def missing(what: str) -> None:
    """Skip the test, or fail it where the tests are meant to be complete."""
    if os.environ.get("CI"):
        pytest.fail(f"continuous integration needs {what}")
    pytest.skip(f"needs {what}")


@contextmanager
def virtual_display() -> Iterator[str]:
    """Start Xvfb, and return the name of its display; the one there is already serves where Xvfb is not installed."""
    if shutil.which("Xvfb") is None:
        if not os.environ.get("DISPLAY"):
            missing("Xvfb, or a display")
        yield os.environ["DISPLAY"]
        return
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1000x24", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    try:
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()
