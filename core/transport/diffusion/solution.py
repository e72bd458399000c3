"""Solution of the diffusion equation, from which exitance is read at any point of the surface."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import LayerGrid, deposit
from milkglass.core.material.medium import Medium
from milkglass.core.threads import computed_once
from milkglass.core.transport.base import SurfaceLights
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.iteration import Iteration, Reached
from milkglass.core.transport.diffusion.pixels import (
    bending_at_nodes,
    depths_at_nodes,
    mean_fluence,
    pixel_tables,
    sheet_reach,
)
from milkglass.core.transport.diffusion.points import point_exitance
from milkglass.core.transport.diffusion.reentry import SurfaceExchange
from milkglass.core.transport.pixels import PixelTables

if TYPE_CHECKING:
    from milkglass.core.paths.resolved import Resolved


@dataclass(frozen=True, eq=False)
class Solution:
    """Fluence on the surface, and the volume from which any point's is read.

    Attributes
    ----------
    boundary : Boundary, of n patches
    media : R, G and B
    channels : R, G and B; None for a dark one
        What their steps have come to.
    window : float
        Width s of the window of the smooth part, mm.
    tolerance : float
        Relative residual at which a channel is solved.
    exchange : SurfaceExchange, optional
        By which light that leaves enters again.
    returned : callable, optional
        Without it, returns (m, 3) float32, irradiance at the exchange's vertices that counted as entering again.
    estimates_unscattered : bool
        As of `core.transport.base.Scattered`.
    resolved : Resolved, optional
        What matter sends out along rays.
    lacks_light_within : bool
        Whether that is yet to be found.
    """

    boundary: Boundary
    media: tuple[Medium, ...]
    channels: tuple[Reached | None, ...]
    window: float
    tolerance: float
    exchange: SurfaceExchange | None = None
    returned: Callable[[], Float32] | None = None
    estimates_unscattered: bool = False
    resolved: "Resolved | None" = None
    lacks_light_within: bool = False

    windows = None

    @computed_once
    def volume(self) -> Float32:
        """Return O of R, G and B, then K_L 1, at the nodes, (4, n_layers, height, width)."""
        dark = np.zeros(self.boundary.grid.shape, np.float32)
        volumes = [dark if channel is None else channel.volume for channel in self.channels]
        return np.stack([*volumes, self.boundary.constant])

    @computed_once
    def two_A_M(self) -> tuple[Array, ...]:
        """Return 2 A M of each channel's patches, (n,), A of a flat surface: there it is the fluence phi."""
        dark = np.zeros(len(self.boundary.patches))
        return tuple(dark if channel is None else channel.two_A_M for channel in self.channels)

    @property
    def residuals(self) -> tuple[float, ...]:
        """Return |b - A phi| / |b| of each channel, 0 for a dark one."""
        return tuple(0.0 if channel is None else channel.residual for channel in self.channels)

    @property
    def convolutions(self) -> tuple[int, ...]:
        """Return how many convolutions each channel took."""
        return tuple(0 if channel is None else channel.convolutions for channel in self.channels)

    @property
    def is_solved(self) -> bool:
        """Whether every channel's residual is within the tolerance."""
        return max(self.residuals) <= self.tolerance

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Return the boundary as the only one."""
        return (self.boundary,)

    @property
    def grid(self) -> LayerGrid:
        """Return the nodes on which it was solved."""
        return self.boundary.grid

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) from world space to the volume's texture coordinates, row vectors."""
        return self.grid.world_to_texture

    def pixel_tables(self) -> PixelTables:
        """Return the tables from which pixels compute their exitance, in addition to the volume."""
        return pixel_tables(self.boundaries, self.media, self.window, lambda of, _: of(self.boundary))

    def mean_fluence(self) -> Float32:
        """Return the area-weighted mean of 2 A M near each node, (3, n_layers, height, width)."""
        return mean_fluence(self.boundary, self.two_A_M)

    def exitance(self, points: Array, normals: Array, lights: SurfaceLights, tables: PixelTables) -> Array:
        """Return M at points of the surface, (n, 3); see `core.transport.base.Scattered.exitance`."""
        boundary, equation = self.boundary, tables.equation
        if equation.depths is not None:
            equation = replace(equation, depths=depths_at_nodes(boundary, equation.reach))
        if equation.bending is not None:
            equation = replace(equation, bending=bending_at_nodes(boundary, self.media))
        light_at_points = lights.at(points, normals, sheet_reach(self.boundaries), thin=equation.reach > 0.0)
        return point_exitance(
            self.volume, self.mean_fluence(), self.grid, equation, lights.eta, points, normals, light_at_points
        )

    @computed_once
    def exitance_of_patches(self) -> Array:
        """Return M of the patches, (n, 3), >= 0."""
        factors = [0.0 if medium.is_black else 0.5 / medium.extrapolation_factor for medium in self.media]
        columns = [factor * np.maximum(two_A_M, 0.0) for factor, two_A_M in zip(factors, self.two_A_M, strict=True)]
        return np.stack(columns, axis=1)

    @computed_once
    def reentering(self) -> Float32 | None:
        """Return the irradiance that enters again at the vertices of the exchange, (m, 3); None without one."""
        if self.exchange is None:
            return None if self.returned is None else self.returned()
        return self.exchange.irradiance(self.exitance_of_patches, self.media)

    def on_layers(self) -> Float32:
        """Return M dA on the nodes, (3, *grid.shape): the volume is no light yet."""
        boundary = self.boundary
        flux = self.exitance_of_patches * boundary.patches.areas[:, None]
        return deposit(boundary.grid, boundary.weights, flux.astype(np.float32))


def reached(
    boundary: Boundary,
    media: Sequence[Medium],
    channels: Sequence[Channel | None],
    iterations: Mapping[Channel, Iteration],
    window: float,
    tolerance: float,
    exchange: SurfaceExchange | None = None,
    returned: Callable[[], Float32] | None = None,
) -> Solution:
    """Return the solution that the channels' iterations have come to; alike channels share one."""
    ends = {channel: iteration.reached for channel, iteration in iterations.items()}
    of_channels = tuple(None if channel is None else ends[channel] for channel in channels)
    return Solution(boundary, tuple(media), of_channels, window, tolerance, exchange, returned)
