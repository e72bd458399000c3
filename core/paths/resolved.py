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
from milkglass.core.paths.lobes import tables
from milkglass.core.paths.resolution import resolved_share, scaled
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

    @classmethod
    def together(cls, parts: "Sequence[Scattered]") -> "Scattered":
        """Return the power of several lights as one."""
        return cls(*([_sum(of_parts) for of_parts in zip(*column, strict=True)] for column in zip(*parts, strict=True)))

    def of_channels(self, chosen: Sequence[bool]) -> "Scattered":
        """Return the power of some of R, G and B."""
        return Scattered(*([part if used else None for part, used in zip(of, chosen, strict=True)] for of in self))

    def times(self, factors: "Sequence[np.float32 | Float32 | None]") -> "Scattered":
        """Return the power times a factor of each channel, none where that is None."""
        return Scattered(
            *(
                [
                    None if part is None or factor is None else factor * part
                    for part, factor in zip(parts, factors, strict=True)
                ]
                for parts in self
            )
        )

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


def lobes(
    sources: Sequence[Scattered],
    flights: Sequence[DeltaEddington],
    grid: LayerGrid,
    density: Callable[[int, Float32], Float32],
) -> Glow:
    """Return the radiance a mm of light that has scattered once, by all but the forward peak of its phase function.

    `sources` are what its lights have scatter, each by itself; `density` as of `Scattered.glow`.
    """
    found = np.zeros((len(sources), *grid.shape, 3, 4), np.float32)
    for of_source, scattered in zip(found, sources, strict=True):
        for i, (power, turned, flight) in enumerate(zip(scattered.power, scattered.flux, flights, strict=True)):
            if power is not None:
                of_source[..., i, 0] = density(i, power)
            if turned is not None:
                of_source[..., i, 1:] = np.moveaxis(density(i, turned) / np.float32(flight.cosine), 0, -1)
    even = Glow.of(np.zeros((3, *grid.shape)), origin_of(grid), grid.texel)
    return even._replace(lobes=found, tables=tables([flight.g for flight in flights]))


@dataclass(frozen=True, eq=False)
class Resolved:
    """Light that matter scatters into rays through it, in the channels whose free paths nodes resolve.

    Attributes
    ----------
    once, often : Glow
        Of light that has scattered once, and of all other, times the shares.
    shares : of R, G and B
        By how much it takes the place of exitance of the surface, [0, 1].
    further : tuple of Resolved
        Of other kinds of matter.
    """

    once: Glow
    often: Glow
    shares: tuple[float, ...]
    further: "tuple[Resolved, ...]" = ()

    @property
    def kinds(self) -> "tuple[Resolved, ...]":
        """Return that of each kind of matter."""
        return self, *self.further

    @computed_once
    def glow(self) -> Glow:
        """Return that of all light."""
        nodes = self.once.nodes + self.often.nodes
        return self.often._replace(nodes=nodes, lobes=self.once.lobes, tables=self.once.tables)


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
    once, often = (Glow.of(nothing, origin, grid.texel)._replace(bodies=ends if lit else NO_BODIES) for _ in range(2))
    shares: tuple[float, ...] = (0.0, 0.0, 0.0)
    for part, _ in lit:
        assert part is not None
        if part.often.flux.size:
            often = often._replace(flux=np.zeros((*shape, 3, 3), np.float32))
        if len(part.once.lobes) > len(once.lobes):
            wider = np.zeros((len(part.once.lobes), *shape, 3, 4), np.float32)
            once = once._replace(lobes=wider, tables=part.once.tables)
    for part, (layer, row, column) in lit:
        assert part is not None
        shares, (depth, height, width) = part.shares, part.once.nodes.shape[:3]
        box = slice(layer, layer + depth), slice(row, row + height), slice(column, column + width)
        once.nodes[box] += part.once.nodes
        often.nodes[box] += part.often.nodes
        if part.often.flux.size:
            often.flux[box] += part.often.flux
        once.lobes[: len(part.once.lobes), *box] += part.once.lobes
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
    first: Sequence[Scattered],
    often: Scattered,
    media: Sequence[Medium],
    fill: Filled,
    grid: LayerGrid,
) -> Resolved:
    """Return what matter sends out.

    Parameters
    ----------
    first : of Scattered
        For the first time: light by light where it scatters more one way than another, else of all together.
    often : Scattered
        For a later time.
    media : R, G and B
    fill : Filled
    grid : LayerGrid
        Along world axes.
    """
    shares = tuple(resolved_share(medium, grid) for medium in media)
    factors = [share / (4.0 * np.pi * grid.texel**3) for share in shares]

    def a_mm(i: int, power: Float32) -> Float32:
        return power * (np.float32(factors[i]) / fill.weight)

    if any(scattered.is_directed for scattered in first):
        once = lobes(first, [scaled(medium, grid) for medium in media], grid, a_mm)
    else:
        (all_lights,) = first
        once = all_lights.glow(grid, a_mm, directed=False)
    return Resolved(once, often.glow(grid, a_mm, directed=often.is_directed), shares)


def _sum(volumes: Volumes) -> Float32 | None:
    known = [volume for volume in volumes if volume is not None]
    return functools.reduce(np.add, known) if known else None


def origin_of(grid: LayerGrid) -> Float32:
    """Return the place of the first node of a grid along world axes, (3,) mm."""
    return np.asarray(-np.asarray(grid.world_to_grid)[3, :3] * grid.texel, np.float32)
