"""Transport in each body of an object alone, so that no light crosses the air; for every method.

Each body has those nodes of the whole object's that it touches to itself (`core.grid.atlas`), and samples, lights and,
where a method asks for it, a mesh of its own. What a body computed is kept until something that it depends on changes.
Where an equation is solved in steps the coarse solutions come first, body by body, and are a picture together; then the
fine ones. The cost grows with the bodies' boxes together, and a body in the dark costs nothing.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.bodies import Bodies, bodies_at
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.atlas import Atlas, fit_atlas
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.exchange import Exchange
from milkglass.core.paths.resolution import scaled
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import computed_once
from milkglass.core.transport.base import (
    EnteringFlux,
    EnteringLight,
    GoOn,
    Scattered,
    SeparableTransport,
    SurfaceLights,
    Transport,
)
from milkglass.core.transport.pixels import PixelTables

if TYPE_CHECKING:
    from milkglass.core.paths.beams import Beams
    from milkglass.core.paths.resolved import Resolved

Ints = npt.NDArray[np.int64]

# Areas are rounded up to this many steps each factor of two, so that alike bodies share padding and kernels.
AREAS_A_DOUBLING = 2
NEGLIGIBLE_CHANGE = 0.001  # of what light goes from body to body, as a share of all that enters
ATLASES = 4  # kept: a coarse and a fine one, of the last two grids


class Body:
    """One body of an object by itself, as a `core.transport.base.Solid`, with its transport and the stages of that.

    Attributes
    ----------
    chosen : (n,) int64
        Its samples, of the whole object's.
    transport : Transport
    stages : Stages
    """

    def __init__(
        self, object_mesh: Mesh, faces: Ints, samples: SurfaceSamples, chosen: Ints, area: float, transport: Transport
    ) -> None:
        self._whole, self._faces, self._of_whole, self.chosen = object_mesh, faces, samples, chosen
        self.area, self.transport, self.stages = area, transport, Stages()

    @property
    def faces(self) -> Ints:
        """Return its faces, of the whole object's."""
        return self._faces

    @computed_once
    def mesh(self) -> Mesh:
        """Return the body's faces as a mesh, with the vertices that they use."""
        used, corners = np.unique(self._whole.faces[self._faces], return_inverse=True)
        return Mesh.of(self._whole.vertices[used], self._whole.normals[used], corners.reshape(-1, 3))

    @computed_once
    def samples(self) -> SurfaceSamples:
        """Return the body's surface samples, which name faces of its mesh."""
        samples, chosen = self._of_whole, self.chosen
        faces = np.searchsorted(self._faces, samples.faces[chosen]).astype(np.int32)
        return SurfaceSamples(samples.points[chosen], samples.normals[chosen], samples.areas[chosen], faces)


