"""Light within clear and murky matter, where nodes resolve the free paths: collision by collision, then diffusion.

Beams of unscattered light deposit their first collisions, one flight more makes the second, and these are the source of
diffusion: what it is bad at, light that has scattered once, it is not asked for. What matter sends out along any ray
follows from the three (`core.paths.resolved`).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.kernels import Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.material.fresnel import index_of
from milkglass.core.material.medium import BOUNDARY_CONDITION, DeltaEddington, Medium
from milkglass.core.paths.beams import Beams
from milkglass.core.paths.deposit import moments
from milkglass.core.paths.filled import Filled, filled
from milkglass.core.paths.flight import flight_spectrum, potential_spectrum
from milkglass.core.paths.onwards import Onwards, sent_on
from milkglass.core.paths.resolution import RESOLVED, balanced_share, met_in_ball, needs_beams, scaled, thick_gain
from milkglass.core.paths.resolved import Resolved, Scattered, Volumes, often_scattered, resolved
from milkglass.core.paths.second import Returns, carried_on, collided_again, exits, left, returns
from milkglass.core.paths.surface import Surface
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import pool_map
from milkglass.core.transport.diffusion.boundary import RAY_OFFSET, Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.iteration import End, Iteration, Reached, begin
from milkglass.core.transport.diffusion.reentry import Reentry, SurfaceExchange

MOST_LOBES = 4  # lights whose directions are kept apart where matter scatters forward
FLIGHT, POTENTIAL = "flight", "potential"
KERNELS = {FLIGHT: flight_spectrum, POTENTIAL: potential_spectrum}


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
    """

    mesh: Mesh
    samples: SurfaceSamples
    boundary: Boundary
    exchange: SurfaceExchange | None
    external: Float32 | None = None


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


