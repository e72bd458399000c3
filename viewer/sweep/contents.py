"""What a picture is made of, as a hash: it changes with any value, file or version that the picture depends on."""

import functools
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

from milkglass.core.errors import InputError
from milkglass.viewer.files.record import VERSION
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.given_file import TEXT_BYTES, check_given, reading
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import TABLES
from milkglass.viewer.sweep.sweep import Row, Sweep

# Models that name other files, and what such names look like.
NAMING = (".obj", ".mtl", ".gltf", ".dae")
_NAMED = re.compile(r"[^\s\"'<>|*?]+\.(?:mtl|bin|png|jpe?g|webp|tiff?|bmp|gif|tga)\b", re.IGNORECASE)


def content_hash(sweep: Sweep, row: Row) -> str:
    """Return what tells a picture from any other, 64 hexadecimal digits.

    Equal where the settings, the contents of all files that these name, what is written, and the version are.
    """
    output = sweep.output
    made_of = {
        "version": VERSION,
        "scene": by_content(row.scene).to_toml(),
        "files": sweep.files,
        "name": row.name,
        "measured": output.measured,
        "samples": [output.samples, output.seed],
        "series": None if row.series is None else [row.series.table.frames, by_content(row.series.scene).to_toml()],
    }
    return hashlib.sha256(json.dumps(made_of, sort_keys=True).encode()).hexdigest()


def by_content(scene: Scene) -> Scene:
    """Return a scene whose files are named by what is in them."""
    tables = {}
    for name in TABLES:
        table = getattr(scene, name)
        paths = {key: getattr(table, key) for key, declared in settings_of(table).items() if declared.kind == "path"}
        named = {key: Path("/", digest(path) + path.suffix) for key, path in paths.items() if path is not None}
        tables[name] = replace(table, **named)
    return replace(scene, **tables)


def digest(path: Path) -> str:
    """Return the hash of a file and of those that it names; kept as long as its time and size stay.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    hashes = hashlib.sha256()
    for part in _with_named(path):
        found = part.stat()
        hashes.update(_digest(part, found.st_mtime_ns, found.st_size))
    return hashes.hexdigest()


@functools.lru_cache(4096)
def _digest(path: Path, changed: int, size: int) -> bytes:
    with reading(path, "the file"), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _with_named(path: Path, deep: int = 2) -> Iterator[Path]:
    """Yield a file, and those beside and below it that its text names."""
    check_given(path, "the file")
    yield path
    if path.suffix.lower() not in NAMING or deep == 0 or path.stat().st_size > 100 * TEXT_BYTES:
        return
    with reading(path, "the file"):
        text = path.read_text(encoding="utf-8", errors="replace")
    for name in sorted(set(_NAMED.findall(text))):
        named = path.parent / unquote(name).replace("\\", "/")
        if named.is_file() and named.suffix.lower() != path.suffix.lower():
            try:
                yield from _with_named(named, deep - 1)
            except InputError:  # what cannot be read is no part of the picture either
                continue
