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
from milkglass.core.material.medium import BOUNDARY_CONDITION, Medium
from milkglass.core.paths.beams import Beams
from milkglass.core.paths.deposit import collided
from milkglass.core.paths.filled import Filled, filled
from milkglass.core.paths.flight import flight_spectrum
from milkglass.core.paths.resolution import RESOLVED, needs_beams
from milkglass.core.paths.resolved import Resolved, Volumes, often_scattered, resolved
from milkglass.core.paths.second import Returns, arriving, collided_again, returns
from milkglass.core.paths.surface import Surface
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import pool_map
from milkglass.core.transport.diffusion.boundary import RAY_OFFSET, Boundary
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.iteration import End, Iteration, Reached, begin
from milkglass.core.transport.diffusion.reentry import Reentry, SurfaceExchange


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
    """

    mesh: Mesh
    samples: SurfaceSamples
    boundary: Boundary
    exchange: SurfaceExchange | None


@dataclass(frozen=True, eq=False)
class Often:
    """One channel of light that has scattered twice or more.

    Attributes
    ----------
    end : Reached
        What its diffusion has come to.
    entered : (n_layers, height, width) float32
        Power at the nodes that scatters for the first time since it left the object and entered again.
    """

    end: Reached
    entered: Float32

    def leaving(self, areas: Array) -> float:
        """Return the flux that leaves patches of these areas, (n,)."""
        return float(areas @ self.end.two_A_M) / (2.0 * self.end.channel.medium.extrapolation_factor)


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
        areas = patches.areas
        fill = stages.run(Stage.FILLED, (body.mesh, grid), lambda: filled(body.mesh, grid))
        seen = [needs_beams(medium, grid) for medium in media]

        def once() -> Volumes:
            power = collided(beams, [medium.sigma_t_prime for medium in media], grid)
            return [
                np.float32(medium.albedo) * part if used and part.any() else None
                for medium, part, used in zip(media, power, seen, strict=True)
            ]

        def sent_back() -> Returns:
            places = patches.on_surface, patches.face_normals, patches.areas
            return returns(*places, Surface.of(body.mesh, eta), RAY_OFFSET * grid.texel)

        first = stages.run(Stage.FIRST_VOLUME, (beams, grid, *media), once)
        followed = [medium.albedo >= RESOLVED.least_albedo for medium in media]
        source = [part if goes_on else None for part, goes_on in zip(first, followed, strict=True)]
        if all(part is None for part in source):
            no_gains = [1.0] * len(media)
            return stages.run(
                Stage.RESOLVED, (first, fill), lambda: resolved(first, source, no_gains, media, fill, grid)
            )
        back = stages.run(Stage.RETURNS, (body.boundary, eta), sent_back)
        fly = functools.partial(self._flown, media=media, fill=fill, back=back, grid=grid)

        def twice() -> Volumes:
            return [
                None if power is None else np.float32(medium.albedo) * power
                for medium, power in zip(media, fly(source), strict=True)
            ]

        if not is_wanted():
            return None
        second = stages.run(Stage.SECOND_VOLUME, (first, fill, back), twice)
        if not is_wanted():
            return None
        fluence = stages.run(
            Stage.FLUENCE,
            (second, body.boundary, body.exchange),
            lambda: self._fluence(second, media, body, window, green),
        )

        def seen_along_rays() -> Resolved:
            often = [
                None
                if again is None or found is None
                else often_scattered(again + found.entered, found.end.volume, medium, fill, grid)
                for again, found, medium in zip(second, fluence, media, strict=True)
            ]
            gains = self._gains(source, second, often, fluence, areas, media, fly)
            return resolved(first, often, gains, media, fill, grid)

        if not is_wanted():
            return None
        return stages.run(Stage.RESOLVED, (first, second, fluence), seen_along_rays)

    def _flown(
        self, scattered: Volumes, media: Sequence[Medium], fill: Filled, back: Returns, grid: LayerGrid
    ) -> Volumes:
        """Return the power that meets matter next, where some that scatters is given, at the nodes."""
        kernels = [
            None
            if part is None
            else (("flight", medium.sigma_t_prime), self._shape(grid, medium), grid.texel, grid.layer_distance)
            for part, medium in zip(scattered, media, strict=True)
        ]
        flights = self._kernels.spectra(kernels, lambda source, shape: flight_spectrum(source[1], grid, shape))
        radiance = arriving(scattered, media, fill, back, grid)

        def fly(i: int, power: Float32) -> Float32:
            spectrum = flights[i]
            assert spectrum is not None
            return self._kernels.convolver(self._shape(grid, media[i]), i).convolve(power, spectrum)

        return collided_again(scattered, radiance, media, fill, back, grid, fly)

    @staticmethod
    def _gains(
        first: Volumes,
        second: Volumes,
        often: Volumes,
        fluence: Sequence[Often | None],
        areas: Array,
        media: Sequence[Medium],
        fly: Callable[[Volumes], Volumes],
    ) -> list[float]:
        """Return factors on what scatters twice or more: what of it leaves is what leaves in the solution.

        In thick matter, where that is a small difference, they are the least.
        """
        gains, asked = [RESOLVED.least_gain] * len(media), list(often)
        for i, (once, twice, medium) in enumerate(zip(first, second, media, strict=True)):
            if once is not None and twice is not None:
                escaping = 1.0 - _total(twice) / (medium.albedo * _total(once))
                asked[i] = asked[i] if escaping > RESOLVED.clear_escape else None
        if any(again is not None for again in asked):
            met = fly(asked)
            for i, (again, stopped, found) in enumerate(zip(asked, met, fluence, strict=True)):
                if again is not None and stopped is not None and found is not None:
                    gains[i] = max(gains[i], found.leaving(areas) / max(_total(again) - _total(stopped), 1e-30))
        return gains

    def _fluence(
        self, second: Volumes, media: Sequence[Medium], body: Body, window: float, green: Sequence[Spectra | None]
    ) -> list[Often | None]:
        """Return what has scattered twice or more, of power that scatters for the second time at the nodes.

        Of it some leaves and enters again. Of what has scattered once that is in the second scattering, whose flight
        knows no surface between parts.
        """
        boundary, grid = body.boundary, body.boundary.grid
        channels: list[Channel | None] = [None] * len(media)
        none = np.zeros(len(boundary.patches))

        def solved(i: int) -> Often | None:
            power, spectrum = second[i], green[i]
            if power is None or spectrum is None or not power.any():
                return None
            medium = replace(media[i], anisotropy=BOUNDARY_CONDITION.anisotropy_within)
            convolver = self._kernels.convolver(self._shape(grid, media[i]), i)
            reentry, entered = None, np.zeros(power.size, np.float32)
            if body.exchange is not None and not body.exchange.is_negligible(medium):
                reentry = Reentry(body.exchange, i, medium, window)
            convolve = functools.partial(convolver.convolve, spectra=spectrum)
            at = channels[i] = Channel(boundary, medium, window, convolve, power.ravel(), none, reentry=reentry)
            start = begin(at, i, self._last, None, body.samples)
            iteration = Iteration(at, start, self._tolerance, self._most_products)
            while iteration.advance():
                pass
            end = iteration.reached
            if reentry is not None:
                entered = reentry.at_nodes(end.two_A_M)
            return Often(end, entered.reshape(grid.shape))

        found = pool_map(solved, range(len(media)))
        iterates = tuple(none if often is None else often.end.iterate for often in found)
        self._last = End(boundary, tuple(channels), iterates)
        return found


def _total(power: Float32) -> float:
    return float(power.sum(dtype=np.float64))