class Within:
    """Solves for the light within an object, each time from where it ended the last time.

    Parameters
    ----------
    kernels : Kernels
        Keeps spectra and convolvers.
    shape : callable
        Padded sizes of a medium's convolution on a grid.
    tolerance : float
        Relative residual at which a channel is solved.
    most_products : int
        Of a channel.
    """

    def __init__(
        self,
        kernels: Kernels,
        shape: Callable[[LayerGrid, Medium], ConvolutionShape],
        tolerance: float,
        most_products: int,
    ) -> None:
        self._kernels, self._shape, self._tolerance, self._most_products = kernels, shape, tolerance, most_products
        self._last: End | None = None

    def resolved(
        self,
        beams: Beams,
        media: Sequence[Medium],
        body: Body,
        window: float,
        green: Sequence[Spectra | None],
        stages: Stages,
        is_wanted: Callable[[], bool],
    ) -> Resolved | None:
        """Return what matter sends out along rays; None where it is no longer wanted, as asked between long steps.

        Parameters
        ----------
        beams : Beams
            Unscattered light.
        media : R, G and B
        body : Body
        window : float
            Width of the window of the smooth part, mm.
        green : R, G and B
            Spectra of G_L.
        stages : Stages
        is_wanted : callable
        """
        grid, eta, patches = body.boundary.grid, media[0].eta, body.boundary.patches
        fill = stages.run(Stage.FILLED, (body.mesh, grid), lambda: filled(body.mesh, grid))
        # Several bodies send light into each other through clear parts, which is left out.
        is_nested = beams.surface is not None and beams.surface.is_nested and beams.surface.scattering == 1
        around = beams.surface if is_nested else None
        seen = [needs_beams(medium, grid) for medium in media]
        flights = [scaled(medium, grid) for medium in media]

        turned = [used and flight.cosine > 0.0 for used, flight in zip(seen, flights, strict=True)]

        def once(of_light: Beams) -> Scattered:
            met = moments(of_light, [flight.sigma_t for flight in flights], grid, 4 if any(turned) else 1)
            power = [
                np.float32(flight.albedo) * part if used and part.any() else None
                for flight, part, used in zip(flights, met[0], seen, strict=True)
            ]
            flux = [
                np.float32(flight.turning) * met[1:, i] if turns and power[i] is not None else None
                for i, (flight, turns) in enumerate(zip(flights, turned, strict=True))
            ]
            return Scattered(power, flux)

        alone = functools.cache(lambda: Surface.of(body.mesh, eta))
        places = patches.on_surface, patches.face_normals, patches.areas

        def sent_back() -> Returns:
            return returns(*places, alone(), RAY_OFFSET * grid.texel, around)

        def ways_out() -> Beams:
            return exits(*places, alone(), RAY_OFFSET * grid.texel)

        def light_by_light() -> list[Scattered]:
            return [once(of_light) for of_light in (beams.by_light(MOST_LOBES) if any(turned) else [beams])]

        first = stages.run(Stage.FIRST_VOLUME, (beams, grid, *media), light_by_light)
        together = Scattered.together(first)
        followed = [medium.albedo >= RESOLVED.least_albedo for medium in media]
        source = Scattered(
            *([part if goes_on else None for part, goes_on in zip(parts, followed, strict=True)] for parts in together)
        )
        if all(part is None for part in source.power):
            no_gains = [1.0] * len(media)
            return stages.run(
                Stage.RESOLVED, (first, fill), lambda: resolved(first, source, no_gains, media, fill, grid)
            )
        back = stages.run(Stage.RETURNS, (body.boundary, eta, around), sent_back)
        index = eta if around is None else index_of(back.reflected())
        fly = functools.partial(self._flown, media=media, flights=flights, fill=fill, back=back, grid=grid)

        phases = [medium.g for medium in media]

        def goes_on() -> Onwards:
            return sent_on(beams, phases, around or alone())

        def twice() -> Scattered:
            directed = [part is not None for part in source.flux]
            if any(directed):
                used = [part is not None for part in source.power]
                key = body.mesh, beams.starts, beams.emitted, eta, around, *phases
                scattered = stages.run(Stage.ONWARDS, key, goes_on).scattered(beams, flights, used)
                power, *flux = moments(scattered, [flight.sigma_t for flight in flights], grid, 4)
                met = Scattered(
                    [part if used[i] else None for i, part in enumerate(power)],
                    [np.stack([part[i] for part in flux]) if directed[i] else None for i in range(len(power))],
                )
            else:
                met = fly(source)
            return Scattered(
                [
                    None if power is None else np.float32(flight.albedo) * power
                    for flight, power in zip(flights, met.power, strict=True)
                ],
                [
                    None if flux is None else np.float32(flight.turning) * flux
                    for flight, flux in zip(flights, met.flux, strict=True)
                ],
            )

        if not is_wanted():
            return None
        second = stages.run(Stage.SECOND_VOLUME, (first, fill, back), twice)
        if not is_wanted():
            return None
        fluence = stages.run(
            Stage.FLUENCE,
            (second, body.boundary, body.exchange, body.external),
            lambda: self._fluence(_diffusing(source, second, media, flights), media, index, body, window, green),
        )

        def seen_along_rays() -> Resolved:
            again = [
                None if twice is None or found is None else _again(twice, found, medium, flight, fill, grid)
                for twice, found, medium, flight in zip(second.power, fluence, media, flights, strict=True)
            ]
            begun = [
                0.0 if twice is None or found is None else _total(twice) + _total(_entered(found, medium, flight))
                for twice, found, medium, flight in zip(second.power, fluence, media, flights, strict=True)
            ]
            chord = body.mesh.mean_chord
            # In thin parts fluence is larger for what they let out, and so much less is lacking.
            met = [met_in_ball(chord * medium.sigma_t_prime, medium.eta) for medium in media]
            gathered = [thick_gain(chord * flight.sigma_t, flight.albedo) for flight in flights]
            thick = [gain * share for gain, share in zip(gathered, met, strict=True)]
            extinctions = [flight.sigma_t for flight in flights]
            convolve = self._convolution(FLIGHT, [flux is not None for flux in second.flux], media, extinctions, grid)

            def carry(i: int, flux: Float32) -> Float32:
                return carried_on(flux, flights[i].turning, functools.partial(convolve, i), fill)

            often = _turned(second, again, flights, fly, carry)
            gone = None if out is None else left(often, extinctions, fill, out, grid, eta)
            chords = [chord * extinction for extinction in extinctions]
            gains = _gains(begun, often, gone, chords, flights, thick, fly)
            return resolved(first, often, gains, media, fill, grid)

        if not is_wanted():
            return None
        is_bare = around is None and second.is_directed
        out = stages.run(Stage.EXITS, (body.boundary, eta), ways_out) if is_bare else None
        return stages.run(Stage.RESOLVED, (first, second, fluence, out), seen_along_rays)

    def _flown(
        self,
        scattered: Scattered,
        directed: Sequence[bool] = (False,) * 3,
        *,
        media: Sequence[Medium],
        flights: Sequence[DeltaEddington],
        fill: Filled,
        back: Returns,
        grid: LayerGrid,
    ) -> Scattered:
        """Return the light that meets matter next, where some that scatters is given, with its flux if `directed`."""
        extinctions = [flight.sigma_t for flight in flights]
        turned = [turns or flux is not None for turns, flux in zip(directed, scattered.flux, strict=True)]
        fly = self._convolution(FLIGHT, [part is not None for part in scattered.power], media, extinctions, grid)
        potential = self._convolution(POTENTIAL, turned, media, extinctions, grid)
        return collided_again(scattered, extinctions, fill, back, grid, fly, potential, directed)

    def _convolution(
        self, kernel: str, used: Sequence[bool], media: Sequence[Medium], extinctions: Sequence[float], grid: LayerGrid
    ) -> Callable[[int, Float32], Float32]:
        """Return what convolves a volume of a channel that is `used` with a kernel of `KERNELS`."""
        sizes = [(self._shape(grid, medium), grid.texel, grid.layer_distance) for medium in media]
        asked = [
            ((kernel, extinction), *size) if is_used else None
            for extinction, size, is_used in zip(extinctions, sizes, used, strict=True)
        ]
        spectra = self._kernels.spectra(asked, lambda source, shape: KERNELS[kernel](source[1], grid, shape))

        def convolve(i: int, volume: Float32) -> Float32:
            spectrum = spectra[i]
            assert spectrum is not None
            return self._kernels.convolver(sizes[i][0], i).convolve(volume, spectrum)

        return convolve

    def _fluence(
        self,
        second: Volumes,
        media: Sequence[Medium],
        eta: float,
        body: Body,
        window: float,
        green: Sequence[Spectra | None],
    ) -> list[Often | None]:
        """Return what has scattered twice or more, of power that scatters for the second time at the nodes.

        Of it some leaves and enters again. Of what has scattered once that is in the second scattering, whose flight
        knows no surface between parts. The surface reflects as one of an index `eta`.
        """
        boundary, grid = body.boundary, body.boundary.grid
        channels: list[Channel | None] = [None] * len(media)
        none = np.zeros(len(boundary.patches))

        def solved(i: int) -> Often | None:
            power, spectrum = second[i], green[i]
            if power is None or spectrum is None or not power.any():
                return None
            medium = replace(media[i], eta=eta, anisotropy=BOUNDARY_CONDITION.anisotropy_within)
            convolver = self._kernels.convolver(self._shape(grid, media[i]), i)
            reentry, entered, local = None, np.zeros(power.size, np.float32), none
            if body.exchange is not None and body.external is not None:
                entering = body.exchange.sources(medium, window)
                flux = boundary.patches.sums @ body.external[:, i].astype(np.float64)
                entered, local = entering.at_nodes(flux), entering.at_patches(flux)
            if body.exchange is not None and not body.exchange.is_negligible(medium):
                reentry = Reentry(body.exchange, i, medium, window)
            convolve = functools.partial(convolver.convolve, spectra=spectrum)
            deposited = power.ravel() + entered
            at = channels[i] = Channel(boundary, medium, window, convolve, deposited, local, reentry=reentry)
            start = begin(at, i, self._last, None, body.samples)
            iteration = Iteration(at, start, self._tolerance, self._most_products)
            while iteration.advance():
                pass
            end = iteration.reached
            if reentry is not None:
                entered = entered + reentry.at_nodes(end.two_A_M)
            return Often(end, entered.reshape(grid.shape))

        found = pool_map(solved, range(len(media)))
        iterates = tuple(none if often is None else often.end.iterate for often in found)
        self._last = End(boundary, tuple(channels), iterates)
        return found


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


