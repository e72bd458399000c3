"""Light within an object, order by order of scattering, and what even light tells of its errors.

In surroundings of radiance 1 matter that absorbs nothing is as bright everywhere: radiance inside is eta^2, and what
scatters is s_s 4 pi eta^2 a volume. So it is where matter absorbs and sends out as much. All that is approximate in
light that has scattered twice or more is known by it, place by place: fluence errs by some per cent, and is not
gathered in full next to the boundary; a flight knows no surface between parts. What light from outside must scatter,
over what is found to, is a gain on such light, whatever it comes from, as a double layer's K 1 = -1/2 corrects what
nodes miss of K. What scatters of the light that matter sends out is left out of it, and followed flight by flight.

Other bodies are in the way of such light, and send out all that leaves them in it. It has no direction, and so light
that scatters forward has one gain, by the balance of its power.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from milkglass.core.arrays import Array, Float32, Int32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.material.medium import DeltaEddington, Medium
from milkglass.core.paths.beams import Beams, traced
from milkglass.core.paths.deposit import moments
from milkglass.core.paths.emission import Ball, surrounding
from milkglass.core.paths.filled import Filled
from milkglass.core.paths.flight import flight_spectrum, potential_spectrum
from milkglass.core.paths.onwards import Onwards
from milkglass.core.paths.resolved import Scattered, Volumes, often_scattered
from milkglass.core.paths.second import Returns, carried_on, collided_again, left
from milkglass.core.paths.surface import Surface
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.iteration import End, Reached
from milkglass.core.transport.diffusion.reentry import SurfaceExchange

FLIGHT, POTENTIAL = "flight", "potential"  # kernels
EVEN_BEAMS = 100_000  # of light from all around
EVEN_MAP = (64, 128, 3)  # texels of it, in which directions are taken to be as dense everywhere
BLACK = np.float32(1e6)  # 1/mm
FLIGHTS = 8  # after which light that matter sends out goes on in a geometric series
MOST_KEPT = 0.999  # of light from one flight to the next
MOST_GAIN = 4.0  # of nodes that have next to no matter beside them


@dataclass(frozen=True, eq=False)
class Body:
    """An object as diffusion has it.

    Attributes
    ----------
    mesh : Mesh
    samples : SurfaceSamples
        Of which patches are made.
    boundary : Boundary
    exchange : SurfaceExchange, optional
        By which light that leaves enters again.
    external : (samples, 3) float32, optional
        Flux that enters from other bodies.
    is_even : bool
        Whether it enters as in surroundings of radiance 1 instead.
    """

    mesh: Mesh
    samples: SurfaceSamples
    boundary: Boundary
    exchange: SurfaceExchange | None
    external: Float32 | None = None
    is_even: bool = False

    def entering(self, channel: int, medium: Medium) -> Array | None:
        """Return the flux that enters the patches from other bodies, (patches,); None for none."""
        if self.exchange is None:
            return None
        if self.is_even:
            return self.exchange.flux_from_others(channel, medium)
        if self.external is None:
            return None
        return np.asarray(self.boundary.patches.sums @ self.external[:, channel].astype(np.float64))


@dataclass(frozen=True, eq=False)
class Often:
    """One channel of light that has scattered twice or more.

    Attributes
    ----------
    end : Reached
        What its diffusion has come to.
    entered : (n_layers, height, width) float32
        Power at the nodes that scatters for the first time since it left the object, or another one, and entered.
    """

    end: Reached
    entered: Float32


class Convolvers(Protocol):
    """Makes convolutions of channels that are used with kernels of a name, of their extinctions."""

    def __call__(
        self,
        name: str,
        extinctions: Sequence[float],
        used: Sequence[bool],
        make: Callable[[float, LayerGrid, ConvolutionShape], Float32],
        /,
    ) -> Callable[[int, Float32], Float32]:
        """Return a function of a channel's number and its volume."""


