"""What matter sends out along rays where nodes resolve its free paths: light that has scattered once and more."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Float32, Ints
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.medium import DeltaEddington, Medium
from milkglass.core.paths.filled import LEAST_WEIGHT, Filled
from milkglass.core.paths.glow import ALL_BODIES, NO_BODIES, Glow
from milkglass.core.paths.resolution import resolved_share
from milkglass.core.threads import computed_once

Volumes = Sequence[Float32 | None]  # of R, G and B, (n_layers, height, width); None of a dark one


class Scattered(NamedTuple):
    """Power that scatters, at nodes: towards w it is power + 3 w . flux, over all directions alike.

    Attributes
    ----------
    power : Volumes
    flux : of R, G and B
        Power times mean direction, along x, y and z, (3, n_layers, height, width); None where all directions are alike.
    """

    power: Volumes
    flux: Volumes

    @classmethod
    def evenly(cls, power: Volumes) -> "Scattered":
        """Return power that scatters towards all directions alike."""
        return cls(power, [None] * len(power))

    @property
    def is_directed(self) -> bool:
        """Whether a channel scatters more one way than another."""
        return any(flux is not None for flux in self.flux)

    def glow(self, grid: LayerGrid, density: Callable[[int, Float32], Float32], *, directed: bool) -> Glow:
        """Return the radiance a mm, with flux if `directed`; `density` takes a channel's power to that all around."""
        radiance = np.zeros((3, *grid.shape), np.float32)
        flux = np.zeros((3, 3, *grid.shape), np.float32) if directed else None
        for i, (power, turned) in enumerate(zip(self.power, self.flux, strict=True)):
            if power is not None:
                radiance[i] = density(i, power)
            if flux is not None and turned is not None:
                flux[i] = np.float32(3.0) * density(i, turned)
        return Glow.of(radiance, origin_of(grid), grid.texel, flux)


@dataclass(frozen=True, eq=False)
class Resolved:
    """Light that matter scatters into rays through it, in the channels whose free paths nodes resolve.

    Attributes
    ----------
    once, often : Glow
        Of light that has scattered once, and of all other, times the shares.
    shares : of R, G and B
        By how much it takes the place of exitance of the surface, [0, 1].
    others : tuple of Resolved
        Of other kinds of matter.
    """

    once: Glow
    often: Glow
    shares: tuple[float, ...]
    others: "tuple[Resolved, ...]" = ()

    @property
    def kinds(self) -> "tuple[Resolved, ...]":
        """Return that of each kind of matter."""
        return self, *self.others

    @computed_once
    def glow(self) -> Glow:
        """Return that of all light."""
        nodes, flux = self.once.nodes + self.often.nodes, self.once.flux + self.often.flux
        return self.once._replace(nodes=nodes, flux=flux)


def together(parts: Sequence[Resolved | None], bodies: range, first: Ints, grid: LayerGrid) -> Resolved:
    """Return what matter of one kind sends out.

    Parameters
    ----------
    parts : of n bodies
        None of a dark one.
    bodies : range
        Those of this kind.
    first : (n, 3) int
        First node of each in a grid: layer, row and column.
    grid : LayerGrid
        Of all.
    """
    lit = [(parts[i], first[i]) for i in bodies if parts[i] is not None]
    shape = grid.shape if lit else (0, 0, 0)
    ends = (bodies.start, bodies.stop - 1) if len(bodies) < len(parts) else ALL_BODIES
    nothing, origin = np.zeros((3, *shape)), origin_of(grid)
    found = [Glow.of(nothing, origin, grid.texel)._replace(bodies=ends if lit else NO_BODIES) for _ in range(2)]
    shares: tuple[float, ...] = (0.0, 0.0, 0.0)
    for part, (layer, row, column) in lit:
        assert part is not None
        if part.once.flux.size and not found[0].flux.size:
            found = [glow._replace(flux=np.zeros((*shape, 3, 3), np.float32)) for glow in found]
        shares, (depth, height, width) = part.shares, part.once.nodes.shape[:3]
        box = slice(layer, layer + depth), slice(row, row + height), slice(column, column + width)
        for glow, of_part in zip(found, (part.once, part.often), strict=True):
            glow.nodes[box] += of_part.nodes
            glow.flux[box] += of_part.flux
    once, often = found
    return Resolved(once, often, shares)


def often_scattered(
    second: Float32, fluence: Float32, medium: DeltaEddington, fill: Filled, grid: LayerGrid
) -> Float32:
    """Return the power that scatters for the second time or a later one, at the nodes.

    `fluence` is that of light that has scattered twice or more.
    """
    inside = np.where(fill.weight > LEAST_WEIGHT, np.maximum(fluence, np.float32(0.0)), np.float32(0.0))
    return np.asarray(second + np.float32(medium.sigma_s * grid.texel**3) * inside)


def resolved(
    first: Scattered, often: Scattered, gains: Sequence[float], media: Sequence[Medium], fill: Filled, grid: LayerGrid
) -> Resolved:
    """Return what matter sends out.

    Parameters
    ----------
    first, often : Scattered
        For the first time, and for a later one.
    gains : of R, G and B
        Factors on the latter.
    media : R, G and B
    fill : Filled
    grid : LayerGrid
        Along world axes.
    """
    shares = tuple(resolved_share(medium, grid) for medium in media)
    factors = [share / (4.0 * np.pi * grid.texel**3) for share in shares]

    def density(factors: Sequence[float], i: int, power: Float32) -> Float32:
        return power * (np.float32(factors[i]) / fill.weight)

    gained = [factor * gain for factor, gain in zip(factors, gains, strict=True)]
    once_a_mm, often_a_mm = (functools.partial(density, of_channels) for of_channels in (factors, gained))
    directed = first.is_directed or often.is_directed
    return Resolved(
        first.glow(grid, once_a_mm, directed=directed), often.glow(grid, often_a_mm, directed=directed), shares
    )


def origin_of(grid: LayerGrid) -> Float32:
    """Return the place of the first node of a grid along world axes, (3,) mm."""
    return np.asarray(-np.asarray(grid.world_to_grid)[3, :3] * grid.texel, np.float32)
