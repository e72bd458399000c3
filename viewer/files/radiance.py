"""Light probes' files: radiance in linear Rec. 709, with what their headers say of colour, exposure and windows.

What is not as it should be is mended where one can, and every such step is one sentence.
"""

import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.viewer.files.images import PROBE_SUFFIXES, Pixels32, Stored, stored_image
from milkglass.viewer.scene.given_file import reading

# A resampled probe can undershoot next to a lamp. Negative values of at most this share of the sum are such
# ringing and become 0 without a word.
NEGATIVE_SHARE = 1e-3
WHOLE_PICTURE = ("combined", "beauty", "rgba")  # names of the layer that holds it, of Blender and of renderers for film
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # x, y of R, G, B and white (ITU-R BT.709)
_AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)  # SMPTE ST 2065-1
_AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # Academy S-2014-004
_REC2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
_P3D65 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
_XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
SPACES = {
    **dict.fromkeys(("lin_rec709", "lin_rec709_scene", "lin_srgb", "linear", "scene_linear"), REC709),
    **dict.fromkeys(("acescg", "lin_ap1", "lin_ap1_scene"), _AP1),
    **dict.fromkeys(("aces2065_1", "lin_ap0", "lin_ap0_scene"), _AP0),
    **dict.fromkeys(("lin_rec2020", "lin_rec2020_scene"), _REC2020),
    **dict.fromkeys(("lin_p3d65", "lin_p3d65_scene"), _P3D65),
    **dict.fromkeys(("xyz", "lin_ciexyzd65_scene"), _XYZ),
}
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_BLOCK = 1 << 18  # pixels at a time, whose neighbours are gathered
_XYZE, _RGBE = b"32-bit_rle_xyze", b"32-bit_rle_rgbe"
_HEADER_BYTES = 1 << 16


def read_radiance(path: str | os.PathLike[str]) -> Pixels32:
    """Return the radiance of a light probe's file, as `read_probe`, without its sentences."""
    return read_probe(path)[0]


def read_probe(path: str | os.PathLike[str]) -> tuple[Pixels32, tuple[str, ...]]:
    """Return the radiance of a light probe's file, and what was done to have it.

    Parameters
    ----------
    path : path of a .hdr or .exr file

    Returns
    -------
    pixels : (h, w, 3) float32
        Radiance, linear Rec. 709, finite and >= 0; one channel is repeated. NaN became the median of finite
        neighbours, infinity the largest finite value of its channel, what is negative 0.
    said : tuple of str
        Sentences on conversions and repairs; slight ringing below 0 needs none.

    Raises
    ------
    InputError
        If the file cannot be read or is too large, has no RGB or several layers that do, has more NaN and infinite
        pixels than others, or says of its colours what cannot be.
    """
    path = Path(path)
    said: list[str] = []
    header = _RadianceHeader.of(path) if path.suffix.lower() == ".hdr" else None
    if header is not None and header.is_xyz:
        # OpenImageIO reads no XYZE, whose bytes are those of RGBE.
        with reading(path, "the image"), tempfile.TemporaryDirectory() as folder:
            twin = Path(folder, "probe.hdr")
            twin.write_bytes(path.read_bytes().replace(_XYZE, _RGBE, 1))
            image = stored_image(path, PROBE_SUFFIXES, "float", _channels(path, said), opened=twin)
    else:
        image = stored_image(path, PROBE_SUFFIXES, "float", _channels(path, said))
    if image.cropped:
        said.append("what lies outside its display window was left out")
    pixels = np.array(image.pixels, np.float32)
    said += _repair(path, pixels)
    stated, space = _chromaticities(image) if header is None else header.chromaticities
    if set(image.names) == {"Y", "RY", "BY"}:
        order = [image.names.index(name) for name in ("Y", "RY", "BY")]
        pixels = _from_chroma(pixels[..., order], _usable(path, stated))
        said.append("luminance and chroma were converted to RGB")
    elif len(image.names) == 1:
        pixels, stated = np.repeat(pixels, 3, axis=2), REC709
    if header is not None and not np.all(header.scale == 1.0):
        pixels = (pixels / header.scale).astype(np.float32)
        said.append(f"EXPOSURE and COLORCORR of its header were divided out ({_numbers(header.scale)})")
    if stated is None:
        said.append(f'its colour space "{space}" is not known, and it was read as linear Rec. 709')
    elif not np.allclose(_usable(path, stated), REC709, atol=2e-3):
        pixels = (pixels @ to_rec709(stated).T).astype(np.float32)
        said.append(f"its colours ({space}) were converted to linear Rec. 709")
    negative = pixels < 0.0
    if negative.any():
        if -pixels[negative].sum(dtype=np.float64) > NEGATIVE_SHARE * np.abs(pixels).sum(dtype=np.float64):
            said.append(f"{_count(negative)} with negative radiance became 0 there")
        pixels[negative] = 0.0
    return pixels, tuple(f"{path}: {sentence}." for sentence in said)