@dataclass(frozen=True, eq=False)
class Orders:
    """Follows the light within a body from collision to collision, and then by diffusion.

    Attributes
    ----------
    media : R, G and B
    flights : of R, G and B
        The media as light crosses them between collisions.
    used : of R, G and B
        Whether light is followed that scatters more than once.
    fill : Filled
    back : Returns
    grid : LayerGrid
    convolvers : Convolvers
    fluence : callable
        Solves for the light that has scattered twice or more, of power that scatters for the second time in a body,
        from where it ended the last time; and says where it ended.
    """

    media: Sequence[Medium]
    flights: Sequence[DeltaEddington]
    used: Sequence[bool]
    fill: Filled
    back: Returns
    grid: LayerGrid
    convolvers: Convolvers
    fluence: Callable[[Volumes, Body, End | None], tuple[list[Often | None], End]]

    def twice(self, beams: Beams, once: Scattered, onwards: Callable[[], Onwards]) -> Scattered:
        """Return what scatters for the second time of beams that have what scatters `once`.

        `onwards` gives their ways on, which are asked for where matter scatters forward.
        """
        directed = [flux is not None for flux in once.flux]
        if not any(directed):
            return scattered(self._flown(once), self.flights)
        again = onwards().scattered(beams, self.flights, self.used)
        return scattered_once(again, self.flights, self.used, self.grid, directed)

    def often(
        self, once: Scattered, twice: Scattered, body: Body, last: End | None
    ) -> tuple[Scattered, list[float], End]:
        """Return what scatters twice or more, the power that begins to, and where diffusion ended.

        `last` is where it did so before. What begins to scatters for the second time, or first since it entered again.
        """
        fluence, end = self.fluence(_diffusing(once, twice, self.media, self.flights), body, last)
        begins = [
            None if second is None or often is None else self._begins(second, often, medium, flight)
            for second, often, medium, flight in zip(twice.power, fluence, self.media, self.flights, strict=True)
        ]
        found = [
            None
            if power is None or often is None
            else often_scattered(power, often.end.volume, flight, self.fill, self.grid)
            for power, often, flight in zip(begins, fluence, self.flights, strict=True)
        ]
        begun = [0.0 if power is None else _total(power) for power in begins]
        directed = [flux is not None for flux in twice.flux]
        if not any(directed):
            return Scattered.evenly(found), begun, end
        turned = [part if turns else None for part, turns in zip(found, directed, strict=True)]
        further = scattered(self._flown(Scattered.evenly(turned), directed), self.flights)
        turning = Scattered.together([twice, further]).flux
        extinctions = [flight.sigma_t for flight in self.flights]
        fly = self.convolvers(FLIGHT, extinctions, directed, flight_spectrum)
        flux = [
            None if part is None else carried_on(part, flight.turning, functools.partial(fly, i), self.fill)
            for i, (part, flight) in enumerate(zip(turning, self.flights, strict=True))
        ]
        return Scattered(found, flux), begun, end

    def gains(
        self, light: Beams, alone: Beams, onwards: Callable[[], Onwards], body: Body, last: End | None
    ) -> tuple[list[Float32 | None], End]:
        """Return by how much more of light from all around scatters twice or more than is found, at the nodes.

        And where diffusion ended.

        Parameters
        ----------
        light, alone : Beams
            Of `even_beams`, with all other bodies and without those that scatter.
        onwards : callable
            As of `twice`.
        body : Body
        last : End, optional
            Where diffusion ended before.
        """
        once = scattered_once(light, self.flights, self.used, self.grid)
        of_alone = once if alone is light else scattered_once(alone, self.flights, self.used, self.grid)
        exchange = None if body.exchange is None else body.exchange.afloat()
        around = replace(body, exchange=exchange, is_even=True)
        often, _, end = self.often(once, self.twice(light, once, onwards), around, last)
        scattering = [np.float32(flight.sigma_s) for flight in self.flights]
        known = [Scattered.evenly(once.power), self._emitted(of_alone)]
        expected = _less(self._even(self.used).times(scattering), known)
        return _gains(expected, often), end

    def _even(self, used: Sequence[bool]) -> Scattered:
        """Return what collides in surroundings of radiance 1 over sigma_t, in channels that are `used`, mm^3."""
        volume = np.float32(4.0 * np.pi * self.media[0].eta ** 2 * self.grid.texel**3)
        return Scattered.evenly([volume * self.fill.weight if is_used else None for is_used in used])

    def _emitted(self, once: Scattered) -> Scattered:
        """Return what scatters of the light that matter sends out, as much as it absorbs in surroundings of radiance 1.

        It starts deep inside too: by diffusion too much of it would come up to the surface, and hide what light from
        outside lacks there. It is followed for `FLIGHTS`, and then goes on in a geometric series. Even light tells what
        a flight lacks as well: all that collides arrives by flights, but light from outside, `once` over the albedo.
        """
        emitting = [used and flight.sigma_a > 0.0 for used, flight in zip(self.used, self.flights, strict=True)]
        even = self._even(emitting)
        if not any(emitting):
            return even
        collided = even.times([np.float32(flight.sigma_t) for flight in self.flights])
        entered = once.times([np.float32(1.0 / flight.albedo) if flight.albedo else None for flight in self.flights])
        lacking = _gains(_less(collided, [Scattered.evenly(entered.power)]), self._flown(collided))

        def onwards(source: Scattered) -> Scattered:
            return scattered(self._flown(source).times(lacking), self.flights)

        parts = [onwards(even.times([np.float32(flight.sigma_a) for flight in self.flights]))]
        for _ in range(FLIGHTS - 1):
            parts.append(onwards(parts[-1]))
        following: list[np.float32 | Float32 | None] = []
        for before, after in zip(parts[-2].power, parts[-1].power, strict=True):
            share = 0.0 if before is None or after is None else _total(after) / max(_total(before), 1e-30)
            following.append(np.float32(share / (1.0 - min(share, MOST_KEPT))))
        return Scattered.together([*parts, parts[-1].times(following)])

    def _flown(self, source: Scattered, directed: Sequence[bool] = (False,) * 3) -> Scattered:
        """Return the light that meets matter next, where some that scatters is given, with its flux if `directed`."""
        extinctions = [flight.sigma_t for flight in self.flights]
        powered = [power is not None for power in source.power]
        turned = [turns or flux is not None for turns, flux in zip(directed, source.flux, strict=True)]
        fly = self.convolvers(FLIGHT, extinctions, powered, flight_spectrum)
        potential = self.convolvers(POTENTIAL, extinctions, turned, potential_spectrum)
        return collided_again(source, extinctions, self.fill, self.back, self.grid, fly, potential, directed)

    def balanced(
        self, often: Scattered, begun: Sequence[float], out: Beams, gains: Sequence[Float32 | None]
    ) -> list[np.float32 | Float32 | None]:
        """Return the gains with those of directed light by which its power balances.

        What scatters is what has `begun` to and, of what scatters, all that collides again: all but what leaves by its
        ways `out` (`core.paths.second.exits`). Even light has no direction, and tells nothing of the errors in it.
        """
        extinctions, eta = [flight.sigma_t for flight in self.flights], self.media[0].eta
        gone = left(often, extinctions, self.fill, out, self.grid, eta)
        found: list[np.float32 | Float32 | None] = list(gains)
        for i, (power, flux, flight) in enumerate(zip(*often, self.flights, strict=True)):
            if power is not None and flux is not None:
                total = _total(power)
                lost = total - flight.albedo * (total - float(gone[i]))
                found[i] = np.float32(begun[i] / max(lost, 1e-30))
        return found

    @staticmethod
    def _begins(twice: Float32, often: Often, medium: Medium, flight: DeltaEddington) -> Float32:
        """Return the power that scatters for the second time, or first since it left and entered.

        What entered is told by reduced coefficients.
        """
        return np.asarray(twice + np.float32(flight.sigma_s / medium.sigma_s_prime) * often.entered, np.float32)


