"""Profiles from files: CSV text of radius_mm, R, G, B."""

import functools
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.core.profiles.table import TableProfile, parse_table
from milkglass.viewer.scene.given_file import TEXT_BYTES, check_given, given_bytes

ProfileTable = tuple[TableProfile, TableProfile, TableProfile]


def read_profile_table(path: Path) -> ProfileTable:
    """Read a file, or return what it held if it has not changed since.

    Raises
    ------
    InputError
        Naming the file, and the line where one is wrong.
    """
    check_given(path, "the profile", TEXT_BYTES)
    try:
        found = path.stat()
        return _read(path, found.st_mtime_ns, found.st_size)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file; write lines of radius_mm, R, G, B") from error


@functools.lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> ProfileTable:
    return parse_table(given_bytes(path, "the profile").decode("utf-8"), path.name)
