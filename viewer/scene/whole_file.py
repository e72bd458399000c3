"""Files written whole or not at all."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacement(path: str | Path) -> Iterator[Path]:
    """Yield a path beside a file, of its suffix in lower case, for the content that is to take the file's place.

    The file is replaced where the block ends; where it raises, the file stays as it was. A link stays a link: what it
    points to is replaced.

    Raises
    ------
    OSError
        The content was not written, or cannot take the place.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{secrets.token_hex(8)}{Path(path).suffix.lower()}")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()
