"""Transport `diffusion` in each body alone: an equation for every body, so that no light crosses the air.

Bodies nearer to each other than about four nodes would leak through the nodes that they share. Here each has those
nodes of the whole object's that it touches to itself (`core.grid.atlas`), and rays, patches and sheets of its own.
Spacing and window are the whole object's, so all of them share the tables of `core.transport.diffusion.pixels`. The
coarse solutions come first, body by body, and are a picture together; then the fine ones. A body in the dark costs
nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.atlas import Atlas, fit_atlas
from milkglass.core.grid.convolution import LayerConvolver
from milkglass.core.grid.kernels import Kernel, Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.material.medium import Medium
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import computed_once
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.entry import EnteringLight
from milkglass.core.transport.diffusion.pixels import (
    PixelTerms,
    bending_at_nodes,
    depths_at_nodes,
    is_bent,
    mean_fluence,
    tables,
    thin_reach,
)
from milkglass.core.transport.diffusion.solver import COARSE_TOLERANCE, DiffusionTransport, Solution

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SeparateSolution:
    """Solutions of bodies on nodes of one spacing: what `diffusion.solution.Solution` has, of all together.

    Attributes
    ----------
    atlas : Atlas
        Of those nodes.
    media : R, G and B
    parts : tuple of Solution or None
        Of each body; None where it is dark, or not solved yet.
    waiting : bool
        Whether some are not solved yet.
    """

    atlas: Atlas
    media: tuple[Medium, ...]
    parts: tuple[Solution | None, ...]
    waiting: bool = False

    @property
    def solved(self) -> list[Solution]:
        """Those of bodies that are not dark."""
        return [part for part in self.parts if part is not None]

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Of these bodies."""
        return tuple(part.boundary for part in self.solved)

    @property
    def residuals(self) -> tuple[float, ...]:
        """Of each channel the worst body's; 1, that of nothing, while some wait."""
        if self.waiting:
            return 1.0, 1.0, 1.0
        return tuple(max(each) for each in zip((0.0, 0.0, 0.0), *(part.residuals for part in self.solved), strict=True))

    @property
    def convolutions(self) -> tuple[int, ...]:
        """Of each channel the most that a body took."""
        return tuple(max(each) for each in zip((0, 0, 0), *(part.convolutions for part in self.solved), strict=True))

    @computed_once
    def volume(self) -> Float32:
        """O of R, G and B, then K_L 1, in the atlas: (4, *atlas.shape)."""
        return self.filled(lambda part: part.volume, 4)

    @property
    def grid(self) -> LayerGrid:
        """Nodes of the whole object."""
        return self.atlas.whole

    @property
    def world_to_texture(self) -> npt.NDArray[np.float64]:
        """See `core.grid.atlas.Atlas`."""
        return self.atlas.world_to_texture

    def pixel_terms(self, s: float) -> PixelTerms:
        """Tabulate what pixels need beside the volume, for a window of width s, mm: one set for all bodies."""
        reach = max((thin_reach(boundary, self.media) for boundary in self.boundaries), default=0.0)
        terms = tables(reach, self.media, s)
        if is_bent(self.boundaries, self.media):
            terms = replace(terms, bending=self.filled(lambda part: bending_at_nodes(part.boundary, self.media)))
        if reach == 0.0:
            return terms
        return replace(terms, depths=self.filled(lambda part: depths_at_nodes(part.boundary, reach), 2))

    def mean_fluence(self) -> Float32:
        """See `core.transport.diffusion.pixels.mean_fluence`; in the atlas: (3, *atlas.shape)."""
        return self.filled(lambda part: mean_fluence(part.boundary, part.fluence))

    def filled(self, of: Callable[[Solution], Float32], channels: int = 3) -> Float32:
        """Put what there is `of` each solution, (channels, *its grid's shape), into an atlas."""
        return self.atlas.filled([None if part is None else of(part) for part in self.parts], channels)


AnySolution = Solution | SeparateSolution


