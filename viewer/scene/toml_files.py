"""TOML files, read and written whole or not at all."""

import contextlib
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from milkglass.core.errors import InputError

# Vectors of numbers on one line: one key a line is what people edit.
_VECTOR = re.compile(r"\[\n((?: +-?[0-9][^\n]*,\n)+)\]")


def parse(data: bytes, path: Path) -> dict[str, Any]:
    """Return the content of a file's bytes.

    Raises
    ------
    InputError
        Naming the file.
    """
    try:
        return tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # no UTF-8, no TOML, numbers of thousands of digits
        raise InputError(f"{path}: not a TOML file ({_one_line(error)})") from error


def dumps(document: Mapping[str, Any]) -> str:
    """Return the text of a file."""
    return _VECTOR.sub(lambda match: f"[{' '.join(match[1].split()).rstrip(',')}]", tomli_w.dumps(document))


def write(path: str | Path, text: str, document: str) -> None:
    """Write a file, whole or not at all; `what` names it in messages: "the scene file"."""
    # Through a link, write what it points to, and leave the link.
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(text.encode("utf-8"))
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"{path}: cannot write {document} ({error.strerror or error})") from error
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: cannot hold a file name that is not UTF-8 text; rename it") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
