"""Files written whole or not at all."""

import contextlib
import errno
import os
import re
import secrets
import zlib
from collections.abc import Iterator
from pathlib import Path
from platform import node

import platformdirs

from milkglass.viewer.scene.processes import is_running

# Of temporary files: the machine and the process that write, by which a later one knows what nobody writes any more.
_TEMPORARY = re.compile(r"\.milkglass-(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-[0-9a-f]{16}\..*")


class _Confinement:
    """Where files may be written: anywhere, or into one folder, or into none."""

    active = False
    folder: Path | None = None

    def check(self, target: Path) -> None:
        """Raise `PermissionError` for a file that may not be written; caches hold nothing of a person's."""
        allowed = [Path(platformdirs.user_cache_dir("milkglass", appauthor=False))]
        allowed += [] if self.folder is None else [self.folder]
        if self.active and not any(target.is_relative_to(os.path.realpath(folder)) for folder in allowed):
            raise PermissionError(errno.EACCES, "a replay writes only into the folder that --into names")


_confinement = _Confinement()


@contextlib.contextmanager
def confined(folder: Path | None) -> Iterator[None]:
    """Let all threads write files into one folder alone, and those below it, or nowhere, while the context lasts."""
    _confinement.active, _confinement.folder = True, folder
    try:
        yield
    finally:
        _confinement.active, _confinement.folder = False, None


@contextlib.contextmanager
def replacement(path: str | Path) -> Iterator[Path]:
    """Yield a path beside a file, of its suffix in lower case, for the content that is to take the file's place.

    The file is replaced where the block ends; where it raises, the file stays as it was. A link stays a link: what it
    points to is replaced. What a killed process left half-written in that folder is taken away.

    Raises
    ------
    OSError
        The content was not written, or cannot take the place.
    """
    target = Path(os.path.realpath(path))
    _confinement.check(target)
    _take_away_left(target.parent)
    name = f".milkglass-{_machine()}-{os.getpid()}-{secrets.token_hex(8)}{Path(path).suffix.lower()}"
    temporary = target.with_name(name)
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _take_away_left(folder: Path) -> None:
    """Delete temporary files of processes of this machine that run no longer."""
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            found = _TEMPORARY.fullmatch(entry.name)
            if found and found["machine"] == _machine() and not is_running(int(found["process"])):
                with contextlib.suppress(OSError):
                    os.unlink(entry.path)


def _machine() -> str:
    return f"{zlib.crc32(node().encode()):08x}"
