"""Image files through OpenImageIO: pictures, light probes and photographs in, PNG and multi-channel EXR out.

Pixel arrays are (h, w, c), row 0 at the top. Every failure is an InputError of one sentence. Files are
written under a temporary name in the same folder and then renamed: no reader sees half a file, and nothing is
left behind.
"""

import contextlib
import io
import itertools
import os
import struct
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 (its own documentation's name)

from milkglass.core.errors import InputError
from milkglass.viewer.scene.given_file import check_given, reading
from milkglass.viewer.scene.whole_file import replacement

Pixels8 = npt.NDArray[np.uint8]
PixelsInt = npt.NDArray[np.unsignedinteger]  # uint8 or uint16
Pixels32 = npt.NDArray[np.float32]

PROBE_SUFFIXES = (".hdr", ".exr")
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
PHOTO_SUFFIXES = (*PICTURE_SUFFIXES, ".tif", ".tiff", ".webp", ".bmp")
MAX_PIXELS = 1 << 26  # 8192 x 8192: 800 MB of float32 RGB; no probe or photograph here gains from more
NO_TEXTS: Mapping[str, str] = MappingProxyType({})
BAND = 128  # rows of an EXR that are put together at once: 8 of its blocks, 12 MB of a frame of 1024 columns
_PNG_FILTER_AVERAGE = 64  # of libpng: each byte less the mean of those to the left and above
_FORMATS = {".hdr": "hdr", ".exr": "openexr", ".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}
_FORMATS |= {".tif": "tiff", ".tiff": "tiff", ".webp": "webp", ".bmp": "bmp"}


@dataclass(frozen=True)
class Stored:
    """An image as its file stores it, turned upright.

    Attributes
    ----------
    names : of the channels
    pixels : (h, w, c)
        Of the display window.
    attributes : of the header, by name
    cropped : whether the file has pixels outside the display window
    """

    names: list[str]
    pixels: npt.NDArray[np.generic]
    attributes: Mapping[str, Any]
    cropped: bool


def read_image(path: str | os.PathLike[str]) -> Pixels8 | Pixels32:
    """Read a picture: (h, w, c) uint8 as stored (PNG, JPEG; 16 bits are rounded to 8), float32 (EXR, HDR).

    Alpha of PNG stays unassociated. Channels of EXR are in the order of `read_channels`.

    Raises
    ------
    InputError
        If the file is missing, of another type, damaged or too large.
    """
    path = Path(path)
    if path.suffix.lower() in PROBE_SUFFIXES:
        return np.stack(list(read_channels(path).values()), axis=-1)
    return np.asarray(stored_image(path, PICTURE_SUFFIXES, "uint8").pixels, np.uint8)


def read_photo(path: str | os.PathLike[str]) -> tuple[PixelsInt, bytes | None]:
    """Read a photograph or a mask: (h, w, 1 to 4) uint8, or uint16 where it has more than 8 bits, and its ICC profile.

    Palettes and CMYK come as RGB, a turn that the camera noted is done, alpha stays unassociated. The profile is None
    where there is none for RGB. Errors as `read_image`.
    """
    path = Path(path)
    stored = stored_image(path, PHOTO_SUFFIXES, "", lambda names: names[:4])
    names, pixels = stored.names, stored.pixels
    if pixels.dtype == np.float32:
        raise InputError(f"{path} holds floating-point pixels: save it with 8 or 16 bits a channel.")
    source = oiio.ImageInput.open(str(path))
    assert source is not None  # it was just read
    spec = source.spec()
    fits = spec.get_string_attribute("ICCProfile:color_space") == "RGB" and len(names) >= 3
    profile = spec.getattribute("ICCProfile") if fits else None
    return np.asarray(pixels), None if profile is None else bytes(profile)


def read_channels(
    path: str | os.PathLike[str],
    suffixes: Collection[str] = PROBE_SUFFIXES,
    limit: int | None = None,
) -> dict[str, Pixels32]:
    """Read the channels of an EXR or HDR file by name, each (h, w) float32; at most `limit` of them.

    R, G, B and A come first, then the others sorted by name: the file format stores them sorted.
    """
    stored = stored_image(Path(path), suffixes, "float", lambda names: names[:limit])
    return {name: np.ascontiguousarray(stored.pixels[..., i], np.float32) for i, name in enumerate(stored.names)}


def check_output(path: str | os.PathLike[str], allowed_suffixes: Collection[str]) -> None:
    """Raise InputError if a file cannot be written at path, to be called before any work is done."""
    path = Path(path)
    if path.suffix.lower() not in allowed_suffixes:
        raise InputError(f"{path} must end in {' or '.join(allowed_suffixes)} to be written.")
    folder = path.parent
    try:
        if not folder.is_dir():
            raise InputError(f"The folder {folder} does not exist: create it to write {path.name} there.")
        if path.is_dir():
            raise InputError(f"{path} is a folder: name a file to write.")
        if not os.access(folder, os.W_OK | os.X_OK) or (path.exists() and not os.access(path, os.W_OK)):
            raise InputError(f"{path} cannot be written: change its permissions or choose another folder.")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error


def read_texts(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return the texts that a PNG or EXR file holds beside its pixels, by name; errors as `read_image`."""
    path = Path(path)
    _check_input(path, (".png", ".exr"))
    with reading(path, "the image"):
        source = oiio.ImageInput.open(str(path))
        if source is None:
            _drop_error(oiio.geterror)
            raise InputError(f"{path} cannot be read: it is damaged or not a {path.suffix} file.")
        attributes = source.spec().extra_attribs
        source.close()
        return {one.name: one.value for one in attributes if isinstance(one.value, str)}


def write_png(
    path: str | os.PathLike[str], pixels: PixelsInt, profile: bytes | None = None, texts: Mapping[str, str] = NO_TEXTS
) -> None:
    """Write (h, w, 1, 3 or 4) uint8 or uint16, sRGB with unassociated alpha, as a PNG, bit for bit.

    Tagged sRGB, or with the ICC profile given; `texts`, ASCII, are kept beside the pixels.
    """
    write_png_bands(path, pixels.shape[:2], [pixels], profile, texts)


def png_bytes(pixels: Pixels8) -> bytes:
    """Return the content of a PNG file of sRGB pixels, (h, w, 3 or 4) uint8: what a notebook shows."""
    from PIL import Image

    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "PNG")
    return content.getvalue()


def write_png_bands(
    path: str | os.PathLike[str],
    size: tuple[int, ...],
    bands: Iterable[PixelsInt],
    profile: bytes | None = None,
    texts: Mapping[str, str] = NO_TEXTS,
) -> None:
    """Write a PNG as `write_png`, whose rows come in bands (rows, w, 1, 3 or 4), from the top."""
    remaining = iter(bands)
    first = next(remaining)
    if first.dtype not in (np.uint8, np.uint16) or first.ndim != 3 or first.shape[2] not in (1, 3, 4):
        raise ValueError(f"pixels must be (h, w, 1, 3 or 4) uint8 or uint16, not {first.shape} {first.dtype}")
    spec = oiio.ImageSpec(size[1], size[0], first.shape[2], first.dtype.name)
    # Half the time of zlib's level 4 without a filter; files are 3 % smaller (photographs) to 11 % larger (windows).
    spec.attribute("compression", "rle")
    spec.attribute("png:filter", _PNG_FILTER_AVERAGE)
    if profile is None:
        spec.attribute("oiio:ColorSpace", "sRGB")
    else:
        spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8))
    spec.attribute("oiio:UnassociatedAlpha", 1)  # else colours are divided by alpha on the way out
    _say(spec, texts)
    _write(Path(path), ".png", spec, itertools.chain([first], remaining))


def write_exr(
    path: str | os.PathLike[str], channels: Mapping[str, Pixels32], texts: Mapping[str, str] = NO_TEXTS
) -> None:
    """Write named channels, each (h, w), as 32-bit float EXR with ZIP compression, and texts beside them.

    Names may have dots (`position.X`). The file format itself keeps channels sorted by name.
    """
    size = next(iter(channels.values())).shape if channels else ()
    if len(size) != 2 or any(plane.shape != size for plane in channels.values()):
        raise ValueError("channels must be one or more arrays of one shape (h, w)")
    write_exr_bands(path, tuple(channels), size, channel_bands(channels), texts)


def channel_bands(channels: Mapping[str, Pixels32]) -> Iterator[Pixels32]:
    """Yield channels, each (h, w), as bands (rows, w, c) of at most `BAND` rows, from the top."""
    planes = [np.asarray(plane, np.float32) for plane in channels.values()]
    for top in range(0, len(planes[0]), BAND):
        yield np.stack([plane[top : top + BAND] for plane in planes], axis=-1)


def write_exr_bands(
    path: str | os.PathLike[str],
    names: Sequence[str],
    size: tuple[int, ...],
    bands: Iterable[Pixels32],
    texts: Mapping[str, str] = NO_TEXTS,
) -> None:
    """Write an EXR as `write_exr`, whose rows come in bands (rows, w, c) of at most `BAND`, from the top."""
    spec = oiio.ImageSpec(size[1], size[0], len(names), "float")
    spec.channelnames = tuple(names)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "")  # the same picture gives the same bytes
    _say(spec, texts)
    _write(Path(path), ".exr", spec, bands)


def _say(spec: oiio.ImageSpec, texts: Mapping[str, str]) -> None:
    for name, text in texts.items():
        spec.attribute(name, text)


def stored_image(
    path: Path,
    suffixes: Collection[str],
    dtype: str,
    choose: Callable[[Sequence[str]], Sequence[str]] = list,
    opened: Path | None = None,
) -> Stored:
    """Return the first image in a file, of the channels that `choose` takes of all names, in its order.

    No dtype: as stored. `opened` is a file that stands in for that at `path`. Errors as `read_image`, and as `choose`.
    """
    _check_input(path, suffixes)
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # else colours are multiplied by alpha on the way in
    with reading(path, "the image"):
        source = _opened(str(opened or path), config)
        if source is None:
            raise InputError(f"{path} cannot be read: it is damaged or not a {path.suffix} file.")
        return _stored_pixels(source, path, dtype, choose)


def _opened(name: str, config: oiio.ImageSpec) -> oiio.ImageInput | None:
    """Open an image; None if that fails."""
    source = oiio.ImageInput.open(name, config)
    if source is not None or "Subsampled" not in _drop_error(oiio.geterror):
        return source
    # Only OpenEXR's older interface knows chroma of fewer pixels, and gives RGB.
    newer = oiio.get_int_attribute("openexr:core", 1)
    oiio.attribute("openexr:core", 0)
    try:
        source = oiio.ImageInput.open(name, config)
    finally:
        oiio.attribute("openexr:core", newer)
    if source is None:
        _drop_error(oiio.geterror)
    return source


def _stored_pixels(
    source: oiio.ImageInput, path: Path, dtype: str, choose: Callable[[Sequence[str]], Sequence[str]]
) -> Stored:
    """Return what `stored_image` returns, of a file that is open, and close it."""
    try:
        spec = source.spec()
        if source.format_name() != _FORMATS[path.suffix.lower()]:
            raise InputError(f"{path} holds {source.format_name()} data: rename it to its real type.")
        size = f"{spec.width}x{spec.height}"
        names = list(choose(spec.channelnames))
        at = [spec.channelnames.index(name) for name in names]
        first, last = min(at), max(at) + 1
        if spec.width * spec.height * max(1.0, (last - first) / 8) > MAX_PIXELS:
            raise InputError(f"{path} measures {size} pixels: reduce it to at most 8192x8192.")
        left, top = spec.full_x - spec.x, spec.full_y - spec.y
        right, bottom = left + spec.full_width, top + spec.full_height
        if min(left, top) < 0 or right > spec.width or bottom > spec.height or min(right - left, bottom - top) < 1:
            raise InputError(
                f"{path} stores a cropped window, {size} pixels of {spec.full_width}x{spec.full_height}: "
                "save the full picture."
            )
        dtype = dtype or _stored(spec.format)
        pixels = None if spec.deep else source.read_image(0, 0, first, last, dtype)
        if pixels is None:
            _drop_error(source.geterror)
            raise InputError(f"{path} cannot be read: it is cut short, damaged or has deep pixels.")
        _drop_error(source.geterror)  # of an attribute that was left out
        pixels = pixels[top:bottom, left:right]
        if at != list(range(first, last)):
            pixels = pixels[..., [index - first for index in at]]
        return Stored(
            names,
            upright(pixels, spec.get_int_attribute("Orientation", 1)),
            {attribute.name: attribute.value for attribute in spec.extra_attribs},
            (right - left, bottom - top) != (spec.width, spec.height),
        )
    finally:
        source.close()


def _drop_error(fetch: Callable[[], str]) -> str:
    """Fetch an error of OpenImageIO, which it would print at exit; one that quotes a damaged file may be no UTF-8."""
    with contextlib.suppress(UnicodeDecodeError):
        return fetch()
    return ""


def _stored(kind: oiio.TypeDesc) -> str:
    """Return the dtype that keeps what is stored: uint8, uint16 or float."""
    if kind.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
        return "float"
    return "uint8" if kind.basesize() == 1 else "uint16"


def _check_input(path: Path, suffixes: Collection[str]) -> None:
    with reading(path, "the image"):
        if path.is_dir():
            raise InputError(f"{path} is a folder: name an image file.")
        if not path.exists():
            raise InputError(f"{path} does not exist: check the path.")
        if path.suffix.lower() not in suffixes:
            raise InputError(f"{path} must end in {', '.join(suffixes)} to be read here.")
        check_given(path, "the image")
        # libpng would print its own complaints.
        damaged = path.suffix.lower() == ".png" and not _is_whole_png(path.read_bytes())
    if damaged:
        raise InputError(f"{path} cannot be read: it is cut short, damaged or not a PNG file.")


def _is_whole_png(content: bytes) -> bool:
    """Tell whether content is chunks of a PNG, each with its checksum, to the last; what follows that is left alone."""
    at = len(_PNG_START)
    if content[:at] != _PNG_START:
        return False
    while at + 12 <= len(content):
        length, name = struct.unpack_from(">I4s", content, at)
        chunk, at = content[at + 4 : at + 8 + length], at + 12 + length
        if at > len(content) or zlib.crc32(chunk) != struct.unpack_from(">I", content, at - 4)[0]:
            return False
        if name == b"IEND":
            return True
    return False


def upright(pixels: npt.NDArray[np.generic], orientation: int) -> npt.NDArray[np.generic]:
    """Return pixels turned by the EXIF orientation 1 to 8, which cameras and bottom-up HDR files set."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    flip_rows = orientation in (3, 4, 7, 8)
    flip_columns = orientation in (2, 3, 6, 7)
    return np.ascontiguousarray(pixels[:: -1 if flip_rows else 1, :: -1 if flip_columns else 1])


def _write(path: Path, suffix: str, spec: oiio.ImageSpec, bands: Iterable[npt.NDArray[np.generic]]) -> None:
    """Write an image whose rows come in bands, from the top."""
    check_output(path, (suffix,))
    output = oiio.ImageOutput.create(suffix[1:])
    if output is None:
        raise RuntimeError(f"this OpenImageIO cannot write {suffix} files: {oiio.geterror()}")
    try:
        with replacement(path) as temporary:
            written, top = output.open(str(temporary), spec), 0
            for band in bands if written else ():
                written = written and output.write_scanlines(top, top + len(band), 0, np.ascontiguousarray(band))
                top += len(band)
            written = output.close() and written
            output.geterror()  # fetched so that it is not printed at exit
            if not written or not is_complete(temporary, spec.height):
                raise InputError(f"{path} could not be written: check the free space and the permissions.")
    except OSError as error:
        raise InputError(f"{path} could not be written: {error.strerror}.") from error


_PNG_START = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"\0\0\0\0IEND\xaeB\x60\x82"  # the last chunk: length, name, checksum


def is_complete(path: Path, height: int) -> bool:
    """Return whether a file just written is complete.

    On a full disk OpenImageIO reports success for PNG, and for EXR too where only the last few kilobytes are missing.
    """
    if path.suffix == ".png":
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 12))
            return file.read() == _PNG_END
    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()
        return False
    last_row = source.read_scanline(height - 1, 0, "float")
    source.geterror()
    source.close()
    return last_row is not None