def _turned(
    second: Scattered,
    again: Volumes,
    flights: Sequence[DeltaEddington],
    fly: Callable[..., Scattered],
    carry: Callable[[int, Float32], Float32],
) -> Scattered:
    """Return what scatters twice or more, `again`, with its flux where what scatters for the second time has one."""
    directed = [flux is not None for flux in second.flux]
    if not any(directed):
        return Scattered(again, second.flux)
    asked = [power if turns else None for power, turns in zip(again, directed, strict=True)]
    met = fly(Scattered.evenly(asked), directed)
    flux = [
        None if begun is None or more is None else carry(i, begun + np.float32(flight.turning) * more)
        for i, (begun, more, flight) in enumerate(zip(second.flux, met.flux, flights, strict=True))
    ]
    return Scattered(again, flux)


def _gains(
    begun: Sequence[float],
    often: Scattered,
    gone: Array | None,
    chords: Sequence[float],
    flights: Sequence[DeltaEddington],
    thick: Sequence[float],
    fly: Callable[..., Scattered],
) -> list[float]:
    """Return factors on what scatters twice or more, by which its power balances.

    What scatters is what has just `begun` to and, of what scatters, all that collides again: of directed light all but
    what rays see leave, `gone`, where that is known. Else its flight tells; in thick matter that is a small difference,
    and what is gathered near the surface lacks some light: there the factors are `thick`.
    """
    seen = [gone is not None and flux is not None for flux in often.flux]
    counted = [1.0 if is_seen else balanced_share(length) for is_seen, length in zip(seen, chords, strict=True)]
    asked = [
        None if is_seen or share == 0.0 else power
        for power, is_seen, share in zip(often.power, seen, counted, strict=True)
    ]
    stopped = [None] * len(asked) if all(power is None for power in asked) else fly(Scattered(asked, often.flux)).power
    gains = list(thick)
    for i, (power, met, flight) in enumerate(zip(often.power, stopped, flights, strict=True)):
        total = 0.0 if power is None else _total(power)
        if gone is not None and seen[i]:
            collided = total - float(gone[i])
        elif met is not None:
            collided = _total(met)
        else:
            continue
        gains[i] += counted[i] * (begun[i] / max(total - flight.albedo * collided, 1e-30) - gains[i])
    return gains


def _again(
    second: Float32, found: Often, medium: Medium, flight: DeltaEddington, fill: Filled, grid: LayerGrid
) -> Float32:
    """Return the power that scatters twice or more, or again since it left and entered."""
    return often_scattered(second + _entered(found, medium, flight), found.end.volume, flight, fill, grid)


def _entered(found: Often, medium: Medium, flight: DeltaEddington) -> Float32:
    """Return the power that scatters first since it entered again, which is told by reduced coefficients."""
    return np.asarray(np.float32(flight.sigma_s / medium.sigma_s_prime) * found.entered)


def _total(power: Float32) -> float:
    return float(power.sum(dtype=np.float64))
