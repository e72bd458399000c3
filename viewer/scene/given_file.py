"""Files that someone gives: regular ones up to a stated size, and readers whose every failure is one sentence."""

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from milkglass.core.errors import InputError

TEXT_BYTES = 10_000_000  # of scene files, tables and materials
LARGEST_BYTES = 4 << 30  # of any file: a probe of 8192 x 8192 in 32 bits has 0.8 GB


def check_given(path: Path, role: str, most_bytes: int = LARGEST_BYTES) -> None:
    """Raise `InputError` unless a path is a regular file of at most so many bytes that may be read.

    A device has no end and a pipe no size: both are refused before a byte is read. `role` names the file's part in
    messages: "the profile".
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot read {role} ({reason_of(error)})") from error
    if stat.S_ISDIR(found.st_mode):
        raise InputError(f"{path}: cannot read {role} (it is a folder); name a file")
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: cannot read {role} (a device or a pipe); copy it to a file")
    if found.st_size > most_bytes:
        sizes = f"{found.st_size / 1e6:.0f} MB, at most {most_bytes / 1e6:.0f} are read"
        raise InputError(f"{path}: too large for {role} ({sizes})")


def given_bytes(path: Path, role: str, most_bytes: int = TEXT_BYTES) -> bytes:
    """Return the content of a regular file; errors as `check_given`."""
    check_given(path, role, most_bytes)
    try:
        with path.open("rb") as file:
            return file.read(most_bytes)
    except OSError as error:
        raise InputError(f"{path}: cannot read {role} ({reason_of(error)})") from error


@contextmanager
def reading(path: Path | str, role: str) -> Iterator[None]:
    """Turn whatever a reader raises on a file into `InputError`: libraries promise no kind of exception for damage.

    Only the reader itself belongs into the block, since a fault of this program would be called a damaged file.
    """
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise InputError(f"{path}: cannot read {role}: it is damaged, or needs more memory than there is") from error
    except OSError as error:
        raise InputError(f"{path}: cannot read {role} ({reason_of(error)})") from error
    except Exception as error:
        raise InputError(f"{path}: cannot read {role}: damaged or of another kind ({reason_of(error)})") from error


def reason_of(error: BaseException) -> str:
    """Return what an exception says, on one line of at most 100 letters; its class where it says nothing."""
    text = " ".join(str(getattr(error, "strerror", None) or error).split())
    return text[:100].rstrip(". ") or type(error).__name__
