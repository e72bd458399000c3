"""What `core.diffusion` finds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.boundary import Boundary
from core.diffusion_channel import Iteration
from core.diffusion_pixels import PixelTerms, mean_fluence, pixel_terms
from core.entry import Entry
from core.layers import LayerGrid
from core.medium import Medium

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Solution:
    """Fluence on the surface, and the volume from which any point's is read.

    Attributes
    ----------
    boundary : Boundary, of n patches
    media : R, G and B
    volume : (4, n_layers, height, width) float32
        O of R, G and B; then K_L 1.
    fluence : tuple of (n,) float64
        phi of each channel's patches.
    residuals : tuple of float
        |b - A phi| / |b| of each channel, 0 for a dark one.
    products : tuple of int
        Convolutions that each channel took.
    """

    boundary: Boundary
    media: tuple[Medium, ...]
    volume: Float32
    fluence: tuple[Array, ...]
    residuals: tuple[float, ...]
    products: tuple[int, ...]

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """The one."""
        return (self.boundary,)

    @property
    def grid(self) -> LayerGrid:
        """Nodes of the whole object."""
        return self.boundary.grid

    @property
    def world_to_texture(self) -> Array:
        """(4, 4): world space to the volume's texture coordinates, row vectors."""
        return self.grid.world_to_texture

    def pixel_terms(self, s: float) -> PixelTerms:
        """Tabulate what pixels need beside the volume, for a window of width s, mm."""
        return pixel_terms(self.boundary, self.media, s)

    def mean_fluence(self) -> Float32:
        """See `core.diffusion_pixels.mean_fluence`."""
        return mean_fluence(self.boundary, self.fluence)


def collected(
    boundary: Boundary, media: Sequence[Medium], ways: Sequence[Iteration | None], reached: Sequence[Array]
) -> Solution:
    """Gather what the channels have come to, `reached` being their fluence."""
    volumes, fluences = [], []
    for way, fluence in zip(ways, reached, strict=True):
        volume = np.zeros(boundary.grid.shape, np.float32) if way is None else way.volume
        share = 1.0 if way is None else way.channel.allowed(fluence)
        fluences.append(share * fluence)
        volumes.append(np.float32(share) * volume)
    return Solution(
        boundary=boundary,
        media=tuple(media),
        volume=np.stack([*volumes, boundary.constant]),
        fluence=tuple(fluences),
        residuals=tuple(0.0 if way is None else way.residual for way in ways),
        products=tuple(0 if way is None else way.products for way in ways),
    )


def same_flux(entries: Sequence[Entry], i: int, k: int) -> bool:
    """Whether two channels are lit alike."""
    return all(np.array_equal(entry.flux[:, i], entry.flux[:, k]) for entry in entries)
