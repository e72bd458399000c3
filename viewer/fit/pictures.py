"""Pictures of an object as linear radiance, with the pixels that count."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bools
from milkglass.core.display import linear
from milkglass.core.errors import InputError
from milkglass.viewer.files.images import PROBE_SUFFIXES, read_channels, read_photo

LEAST_SIDE = 16  # pixels, as of any picture
CLIPPED = 4  # pixels of one value, the largest, from which on it is where the sensor or the file ended
COVERED = 0.5  # of a mask's pixel, from which on it counts


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of an object.

    Attributes
    ----------
    name : str
        What sentences call it.
    pixels : (h, w, 3) float64
        Linear RGB, of any unit.
    counts : (h, w, 3) bool
        Where it says something: not clipped, finite, and in its mask.
    """

    name: str
    pixels: Array
    counts: Bools

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @classmethod
    def of(cls, pixels: npt.ArrayLike, mask: npt.ArrayLike | None = None, name: str = "the picture") -> "Picture":
        """Return the picture of linear RGB (h, w, 3), in a mask (h, w) if there is one.

        Raises
        ------
        InputError
            For another shape, or a picture of nothing but black.
        """
        values = np.asarray(pixels, np.float64)
        if values.ndim != 3 or values.shape[2] != 3 or min(values.shape[:2]) < LEAST_SIDE:
            raise InputError(f"{name} must have R, G and B and {LEAST_SIDE} pixels or more on each side")
        counts = np.isfinite(values)
        values = np.where(counts, values, 0.0)
        for channel in range(3):
            largest = values[..., channel].max()
            at_end = values[..., channel] == largest
            if np.count_nonzero(at_end) >= CLIPPED:
                counts[..., channel] &= ~at_end
        if mask is not None:
            covered = np.asarray(mask, np.float64)
            if covered.shape != values.shape[:2]:
                width, height = covered.shape[1], covered.shape[0]
                raise InputError(
                    f"the mask of {name} measures {width}x{height} pixels, and {name} {values.shape[1]}x"
                    f"{values.shape[0]}; make the mask of the same picture, at the same size"
                )
            counts &= (covered > COVERED)[..., None]
        if not values[counts].any():
            raise InputError(f"{name} is black or clipped wherever it counts; expose it so that the object is seen")
        return cls(name, values, counts)

    def reduced(self, size: tuple[int, int]) -> "Picture":
        """Return means over the areas of the pixels of a smaller size (width, height); one counts where all do."""
        (columns, rows), uncounted = size, (~self.counts).astype(np.float64)
        across, down = _areas(self.size[0], columns), _areas(self.size[1], rows)

        def means(values: Array) -> Array:
            return np.asarray(np.einsum("ih,hwc,jw->ijc", down, values, across, optimize=True))

        return Picture(self.name, means(self.pixels), means(uncounted) < 1e-6)


def _areas(many: int, few: int) -> Array:
    """Return the share of each of many pixels in a row in each of few, (few, many); rows sum to 1."""
    edges = np.arange(few + 1) * (many / few)
    starts = np.arange(many)
    shared = np.minimum(edges[1:, None], starts + 1.0) - np.maximum(edges[:-1, None], starts)
    return np.asarray(np.maximum(shared, 0.0) * (few / many))


def read_picture(path: str | os.PathLike[str], mask: str | os.PathLike[str] | None = None) -> Picture:
    """Read a picture: ``.exr`` and ``.hdr`` are linear, all others are decoded from sRGB; errors as `Picture.of`.

    Its mask is a picture of the same size, white where it counts.
    """
    path = Path(path)
    if path.suffix.lower() in PROBE_SUFFIXES:
        channels = read_channels(path)
        if not {"R", "G", "B"} <= channels.keys():
            raise InputError(f"{path} has no channels R, G and B; it has {', '.join(list(channels)[:6])}")
        pixels: npt.NDArray[np.floating] = np.stack([channels[name] for name in "RGB"], axis=-1)
    else:
        stored, _ = read_photo(path)
        if stored.shape[2] < 3:
            raise InputError(f"{path} is grey; the three channels of a material need one in colour")
        pixels = linear(stored[..., :3] / np.float32(np.iinfo(stored.dtype).max))
    return Picture.of(pixels, None if mask is None else _mask(Path(mask)), str(path))


def _mask(path: Path) -> Array:
    stored, _ = read_photo(path)
    return np.asarray(stored[..., : 3 if stored.shape[2] >= 3 else 1].mean(axis=2) / np.iinfo(stored.dtype).max)
