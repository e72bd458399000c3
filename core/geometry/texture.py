"""Textures of a surface on the CPU: pictures over texture coordinates, with their mip levels (Williams 1983).

Samples and the reference stand for pieces of the surface, so they need means over pieces. Texture coordinates
have their origin at the lower left, u to the right and v up, and repeat beyond [0, 1], as glTF and OBJ have them.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Bytes, Float32

COLOUR, NORMAL = "colour", "normal"
MAX_TEXELS = 1024  # texels along a side of the finest level held as floats: samples are no denser


def linear(srgb: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return linear values of sRGB in [0, 1] (IEC 61966-2-1)."""
    x = np.asarray(srgb, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


class Texture:
    """An RGB picture with its mip levels; compared by identity, so that it can be a cache key.

    Parameters
    ----------
    pixels : (h, w, 3) uint8
        Row 0 at the top. A colour is sRGB; a normal is (v - 128) / 127 along u, along v and outwards.
    kind : str
        ``COLOUR`` or ``NORMAL``, the encoding of the bytes.
    """

    def __init__(self, pixels: Bytes, kind: str = COLOUR) -> None:
        self.pixels = np.ascontiguousarray(pixels[::-1])  # row 0 at v = 0, as OpenGL has it
        self.kind = kind
        self._levels: dict[float, list[Float32]] = {}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in texels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def levels(self, power: float = 1.0) -> list[Float32]:
        """Return the mip levels, (h, w, 3) each half the one before: means of linear colour^power, or of normals."""
        levels = self._levels.get(power)
        if levels is None:
            levels = [self._finest(power)]
            while max(levels[-1].shape[:2]) > 1:
                levels.append(_halved(levels[-1]))
            self._levels = {power: levels}
        return levels

    def mean(
        self, coordinates: npt.NDArray[np.floating], area: npt.NDArray[np.floating], power: float = 1.0
    ) -> Float32:
        """Return trilinear means (n, 3) about texture coordinates (n, 2) over areas (n,) of the unit square."""
        levels = self.levels(power)
        height, width = levels[0].shape[:2]
        level = 0.5 * np.log2(np.maximum(area * (width * height), 1.0))
        level = np.minimum(level, len(levels) - 1)
        lower = np.floor(level).astype(np.intp)
        found = np.empty((len(level), 3), np.float32)
        for k in np.unique(lower):
            rows = np.flatnonzero(lower == k)
            values = _bilinear(levels[k], coordinates[rows])
            share = (level[rows] - k)[:, None].astype(np.float32)
            if share.any():
                values += share * (_bilinear(levels[k + 1], coordinates[rows]) - values)
            found[rows] = values
        return found

    def _finest(self, power: float) -> Float32:
        """Return the finest level, averaged so that no side exceeds `MAX_TEXELS`; by bands, to save memory."""
        table = _decoding(self.kind) ** np.float32(power) if self.kind == COLOUR else _decoding(self.kind)
        height, width = self.pixels.shape[:2]
        step = max(1, max(height, width) // (2 * MAX_TEXELS))  # two texels a side make a mean; more would be slow
        pixels = self.pixels[step // 2 :: step, step // 2 :: step]
        height, width = pixels.shape[:2]
        factor = -(-max(height, width) // MAX_TEXELS)
        padded = np.pad(pixels, ((0, -height % factor), (0, -width % factor), (0, 0)), mode="edge")
        rows, columns = padded.shape[0] // factor, padded.shape[1] // factor
        finest = np.empty((rows, columns, 3), np.float32)
        for first in range(0, rows, 64):
            band = table[padded[first * factor : (first + 64) * factor]]
            if self.kind == NORMAL:  # a length below 1 from rounding to bytes is no roughness
                band /= np.maximum(np.linalg.norm(band, axis=2, keepdims=True), 1e-6)
            finest[first : first + 64] = band.reshape(-1, factor, columns, factor, 3).mean(axis=(1, 3))
        return finest


def _decoding(kind: str) -> Float32:
    """Return the value of each byte, (256,)."""
    byte = np.arange(256)
    values = linear(byte / 255.0) if kind == COLOUR else np.maximum((byte - 128) / 127.0, -1.0)
    return values.astype(np.float32)


def _halved(level: Float32) -> Float32:
    height, width = level.shape[:2]
    padded = np.pad(level, ((0, height % 2 if height > 1 else 0), (0, width % 2 if width > 1 else 0), (0, 0)), "edge")
    if height > 1:
        padded = 0.5 * (padded[::2] + padded[1::2])
    if width > 1:
        padded = 0.5 * (padded[:, ::2] + padded[:, 1::2])
    return np.asarray(padded, np.float32)


def _bilinear(level: Float32, coordinates: npt.NDArray[np.floating]) -> Float32:
    """Return a level's values at coordinates (n, 2) as GL filters: texel centres at half integers, repeating."""
    height, width = level.shape[:2]
    x, y = (np.mod(coordinates[:, i], 1.0) * side - 0.5 for i, side in enumerate((width, height)))
    left, low = np.floor(x), np.floor(y)
    fx, fy = ((value - floor)[:, None].astype(np.float32) for value, floor in ((x, left), (y, low)))
    j0, i0 = left.astype(np.intp) % width, low.astype(np.intp) % height
    j1, i1 = (j0 + 1) % width, (i0 + 1) % height
    lower = level[i0, j0] + fx * (level[i0, j1] - level[i0, j0])
    upper = level[i1, j0] + fx * (level[i1, j1] - level[i1, j0])
    return np.asarray(lower + fy * (upper - lower), np.float32)
