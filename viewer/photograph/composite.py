"""The edited object back in its photograph, band by band: soft edges, the photograph's tone curve and bits.

Pixels farther than three from the mask, counted along rows and columns, stay what they were, bit for bit.
"""

import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.display import srgb, tone_map
from milkglass.core.photograph.surround import filled, scene_radiance
from milkglass.core.threads import computed_once, thread_pool
from milkglass.viewer.files.images import BAND, PixelsInt
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.photograph.edit import Edited
from milkglass.viewer.photograph.enlarge import enlarged, sampled
from milkglass.viewer.photograph.geometry import Geometry

Ints = npt.NDArray[np.intp]

BACKGROUNDS = ("filled", "seen")  # what soft edges show: the background without the object, or the photograph as it is
LAYER_CHANNELS = {"irradiance": "RGB", "exitance": "RGB", "subsurface": "RGB", "specular": "RGB", "position": "XYZ",
          "normal": "XYZ"}  # fmt: skip
GRAZING_COSINE = 0.3  # between surface and camera; below it the object takes the colour of what is beside
_EDGE_MARGIN = 2  # rows and columns that an edge pixel looks at, and that the object changes around its outline


class Compositor:
    """Puts an object into its photograph.

    Parameters
    ----------
    edited : Edited
    behind : str
        One of `BACKGROUNDS`.
    """

    def __init__(self, edited: Edited, behind: str = "filled") -> None:
        self._edited, self._fill = edited, behind == "filled"
        self._framing = edited.geometry.framing
        self._known = trusted(edited.geometry) * edited.coverage
        mean = edited.radiance / np.maximum(edited.coverage, 1e-6)[..., None]
        self._radiance = np.float32(edited.exposure) * self._continued(mean)

    def picture(self, *, transparent: bool = False) -> PixelsInt:
        """Return the photograph with the object, (h, w, 3 or 4) of the photograph's type.

        `transparent`: the object alone, with alpha that is not multiplied in.
        """
        return np.concatenate(list(self.bands(transparent=transparent)))

    def bands(self, *, transparent: bool = False) -> Iterator[PixelsInt]:
        """Return the picture in bands of at most `BAND` rows, from the top; some are computed ahead."""
        h, w = self._edited.photo.size
        rows = (Region(top, 0, min(BAND, h - top), w) for top in range(0, h, BAND))
        return ahead(lambda place: self._developed(place, transparent=transparent), rows)

    @computed_once
    def _shown(self) -> Float32:
        """The object's radiance under the photograph's tone curve, linear in [0, 1]."""
        return np.minimum(tone_map(self._radiance, 1.0, self._edited.white), 1.0).astype(np.float32)

    def _developed(self, rows: Region, *, transparent: bool) -> PixelsInt:
        """Return rows of the picture, (h, w, 3 or 4)."""
        photo = self._edited.photo
        out = _beside(photo, rows, transparent=transparent)
        place = _common(rows, _grown(photo.outline, _EDGE_MARGIN))
        if place.height <= 0 or place.width <= 0:
            return out
        top, full_scale = place.top - rows.top, int(np.iinfo(photo.pixels.dtype).max)
        target = out[top : top + place.height, place.left : place.left + place.width]
        alpha, near = edges(photo, place)
        touched = near > 0.0 if self._fill and not transparent else alpha > 0.0
        colour = self._object(place, self._shown)
        if not transparent:
            at = np.nonzero(touched & (alpha < 1.0))
            behind = photo.linear_at(at[0] + place.top, at[1] + place.left)
            if self._fill:
                # Pixels at the edge hold some of the object's old material.
                behind += near[at][:, None] * (self._behind(place, *at) - behind)
            colour[at] = behind + alpha[at][:, None] * (colour[at] - behind)
        shown = encoded(colour, full_scale)
        for i in range(3):  # one mask for all three would be copied six times as slowly
            np.copyto(target[..., i], shown[..., i], where=touched)
        if transparent:
            target[..., 3] = _quantised(alpha, full_scale)
        elif photo.alpha is not None:  # where there is an object, there is no hole
            target[..., 3] = np.maximum(target[..., 3], _quantised(alpha, full_scale))
        return out

    def layers(self) -> tuple[tuple[str, ...], Iterator[Float32]]:
        """Return the names of the layers, and bands of them for `files.images.write_exr_bands`; needs the parts."""
        names = [*"RGBA", *(f"object.{c}" for c in "RGBA"), *(f"background.{c}" for c in "RGB"), "depth.Z"]
        names += [f"{layer}.{c}" for layer, letters in LAYER_CHANNELS.items() for c in letters]
        return tuple(names), self._layer_bands()

    def _layer_bands(self) -> Iterator[Float32]:
        photo, frame, exposure = self._edited.photo, self._edited.frame, self._edited.exposure
        assert frame is not None
        parts = {name: self._continued(getattr(frame, name)) for name in LAYER_CHANNELS}
        full_scale = np.float32(np.iinfo(photo.pixels.dtype).max)
        for top in range(0, photo.size[0], BAND):
            place = Region(top, 0, min(BAND, photo.size[0] - top), photo.size[1])
            alpha, near = (edge[..., None] for edge in edges(photo, place))
            shown, behind = self._object(place, self._radiance), photo.linear(place)
            if self._fill:
                at = np.nonzero(near[..., 0] > 0.0)
                behind = behind.copy()
                behind[at] += near[at] * (self._behind(place, *at) - behind[at])
            behind = scene_radiance(behind, self._edited.white)
            rows = slice(place.top, place.top + place.height)
            opaque = np.ones_like(alpha) if photo.alpha is None else photo.alpha[rows, :, None] / full_scale
            depth = self._edited.geometry.depth_mm(place)[..., None]
            planes = [behind + alpha * (shown - behind), np.maximum(opaque, alpha), alpha * shown, alpha]
            planes += [behind, np.where(alpha > 0.0, depth, 0.0)]
            for name, values in parts.items():
                scale = exposure if LAYER_CHANNELS[name] == "RGB" else 1.0
                planes.append(np.where(alpha > 0.0, scale * self._object(place, values), 0.0))
            yield np.concatenate(planes, axis=2).astype(np.float32)

    def _continued(self, values: npt.NDArray[np.floating]) -> Float32:
        """Return rendered values continued beyond the surface, which ends about where the mask does."""
        return filled(values, self._known)

    def _object(self, place: Region, values: Float32) -> Float32:
        """Return a band of rendered values at the photograph's size."""
        region, pixel = self._framing.shown, self._framing.node / self._framing.shades
        top, left = place.top - region.top, place.left - region.left
        return enlarged(values, pixel, range(top, top + place.height), range(left, left + place.width))

    def _behind(self, place: Region, rows: Ints, columns: Ints) -> Float32:
        """Return the background behind k pixels of a band, (k, 3)."""
        region, pixel = self._framing.shown, 2.0 * self._framing.block
        rows, columns = rows + (place.top - region.top), columns + (place.left - region.left)
        return sampled(self._edited.behind, pixel, rows, columns)