def to_rec709(chromaticities: Sequence[float]) -> Array:
    """Return what turns linear colours into those of Rec. 709, (3, 3): pixels @ it.T.

    Parameters
    ----------
    chromaticities : 8 floats
        CIE x, y of red, green, blue and white. White is adapted to D65 (Bradford), but that of the XYZ axes
        themselves, whose pixels are tristimulus values of a light as it is, not colours under another white.
    """
    matrix, target = rgb_to_xyz(chromaticities), rgb_to_xyz(REC709)
    if not np.allclose(chromaticities[:6], _XYZ[:6], atol=1e-3):
        source_white, target_white = (_BRADFORD @ columns.sum(axis=1) for columns in (matrix, target))
        matrix = np.linalg.solve(_BRADFORD, (target_white / source_white)[:, None] * _BRADFORD) @ matrix
    return np.asarray(np.linalg.solve(target, matrix))


def rgb_to_xyz(chromaticities: Sequence[float]) -> Array:
    """Return CIE XYZ of R, G and B as columns, (3, 3), white having Y = 1 (SMPTE RP 177); see `to_rec709`."""
    x, y = np.reshape(np.asarray(chromaticities, np.float64), (4, 2)).T
    columns = np.stack([x, y, 1.0 - x - y])
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3] / y[3])


class _RadianceHeader:
    """What the header of a Radiance picture says of its values."""

    def __init__(self, scale: Array, chromaticities: tuple[tuple[float, ...], str], *, is_xyz: bool) -> None:
        self.scale, self.chromaticities, self.is_xyz = scale, chromaticities, is_xyz

    @classmethod
    def of(cls, path: Path) -> "_RadianceHeader":
        """Read the header; `stored_image` says what is wrong with a file that has none."""
        stated: tuple[tuple[float, ...], str] = REC709, "Rec. 709"
        scale, is_xyz = np.ones(3), False
        start = b""
        if path.is_file():
            with reading(path, "the image"), path.open("rb") as file:
                start = file.read(_HEADER_BYTES)
        for line in start.replace(b"\r", b"").split(b"\n\n", 1)[0].split(b"\n"):
            key, _, value = line.partition(b"=")
            name = key.strip().upper()
            if name == b"FORMAT":
                is_xyz = value.strip() == _XYZE
            elif name in (b"EXPOSURE", b"COLORCORR"):  # each may be given several times; they multiply
                numbers = _floats(path, value, 1 if name == b"EXPOSURE" else 3)
                if not numbers.min() > 0.0:
                    raise InputError(f"{path} has {_text(line)} in its header, which is not positive: correct it.")
                scale = scale * numbers
            elif name == b"PRIMARIES":
                stated = tuple(float(number) for number in _floats(path, value, 8)), "PRIMARIES"
        return cls(scale, (_XYZ, "XYZ") if is_xyz else stated, is_xyz=is_xyz)


def _floats(path: Path, text: bytes, count: int) -> Array:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f'{path} has "{_text(text)}" in its header in place of {count} numbers: correct it.')
    return numbers


def _text(line: bytes) -> str:
    return line[:60].decode("ascii", "replace").strip()


def _numbers(scale: Array) -> str:
    return ", ".join(f"{number:g}" for number in (scale[:1] if np.ptp(scale) == 0.0 else scale))


def _channels(path: Path, said: list[str]) -> Callable[[Sequence[str]], Sequence[str]]:
    """Return what chooses the channels of a picture by their names, and says so of a layer."""

    def choose(names: Sequence[str]) -> Sequence[str]:
        layers: dict[str, dict[str, str]] = {}
        for name in names:
            layer, _, channel = name.rpartition(".")
            layers.setdefault(layer, {})[channel.upper()] = name
        coloured = {layer: found for layer, found in layers.items() if {"R", "G", "B"} <= found.keys()}
        whole = [layer for layer in coloured if layer.rpartition(".")[2].casefold() in WHOLE_PICTURE]
        candidates = [""] if "" in coloured else list(coloured) if len(coloured) == 1 else whole
        if len(candidates) == 1:
            if candidates[0]:
                said.append(f"its layer {candidates[0]} was read")
            return [coloured[candidates[0]][channel] for channel in "RGB"]
        if coloured:
            raise InputError(f"{path} has colours in the layers {', '.join(coloured)}: save the one of light alone.")
        if {"Y", "RY", "BY"} <= set(names):
            return ["Y", "RY", "BY"]
        if "Y" in names or len(names) == 1:
            return ["Y"] if "Y" in names else list(names)
        raise InputError(f"{path} has no R, G and B but {', '.join(names)}: save a colour picture.")

    return choose


