"""The formats of depth maps, one a line of `DEPTH_FORMATS`: arrays (h, w) float32, larger is nearer."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.errors import InputError
from milkglass.viewer.files.images import MAX_PIXELS, read_channels, read_photo, write_exr, write_png
from milkglass.viewer.scene.given_file import check_given, reading
from milkglass.viewer.scene.whole_file import replacement


@dataclass(frozen=True)
class DepthFormat:
    """A format of depth maps: how it is read and written.

    Attributes
    ----------
    read : callable
        Returns the depth (h, w) of a file.
    write : callable
        Writes a depth (h, w) in mm, whole or not at all.
    relative : bool
        Whether what is read has a range of its own instead of mm.
    """

    read: Callable[[Path], Float32]
    write: Callable[[Path, Float32], None]
    relative: bool = False


def _read_png(path: Path) -> Float32:
    return read_photo(path)[0][..., 0].astype(np.float32)


def _write_png(path: Path, depth: Float32) -> None:
    """Write 16 bits, from the lowest to the highest."""
    span = max(float(depth.max() - depth.min()), 1e-9)
    write_png(path, np.rint((depth - depth.min()) * (65535.0 / span)).astype(np.uint16)[..., None])


def _read_exr(path: Path) -> Float32:
    channels = read_channels(path, (".exr",), limit=8)
    return channels.get("Z", channels.get("depth.Z", next(iter(channels.values()))))


def _write_exr(path: Path, depth: Float32) -> None:
    write_exr(path, {"Z": depth})


def _read_npy(path: Path) -> Float32:
    check_given(path, "the depth map")
    with reading(path, "the depth map"):
        # Mapped, not read: what a header claims is then held against the file's length before any memory is taken.
        values = np.lib.format.open_memmap(path, mode="r")
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        raise InputError(f"the depth map {path} must hold one array (height, width) of numbers; save the depth alone")
    if values.size > MAX_PIXELS:
        raise InputError(f"the depth map {path} measures {values.shape[1]}x{values.shape[0]}; reduce it to 8192x8192")
    with np.errstate(over="ignore"):  # beyond float32 is infinite, which is refused as what the file itself holds
        return np.array(values, np.float32)


def _write_npy(path: Path, depth: Float32) -> None:
    try:
        with replacement(path) as temporary:
            np.save(temporary, depth)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}); check the free space") from error


DEPTH_FORMATS: dict[str, DepthFormat] = {
    ".png": DepthFormat(_read_png, _write_png, relative=True),
    ".exr": DepthFormat(_read_exr, _write_exr),
    ".npy": DepthFormat(_read_npy, _write_npy),
}


def depth_format_of(path: Path) -> DepthFormat:
    """Return the format that a path's suffix names.

    Raises
    ------
    InputError
        For a suffix that names none.
    """
    found = DEPTH_FORMATS.get(path.suffix.lower())
    if found is None:
        raise InputError(f"the depth map {path} must end in {', '.join(DEPTH_FORMATS)}; save it as one of them")
    return found
