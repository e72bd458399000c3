"""What matter sends out along rays where nodes resolve its free paths: light that has scattered once and more."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Float32, Ints
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.medium import Medium
from milkglass.core.paths.filled import LEAST_WEIGHT, Filled
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.resolution import resolved_share
from milkglass.core.threads import computed_once

Volumes = Sequence[Float32 | None]  # of R, G and B, (n_layers, height, width); None of a dark one


@dataclass(frozen=True, eq=False)
class Resolved:
    """Light that matter scatters into rays through it, in the channels whose free paths nodes resolve.

    Attributes
    ----------
    once, often : Glow
        Of light that has scattered once, and of all other, times the shares.
    shares : of R, G and B
        By how much it takes the place of exitance of the surface, [0, 1].
    """

    once: Glow
    often: Glow
    shares: tuple[float, ...]

    @computed_once
    def glow(self) -> Glow:
        """Return that of all light."""
        return self.once._replace(nodes=self.once.nodes + self.often.nodes)

    def together(self, parts: Sequence["Resolved | None"], first: Ints, grid: LayerGrid) -> "Resolved":
        """Return that of several bodies with the same shares.

        Parameters
        ----------
        parts : of n bodies
            None of a dark one.
        first : (n, 3) int
            First node of each in a grid: layer, row and column.
        grid : LayerGrid
            Of all.
        """
        once, often = (np.zeros((*grid.shape, 3), np.float32) for _ in range(2))
        for part, (layer, row, column) in zip(parts, first, strict=True):
            if part is not None:
                depth, height, width = part.once.nodes.shape[:3]
                box = slice(layer, layer + depth), slice(row, row + height), slice(column, column + width)
                once[box] += part.once.nodes
                often[box] += part.often.nodes
        origin, spacing = origin_of(grid), grid.texel
        return Resolved(Glow(once, origin, spacing), Glow(often, origin, spacing), self.shares)


def often_scattered(second: Float32, fluence: Float32, medium: Medium, fill: Filled, grid: LayerGrid) -> Float32:
    """Return the power that scatters for the second time or a later one, at the nodes.

    `fluence` is that of light that has scattered twice or more.
    """
    inside = np.where(fill.weight > LEAST_WEIGHT, np.maximum(fluence, np.float32(0.0)), np.float32(0.0))
    return np.asarray(second + np.float32(medium.sigma_s_prime * grid.texel**3) * inside)


def resolved(
    first: Volumes, often: Volumes, gains: Sequence[float], media: Sequence[Medium], fill: Filled, grid: LayerGrid
) -> Resolved:
    """Return what matter sends out.

    Parameters
    ----------
    first, often : Volumes
        Power that scatters for the first time, and for a later one, at the nodes.
    gains : of R, G and B
        Factors on the latter.
    media : R, G and B
    fill : Filled
    grid : LayerGrid
        Along world axes.
    """
    shares = tuple(resolved_share(medium, grid) for medium in media)
    factors = [share / (4.0 * np.pi * grid.texel**3) for share in shares]
    gained = [factor * gain for factor, gain in zip(factors, gains, strict=True)]

    def glow(powers: Volumes, factors: Sequence[float]) -> Glow:
        radiance = np.zeros((3, *grid.shape), np.float32)
        for sent, power, factor in zip(radiance, powers, factors, strict=True):
            if power is not None:
                np.multiply(power, np.float32(factor) / fill.weight, out=sent)
        return Glow.of(radiance, origin_of(grid), grid.texel)

    return Resolved(glow(first, factors), glow(often, gained), shares)


def origin_of(grid: LayerGrid) -> Float32:
    """Return the place of the first node of a grid along world axes, (3,) mm."""
    return np.asarray(-np.asarray(grid.world_to_grid)[3, :3] * grid.texel, np.float32)
