"""What `core.transport.diffusion.solver` finds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.medium import Medium
from milkglass.core.threads import computed_once
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.entry import Entry
from milkglass.core.transport.diffusion.iteration import Iteration, Reached
from milkglass.core.transport.diffusion.pixels import PixelTerms, mean_fluence, pixel_terms


@dataclass(frozen=True, eq=False)
class Solution:
    """Fluence on the surface, and the volume from which any point's is read.

    Attributes
    ----------
    boundary : Boundary, of n patches
    media : R, G and B
    channels : R, G and B; None for a dark one
        What their steps have come to.
    """

    boundary: Boundary
    media: tuple[Medium, ...]
    channels: tuple[Reached | None, ...]

    @computed_once
    def volume(self) -> Float32:
        """O of R, G and B; then K_L 1: (4, n_layers, height, width)."""
        dark = np.zeros(self.boundary.grid.shape, np.float32)
        own = [dark if channel is None else channel.volume for channel in self.channels]
        return np.stack([*own, self.boundary.constant])

    @computed_once
    def fluence(self) -> tuple[Array, ...]:
        """2 A M of each channel's patches, (n,), A of a flat surface: phi where theirs is flat."""
        dark = np.zeros(len(self.boundary.patches))
        return tuple(dark if channel is None else channel.two_A_M for channel in self.channels)

    @property
    def residuals(self) -> tuple[float, ...]:
        """|b - A phi| / |b| of each channel, 0 for a dark one."""
        return tuple(0.0 if channel is None else channel.residual for channel in self.channels)

    @property
    def convolutions(self) -> tuple[int, ...]:
        """Convolutions that each channel took."""
        return tuple(0 if channel is None else channel.convolutions for channel in self.channels)

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
        """See `core.transport.diffusion.pixels.mean_fluence`."""
        return mean_fluence(self.boundary, self.fluence)


def reached(
    boundary: Boundary,
    media: Sequence[Medium],
    channels: Sequence[Channel | None],
    ways: Mapping[Channel, Iteration],
) -> Solution:
    """Say what the channels have come to on their ways; alike ones share theirs."""
    ends = {channel: way.reached for channel, way in ways.items()}
    of_channels = tuple(None if channel is None else ends[channel] for channel in channels)
    return Solution(boundary, tuple(media), of_channels)


def same_flux(entries: Sequence[Entry], i: int, k: int) -> bool:
    """Whether two channels are lit alike."""
    return all(np.array_equal(entry.flux[:, i], entry.flux[:, k]) for entry in entries)
