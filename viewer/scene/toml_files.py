"""TOML files, read and written whole or not at all."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from milkglass.core.errors import InputError
from milkglass.viewer.scene.whole_file import replacement

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
    """Write a file, whole or not at all; `document` names it in messages: "the scene file"."""
    try:
        with replacement(path) as temporary:
            temporary.write_bytes(text.encode("utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot write {document} ({error.strerror or error})") from error
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: cannot hold a file name that is not UTF-8 text; rename it") from error


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