@dataclass(kw_only=True)
class _BodyTransport(DiffusionTransport):
    """Transport in one body, with kernels that all share."""

    body: int
    atlas: Callable[[int], Atlas]  # of a resolution
    kernels: Kernels

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Return the body's part of the whole object's nodes."""
        return self.atlas(self.resolution).crops[self.body]

    def spectra(
        self, kernels: Sequence[Kernel | None], make: Callable[[Any, ConvolutionShape], Float32]
    ) -> list[Spectra | None]:
        """See `core.grid.kernels.Kernels`."""
        return self.kernels.spectra(kernels, make)

    def convolver(self, shape: ConvolutionShape, user: int = 0) -> LayerConvolver:
        """See `core.grid.kernels.Kernels`."""
        return self.kernels.convolver(shape, user)


@dataclass(frozen=True, eq=False)
class _Body:
    """A body by itself, and the stages of its transport."""

    mesh: Mesh
    samples: SurfaceSamples
    chosen: Ints  # samples, of the whole object's
    transport: _BodyTransport
    stages: Stages


class SeparateDiffusion:
    """Solves the diffusion equation in each body of an object alone.

    Parameters
    ----------
    transport : DiffusionTransport
        Its kernels serve all bodies.
    mesh : Mesh
    bodies : Bodies
        Two or more.
    samples : SurfaceSamples
        Of the mesh.
    """

    def __init__(self, transport: DiffusionTransport, mesh: Mesh, bodies: Bodies, samples: SurfaceSamples) -> None:
        self._transport, self._mesh, self._of_vertex = transport, mesh, bodies.of_vertex(mesh)
        self._atlases: dict[int, Atlas] = {}
        faces = _grouped(bodies.of_face, bodies.count)
        chosen = _grouped(bodies.of_face[samples.faces], bodies.count)
        self._bodies = [self._body(i, *parts, samples) for i, parts in enumerate(zip(faces, chosen, strict=True))]

    def atlas(self, resolution: int | None = None) -> Atlas:
        """Return the bodies' nodes at a resolution, the transport's if not given."""
        resolution = resolution or self._transport.resolution
        if resolution not in self._atlases:
            grid = replace(self._transport, resolution=resolution).grid(self._mesh, np.eye(3))
            self._atlases[resolution] = fit_atlas(grid, True, self._mesh.vertices, self._of_vertex)
        return self._atlases[resolution]

    def solve(
        self,
        lights: Sequence[EnteringLight],
        media: Sequence[Medium],
        stages: Stages,
        go_on: Callable[[SeparateSolution], bool] | None = None,
    ) -> SeparateSolution:
        """Solve for the fluence on the surface of every body.

        Parameters
        ----------
        lights : of any number
            On the samples of the whole object.
        media : R, G and B
        stages : Stages
            Keeps what the bodies have in common; their steps' times are added to its own.
        go_on : callable
            See `core.transport.diffusion.solver.DiffusionTransport.solve`; told all bodies together.
        """
        shares = [
            stages.run(Stage.BODY_LIGHT_FLUX.of(i), (self, light), lambda light=light: self._shares(light))  # type: ignore[misc]
            for i, light in enumerate(lights, start=1)
        ]
        key = self, *shares, *media
        if stages.has(Stage.BODIES, key):
            return stages.run(Stage.BODIES, key, lambda: self._dark(media))
        for body in self._bodies:
            body.stages.begin()
        solution = self._solve(shares, media, go_on)
        for body in self._bodies:
            for name, milliseconds in body.stages.timings.items():
                stages.timings[name] = stages.timings.get(name, 0.0) + milliseconds
        if solution.atlas is self.atlas() and max(solution.residuals) <= self._transport.tolerance:
            stages.run(Stage.BODIES, key, lambda: solution)
        return solution

    def release(self) -> None:
        """Let go of the bodies' surfaces and solutions."""
        for body in self._bodies:
            body.transport.release()
            body.stages.clear()

    def _solve(
        self,
        shares: Sequence[Sequence[EnteringLight | None]],
        media: Sequence[Medium],
        go_on: Callable[[SeparateSolution], bool] | None,
    ) -> SeparateSolution:
        """Solve body by body, all of them on coarse nodes first where somebody looks."""
        own = [[share for share in each if share is not None] for each in zip(*shares, strict=True)]
        lit = [i for i, lights in enumerate(own) if lights]
        parts: dict[int, Solution] = {}
        newest = replace(self._dark(media), waiting=bool(lit))

        def take(i: int, part: Solution) -> None:
            nonlocal newest
            if parts.get(i) is not part:
                parts[i] = part
                newest = self._together(parts, lit, i) or newest

        for coarse, i in [*((True, i) for i in lit if go_on is not None), *((False, i) for i in lit)]:
            body, crop, ended = self._bodies[i], self.atlas().crops[i], False

            def told(part: Solution, i: int = i, coarse: bool = coarse, crop: LayerGrid = crop) -> bool:
                nonlocal ended
                take(i, part)
                ended = go_on is not None and not go_on(newest)
                enough = coarse and part.boundary.grid != crop and max(part.residuals) <= COARSE_TOLERANCE
                return not ended and not enough

            watched = None if go_on is None else told
            take(i, body.transport.solve(body.mesh, body.samples, crop, own[i], media, body.stages, watched))
            if ended:
                break
        return newest

    def _together(self, parts: dict[int, Solution], lit: Sequence[int], latest: int) -> SeparateSolution | None:
        """Put solutions together where all of the lit bodies have one for the latest one's spacing."""
        if len(parts) < len(lit):
            return None
        grid = parts[latest].boundary.grid
        atlas = next(atlas for atlas in self._atlases.values() if atlas.crops[latest] == grid)
        if not all(parts[i].boundary.grid == atlas.crops[i] for i in lit):
            return None
        together = tuple(parts.get(i) for i in range(len(self._bodies)))
        return SeparateSolution(atlas, parts[latest].media, together)

    def _dark(self, media: Sequence[Medium]) -> SeparateSolution:
        return SeparateSolution(self.atlas(), tuple(media), (None,) * len(self._bodies))

    def _shares(self, light: EnteringLight) -> list[EnteringLight | None]:
        """Return what each body has of a light; None where it is dark."""
        fluxes = (light.flux[body.chosen] for body in self._bodies)
        return [replace(light, flux=flux) if flux.any() else None for flux in fluxes]

    def _body(self, i: int, faces: Ints, chosen: Ints, samples: SurfaceSamples) -> _Body:
        used, corners = np.unique(self._mesh.faces[faces], return_inverse=True)
        mesh = Mesh.of(self._mesh.vertices[used], self._mesh.normals[used], corners.reshape(-1, 3))
        on = np.searchsorted(faces, samples.faces[chosen]).astype(np.int32)
        own = SurfaceSamples(samples.points[chosen], samples.normals[chosen], samples.areas[chosen], on)
        whole = self._transport
        settings = {name: getattr(whole, name) for name in ("resolution", "n_layers", "tolerance", "patch")}
        transport = _BodyTransport(**settings, body=i, atlas=self.atlas, kernels=whole)
        return _Body(mesh, own, chosen, transport, Stages())


def _grouped(body: npt.NDArray[np.integer], count: int) -> list[Ints]:
    """Indices of the elements of each body, in ascending order."""
    order = np.argsort(body, kind="stable")
    bounds = np.searchsorted(body[order], np.arange(count + 1))
    return [order[start:stop] for start, stop in pairwise(bounds)]
