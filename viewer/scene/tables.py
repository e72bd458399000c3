"""Profiles from files: CSV text of radius_mm, R, G, B."""

import functools
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.core.profiles.table import TableProfile, parse_table

MAX_BYTES = 10_000_000

ProfileTable = tuple[TableProfile, TableProfile, TableProfile]


def read_profile_table(path: Path) -> ProfileTable:
    """Read a file, or return what it held if it has not changed since.

    Raises
    ------
    InputError
        Naming the file, and the line where one is wrong.
    """
    try:
        found = path.stat()
        return _read(path, found.st_mtime_ns, found.st_size)
    except OSError as error:
        raise InputError(f"{path}: cannot read the profile ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file; write lines of radius_mm, R, G, B") from error


@functools.lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> ProfileTable:
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size / 1e6:.0f} MB are too large for a profile")
    return parse_table(path.read_bytes().decode("utf-8"), path.name)
