"""Transport as diffusion in the object itself: its boundary integral equation, by FFT.

-D lap phi + s_a phi = Q inside, phi + 2 A D dphi/dn = 0 on the surface, M = phi / (2 A). With the surface's own
boundary in place of the dipole's plane, light crosses slabs, limbs and holes as it does in a photon walk. As an
integral equation over the surface (`core.transport.diffusion.boundary`) each product with its matrix is the convolution
that `core.transport.ewald.EwaldTransport` has, and a few of them solve it (`core.transport.diffusion.krylov`): its
symbol on a plane, (1 + 1 / (z_b q)) / 2 with z_b = 2 A D and q^2 = k^2 + sigma^2, is bounded on both sides.

A surface point's own value follows from the volume O = G_L * (Q - double layer) and the light that enters there:

    phi = (O + a' E sum w rho(depth)) / (rho(0) / (2 A) - K_L 1).
"""

import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.assignment import SHEET_REACH
from milkglass.core.grid.atlas import Atlas
from milkglass.core.grid.kernels import Kernel, Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid, fit_nodes, tsc_matrix
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.light.exchange import Exchange
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.paths.resolution import needs_beams, scatters_once
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import one_blas_thread, pool_map, thread_pool
from milkglass.core.transport.base import EnteringFlux, EnteringLight, GoOn, Scattered, Unscattered
from milkglass.core.transport.diffusion.boundary import Boundary, Depths, put_on_grid
from milkglass.core.transport.diffusion.channel import Channel, Sources, lit
from milkglass.core.transport.diffusion.collisions import InnerPaths
from milkglass.core.transport.diffusion.entry import enter
from milkglass.core.transport.diffusion.even import EvenLight
from milkglass.core.transport.diffusion.green import green_spectrum
from milkglass.core.transport.diffusion.iteration import End, Iteration, Reached, begin, prolonged
from milkglass.core.transport.diffusion.patches import Patches, make_patches
from milkglass.core.transport.diffusion.pixels import pixel_tables
from milkglass.core.transport.diffusion.reentry import (
    ExchangeGeometry,
    Returned,
    SurfaceExchange,
    flux_matrices,
)
from milkglass.core.transport.diffusion.solution import Solution as Solution, reached
from milkglass.core.transport.pixels import PixelTables

if TYPE_CHECKING:  # compiled loops take half a second to import, and dense matter does without
    from milkglass.core.paths.beams import Beams
    from milkglass.core.transport.diffusion.within import Within

SOURCES = Stage.SOURCES_R, Stage.SOURCES_G, Stage.SOURCES_B
WINDOW = 1.25  # of the smooth part, in spacings
TOLERANCE = 3e-4  # relative residual at which the steps end; at 3e-3 deep shadows are yet stained with colours
MOST_PRODUCTS = 40
WITHIN_TOLERANCE, WITHIN_PRODUCTS = 2e-3, 16  # of light within clear matter, of which little is diffuse
ROUND_PRODUCTS = 2  # of a channel between two looks at the solution: two threads share those of three evenly
NESTED = 44  # nodes from which on half of them are solved first
COARSE_TOLERANCE = 1e-3
PATCH = 1.0  # cells that a patch may extend over; at 0.7 there are 60 % more, and no error is smaller
LEAST_REACH = 12  # nodes over which the kernel must lie on each side, however thin the object
DECADES = 9.2  # of exp(-sigma r), at which a channel's padding ends: 1e-4
ALONE = 3  # beside R, G and B, of the users of convolvers
WINDOW_REACH = 6.0  # widths beyond which the smooth part is the kernel itself


