"""The object of a photograph: its surface, its light, and what a picture of it needs beside them."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.light.probe import Probe
from milkglass.core.stages import Part
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.photograph.composite import dilated, softened
from milkglass.viewer.photograph.edit import background, photo_light
from milkglass.viewer.photograph.framing import MAX_READ_PIXELS, frame_object
from milkglass.viewer.photograph.geometry import Geometry, make_geometry
from milkglass.viewer.scene.keys import Key
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import PhotoSettings

KEPT_OBJECTS = 4  # one is shown, the next on its way, and both perhaps in each half of a split view


@dataclass(frozen=True)
class ObjectRequest:
    """What an object's surface and light depend on.

    Attributes
    ----------
    mask : int
        Version of the mask, see `viewer.photograph.mask.PaintedMask`.
    key : Key
        The values of all settings that declare to move an object; two requests with the same ask for the same object.
    size_mm : float
        Longer side of the object's outline.
    white : float
        White point of the tone map, which the photograph's radiance is estimated with.
    photo : PhotoSettings
        How depth is estimated or read.
    """

    mask: int
    key: Key
    size_mm: float = field(compare=False)
    white: float = field(compare=False)
    photo: PhotoSettings = field(compare=False)

    @classmethod
    def of(cls, scene: Scene, mask: int) -> "ObjectRequest":
        """Return what a scene and a version of the mask ask for."""
        return cls(mask, scene.key(Part.OBJECT), scene.model.length_mm, scene.display.white, scene.photo)

    @property
    def light(self) -> tuple[object, ...]:
        """What all but the surface depends on: how deep an object is estimated does not change what it is lit by.

        How deep a depth map is read does: its slopes tell which light shades as the photograph shows.
        """
        depth = self.photo.depth
        return self.mask, self.size_mm, self.white, depth, None if depth is None else self.photo.depth_strength


@dataclass(frozen=True, eq=False)
class PhotographObject:
    """The object of a photograph, ready to be lit and put back.

    Attributes
    ----------
    request : ObjectRequest
        What it was made for.
    photo : Photo
    geometry : Geometry
    light : Probe
    behind : (h, w, 3) float32
        As of `viewer.photograph.edit.Edited`.
    edges : (H, W, 2) uint8
        Of the pixels shown: the object's coverage, and the share that the background is filled in; edges softened.
    """

    request: ObjectRequest
    photo: Photo
    geometry: Geometry
    light: Probe
    behind: Float32
    edges: npt.NDArray[np.uint8]


def make_object(photo: Photo, request: ObjectRequest, last: PhotographObject | None) -> PhotographObject:
    """Make an object, with what can stay of the last one; uses no OpenGL, so that any thread may run it.

    Raises
    ------
    InputError
        As `make_geometry`.
    """
    framing, read = frame_object(photo, request.size_mm), request.photo
    geometry = make_geometry(
        photo, framing, request.white, strength=read.depth_strength, smoothing=read.depth_smoothing, depth=read.depth
    )
    if last is not None and last.request.light == request.light:
        return replace(last, request=request, photo=photo, geometry=geometry)
    light = photo_light(photo, geometry.shading, request.white)
    return PhotographObject(request, photo, geometry, light, background(geometry), soft_edges(photo))


def shown_block(photo: Photo) -> int:
    """Return how many pixels of a photograph make a side of a pixel that is shown."""
    return -(-max(photo.size) // MAX_READ_PIXELS)


def soft_edges(photo: Photo) -> npt.NDArray[np.uint8]:
    """Return coverage and filling of the pixels that are shown, (h, w, 2), as `photograph.composite.edges` has them."""
    block = shown_block(photo)
    rows, columns = (-(-side // block) for side in photo.size)
    coverage = photo.coverage(Region(0, 0, rows * block, columns * block))
    coverage = coverage.reshape(rows, block, columns, block).mean(axis=(1, 3), dtype=np.float32)
    both = np.stack([softened(coverage), softened(dilated(coverage))], axis=-1)
    return np.asarray(np.rint(255.0 * both), np.uint8)
