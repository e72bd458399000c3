"""A photograph with the mask of an object in it: read, checked, and reduced to what each step needs.

Pixels stay as they were stored, 8 or 16 bits: what is computed of them comes in bands of rows, so that a large
photograph needs little more memory than itself.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.display import linear
from milkglass.core.errors import InputError
from milkglass.core.threads import thread_pool
from milkglass.viewer.files.images import PixelsInt, read_photo

LEAST_SIDE = 16  # pixels of a photograph, as of any picture
MIN_SIDE = 8  # pixels of the outline's longer side
# Coverage below the first counts as none and above the second as full: what JPEG leaves around an edge.
NO_COVERAGE, FULL_COVERAGE = 0.02, 0.98
_BAND_PIXELS = 1 << 20


@dataclass(frozen=True)
class Region:
    """A rectangle of a photograph, in pixels; may reach beyond it, where the photograph's edge goes on."""

    top: int
    left: int
    height: int
    width: int


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph and a mask.

    Attributes
    ----------
    path, mask_path : Path
    pixels : (h, w, 3) uint8 or uint16, sRGB
    alpha : (h, w) of the same type, or None
    mask : (h, w) uint8 or uint16
    profile : bytes, optional
        ICC profile.
    """

    path: Path
    mask_path: Path
    pixels: PixelsInt
    alpha: PixelsInt | None
    mask: PixelsInt
    profile: bytes | None
    _linear: Float32 = field(init=False, repr=False)
    _coverage: Float32 = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Tables: 8 and 16 bits have few values, and a photograph many pixels.
        object.__setattr__(self, "_linear", linear(_levels(self.pixels)))
        coverage = np.clip((_levels(self.mask) - NO_COVERAGE) / (FULL_COVERAGE - NO_COVERAGE), 0.0, 1.0)
        object.__setattr__(self, "_coverage", coverage.astype(np.float32))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the photograph, pixels."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def full_region(self) -> Region:
        """The region of the whole photograph."""
        return Region(0, 0, *self.size)

    @property
    def outline(self) -> Region:
        """The smallest rectangle around the object.

        Raises
        ------
        InputError
            If there is none, or it is too small.
        """
        present = self.mask > int(NO_COVERAGE * np.iinfo(self.mask.dtype).max)
        rows, columns = np.flatnonzero(present.any(axis=1)), np.flatnonzero(present.any(axis=0))
        if len(rows) == 0:
            raise InputError(f"{self.mask_path} is empty: paint the object white, the rest black")
        region = Region(int(rows[0]), int(columns[0]), int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1)
        if max(region.height, region.width) < MIN_SIDE:
            raise InputError(
                f"{self.mask_path} shows an object of {region.width}x{region.height} pixels: it needs {MIN_SIDE} at "
                "least; take a larger photograph"
            )
        return region

    def linear(self, region: Region) -> Float32:
        """Return linear RGB of a region in [0, 1]: (height, width, 3)."""
        return np.asarray(self._linear.take(_cut(self.pixels, region)))

    def linear_at(self, rows: npt.NDArray[np.integer], columns: npt.NDArray[np.integer]) -> Float32:
        """Return linear RGB of k pixels in [0, 1]: (k, 3)."""
        return np.asarray(self._linear.take(self.pixels[rows, columns]))

    def coverage(self, region: Region) -> Float32:
        """Return the share of each pixel that the object covers, from the mask: (height, width)."""
        return np.asarray(self._coverage.take(_cut(self.mask, region)))

    def reduced(self, region: Region, block: int) -> tuple[Float32, Float32]:
        """Return means over squares of `block` pixels of linear RGB (h, w, 3) and of coverage (h, w).

        Height and width of the region are multiples of `block`.
        """
        colours, coverages = [], []
        for band in bands(region, block):
            colours.append(_means(self.linear(band), block))
            coverages.append(_means(self.coverage(band)[..., None], block)[..., 0])
        return np.concatenate(colours), np.concatenate(coverages)


def load_photo(path: Path, mask_path: Path | None) -> Photo:
    """Read a photograph and the mask of its object.

    The mask is white where the object is; one with an alpha channel is opaque there instead. None is an empty mask.

    Raises
    ------
    InputError
        Files that cannot be read, or do not belong together.
    """
    painted = None if mask_path is None else thread_pool().submit(read_photo, mask_path)
    pixels, profile = read_photo(path)
    if min(pixels.shape[:2]) < LEAST_SIDE:
        raise InputError(
            f"{path} measures {pixels.shape[1]}x{pixels.shape[0]} pixels: take one of {LEAST_SIDE}x{LEAST_SIDE} or more"
        )
    mask: PixelsInt
    if mask_path is None or painted is None:
        mask_path, mask = Path("the mask"), np.zeros(pixels.shape[:2], np.uint8)
    else:
        mask = _mask(painted.result()[0])
    if mask.shape != pixels.shape[:2]:
        raise InputError(
            f"{mask_path} measures {mask.shape[1]}x{mask.shape[0]} pixels but {path} {pixels.shape[1]}x"
            f"{pixels.shape[0]}: make the mask of the same picture, at the same size"
        )
    alpha = np.asarray(pixels[..., -1], pixels.dtype) if pixels.shape[2] in (2, 4) else None
    colour = pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    # Absolute, as scenes have paths: its light goes by this name.
    return Photo(Path(os.path.abspath(path)), mask_path, np.asarray(colour, pixels.dtype), alpha, mask, profile)


def bands(region: Region, block: int = 1) -> Iterator[Region]:
    """Yield the bands of rows of a region, from the top, each a multiple of `block` high."""
    rows = max(1, _BAND_PIXELS // max(1, region.width * block)) * block
    for start in range(0, region.height, rows):
        yield Region(region.top + start, region.left, min(rows, region.height - start), region.width)


def _mask(pixels: PixelsInt) -> PixelsInt:
    """One plane: alpha where it says something, else the mean of the colours."""
    if pixels.shape[2] in (2, 4) and pixels[..., -1].min() < pixels[..., -1].max():
        return np.asarray(pixels[..., -1], pixels.dtype)
    colour = pixels[..., : 1 if pixels.shape[2] < 3 else 3]
    if colour.shape[2] == 1:
        return np.asarray(colour[..., 0], pixels.dtype)
    return np.asarray(colour.mean(axis=2), pixels.dtype)


def _levels(pixels: PixelsInt) -> Float32:
    """Every value that the type has, in [0, 1]."""
    maximum = int(np.iinfo(pixels.dtype).max)
    return (np.arange(maximum + 1) / maximum).astype(np.float32)


def _cut(plane: PixelsInt, region: Region) -> PixelsInt:
    """Cut a region out; beyond the photograph its edge goes on."""
    h, w = plane.shape[:2]
    bottom, right = region.top + region.height, region.left + region.width
    if region.top >= 0 and region.left >= 0 and bottom <= h and right <= w:
        return plane[region.top : bottom, region.left : right]
    rows = np.clip(np.arange(region.top, bottom), 0, h - 1)
    columns = np.clip(np.arange(region.left, right), 0, w - 1)
    return np.asarray(plane.take(rows, axis=0).take(columns, axis=1), plane.dtype)


def _means(values: Float32, block: int) -> Float32:
    if block == 1:
        return values
    h, w, c = values.shape
    # Rows first: sums along memory.
    rows = values.reshape(h // block, block, w * c).sum(axis=1)
    return np.asarray(rows.reshape(h // block, w // block, block, c).sum(axis=2) / block**2, np.float32)
