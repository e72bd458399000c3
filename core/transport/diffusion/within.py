"""Light within clear and murky matter, where nodes resolve the free paths: collision by collision, then diffusion.

Beams of unscattered light deposit their first collisions, one flight more makes the second, and these are the source of
diffusion: what it is bad at, light that has scattered once, it is not asked for. What matter sends out along any ray
follows from the three (`core.paths.resolved`).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.grid.kernels import Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.material.fresnel import index_of
from milkglass.core.material.medium import BOUNDARY_CONDITION, Medium
from milkglass.core.paths.beams import Beams
from milkglass.core.paths.filled import filled
from milkglass.core.paths.onwards import Onwards, sent_on
from milkglass.core.paths.resolution import RESOLVED, needs_beams, scaled
from milkglass.core.paths.resolved import Resolved, Scattered, Volumes, resolved
from milkglass.core.paths.second import Returns, exits, returns
from milkglass.core.paths.surface import Surface
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import pool_map
from milkglass.core.transport.diffusion.boundary import RAY_OFFSET
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.iteration import End, Iteration, begin
from milkglass.core.transport.diffusion.orders import Body, Convolvers, Often, Orders, even_beams, scattered_once
from milkglass.core.transport.diffusion.reentry import Reentry

MOST_LOBES = 4  # lights whose directions are kept apart where matter scatters forward


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
        self._last_even: End | None = None

    def start_cold(self) -> None:
        """Forget where the last solutions ended."""
        self._last = self._last_even = None

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
        alone = functools.cache(lambda: Surface.of(body.mesh, eta))
        places = patches.on_surface, patches.face_normals, patches.areas

        def sent_back(around: Surface | None) -> Returns:
            return returns(*places, alone(), RAY_OFFSET * grid.texel, around)

        def ways_out() -> Beams:
            return exits(*places, alone(), RAY_OFFSET * grid.texel)

        def light_by_light() -> list[Scattered]:
            directed = any(used and flight.cosine > 0.0 for used, flight in zip(seen, flights, strict=True))
            lights = beams.by_light(MOST_LOBES) if directed else [beams]
            return [scattered_once(light, flights, seen, grid) for light in lights]

        first = stages.run(Stage.FIRST_VOLUME, (beams, grid, *media), light_by_light)
        followed = [medium.albedo >= RESOLVED.least_albedo for medium in media]
        source = Scattered.together(first).of_channels(followed)
        if all(part is None for part in source.power):
            return stages.run(Stage.RESOLVED, (first, fill), lambda: resolved(first, source, media, fill, grid))
        back = stages.run(Stage.RETURNS, (body.boundary, eta, around), lambda: sent_back(around))
        index = eta if around is None else index_of(back.reflected())
        used = [part is not None for part in source.power]
        solve = functools.partial(self._fluence, media=media, eta=index, window=window, green=green)
        orders = Orders(media, flights, used, fill, back, grid, self._convolvers(grid, media), solve)
        phases = [medium.g for medium in media]

        def onwards() -> Onwards:
            key = body.mesh, beams.starts, beams.emitted, eta, around, *phases
            return stages.run(Stage.ONWARDS, key, lambda: sent_on(beams, phases, around or alone()))

        def twice() -> Scattered:
            return orders.twice(beams, source, onwards)

        if not is_wanted():
            return None
        second = stages.run(Stage.SECOND_VOLUME, (first, fill, back), twice)
        if not is_wanted():
            return None

        def scattering_often() -> tuple[Scattered, list[float]]:
            found, begun, self._last = orders.often(source, second, body, self._last)
            return found, begun

        key = second, body.boundary, body.exchange, body.external
        often, begun = stages.run(Stage.OFTEN_SCATTERED, key, scattering_often)
        if not is_wanted():
            return None

        is_balanced = [around is None and flux is not None for flux in often.flux]
        uneven = [is_used and not known for is_used, known in zip(used, is_balanced, strict=True)]
        gains: list[Float32 | None] = [None] * len(media)
        if any(uneven):
            # Others are in the way of even light where what they let out enters, or where they are clear.
            whole = (around if body.exchange is None else beams.surface) or alone()
            bodies = np.unique(beams.bodies) if whole is beams.surface else np.zeros(1, np.int32)

            def from_all_around() -> tuple[Beams, Beams]:
                light = even_beams(whole, bodies)
                return light, light if whole.scattering == 1 else even_beams(alone(), np.zeros(1, np.int32))

            place = body.mesh, eta, beams.surface, body.exchange is None
            rays = stages.run(Stage.EVEN_BEAMS, place, from_all_around)
            depends_on = fill, back, body.boundary, body.exchange, *rays, *media, *uneven
            gains = stages.run(
                Stage.EVENNESS,
                depends_on,
                lambda: self._gains(replace(orders, used=uneven), rays, body, around or alone(), sent_back, stages),
            )
        out = stages.run(Stage.EXITS, (body.boundary, eta), ways_out) if any(is_balanced) else None

        def seen_along_rays() -> Resolved:
            factors = gains if out is None else orders.balanced(often, begun, out, gains)
            return resolved(first, often.times(factors), media, fill, grid)

        return stages.run(Stage.RESOLVED, (first, often, gains, out), seen_along_rays)

    def _gains(
        self,
        orders: Orders,
        rays: tuple[Beams, Beams],
        body: Body,
        surface: Surface,
        sent_back: Callable[[Surface], Returns],
        stages: Stages,
    ) -> list[Float32 | None]:
        """Return the gains of even light, of these beams, with all others and alone; no clear part absorbs."""
        light, of_alone = rays
        if surface.absorption.any():
            surface = replace(surface, absorption=np.zeros_like(surface.absorption))
            orders = replace(orders, back=sent_back(surface))
        phases = [medium.g for medium in orders.media]

        def onwards() -> Onwards:
            key = light, *phases
            return stages.run(Stage.EVEN_ONWARDS, key, lambda: sent_on(light, phases, surface))

        found, self._last_even = orders.gains(light, of_alone, onwards, body, self._last_even)
        return found

    def _convolvers(self, grid: LayerGrid, media: Sequence[Medium]) -> Convolvers:
        """Return convolutions with the kernels of `core.paths.flight` on a grid padded as for a medium's G."""
        sizes = [(self._shape(grid, medium), grid.texel, grid.layer_distance) for medium in media]

        def spectra(
            name: str,
            extinctions: Sequence[float],
            used: Sequence[bool],
            make: Callable[[float, LayerGrid, ConvolutionShape], Float32],
        ) -> Callable[[int, Float32], Float32]:
            kernels = [
                ((name, extinction), *size) if is_used else None
                for extinction, size, is_used in zip(extinctions, sizes, used, strict=True)
            ]
            found = self._kernels.spectra(kernels, lambda source, shape: make(source[1], grid, shape))

            def convolve(i: int, power: Float32) -> Float32:
                kernel = found[i]
                assert kernel is not None
                return self._kernels.convolver(sizes[i][0], i).convolve(power, kernel)

            return convolve

        return spectra

    def _fluence(
        self,
        second: Volumes,
        body: Body,
        last: End | None,
        *,
        media: Sequence[Medium],
        eta: float,
        window: float,
        green: Sequence[Spectra | None],
    ) -> tuple[list[Often | None], End]:
        """Return what has scattered twice or more, of power that scatters for the second time, and where that ended.

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
            if body.exchange is not None and (flux := body.entering(i, media[i])) is not None:
                entering = body.exchange.sources(medium, window)
                entered, local = entering.at_nodes(flux), entering.at_patches(flux)
            if body.exchange is not None and not body.exchange.is_negligible(medium):
                reentry = Reentry(body.exchange, i, medium, window)
            convolve = functools.partial(convolver.convolve, spectra=spectrum)
            deposited = power.ravel() + entered
            at = channels[i] = Channel(boundary, medium, window, convolve, deposited, local, reentry=reentry)
            start = begin(at, i, last, None, body.samples)
            iteration = Iteration(at, start, self._tolerance, self._most_products)
            while iteration.advance():
                pass
            end = iteration.reached
            if reentry is not None:
                entered = entered + reentry.at_nodes(end.two_A_M)
            return Often(end, entered.reshape(grid.shape))

        found = pool_map(solved, range(len(media)))
        iterates = tuple(none if often is None else often.end.iterate for often in found)
        return found, End(boundary, tuple(channels), iterates)