def edges(photo: Photo, place: Region) -> tuple[Float32, Float32]:
    """Return coverage by the object and how far the background is filled in, (h, w) each, softened by a pixel."""
    coverage = photo.coverage(_grown(place, _EDGE_MARGIN))
    return _binomial(coverage)[1:-1, 1:-1], _binomial(dilated(coverage))[1:-1, 1:-1]


def dilated(coverage: Float32) -> Float32:
    """Return 1 where a pixel or one of the four beside it is covered, else 0; (h, w)."""
    covered = coverage > 0.0
    near = covered.copy()
    near[1:] |= covered[:-1]
    near[:-1] |= covered[1:]
    near[:, 1:] |= covered[:, :-1]
    near[:, :-1] |= covered[:, 1:]
    return near.astype(np.float32)


def trusted(geometry: Geometry) -> Float32:
    """Return the weight of rendered pixels, (h, w): little where the surface is steep.

    Close to the outline the slopes of an estimated surface are chance, and highlights on them a bright seam. The weight
    is never 0, for objects that are steep everywhere.
    """
    return np.where(geometry.facing() < GRAZING_COSINE, np.float32(1e-3), np.float32(1.0))


def softened(values: Float32) -> Float32:
    """Return binomial means over 3 x 3 pixels, (h, w); the border pixels are repeated outside."""
    return _binomial(np.pad(values, 1, mode="edge"))


def encoded(linear: Float32, full_scale: int) -> PixelsInt:
    """Return linear RGB in [0, 1] as sRGB of 8 or 16 bits; of 8, by a table over the root, within 0.003 levels."""
    if full_scale != 255:
        return _quantised(srgb(linear), full_scale)
    at = np.sqrt(linear)
    at *= np.float32(65535.0)
    at += np.float32(0.5)
    return _levels().take(at.astype(np.uint16))


def ahead(make: Callable[[Region], PixelsInt], regions: Iterable[Region], count: int = 3) -> Iterator[PixelsInt]:
    """Yield what is made of each region in the thread pool, `count` regions before they are asked for."""
    begun: deque[Future[PixelsInt]] = deque()
    for region in regions:
        begun.append(thread_pool().submit(make, region))
        if len(begun) > count:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


@functools.cache
def _levels() -> npt.NDArray[np.uint8]:
    roots = np.arange(65536) / 65535.0
    return np.rint(255.0 * srgb(roots**2)).astype(np.uint8)


def _binomial(values: Float32) -> Float32:
    """Return binomial means over 3 x 3 pixels, (h - 2, w - 2)."""
    quarter, half = np.float32(0.25), np.float32(0.5)
    values = quarter * (values[:-2] + values[2:]) + half * values[1:-1]
    return quarter * (values[:, :-2] + values[:, 2:]) + half * values[:, 1:-1]


def _beside(photo: Photo, rows: Region, *, transparent: bool) -> PixelsInt:
    """Return a copy of the photograph's rows, or transparent black, (h, w, 3 or 4)."""
    cut = slice(rows.top, rows.top + rows.height)
    if transparent:
        return np.zeros((rows.height, rows.width, 4), photo.pixels.dtype)
    if photo.alpha is None:
        return photo.pixels[cut].copy()
    return np.concatenate([photo.pixels[cut], photo.alpha[cut, :, None]], axis=2)


def _grown(region: Region, by: int) -> Region:
    return Region(region.top - by, region.left - by, region.height + 2 * by, region.width + 2 * by)


def _common(a: Region, b: Region) -> Region:
    """Return the intersection of two regions; a side of it is not above 0 where they have none."""
    top, left = max(a.top, b.top), max(a.left, b.left)
    bottom, right = min(a.top + a.height, b.top + b.height), min(a.left + a.width, b.left + b.width)
    return Region(top, left, bottom - top, right - left)


def _quantised(values: npt.NDArray[np.floating], full_scale: int) -> PixelsInt:
    return np.asarray(np.rint(values * full_scale), np.uint8 if full_scale == 255 else np.uint16)