def even_beams(surface: Surface, bodies: Int32) -> Beams:
    """Return the beams of surroundings of radiance 1 through some of the bodies of a surface.

    Other bodies that scatter are black within, since all that leaves them has scattered (`Body.is_even`); clear parts
    absorb nothing.
    """
    number = np.arange(len(surface.absorption))
    is_other = (number < surface.scattering) & ~np.isin(number, bodies)
    seen = replace(surface, absorption=np.where(is_other[:, None], BLACK, np.zeros_like(surface.absorption)))
    light = surrounding(np.ones(EVEN_MAP), np.eye(3), Ball.holding(surface.faces.vertices), EVEN_BEAMS)
    beams = traced(seen, light)
    within = beams.chosen(np.isin(beams.bodies, bodies))
    return within.in_matter(int(surface.matter[bodies[0]]), np.zeros((surface.kinds, 3), np.float32))


def scattered_once(
    beams: Beams,
    flights: Sequence[DeltaEddington],
    used: Sequence[bool],
    grid: LayerGrid,
    directed: Sequence[bool] | None = None,
) -> Scattered:
    """Return what scatters of beams where they first collide, in channels that are `used`.

    Its flux is told where it is `directed`; without that, in matter that scatters forward.
    """
    turned = [flight.cosine > 0.0 for flight in flights] if directed is None else directed
    turned = [turns and is_used for turns, is_used in zip(turned, used, strict=True)]
    met = moments(beams, [flight.sigma_t for flight in flights], grid, 4 if any(turned) else 1)
    power = [part if is_used and part.any() else None for part, is_used in zip(met[0], used, strict=True)]
    flux = [met[1:, i] if turns and power[i] is not None else None for i, turns in enumerate(turned)]
    return scattered(Scattered(power, flux), flights)


