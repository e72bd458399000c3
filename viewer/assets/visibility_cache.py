"""What rays found of a mesh, kept in the user's cache folder by its content: done without where that does not work."""

import contextlib
import hashlib
import os
import zipfile
from pathlib import Path

import numpy as np
import platformdirs

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.bake import directions_for, unit_normals
from milkglass.core.light.visibility import Sight

VERSION = 3  # of what is in the files, and of how rays are cast
MOST_BYTES = 512 << 20  # of all files; those unused for longest go first


def read(mesh: Mesh) -> Sight | None:
    """Return what is known of a mesh, None where nothing is or the file is damaged."""
    path = _path(mesh)
    try:
        # Opened here: of a damaged file numpy would leave it open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
            bits = content["bits"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if bits.dtype != np.uint8 or bits.shape != (len(mesh.vertices), directions_for(len(mesh.vertices)) // 8):
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return Sight(unit_normals(mesh), bits)


def write(mesh: Mesh, sight: Sight) -> None:
    """Keep what rays found, whole or not at all, and drop what has not been used for longest."""
    path = _path(mesh)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:  # a name would be given another suffix
                np.savez(file, bits=sight.bits)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        _trim(path.parent)


def folder() -> Path:
    """Return where the files are."""
    return Path(platformdirs.user_cache_dir("milkglass", appauthor=False)) / "visibility"


def _path(mesh: Mesh) -> Path:
    digest = hashlib.sha256(f"{VERSION} {directions_for(len(mesh.vertices))}".encode())
    for array in (mesh.vertices, mesh.normals, mesh.faces):
        digest.update(str(array.shape).encode())
        digest.update(np.ascontiguousarray(array).data)
    return folder() / f"{digest.hexdigest()[:32]}.npz"


def _trim(where: Path) -> None:
    files = []
    for path in where.glob("*.npz"):
        with contextlib.suppress(OSError):  # another process may have dropped it
            about = path.stat()
            files.append((about.st_mtime, about.st_size, path))
    total = 0
    for _, size, path in sorted(files, reverse=True):
        total += size
        if total > MOST_BYTES:
            with contextlib.suppress(OSError):
                path.unlink()