@dataclass(frozen=True, eq=False)
class Problem:
    """A surface and the light that enters it.

    Attributes
    ----------
    mesh, samples
    grid : LayerGrid
        From `DiffusionTransport.grid`.
    lights : of any number
    media : R, G and B
        Black where no equation is to be solved.
    exchange : Exchange, optional
        By which light that leaves enters again.
    beams : Beams, optional
        The lights' beams through the object, where light within is to be followed too.
    media_within : R, G and B
        Of light within.
    external : (samples, 3) float32, optional
    unscattered : Unscattered, optional
        Both as of `core.transport.base.EnteringFlux`.
    is_preliminary : bool
        Whether the solution is to be there at once: what enters again, unscattered or not, and where light goes through
        thin parts is next to what is known.
    returned : Returned, optional
        What is known of light that has scattered then.
    known_unscattered : Unscattered, optional
        ... and of the other.
    paths : InnerPaths, optional
        What is known of paths through thin parts.
    """

    mesh: Mesh
    samples: SurfaceSamples
    grid: LayerGrid
    lights: Sequence[EnteringLight]
    media: Sequence[Medium]
    exchange: Exchange | None = None
    beams: "Beams | None" = None
    media_within: Sequence[Medium] = ()
    external: Float32 | None = None
    unscattered: Unscattered | None = None
    is_preliminary: bool = False
    returned: Returned | None = None
    known_unscattered: Unscattered | None = None
    paths: InnerPaths | None = None

    @property
    def estimates_unscattered(self) -> bool:
        """Whether it does with what is known of unscattered light."""
        return self.is_preliminary and self.unscattered is not None

    @property
    def key(self) -> tuple[object, ...]:
        """Return all that the solution depends on but the grid, and what is known before, as a key of stages."""
        within = self.beams, *self.media_within, self.external, self.unscattered
        return self.mesh, self.samples, *self.lights, *self.media, self.exchange, *within