def scattered(met: Scattered, flights: Sequence[DeltaEddington]) -> Scattered:
    """Return what scatters of light that meets matter, and of its flux."""
    albedos = [np.float32(flight.albedo) for flight in flights]
    turnings = [np.float32(flight.turning) for flight in flights]
    return Scattered(met.times(albedos).power, met.times(turnings).flux)


def _diffusing(
    first: Scattered, second: Scattered, media: Sequence[Medium], flights: Sequence[DeltaEddington]
) -> Volumes:
    """Return the source of diffusion: power that scatters for the second time, moved on to where its flux takes it.

    A source q + 3 w . v is q - 3 D div v to diffusion. Of v = g'' s_s'' J, with J the flux of light that has scattered
    once, div J is what has scattered once less what of that collides, but for what leaves: nothing is added.
    """
    sources: list[Float32 | None] = []
    for once, twice, medium, flight in zip(first.power, second.power, media, flights, strict=True):
        if once is None or twice is None or flight.cosine == 0.0:
            sources.append(twice)
            continue
        moved, met = 3.0 * medium.diffusion * flight.cosine * flight.sigma_s, twice / np.float32(flight.albedo)
        change = met - np.float32(_total(met) / _total(once)) * once
        sources.append(np.asarray(twice + np.float32(moved) * change, np.float32))
    return sources


def _less(power: Scattered, parts: Sequence[Scattered]) -> Scattered:
    """Return power without parts of it."""
    minus = [np.float32(-1.0)] * len(power.power)
    return Scattered.together([power, *(part.times(minus) for part in parts)])


def _gains(expected: Scattered, found: Scattered) -> list[Float32 | None]:
    """Return the factors by which power that is found becomes what is expected, in [0, `MOST_GAIN`]."""
    gains: list[Float32 | None] = []
    for whole, part in zip(expected.power, found.power, strict=True):
        if whole is None or part is None:
            gains.append(None)
            continue
        least = np.maximum(whole, np.float32(0.0))
        enough = np.maximum(part, least / np.float32(MOST_GAIN))
        gains.append(np.divide(least, enough, out=np.ones_like(least), where=enough > 0.0))
    return gains


def _total(power: Float32) -> float:
    return float(power.sum(dtype=np.float64))