@dataclass(frozen=True, eq=False)
class ScatteredInBodies:
    """A `core.transport.base.Scattered` of several bodies on nodes of one spacing, in an atlas.

    Attributes
    ----------
    transport : OfBodies
        That has made it.
    atlas : Atlas
        Of those nodes.
    lit : EnteringFlux
        The light that it is of.
    parts : tuple of Scattered or None
        Of each body; None where it is dark, or has not been computed yet.
    waiting : bool
        Whether some have not been computed yet.
    """

    transport: "OfBodies"
    atlas: Atlas
    lit: EnteringFlux
    parts: tuple[Scattered | None, ...]
    waiting: bool = False

    estimates_unscattered = False

    @property
    def lit_parts(self) -> list[Scattered]:
        """Return the parts of bodies that are not dark."""
        return [part for part in self.parts if part is not None]

    @property
    def boundaries(self) -> tuple[object, ...]:
        """Return the surfaces of lit bodies as they lie on the grid."""
        return tuple(boundary for part in self.lit_parts for boundary in part.boundaries)

    @property
    def residuals(self) -> tuple[float, ...]:
        """Return the relative residual of each channel in the worst body; 1, that of no solution, while some wait."""
        if self.waiting:
            return 1.0, 1.0, 1.0
        return tuple(
            max(channel) for channel in zip((0.0, 0.0, 0.0), *(part.residuals for part in self.lit_parts), strict=True)
        )

    @property
    def convolutions(self) -> tuple[int, ...]:
        """Return of each channel the most convolutions that a body took."""
        return tuple(
            max(channel) for channel in zip((0, 0, 0), *(part.convolutions for part in self.lit_parts), strict=True)
        )

    @property
    def is_solved(self) -> bool:
        """Whether all bodies are solved."""
        return not self.waiting and all(part.is_solved for part in self.lit_parts)

    @computed_once
    def volume(self) -> Float32:
        """Return the volumes of the bodies in the atlas, (3 or 4, *atlas.shape)."""
        return self.filled([None if part is None else part.volume for part in self.parts])

    @property
    def grid(self) -> LayerGrid:
        """Return the nodes of the whole object."""
        return self.atlas.grid

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) of `core.grid.atlas.Atlas.world_to_texture`."""
        return self.atlas.world_to_texture

    @property
    def windows(self) -> Float32:
        """Return where each body lies, `core.grid.atlas.Atlas.windows`."""
        return self.atlas.windows

    def pixel_tables(self) -> PixelTables:
        """Return the tables from which pixels compute their exitance, one set for all bodies."""
        return self.transport.whole.tables_of(self.lit, self.atlas, self.parts)

    def mean_fluence(self) -> Float32:
        """Return means near the nodes of each body, in the atlas: (3, *atlas.shape)."""
        return self.filled([None if part is None else part.mean_fluence() for part in self.parts])

    def exitance(self, points: Array, normals: Array, lights: SurfaceLights, tables: PixelTables) -> Array:
        """Return M at points of the surface, (n, 3), 0 on dark bodies; see `core.transport.base.Scattered.exitance`."""
        bodies = self.transport.bodies
        found, body = np.zeros((len(points), 3)), bodies_at(self.transport.mesh, bodies, points)
        for i, part in enumerate(self.parts):
            on_this = body == i
            if part is not None and on_this.any():
                on_body, of_kind = lights.on_body(bodies.of_face == i), tables.kinds[self.lit.kind_of(i)]
                found[on_this] = part.exitance(points[on_this], normals[on_this], on_body, of_kind)
        return found

    @computed_once
    def reentering(self) -> Float32 | None:
        """Return the irradiance of light that left any body and enters one, at the exchange's vertices, (m, 3)."""
        found = [part.reentering for part in self.lit_parts if part.reentering is not None]
        return np.sum(found, axis=0, dtype=np.float32) if found else None

    @computed_once
    def resolved(self) -> "Resolved | None":
        """Return what the matter of all bodies sends out along rays; None for none."""
        found = [None if part is None else part.resolved for part in self.parts]
        if all(part is None for part in found):
            return None
        from milkglass.core.paths.resolved import together

        ranges = [matter.bodies for matter in self.lit.matter] or [range(len(found))]
        first, *further = (together(found, bodies, self.atlas.first, self.grid) for bodies in ranges)
        return replace(first, further=tuple(further))

    def on_layers(self) -> Float32:
        """Return the bodies' sum on the whole object's layers, (3, *grid.shape)."""
        return self.atlas.summed(self.filled([None if part is None else part.on_layers() for part in self.parts]))

    def filled(self, parts: Sequence[Float32 | None]) -> Float32:
        """Return the atlas filled with one volume of each body, or None where it is dark."""
        channels = next((len(part) for part in parts if part is not None), 3)
        return self.atlas.assembled(parts, channels)