@dataclass(eq=False)
class DiffusionTransport:
    """A `core.transport.base.SeparableTransport` that solves the diffusion equation in a closed object.

    Parameters
    ----------
    resolution : int
        Nodes along the object's longest side.
    n_layers : int, optional
        Layers over the object's z extent; as dense as the nodes if not given, which is best.
    tolerance : float
        Relative residual at which a channel is solved.
    patch : float
        Cells that a patch may extend over.
    kernels : Kernels
        Keeps the spectra and convolvers, of the coarse nodes too.
    place : callable, optional
        Gives the nodes of a resolution where they do not follow from the mesh: in a body of an object.
    """

    resolution: int = 64
    n_layers: int | None = None
    tolerance: float = TOLERANCE
    patch: float = PATCH
    kernels: Kernels = field(default_factory=Kernels)
    sweeps: int = field(default=4, init=False)
    place: Callable[[int], LayerGrid] | None = None
    _coarse: "DiffusionTransport | None" = field(default=None, init=False, repr=False)
    _coarse_stages: Stages = field(default_factory=Stages, init=False, repr=False)
    _last: End | None = field(default=None, init=False, repr=False)
    _last_lit: tuple[Problem, Sources] | None = field(default=None, init=False, repr=False)
    _placed: tuple[Mesh, SurfaceSamples, Boundary] | None = field(default=None, init=False, repr=False)
    _within: "Within | None" = field(default=None, init=False, repr=False)
    _rays: Callable[[Mesh], Depths] = field(default=Depths, init=False, repr=False)  # of half the nodes: those of all

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Fit layers to the mesh itself, whatever the view."""
        return self._fitted(mesh, self.resolution) if self.place is None else self.place(self.resolution)

    def _fitted(self, mesh: Mesh, resolution: int) -> LayerGrid:
        return fit_nodes(mesh.bounds, resolution, self.n_layers)

    @property
    def smooth(self) -> bool:
        """Return True: W are quadratic B-splines."""
        return True

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the quadratic B-splines of points, see `core.grid.layers.tsc_matrix`."""
        return tsc_matrix(grid, coordinates)

    def window_width(self, grid: LayerGrid) -> float:
        """Return the width s of the window of the smooth part, mm."""
        return WINDOW * max(grid.texel, grid.layer_distance)

    def boundary(self, mesh: Mesh, samples: SurfaceSamples, grid: LayerGrid, depths: Depths) -> Boundary:
        """Return a mesh's surface as it lies on a grid, with what the grid misses of K."""
        return self._on_grid(make_patches(mesh, samples, self._cell(grid)), grid, depths)

    def _cell(self, grid: LayerGrid) -> float:
        return self.patch * max(grid.texel, grid.layer_distance)

    def _on_grid(self, patches: Patches, grid: LayerGrid, depths: Depths) -> Boundary:
        return put_on_grid(patches, grid, depths, SHEET_REACH * self.window_width(grid), self._unabsorbed(grid))

    def _unabsorbed(self, grid: LayerGrid) -> Callable[[Float32], Float32]:
        """Return the convolution with G_L of `NO_ABSORPTION`, one at a time."""
        (spectrum,) = self.kernels.spectra([self._kernel(grid, NO_ABSORPTION)], self._maker(grid))
        assert spectrum is not None
        convolver, lock = self.kernels.convolver(self.shape(grid, NO_ABSORPTION), ALONE), threading.Lock()

        def convolve(nodes: Float32) -> Float32:
            with lock:
                return convolver.convolve(nodes.reshape(grid.shape), spectrum)

        return convolve

    def scatter(self, lit: EnteringFlux, stages: Stages, go_on: GoOn | None = None) -> Solution:
        """Return the solution for the light that enters a solid; see `core.transport.base.Transport.scatter`."""
        solid, light = lit.solid, (lit.grid, lit.lights, _solved(lit), lit.exchange, lit.beams, lit.media, lit.external)
        return self.solve(Problem(solid.mesh, solid.samples, *light, lit.unscattered), stages, go_on)

    def material(self, lit: EnteringFlux) -> tuple[object, ...]:
        """Return the media of R, G and B, on which this transport depends, and those of each body."""
        return *lit.media, *lit.matter

    def tables_of(self, lit: EnteringFlux, atlas: Atlas, parts: Sequence[Scattered | None]) -> PixelTables:
        """Return the tables of pixels where the volume is an atlas of several bodies; None for a dark one."""
        boundaries = [part.boundary if isinstance(part, Solution) else None for part in parts]

        def of_kind(light: EnteringFlux, bodies: range) -> PixelTables:
            def on_nodes(of: Callable[[Boundary], Float32], channels: int) -> Float32:
                of_all = [
                    None if boundary is None or i not in bodies else of(boundary)
                    for i, boundary in enumerate(boundaries)
                ]
                return atlas.assembled(of_all, channels)

            present = [boundary for boundary in boundaries[bodies.start : bodies.stop] if boundary is not None]
            return pixel_tables(present, _solved(light), self.window_width(atlas.grid), on_nodes)

        ranges = [matter.bodies for matter in lit.matter] or [range(len(parts))]
        first, *further = (of_kind(*kind) for kind in zip(lit.in_kinds(), ranges, strict=True))
        return replace(first, further=tuple(further))

    def in_body(self, object_mesh: Mesh, crop: Callable[[LayerGrid], LayerGrid]) -> "DiffusionTransport":
        """Return the transport in one body of an object, which shares all kernels."""
        return replace(self, place=lambda resolution: crop(self._fitted(object_mesh, resolution)))

    @one_blas_thread()
    def solve(self, problem: Problem, stages: Stages, go_on: Callable[[Solution], bool] | None = None) -> Solution:
        """Return the solution for the fluence on the surface of a closed mesh.

        Parameters
        ----------
        problem : Problem
        stages : Stages
            Keeps the steps' results between calls.
        go_on : callable, optional
            Told the solution on half the nodes and after each round of products; False ends there, and the next call
            starts from it. Where nobody looks all nodes are solved at once, which takes less time in all.
        """

        def anew() -> Solution:
            coarse, unscattered = None, None if problem.is_preliminary else problem.unscattered
            if go_on is not None:
                coarse = self._coarse_solution(problem, stages, go_on)
                if coarse is not None and not go_on(coarse):
                    self._keep_returned_of_coarse(coarse, problem, stages)
                    return coarse
            if unscattered is not None:
                key = unscattered, unscattered.light  # which is computed now, before all else takes memory
                stages.run(Stage.KNOWN_UNSCATTERED, key, lambda: unscattered)
            sources, channels, returned = self._channels(problem, stages)
            boundary, exchange = sources.boundary, sources.exchange
            ended = None if self._coarse is None or coarse is None else self._coarse._last
            iterations = self._begun(channels, problem.samples, ended)

            def newest() -> Solution:
                width = self.window_width(boundary.grid)
                solution = reached(
                    boundary, problem.media, channels, iterations, width, self.tolerance, exchange, returned
                )
                return replace(solution, estimates_unscattered=problem.estimates_unscattered)

            solution, is_over = _advanced(newest, iterations, go_on)
            iterates = tuple(np.zeros(len(boundary.patches)) if at is None else at.iterate for at in solution.channels)
            self._last = End(boundary, tuple(channels), iterates, ended)
            self._last_lit = problem, sources
            if problem.exchange is not None and exchange is not None:
                _keep_returned(solution, problem.exchange, sources.entering, lambda: solution.reentering, stages)
            if problem.beams is not None and is_over:
                is_wanted = functools.partial(go_on, solution) if go_on is not None else lambda: True
                return self._with_light_within(solution, problem, problem.beams, stages, is_wanted)
            return solution

        solution = stages.run(Stage.SOLUTION, (self, problem.grid, *problem.key), anew)
        if not solution.is_solved or solution.lacks_light_within or solution.grid != problem.grid:
            stages.forget(Stage.SOLUTION)  # to go on from there
        return solution

    def _with_light_within(
        self, solution: Solution, problem: Problem, beams: "Beams", stages: Stages, is_wanted: Callable[[], bool]
    ) -> Solution:
        """Return a solution that knows what matter sends out along rays, where nodes resolve free paths."""
        boundary, _ = self._surface(problem, stages)
        media = problem.media_within
        if not any(needs_beams(medium, boundary.grid) for medium in media):
            return solution
        from milkglass.core.transport.diffusion.orders import Body
        from milkglass.core.transport.diffusion.within import Within

        is_tight = self.tolerance < TOLERANCE
        limits = (self.tolerance, MOST_PRODUCTS) if is_tight else (WITHIN_TOLERANCE, WITHIN_PRODUCTS)
        self._within = self._within or Within(self.kernels, self.shape, *limits)
        kernels = [None if medium.is_black else self._kernel(boundary.grid, medium) for medium in problem.media]
        green = self.kernels.spectra(kernels, self._maker(boundary.grid))
        body = Body(problem.mesh, problem.samples, boundary, solution.exchange, problem.external)
        width = self.window_width(boundary.grid)
        resolved = self._within.resolved(beams, media, body, width, green, stages, is_wanted)
        return replace(solution, resolved=resolved, lacks_light_within=resolved is None)

    def _coarse_solution(self, problem: Problem, stages: Stages, go_on: Callable[[Solution], bool]) -> Solution | None:
        """Return the solution on half the nodes, a picture at once, from which few products are left."""
        if self.resolution < NESTED:
            return None
        if self._coarse is None:
            self._coarse = replace(self, resolution=self.resolution // 2 - 1, tolerance=COARSE_TOLERANCE)
        coarse, mesh = self._coarse, problem.mesh
        coarse._rays = lambda mesh: stages.run(Stage.RAYS, (mesh,), lambda: self._rays(mesh))
        on_coarse = replace(
            problem, grid=coarse.grid(mesh, np.eye(3)), is_preliminary=True, beams=None, media_within=(), external=None
        )
        if not problem.is_preliminary:
            kept = stages.kept(Stage.KNOWN_UNSCATTERED)
            on_coarse = replace(
                on_coarse,
                returned=self._known_returned(problem, stages),
                known_unscattered=None if kept is None else kept[1],
                paths=self._known_paths(problem),
            )
        return stages.run(
            Stage.COARSE_SOLUTION,
            (coarse, *on_coarse.key),
            lambda: coarse.solve(on_coarse, self._coarse_stages, go_on),
        )

    def _known_returned(self, problem: Problem, stages: Stages) -> Returned | None:
        """Return what the last solution has enter the same surface again."""
        kept, exchange = stages.kept(Stage.RETURNED), problem.exchange
        return kept[1] if kept is not None and exchange is not None and kept[1].refined is exchange.refined else None

    def _known_paths(self, problem: Problem) -> InnerPaths | None:
        """Return the paths through the same object that have been followed, where they serve its index."""
        if self._placed is None or self._placed[:2] != (problem.mesh, problem.samples):
            return None
        paths = self._placed[2].paths
        return paths if paths.are_known(problem.media[0].eta) else None

    def _keep_returned_of_coarse(self, coarse: Solution, problem: Problem, stages: Stages) -> None:
        """Begin to compute what the exitance of a coarse solution has enter again, where all for that is at hand."""
        exchange, on_coarse = problem.exchange, self._coarse
        if exchange is None or self._last_lit is None or on_coarse is None or on_coarse._last_lit is None:
            return
        (before, sources), (_, light) = self._last_lit, on_coarse._last_lit
        between, boundary = sources.exchange, sources.boundary
        if between is None or before.exchange is not exchange or before.media[0].eta != problem.media[0].eta:
            return

        def entering_again() -> Float32:
            exitance = prolonged(coarse.exitance_of_patches, coarse.boundary, boundary, problem.samples)
            return between.irradiance(exitance, problem.media)

        _keep_returned(coarse, exchange, light.entering, thread_pool().submit(entering_again).result, stages)

    def _channels(
        self, problem: Problem, stages: Stages
    ) -> tuple[Sources, list[Channel | None], Callable[[], Float32] | None]:
        """Return the light, the equation of each channel, None for a dark one, and what counts as entering again."""
        media, eta = problem.media, problem.media[0].eta
        boundary, depths = self._surface(problem, stages)
        if problem.is_preliminary:
            placed, paths = boundary, problem.paths
            boundary = stages.run(Stage.KNOWN_PATHS, (placed, paths), lambda: placed.going_by(paths))
        thread_pool().submit(lambda: boundary.curvature)  # will be asked for
        exchange, between, lights = problem.exchange, None, problem.lights
        if problem.is_preliminary:
            lights = [light for light in lights if not light.returned]
        elif problem.unscattered is not None:
            lights = *lights, problem.unscattered.light
        if exchange is not None and not problem.is_preliminary:
            geometry = stages.run(
                Stage.EXCHANGE_GEOMETRY,
                (boundary, *exchange.surface),
                lambda: ExchangeGeometry(exchange, boundary, problem.samples),
            )
            between = exchanged = stages.run(
                Stage.SURFACE_EXCHANGE, (geometry, eta), lambda: SurfaceExchange(geometry, depths, eta)
            )
            placed, samples = boundary, problem.samples
            even = stages.run(
                Stage.EVEN_LIGHT, (placed, samples), lambda: self._even_light(placed, len(samples), depths)
            )
            boundary = stages.run(
                Stage.EVEN_SURFACE, (even, exchanged), lambda: _by_even_light(placed, even, exchanged)
            )
            if (crossings := exchange.crossings) is not None:
                alone = between
                lengths = exchange.extinctions
                key = alone, crossings, lengths
                between = stages.run(Stage.SURFACE_CROSSING, key, lambda: alone.through(crossings, lengths))
            if (ground := exchange.ground) is not None:
                floating = between
                between = stages.run(Stage.SURFACE_GROUND, (floating, ground), lambda: floating.above(ground))
        around = None if between is None else between.entry
        entries = [
            stages.run(
                Stage.ENTRY.of(i),
                (boundary, light, eta, around),
                lambda light=light: enter(light, boundary, depths, eta, around),  # type: ignore[misc]
            )
            for i, light in enumerate(lights, start=1)
        ]
        sources, returned = Sources(boundary, depths, entries, between), None
        if problem.is_preliminary:
            sources, returned = self._with_returned(sources, problem, stages)
        kernels = [None if medium.is_black else self._kernel(boundary.grid, medium) for medium in media]
        spectra = stages.run(Stage.SPECTRA, kernels, lambda: self.kernels.spectra(kernels, self._maker(boundary.grid)))
        makers: dict[int, Callable[[], Channel]] = {}
        twins: list[int | None] = []
        for i, (medium, spectrum) in enumerate(zip(media, spectra, strict=True)):
            dark = spectrum is None or sources.is_dark(i)
            twin = next((k for k in makers if media[k] == medium and sources.are_alike(i, k)), i)
            twins.append(None if dark else twin)
            if spectrum is not None and twins[-1] == i:
                makers[i] = self._channel(sources, medium, i, spectrum, stages)
        channels = {i: channel() for i, channel in makers.items()}
        return sources, [None if twin is None else channels[twin] for twin in twins], returned

    def _even_light(self, boundary: Boundary, samples: int, depths: Depths) -> EvenLight:
        """Return what even light tells of a surface of so many samples, whatever the medium."""
        everywhere = EnteringLight(np.ones((samples, 3), np.float32))
        s, convolve = self.window_width(boundary.grid), self._unabsorbed(boundary.grid)
        return EvenLight(boundary, lambda eta: enter(everywhere, boundary, depths, eta), s, convolve)

    def _with_returned(
        self, sources: Sources, problem: Problem, stages: Stages
    ) -> tuple[Sources, Callable[[], Float32] | None]:
        """Return the light with what has met the object before, and what is estimated of that at the vertices."""
        patches, estimates = sources.boundary.patches, list[tuple[Float32, Array]]()
        fluxes = [patches.sums @ light.flux for light in problem.lights if light.returned]
        unscattered, before = problem.unscattered, problem.known_unscattered
        if unscattered is not None and before is not None and (factors := unscattered.growth(before)) is not None:
            flux = stages.run(Stage.PATCH_UNSCATTERED, (patches, before), lambda: patches.sums @ before.light.flux)
            fluxes.append(factors * flux)
            estimates.append((before.irradiance, factors))
        if fluxes:
            sources = replace(sources, shallow=np.sum(fluxes, axis=0, dtype=np.float64))
        exchange, known = problem.exchange, problem.returned
        irradiance = None if known is None else known.irradiance()
        if exchange is not None and known is not None and irradiance is not None:
            key = sources.boundary, exchange.refined, exchange.entering, exchange.faces
            matrices = stages.run(Stage.PATCH_FLUX, key, lambda: flux_matrices(exchange, patches, problem.samples))
            again = np.stack([matrices[i % len(matrices)] @ irradiance[:, i] for i in range(3)], axis=1)
            growth = known.growth(again.sum(axis=0, dtype=np.float64), sources.entering, problem.media)
            sources = replace(sources, again=growth * again)
            estimates.append((irradiance, growth))

        def at_vertices() -> Float32:
            found = [estimate * factors.astype(np.float32) for estimate, factors in estimates]
            return np.asarray(np.sum(found, axis=0), np.float32)

        return sources, at_vertices if estimates else None

    def shape(self, grid: LayerGrid, medium: Medium) -> ConvolutionShape:
        """Return sizes padded by the reach of a channel's G; at most by the extent, which is exact."""
        spacing = np.array([grid.layer_distance, grid.texel, grid.texel])
        counts = np.array(grid.shape)
        reach = WINDOW_REACH * self.window_width(grid) + DECADES / max(medium.attenuation, 1e-12)
        extra = np.minimum(np.ceil(reach / np.maximum(spacing, 1e-12)), np.maximum(counts - 2, 0))
        extra = np.maximum(extra, 2 * LEAST_REACH - counts)
        depth, height, width = (int(n) for n in counts + extra)
        return ConvolutionShape(*grid.shape, padding=(depth, height, width))

    def start_cold(self) -> None:
        """Forget the last solutions, see `core.transport.base.Transport.start_cold`; the surface's geometry stays."""
        self.kernels.keep_used()
        self._last = self._last_lit = None
        if self._within is not None:
            self._within.start_cold()
        if self._coarse is not None:
            self._coarse.start_cold()

    def release(self) -> None:
        """Release the kernels and the last surface and solution."""
        self.kernels.release()
        self._coarse = self._placed = self._last = self._last_lit = self._within = None
        self._coarse_stages.clear()

    def _surface(self, problem: Problem, stages: Stages) -> tuple[Boundary, Depths]:
        """Return a surface as it lies on the grid, the last call's where it is the same, and its rays."""
        mesh, samples, grid = key = problem.mesh, problem.samples, problem.grid
        kept = self._placed
        at_hand = kept is not None and kept[0] is mesh and kept[1] is samples and kept[2].grid == grid
        needed = not at_hand and not stages.has(Stage.BOUNDARY, key)
        merging = thread_pool().submit(make_patches, mesh, samples, self._cell(grid)) if needed else None
        depths = stages.run(Stage.RAYS, (mesh,), lambda: self._rays(mesh))

        def placed() -> Boundary:
            if merging is not None:
                self._placed = mesh, samples, self._on_grid(merging.result(), grid, depths)
            assert self._placed is not None
            return self._placed[2]

        return stages.run(Stage.BOUNDARY, key, placed), depths

    def _channel(
        self, sources: Sources, medium: Medium, i: int, spectrum: Spectra, stages: Stages
    ) -> Callable[[], Channel]:
        """Begin to assemble a channel's equation beside others; the function that is returned waits for it."""
        grid = sources.boundary.grid
        s, convolver = self.window_width(grid), self.kernels.convolver(self.shape(grid, medium), i)

        convolve = functools.partial(convolver.convolve, spectra=spectrum)
        make = functools.partial(lit, sources, medium, s, convolve, i)
        light = sources.boundary, sources.exchange, sources.shallow, sources.again, *sources.entries
        name, key = SOURCES[i], (medium, spectrum, *light)
        future = None if stages.has(name, key) else thread_pool().submit(make)
        return lambda: stages.run(name, key, make if future is None else future.result)

    def _begun(
        self, channels: Sequence[Channel | None], samples: SurfaceSamples, coarse: End | None
    ) -> dict[Channel, Iteration]:
        """Return the iterations of all channels, each from where it ended last time; alike channels share one."""
        new = {channel: i for i, channel in reversed(list(enumerate(channels))) if channel is not None}

        def started(channel: Channel) -> Iteration:
            start = begin(channel, new[channel], self._last, coarse, samples)
            return Iteration(channel, start, self.tolerance, MOST_PRODUCTS)

        return dict(zip(new, pool_map(started, new), strict=True))

    def _kernel(self, grid: LayerGrid, medium: Medium) -> Kernel:
        return medium, self.shape(grid, medium), grid.texel, grid.layer_distance

    def _maker(self, grid: LayerGrid) -> Callable[[Medium, ConvolutionShape], Float32]:
        s = self.window_width(grid)
        return lambda medium, shape: green_spectrum(medium, s, grid, shape)


def _by_even_light(boundary: Boundary, even: EvenLight, exchange: SurfaceExchange) -> Boundary:
    """Return a surface with extrapolation lengths by which even light leaves thin parts as it must.

    Matter so dark that light between parts is not looked for does without.
    """
    return boundary.bent(lambda medium: (boundary if exchange.is_negligible(medium) else even).bending(medium))


def _keep_returned(
    solution: Solution,
    exchange: Exchange,
    entering: Array,
    irradiance: Callable[[], Float32 | None],
    stages: Stages,
) -> None:
    """Keep what a solution has enter again for the start of the next one."""
    returned = Returned(exchange.refined, irradiance, entering, solution.media)
    stages.run(Stage.RETURNED, (solution,), lambda: returned)


def _solved(lit: EnteringFlux) -> tuple[Medium, ...]:
    """Return the media whose equations are solved: black where beams tell next to all that scatters."""
    if lit.beams is None:
        return lit.media
    return tuple(medium.black if scatters_once(medium, lit.grid) else medium for medium in lit.media)


def _advanced(
    newest: Callable[[], Solution],
    iterations: Mapping[Channel, Iteration],
    go_on: Callable[[Solution], bool] | None,
) -> tuple[Solution, bool]:
    """Return the solution after rounds of steps of all channels, and whether no more of them are wanted."""
    solution, is_wanted = newest(), True
    while not solution.is_solved:
        is_wanted = go_on is None or go_on(solution)
        # All of them: each takes its steps.
        if not is_wanted or not any(pool_map(Iteration.advance, [*iterations.values()] * ROUND_PRODUCTS)):
            break
        solution = newest()
    pool_map(Reached.settle, {at for at in solution.channels if at is not None})
    return solution, is_wanted
