"""What the vertices of a mesh see of an environment: of a refined mesh, by rays, or as the cache has it. No OpenGL."""

import contextlib
import hashlib
import os
import threading
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import platformdirs

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined, refined
from milkglass.core.light.bake import BakeCancelled, bake, directions_for, opposite_points, unit_normals
from milkglass.core.light.visibility import Sight, Visibility, transfer
from milkglass.core.threads import computed_once
from milkglass.viewer.scene.settings import EnvironmentSettings
from milkglass.viewer.scene.whole_file import replacement

# Of the longest side, between places where visibility is known: a slab with a ball and a block on it has 1.2 % rms at
# 0.02 (27,000 vertices), 1.7 % at 0.03 (15,000), 5.5 % at 0.1.
LONGEST_EDGE = 0.03
VERSION = 3  # of what is in the files, and of how rays are cast
MOST_BYTES = 512 << 20  # of all files; those unused for longest go first


def cached_sight(mesh: Mesh) -> Sight | None:
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


def keep_sight(mesh: Mesh, sight: Sight) -> None:
    """Keep what rays found, whole or not at all, and drop what has not been used for longest."""
    path = _path(mesh)
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacement(path) as temporary:
            np.savez(temporary, bits=sight.bits)
        _trim(path.parent)


def cache_folder() -> Path:
    """Return where the files are."""
    return Path(platformdirs.user_cache_dir("milkglass", appauthor=False)) / "visibility"


def _path(mesh: Mesh) -> Path:
    digest = hashlib.sha256(f"{VERSION} {directions_for(len(mesh.vertices))}".encode())
    for array in (mesh.vertices, mesh.normals, mesh.faces):
        digest.update(str(array.shape).encode())
        digest.update(np.ascontiguousarray(array).data)
    return cache_folder() / f"{digest.hexdigest()[:32]}.npz"


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


@dataclass(frozen=True, eq=False)
class BakedVisibility:
    """What the vertices of a refined mesh see."""

    refined: Refined
    visibility: Visibility

    @computed_once
    def opposite(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
        """Vertices (n, 3) and weights (n, 3) that interpolate where each vertex' normal, backwards, leaves the object.

        Where it leaves it nowhere, the vertex itself.
        """
        return opposite_points(self.refined.mesh)


def bake_visibility(
    mesh: Mesh,
    progress: Callable[[float], object] = lambda _: None,
    cancelled: threading.Event | None = None,
    *,
    ahead: bool = False,
) -> BakedVisibility:
    """Refine a mesh and cast rays from its vertices, or find on disk what they met; errors as `core`'s `bake`.

    `ahead` makes at once what highlights and thin sheets would have to wait for when they are first asked for.
    """
    stop = cancelled or threading.Event()

    def check() -> None:
        if stop.is_set():
            raise BakeCancelled

    fine = refined(mesh, LONGEST_EDGE * float(np.ptp(mesh.bounds, axis=0).max()))
    check()
    sight = cached_sight(fine.mesh)
    if sight is None:
        sight = bake(fine.mesh, progress, stop)
        keep_sight(fine.mesh, sight)
    baked = BakedVisibility(fine, transfer(sight, check=check))
    if ahead:
        baked.visibility.blocked(check)
        baked.opposite  # noqa: B018  (it is kept)
    return baked


def needs_visibility(environment: EnvironmentSettings) -> bool:
    """Whether there is light that something may be in the way of."""
    return environment.given and environment.occluded and environment.intensity > 0.0
