"""The edited object back in its photograph, band by band: soft edges, the photograph's tone curve and bits.

Pixels farther than three from the mask, counted along rows and columns, stay what they were, bit for bit.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, convolve1d

from core.photo_surround import filled, scene_radiance
from core.tonemap import srgb, tone_map
from viewer.edit import Edited
from viewer.images import BAND, PixelsInt
from viewer.photo import Region
from viewer.photo_geometry import Geometry, enlarged

Float32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

BEHIND = ("filled", "seen")  # what soft edges show: the background without the object, or the photograph as it is
LAYERS = {"irradiance": "RGB", "exitance": "RGB", "subsurface": "RGB", "specular": "RGB", "position": "XYZ",
          "normal": "XYZ"}  # fmt: skip
GRAZING = 0.3  # cosine towards the camera below which the object takes the colour of what is beside
_MARGIN = 2  # rows and columns that an edge pixel looks at


@dataclass(frozen=True, eq=False)
class Band:
    """Rows of the photograph: linear RGB as displayed (h, w, 3), and what the object covers.

    Attributes
    ----------
    place : Region
    alpha : (h, w) float32
        Coverage by the object, its edge softened by a pixel.
    behind : (h, w, 3) float32
    touched : (h, w) bool
        What differs from the photograph.
    """

    place: Region
    alpha: Float32
    behind: Float32
    touched: npt.NDArray[np.bool_]


class Compositor:
    """Puts an object into its photograph.

    Parameters
    ----------
    edited : Edited
    behind : str
        One of `BEHIND`.
    """

    def __init__(self, edited: Edited, behind: str = "filled") -> None:
        self._edited, self._fill = edited, behind == "filled"
        self._framing = edited.geometry.framing
        self._known = trusted(edited.geometry) * edited.coverage
        mean = edited.radiance / np.maximum(edited.coverage, 1e-6)[..., None]
        self._radiance = np.float32(edited.exposure) * self._continued(mean)

    def picture(self, transparent: bool = False) -> PixelsInt:
        """Return the photograph with the object, (h, w, 3 or 4) of the photograph's type.

        `transparent`: the object alone, with alpha that is not multiplied in.
        """
        photo = self._edited.photo
        most = int(np.iinfo(photo.pixels.dtype).max)
        if transparent:
            out = np.zeros((*photo.size, 4), photo.pixels.dtype)
        elif photo.alpha is None:
            out = photo.pixels.copy()
        else:
            out = np.concatenate([photo.pixels, photo.alpha[..., None]], axis=2)
        for band in self._bands(self._shown()):
            shown = tone_map(self._object(band.place, self._radiance), 1.0, self._edited.white)
            place = band.place
            target = out[place.top : place.top + place.height, place.left : place.left + place.width]
            if transparent:
                seen = band.alpha > 0.0
                target[seen, :3] = _quantised(srgb(shown[seen]), most)
                target[..., 3] = _quantised(band.alpha, most)
                continue
            mixed = band.behind + band.alpha[..., None] * (np.minimum(shown, 1.0) - band.behind)
            target[band.touched, :3] = _quantised(srgb(mixed[band.touched]), most)
            if photo.alpha is not None:  # where there is an object, there is no hole
                target[..., 3] = np.maximum(target[..., 3], _quantised(band.alpha, most))
        return out

    def layers(self) -> tuple[tuple[str, ...], Iterator[Float32]]:
        """Return the names of the layers, and bands of them for `viewer.images.write_exr_bands`; needs the parts."""
        names = [*"RGBA", *(f"object.{c}" for c in "RGBA"), *(f"background.{c}" for c in "RGB"), "depth.Z"]
        names += [f"{layer}.{c}" for layer, letters in LAYERS.items() for c in letters]
        return tuple(names), self._layer_bands()

    def _layer_bands(self) -> Iterator[Float32]:
        photo, frame, exposure = self._edited.photo, self._edited.frame, self._edited.exposure
        assert frame is not None
        parts = {name: self._continued(getattr(frame, name)) for name in LAYERS}
        most = np.float32(np.iinfo(photo.pixels.dtype).max)
        for band in self._bands(photo.whole):
            place, alpha = band.place, band.alpha[..., None]
            rows = slice(place.top, place.top + place.height)
            shown = self._object(place, self._radiance)
            behind = scene_radiance(band.behind, self._edited.white)
            opaque = np.ones_like(band.alpha) if photo.alpha is None else photo.alpha[rows] / most
            depth = self._edited.geometry.depth_mm(place)
            planes = [
                behind + alpha * (shown - behind),
                np.maximum(opaque, band.alpha)[..., None],
                alpha * shown,
                alpha,
            ]
            planes += [behind, np.where(band.alpha > 0.0, depth, 0.0)[..., None]]
            for name, values in parts.items():
                scale = exposure if LAYERS[name] == "RGB" else 1.0
                planes.append(np.where(alpha > 0.0, scale * self._object(place, values), 0.0))
            yield np.concatenate(planes, axis=2).astype(np.float32)

    def _continued(self, values: npt.NDArray[np.floating]) -> Float32:
        """Continue beyond the surface, which ends about where the mask does."""
        return filled(values, self._known)

    def _object(self, place: Region, values: Float32) -> Float32:
        """Cut a band out of what was rendered, or the background behind it, at the photograph's size."""
        region = self._framing.region
        top, left = place.top - region.top, place.left - region.left
        pixel = region.height / len(values)
        return enlarged(values, pixel, range(top, top + place.height), range(left, left + place.width))

    def _shown(self) -> Region:
        """The part of the region that is in the photograph."""
        (h, w), whole = self._edited.photo.size, self._framing.region
        top, left = max(whole.top, 0), max(whole.left, 0)
        return Region(top, left, min(whole.top + whole.height, h) - top, min(whole.left + whole.width, w) - left)

    def _bands(self, region: Region) -> Iterator[Band]:
        for start in range(0, region.height, BAND):
            yield self._band(Region(region.top + start, region.left, min(BAND, region.height - start), region.width))

    def _band(self, place: Region) -> Band:
        photo = self._edited.photo
        around = Region(
            place.top - _MARGIN, place.left - _MARGIN, place.height + 2 * _MARGIN, place.width + 2 * _MARGIN
        )
        coverage = photo.coverage(around)
        alpha = _softened(coverage)
        behind, touched = photo.linear(place), alpha > 0.0
        if self._fill:
            # Pixels at the edge hold some of what the object was made of.
            near = _softened(binary_dilation(coverage > 0.0).astype(np.float32))
            share = near[..., None]
            behind = behind + share * (self._object(place, self._edited.behind) - behind)
            touched = near > 0.0
        return Band(place, alpha, behind, touched)


def trusted(geometry: Geometry) -> Float32:
    """How much what is rendered counts, (h, w): little where the surface is steep.

    That close to the outline, slopes of an estimate are chance, and mirror it all as a bright seam. A little, for
    objects that are nothing but steep.
    """
    return np.where(geometry.facing() < GRAZING, np.float32(1e-3), np.float32(1.0))


def softened(values: Float32) -> Float32:
    """Binomial mean over 3 x 3 pixels; beyond the border it goes on."""
    for axis in (0, 1):
        values = convolve1d(values, [0.25, 0.5, 0.25], axis, mode="nearest")
    return values


def _softened(values: Float32) -> Float32:
    """Likewise, without the margin."""
    return softened(values)[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]


def _quantised(values: npt.NDArray[np.floating], most: int) -> PixelsInt:
    return np.asarray(np.rint(values * most), np.uint8 if most == 255 else np.uint16)
