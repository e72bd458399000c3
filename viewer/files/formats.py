"""The formats of pictures that are written, one a line of `PICTURE_FORMATS`.

Command line, help, `Frame.save` and the photograph's output read that table. Its writers load the image library when
they run, so that help does not.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.errors import InputError


@dataclass(frozen=True, eq=False)
class PictureContents:
    """What a picture file may hold; rows come in bands, from the top.

    Attributes
    ----------
    size : (height, width)
    image : callable
        Returns bands (rows, w, 1, 3 or 4) uint8 or uint16 of the tone-mapped picture: sRGB, alpha not multiplied in.
    layers : callable, optional
        Returns the names of linear channels, and bands (rows, w, c) float32 of them; None where they were not computed.
    profile : bytes, optional
        ICC profile of the image, where it is not sRGB.
    texts : mapping
        What is said of the picture, ASCII, by name.
    """

    size: tuple[int, ...]
    image: Callable[[], Iterable[npt.NDArray[np.unsignedinteger]]]
    layers: Callable[[], tuple[Sequence[str], Iterable[Float32]]] | None = None
    profile: bytes | None = None
    texts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class PictureFormat:
    """A format of pictures: how it is written, and what it holds.

    Attributes
    ----------
    write : callable
        Writes contents to a path, whole or not at all, or raises InputError.
    rendered, edited : str
        What it holds of a rendered scene and of an edited photograph, for help.
    linear : bool
        Whether it holds the layers, which then have to be computed.
    """

    write: Callable[[str | Path, PictureContents], None]
    rendered: str
    edited: str
    linear: bool


def _write_png(path: str | Path, contents: PictureContents) -> None:
    from milkglass.viewer.files.images import write_png_bands

    write_png_bands(path, contents.size, contents.image(), contents.profile, contents.texts)


def _write_exr(path: str | Path, contents: PictureContents) -> None:
    from milkglass.viewer.files.images import write_exr_bands

    assert contents.layers is not None
    names, bands = contents.layers()
    write_exr_bands(path, names, contents.size, bands, contents.texts)


PICTURE_FORMATS: dict[str, PictureFormat] = {
    ".png": PictureFormat(_write_png, "tone-mapped", "as many bits as the photo", linear=False),
    ".exr": PictureFormat(_write_exr, "linear", "layers", linear=True),
}


def format_of(path: str | os.PathLike[str]) -> PictureFormat:
    """Return the format that a path's suffix names.

    Raises
    ------
    InputError
        For a suffix that names none.
    """
    found = PICTURE_FORMATS.get(Path(path).suffix.lower())
    if found is None:
        raise InputError(f"{path} must end in {' or '.join(PICTURE_FORMATS)} to be written.")
    return found


def check_picture_output(path: str | os.PathLike[str], *, linear: bool = True) -> None:
    """Raise InputError if no picture can be written at path, to be called before any work is done.

    `linear` says whether formats that hold linear layers will do.
    """
    from milkglass.viewer.files.images import check_output

    check_output(path, [suffix for suffix, kind in PICTURE_FORMATS.items() if linear or not kind.linear])


def write_picture(path: str | Path, contents: PictureContents) -> None:
    """Write a picture in the format that its path's suffix names, whole or not at all.

    Raises
    ------
    InputError
        For a suffix that names no format of what there is, or a place that cannot be written.
    """
    check_picture_output(path, linear=contents.layers is not None)
    format_of(path).write(path, contents)