def _chromaticities(image: Stored) -> tuple[Sequence[float] | None, str]:
    """Return the chromaticities that an EXR's header states, and by which name; None of an unknown name."""
    numbers = image.attributes.get("chromaticities")
    if numbers is not None and len(numbers) == 8:
        return numbers, "chromaticities"
    names = (image.attributes.get(key) for key in ("colorInteropID", "oiio:ColorSpace", "colorspace", "colorSpace"))
    name = next((name for name in names if isinstance(name, str) and name), "linear")
    return SPACES.get(name.casefold().replace(" ", "_").replace("-", "_")), name


def _usable(path: Path, chromaticities: Sequence[float] | None) -> Sequence[float]:
    """Return chromaticities that span colours; those of Rec. 709 for none."""
    if chromaticities is None:
        return REC709
    x, y = np.reshape(np.asarray(chromaticities, np.float64), (4, 2)).T
    columns = np.stack([x, y, 1.0 - x - y])
    if not (np.isfinite(columns).all() and y[3] > 0.0 and abs(np.linalg.det(columns[:, :3])) > 1e-6):
        raise InputError(f"{path} states primaries that span no colours: correct or remove them.")
    return chromaticities


def _from_chroma(pixels: Pixels32, chromaticities: Sequence[float]) -> Pixels32:
    """Return RGB (h, w, 3) of Y, RY = (R - Y) / Y and BY = (B - Y) / Y, as OpenEXR defines them."""
    weights = rgb_to_xyz(chromaticities)[1]
    y, ry, by = np.moveaxis(pixels.astype(np.float64), -1, 0)
    red, blue = (ry + 1.0) * y, (by + 1.0) * y
    return np.stack([red, (y - weights[0] * red - weights[2] * blue) / weights[1], blue], -1).astype(np.float32)


def _repair(path: Path, pixels: Pixels32) -> list[str]:
    """Replace NaN and infinite values of pixels (h, w, c) in place; returns sentences on how many."""
    undefined, infinite = np.isnan(pixels), np.isinf(pixels)
    bad = undefined | infinite
    if not bad.any():
        return []
    if bad.any(axis=-1).mean() > 0.5:
        raise InputError(f"{path} has {_count(bad)} with NaN or infinite radiance, more than others: repair it first.")
    for channel in range(pixels.shape[2]):
        plane = pixels[..., channel]  # a view
        finite = np.where(bad[..., channel], np.nan, plane)
        rows, columns = np.nonzero(undefined[..., channel])
        for start in range(0, len(rows), _BLOCK):
            part = slice(start, start + _BLOCK)
            plane[rows[part], columns[part]] = _neighbours(finite, rows[part], columns[part])
        largest = np.nanmax(finite)
        plane[np.isposinf(plane)], plane[np.isneginf(plane)] = largest, 0.0
    said = []
    if undefined.any():
        said.append(f"{_count(undefined)} with NaN took the median of their neighbours")
    if infinite.any():
        said.append(f"{_count(infinite)} with infinite radiance took the largest finite one, 0 where it was negative")
    return said


def _neighbours(plane: npt.NDArray[np.float32], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Pixels32:
    """Return the median of what is finite around each place, (k,); of the whole plane where nothing is."""
    steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    height, width = plane.shape
    around = np.stack(
        [plane[np.clip(rows + i, 0, height - 1), np.clip(columns + j, 0, width - 1)] for i, j in steps], -1
    )
    around[np.isnan(around).all(axis=-1)] = np.nanmedian(plane)
    return np.asarray(np.nanmedian(around, axis=-1), np.float32)


def _count(mask: npt.NDArray[np.bool_]) -> str:
    """Return "3 pixels" of a mask (h, w, c)."""
    count = int(mask.any(axis=-1).sum())
    return f"{count:,} pixel{'' if count == 1 else 's'}"
