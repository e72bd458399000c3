"""Files of what rays found on a mesh, so that they are cast once: for any process, whole or not at all."""

import contextlib
import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import platformdirs

from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.scene.whole_file import replacement

MOST_BYTES = 512 << 20  # of all files of a kind; those unused for longest go first


def cache_folder() -> Path:
    """Return the folder that has one folder for each kind of files."""
    return Path(platformdirs.user_cache_dir("milkglass", appauthor=False))


@dataclass(frozen=True)
class RayCache:
    """The files of one kind.

    Attributes
    ----------
    name : str
        Of their folder.
    version : int or str
        Of what is in them, and of how rays are cast.
    """

    name: str
    version: int | str

    def read(self, mesh: Mesh, dtypes: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]] | None:
        """Return the arrays kept of a mesh, None where there are none or the file is damaged."""
        path = self.path(mesh)
        try:
            # Opened here: of a damaged file numpy would leave it open.
            with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
                if str(content["key"]) != path.stem:  # the file of another mesh
                    return None
                arrays = {name: content[name] for name in dtypes}
        except Exception:  # whatever NumPy and zipfile raise on a damaged file: rays are then cast anew
            return None
        if any(array.dtype != dtypes[name] for name, array in arrays.items()):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return arrays

    def keep(self, mesh: Mesh, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Keep arrays of a mesh, whole or not at all, and drop what has not been used for longest."""
        path = self.path(mesh)
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacement(path) as temporary:
                np.savez(temporary, allow_pickle=False, key=np.array(path.stem), **arrays)
            _trim(path.parent)

    def path(self, mesh: Mesh) -> Path:
        """Return the file of a mesh."""
        digest = hashlib.sha256(str(self.version).encode())
        for array in (mesh.vertices, mesh.normals, mesh.faces):
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array).data)
        return cache_folder() / self.name / f"{digest.hexdigest()[:32]}.npz"


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