class OfBodies:
    """A `core.transport.base.Transport` that scatters light in each body of an object alone.

    Parameters
    ----------
    transport : SeparableTransport
        Of the whole object; its kernels serve all bodies.
    mesh : Mesh
    bodies : Bodies
        Two or more.
    samples : SurfaceSamples
        Of the mesh.
    """

    def __init__(self, transport: SeparableTransport, mesh: Mesh, bodies: Bodies, samples: SurfaceSamples) -> None:
        self.whole, self.mesh, self.bodies = transport, mesh, bodies
        self._of_vertex = bodies.of_vertex(mesh)
        self._atlases: dict[LayerGrid, Atlas] = {}  # the latest last; replaced, not changed, by `atlas`
        self._lock = threading.Lock()
        self._samples = samples
        of_sample = bodies.of_face[samples.faces]
        faces, chosen = _grouped(bodies.of_face, bodies.count), _grouped(of_sample, bodies.count)
        areas = np.maximum(np.bincount(of_sample, samples.areas, bodies.count), np.finfo(np.float64).tiny)
        areas = 2.0 ** (np.ceil(AREAS_A_DOUBLING * np.log2(areas)) / AREAS_A_DOUBLING)
        self._bodies = [
            Body(mesh, faces[i], samples, chosen[i], float(areas[i]), transport.in_body(mesh, self._crop(i)))
            for i in range(bodies.count)
        ]

    @property
    def smooth(self) -> bool:
        """Whether W are quadratic B-splines rather than tents."""
        return self.whole.smooth

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Place the whole object's layers."""
        return self.whole.grid(mesh, rotation)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the weights W of points on the whole object's layers."""
        return self.whole.weights(grid, coordinates)

    def material(self, lit: EnteringFlux) -> tuple[object, ...]:
        """Return the values of the material on which the transport depends."""
        return self.whole.material(lit)

    def atlas(self, grid: LayerGrid) -> Atlas:
        """Return the bodies' parts of the whole object's layers."""
        with self._lock:  # lighting asks too, perhaps in another thread
            atlas = self._atlases.get(grid) or fit_atlas(
                grid, tsc=self.smooth, vertices=self.mesh.vertices, body=self._of_vertex
            )
            older = [(key, atlas_kept) for key, atlas_kept in self._atlases.items() if key != grid]
            self._atlases = {**dict(older[1 - ATLASES :]), grid: atlas}
        return atlas

    def scatter(self, lit: EnteringFlux, stages: Stages, go_on: GoOn | None = None) -> ScatteredInBodies:
        """Return the light scattered in each body; `go_on` is called with all bodies together.

        `stages` keep what the bodies have in common; times of the bodies' own steps are added to theirs.
        """
        lit = lit.with_unscattered(stages)
        atlas = self.atlas(lit.grid)
        places = stages.run(Stage.BODY_SAMPLES, (atlas, lit.coordinates), lambda: self._placed(atlas, lit.coordinates))
        fluxes = stages.run(Stage.BODY_FLUX, (self, lit.flux), lambda: [lit.flux[body.chosen] for body in self._bodies])
        shares = [
            stages.run(Stage.BODY_LIGHT_FLUX.of(i), (self, light), lambda light=light: self._shares(light))  # type: ignore[misc]
            for i, light in enumerate(lit.lights, start=1)
        ]
        exchange, of_bodies = lit.exchange, [lit.exchange] * len(self._bodies)
        if exchange is not None:
            of_bodies = stages.run(Stage.BODY_EXCHANGE, (self, exchange), lambda: self._exchanges(exchange))
        beams = lit.beams
        crossing: list[Beams | None] = [None] * len(self._bodies)
        if beams is not None:
            kinds = (self, beams, *lit.matter) if lit.matter else (self, beams)
            crossing = stages.run(Stage.BODY_BEAMS, kinds, lambda: self._crossing(beams, lit))
        key = self, atlas, places, fluxes, *shares, *self.material(lit), exchange, beams
        in_matter = lit.in_kinds()
        if stages.has(Stage.BODIES, key):
            return stages.run(Stage.BODIES, key, lambda: self._dark(lit))
        entering = [
            replace(
                in_matter[lit.kind_of(i)],
                solid=body,
                grid=crop,
                coordinates=place,
                flux=flux,
                lights=tuple(filter(None, lights)),
                exchange=of_body,
                beams=across,
            )
            for i, (body, crop, place, flux, of_body, across, *lights) in enumerate(
                zip(self._bodies, atlas.crops, places, fluxes, of_bodies, crossing, *shares, strict=True)
            )
        ]
        for body in self._bodies:
            body.stages.begin()
        scattered = self._scatter(lit, entering, go_on)
        if exchange is not None and scattered.is_solved and scattered.atlas is atlas:
            scattered = self._exchanged(lit, scattered, entering, go_on)
        for body in self._bodies:
            for name, milliseconds in body.stages.timings.items():
                stages.timings[name] = stages.timings.get(name, 0.0) + milliseconds
        if scattered.atlas is atlas and scattered.is_solved:
            stages.run(Stage.BODIES, key, lambda: scattered)
        return scattered

    def start_cold(self) -> None:
        """Forget the solutions of all bodies, see `Transport.start_cold`."""
        for body in self._bodies:
            body.transport.start_cold()
            body.stages.forget(Stage.SOLUTION)
        self.whole.start_cold()

    def release(self) -> None:
        """Release the results of all bodies, and all kernels."""
        for body in self._bodies:
            body.transport.release()
            body.stages.clear()
        self.whole.release()

    def _scatter(self, lit: EnteringFlux, entering: Sequence[EnteringFlux], go_on: GoOn | None) -> ScatteredInBodies:
        """Scatter body by body, all of them on coarse nodes first where somebody looks."""
        clear = _clear(lit)
        shining = [i for i, part in enumerate(entering) if i not in clear and (part.flux.any() or part.beams)]
        parts: dict[int, Scattered] = {}
        newest = replace(self._dark(lit), waiting=bool(shining))

        def take(i: int, part: Scattered) -> None:
            nonlocal newest
            if parts.get(i) is not part:
                parts[i] = part
                newest = self._together(lit, parts, shining, i) or newest

        rounds = (True, False) if go_on is not None else (False,)
        for coarse, i in [(coarse, i) for coarse in rounds for i in shining]:
            body, grid, stopped = self._bodies[i], entering[i].grid, False
            if (known := parts.get(i)) is not None and known.is_solved and known.grid == grid:
                continue

            def notify(part: Scattered, i: int = i, *, coarse: bool = coarse, grid: LayerGrid = grid) -> bool:
                nonlocal stopped
                take(i, part)
                stopped = go_on is not None and not go_on(newest)
                enough = coarse and part.grid != grid and part.is_solved
                return not stopped and not enough

            take(i, body.transport.scatter(entering[i], body.stages, None if go_on is None else notify))
            if stopped:
                break
        return newest

    def _exchanged(
        self, lit: EnteringFlux, scattered: ScatteredInBodies, entering: Sequence[EnteringFlux], go_on: GoOn | None
    ) -> ScatteredInBodies:
        """Return the light scattered with what bodies let out onto others, which goes on until the rest is small."""
        arriving, clear = [np.zeros_like(part.flux) for part in entering], _clear(lit)
        for _ in range(self.whole.sweeps):
            total = scattered.reentering
            if total is None:
                return scattered  # all is dark
            before, arriving, parts = arriving, [], list(scattered.parts)
            for i, (light, part) in enumerate(zip(entering, scattered.parts, strict=True)):
                external = total if part is None or part.reentering is None else total - part.reentering
                arriving.append(self._entering(i, light, external))
            entered = sum(float(light.flux.sum(dtype=np.float64)) for light in entering)
            change = sum(
                float(np.abs(new - old).sum(dtype=np.float64)) for new, old in zip(arriving, before, strict=True)
            )
            if change <= NEGLIGIBLE_CHANGE * entered:
                break
            for i, (light, flux) in enumerate(zip(entering, arriving, strict=True)):
                if i in clear or not flux.any():
                    continue
                if go_on is not None and not go_on(replace(scattered, waiting=True)):
                    return replace(scattered, waiting=True)
                lights = *light.lights, EnteringLight(flux, returned=True)
                lit_again = replace(light, flux=light.flux + flux, lights=lights, external=flux)
                parts[i] = self._bodies[i].transport.scatter(lit_again, self._bodies[i].stages)
            scattered = replace(scattered, parts=tuple(parts))
        return scattered

    def _entering(self, i: int, light: EnteringFlux, irradiance: Float32) -> Float32:
        """Return the flux that enters the samples of a body, (n, 3), for irradiance at the exchange's vertices."""
        exchange, body = light.exchange, self._bodies[i]
        assert exchange is not None
        at_samples = body.stages.run(
            Stage.BODY_INTERPOLATION, exchange.surface, lambda: exchange.at_samples(body.samples)
        )
        return np.asarray(exchange.tinted(at_samples @ irradiance) * body.samples.areas[:, None], np.float32)

    def _exchanges(self, exchange: Exchange) -> list[Exchange | None]:
        """Return the exchange of light from each body, as it is known of the whole object."""
        fine = exchange.refined
        of_face = self._of_vertex[fine.sources[fine.mesh.faces[:, 0]]]
        return [exchange.of_body(body.faces, of_face == i, body.chosen) for i, body in enumerate(self._bodies)]

    def _together(
        self, lit: EnteringFlux, parts: dict[int, Scattered], shining: Sequence[int], latest: int
    ) -> ScatteredInBodies | None:
        """Return the bodies together where all of the lit ones are computed for the latest one's spacing, else None."""
        if len(parts) < len(shining):
            return None
        grid = parts[latest].grid
        atlas = next(atlas for atlas in self._atlases.values() if atlas.crops[latest] == grid)
        if not all(parts[i].grid == atlas.crops[i] for i in shining):
            return None
        return ScatteredInBodies(self, atlas, lit, tuple(parts.get(i) for i in range(len(self._bodies))))

    def _dark(self, lit: EnteringFlux) -> ScatteredInBodies:
        return ScatteredInBodies(self, self.atlas(lit.grid), lit, (None,) * len(self._bodies))

    def _placed(self, atlas: Atlas, coordinates: Float32) -> list[Float32]:
        """Return grid coordinates of each body's samples in its crop; they move by whole nodes, so no bit is lost."""
        return [
            coordinates[body.chosen] - np.asarray(first[::-1], np.float32)
            for body, first in zip(self._bodies, atlas.first, strict=True)
        ]

    def _shares(self, light: EnteringLight) -> list[EnteringLight | None]:
        """Return what each body has of a light; None where it is dark."""
        fluxes = (light.flux[body.chosen] for body in self._bodies)
        return [replace(light, flux=flux) if flux.any() else None for flux in fluxes]

    def _crossing(self, beams: "Beams", lit: EnteringFlux) -> "list[Beams | None]":
        """Return the beams through each body, as far as other matter leaves them; None where none is."""
        of_bodies = [beams.of_body(i) for i in range(len(self._bodies))]
        if not lit.matter:
            return [of_body or None for of_body in of_bodies]
        grid = lit.grid
        lengths = [[scaled(medium, grid).sigma_t for medium in kind.media] for kind in lit.in_kinds()]
        extinctions = np.array(lengths, np.float32)
        return [of_body.in_matter(lit.kind_of(i), extinctions) or None for i, of_body in enumerate(of_bodies)]

    def _crop(self, i: int) -> Callable[[LayerGrid], LayerGrid]:
        return lambda grid: self.atlas(grid).crops[i]


def _clear(lit: EnteringFlux) -> set[int]:
    """Return the bodies in which no light that scatters is followed."""
    return {i for matter in lit.matter if not matter.scatters for i in matter.bodies}


def _grouped(body: npt.NDArray[np.integer], count: int) -> list[Ints]:
    """Return the indices of the elements of each body, in ascending order."""
    order = np.argsort(body, kind="stable")
    bounds = np.searchsorted(body[order], np.arange(count + 1))
    return [order[start:stop] for start, stop in pairwise(bounds)]
