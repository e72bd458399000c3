"""The object of a photograph, made: its surface, its light, and what is shown of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.light.probe import Probe
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.photograph.composite import dilated, softened
from milkglass.viewer.photograph.edit import background, photo_light
from milkglass.viewer.photograph.framing import PICTURE, frame_object
from milkglass.viewer.photograph.geometry import Geometry, make_geometry

MADE = 4  # objects that are kept: one is shown, the next on its way, and both perhaps in each half of a split view


@dataclass(frozen=True)
class Wanted:
    """What the surface and its light depend on; parameters as of `viewer.photograph.geometry.make_geometry`."""

    mask: int  # version
    size_mm: float
    white: float
    strength: float
    smoothing: float
    depth: Path | None

    @property
    def light(self) -> tuple[object, ...]:
        """What all but the surface depends on: how deep an object is read does not change what it is lit by.

        A depth of one's own does: its slopes tell which light shades as the photograph shows.
        """
        return self.mask, self.size_mm, self.white, self.depth, None if self.depth is None else self.strength


@dataclass(frozen=True, eq=False)
class Made:
    """The object as it was last made.

    Attributes
    ----------
    wanted : Wanted
    photo : Photo
    geometry : Geometry
    light : Probe
    behind : (h, w, 3) float32
        As of `viewer.photograph.edit.Edited`.
    edges : (H, W, 2) uint8
        Of the pixels shown: the object's coverage, and the share that the background is filled in; edges softened.
    """

    wanted: Wanted
    photo: Photo
    geometry: Geometry
    light: Probe
    behind: Float32
    edges: npt.NDArray[np.uint8]


def make_object(photo: Photo, wanted: Wanted, last: Made | None) -> Made:
    """Make the object, with what can stay of the last one; in the worker."""
    framing = frame_object(photo, wanted.size_mm)
    geometry = make_geometry(
        photo, framing, wanted.white, strength=wanted.strength, smoothing=wanted.smoothing, depth=wanted.depth
    )
    if last is not None and last.wanted.light == wanted.light:
        return Made(wanted, photo, geometry, last.light, last.behind, last.edges)
    light = photo_light(photo, geometry.shading, wanted.white)
    return Made(wanted, photo, geometry, light, background(geometry), soft_edges(photo))


def shown_block(photo: Photo) -> int:
    """Pixels of a photograph a side of a pixel that is shown."""
    return -(-max(photo.size) // PICTURE)


def soft_edges(photo: Photo) -> npt.NDArray[np.uint8]:
    """Coverage and filling of the pixels that are shown, (h, w, 2), as `photograph.composite.Compositor` has them."""
    block = shown_block(photo)
    rows, columns = (-(-side // block) for side in photo.size)
    coverage = photo.coverage(Region(0, 0, rows * block, columns * block))
    coverage = coverage.reshape(rows, block, columns, block).mean(axis=(1, 3), dtype=np.float32)
    both = np.stack([softened(coverage), softened(dilated(coverage))], axis=-1)
    return np.asarray(np.rint(255.0 * both), np.uint8)
