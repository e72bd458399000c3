"""Interface of every transport: light enters a placed surface, is scattered, and exitance is gathered at any point.

A `Transport` places layers for an object, and scatters the flux that enters its surface (`EnteringFlux`) into a
`Scattered`: a volume at the nodes of the layers, and small tables (`core.transport.pixels`) with which a pixel or a
point adds what they are too coarse for. The methods are rows of `core.transport.methods`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.atlas import Atlas
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.exchange import Exchange
from milkglass.core.material.medium import Medium
from milkglass.core.profiles.base import Profiles
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import computed_once
from milkglass.core.transport.pixels import PixelTables

if TYPE_CHECKING:  # compiled loops take half a second to import
    from milkglass.core.paths.beams import Beams
    from milkglass.core.paths.resolved import Resolved

Bools = npt.NDArray[np.bool_]
Vector = tuple[float, float, float]


# Light that enters


@dataclass(frozen=True, eq=False)
class EnteringLight:
    """One light on the surface samples; neither a direction nor a position means from all around.

    Attributes
    ----------
    flux : (samples, 3) float32
        E dA of each sample.
    direction : 3-tuple, optional
        Unit, the way that light travels.
    position : 3-tuple, optional
        Where it comes from, mm.
    returned : bool
        Whether it has met the object before, and comes from all around: let out or mirrored by it, or come through it.
    """

    flux: Float32
    direction: Vector | None = None
    position: Vector | None = None
    returned: bool = False


@dataclass(frozen=True, eq=False)
class Unscattered:
    """Light that has met the surface before but not scattered, mirrored or through thin parts; from all around.

    It takes rays, so that it is computed when it is first asked for; until then what is known of such light stands for
    it. Compared by identity.

    Attributes
    ----------
    samples : SurfaceSamples
        That it enters.
    besides : (samples, 3) float32
        E dA of the light that enters first.
    compute : callable
        Returns its irradiance at the vertices of the surface refined for exchange, (m, 3), and it as a light.
    """

    samples: SurfaceSamples
    besides: Float32
    compute: Callable[[], tuple[Float32, EnteringLight]]

    @computed_once
    def _computed(self) -> tuple[Float32, EnteringLight]:
        return self.compute()

    @property
    def irradiance(self) -> Float32:
        """Return E at the vertices of the surface refined for exchange, (m, 3)."""
        return self._computed[0]

    @property
    def light(self) -> EnteringLight:
        """Return it as a light on the samples."""
        return self._computed[1]

    @computed_once
    def entering(self) -> Array:
        """Return the flux of R, G and B that enters besides, (3,) float64."""
        return np.asarray(self.besides.sum(axis=0, dtype=np.float64))

    def growth(self, known: "Unscattered") -> Array | None:
        """Return the factors on other such light, which is known, that estimate this, (3,); None on another surface.

        Both are as bright as the light that enters besides, at most.
        """
        if known.samples is not self.samples:
            return None
        most = np.maximum(known.entering, known.light.flux.sum(axis=0, dtype=np.float64))
        return np.asarray(np.divide(self.entering, most, out=np.zeros(3), where=most > 0.0))


class Solid(Protocol):
    """An object, or one body of it, whose surface light enters."""

    @property
    def mesh(self) -> Mesh:
        """Return the surface of the object or body as a triangle mesh."""

    @property
    def samples(self) -> SurfaceSamples:
        """Return samples of the surface, which name faces of the mesh."""

    @property
    def area(self) -> float:
        """Return the area of the surface, mm^2, perhaps rounded up."""


@dataclass(frozen=True, eq=False)
class WholeObject:
    """A whole object as a `Solid`."""

    mesh: Mesh
    samples: SurfaceSamples

    @property
    def area(self) -> float:
        """Return the area of the surface, mm^2."""
        return self.mesh.area


@dataclass(frozen=True)
class Matter:
    """What some bodies of an object are of.

    Attributes
    ----------
    media : R, G and B
    bodies : range
        Numbers of the bodies.
    name : str
        Of the part with a material of its own; empty of the material.
    chord : float
        Mean chord of the bodies, mm.
    scatters : bool
        Whether so much light scatters in it that it is followed.
    """

    media: tuple[Medium, ...]
    bodies: range
    name: str = ""
    chord: float = 0.0
    scatters: bool = True

    @property
    def eta(self) -> float:
        """Return the relative index of refraction."""
        return self.media[0].eta

    @property
    def followed(self) -> tuple[Medium, ...]:
        """Return the media of R, G and B; black where what scatters is left out."""
        return self.media if self.scatters else tuple(medium.black for medium in self.media)


@dataclass(frozen=True, eq=False)
class EnteringFlux:
    """Light that enters a surface, ready to be scattered.

    Attributes
    ----------
    solid : Solid
    grid : LayerGrid
        From `Transport.grid`.
    coordinates : (n, 3) float32
        Grid coordinates of the surface samples.
    flux : (n, 3) float32
        E dA, the power that each sample carries, of all lights together.
    lights : tuple of EnteringLight
        Light by light, where the method takes each light (`core.transport.methods.Method.takes_each_light`).
    profiles, media : R, G and B
    exchange : Exchange, optional
        Where light that leaves the object meets it again, and enters.
    beams : Beams, optional
        The lights' beams through the object.
    matter : tuple of Matter
        What its bodies are of, in their order, where that is more than one; `media` are then those of the first.
    external : (samples, 3) float32, optional
        Of the flux, what comes from other bodies, of which no beams tell.
    unscattered : Unscattered, optional
        Further light, neither in the flux nor among the lights.
    """

    solid: Solid
    grid: LayerGrid
    coordinates: Float32
    flux: Float32
    lights: tuple[EnteringLight, ...]
    profiles: Profiles
    media: tuple[Medium, ...]
    exchange: Exchange | None = None
    beams: "Beams | None" = None
    matter: tuple[Matter, ...] = ()
    external: Float32 | None = None
    unscattered: Unscattered | None = None

    def with_unscattered(self, stages: Stages) -> "EnteringFlux":
        """Return all light in the flux and among the lights: what is unscattered is computed."""
        if self.unscattered is None:
            return self
        light = self.unscattered.light
        flux = stages.run(Stage.TOTAL_FLUX, (self.flux, light), lambda: self.flux + light.flux)
        return replace(self, flux=flux, lights=(*self.lights, light), unscattered=None)

    def kind_of(self, body: int) -> int:
        """Return the number of what a body is of."""
        return next((kind for kind, matter in enumerate(self.matter) if body in matter.bodies), 0)

    def in_kinds(self) -> "tuple[EnteringFlux, ...]":
        """Return the light as each kind of matter has it, with its media."""
        if not self.matter:
            return (self,)
        return tuple(replace(self, media=matter.followed, matter=()) for matter in self.matter)


# What comes of it


@dataclass(frozen=True, eq=False)
class LightAtPoints:
    """One light at n points of a surface.

    Attributes
    ----------
    irradiance : (n, 3)
        E that enters here.
    cosine : (n,) or None
        Of the light to the normal, outside; None where it comes from all around.
    behind : (n, 3)
        E on the other side of a thin slab, times how far the two sides are one.
    behind_cosine : (n,)
        Of the light to the normal over there.
    thickness : (n,)
        Of the slab, mm.
    """

    irradiance: Array
    cosine: Array | None
    behind: Array
    behind_cosine: Array
    thickness: Array


class SurfaceLights(Protocol):
    """Lights on an object, which know what enters anywhere on its surface."""

    eta: float

    def at(self, points: Array, normals: Array, reach: float, *, thin: bool) -> list[LightAtPoints]:
        """Return every light at points (n, 3) with unit outward normals (n, 3).

        Parameters
        ----------
        points, normals
        reach : float
            Thickness up to which the light behind a thin slab matters, mm; 0 where it never does.
        thin : bool
            Whether light from all around is asked for on the other side too.
        """

    def on_body(self, faces: Bools) -> "SurfaceLights":
        """Return the lights on one body of the object, for whose thin slabs only these of the object's faces count."""


class Scattered(Protocol):
    """What transport has made of entering light: exitance at any point of the surface can be read from it."""

    @property
    def grid(self) -> LayerGrid:
        """Return the nodes of the whole object; on the way they may be coarser than those asked for."""

    @property
    def volume(self) -> Float32:
        """Return what nodes carry, (3 or 4, layers, rows, columns): R, G, B; then K_L 1 where pixels solve an equation.

        The same array as long as it is the same transport of the same light.
        """

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) from world space to the volume's texture coordinates, row vectors."""

    @property
    def windows(self) -> Float32 | None:
        """Return `core.grid.atlas.Atlas.windows` where the volume is an atlas of bodies; else None."""

    @property
    def residuals(self) -> tuple[float, ...]:
        """Return the relative residual of each channel's equation; 0 where none is solved."""

    @property
    def convolutions(self) -> tuple[int, ...]:
        """Return how many convolutions each channel's equation took; 0 where none is solved."""

    @property
    def is_solved(self) -> bool:
        """Whether the residuals are as small as was asked for, on this grid."""

    @property
    def boundaries(self) -> tuple[object, ...]:
        """Return the surfaces as they lie on the grid, body by body, where `pixel_tables` depend on them; else ()."""

    def pixel_tables(self) -> PixelTables:
        """Return the tables from which pixels compute their exitance, in addition to the volume."""

    def mean_fluence(self) -> Float32:
        """Return the mean of 2 A M near each node, (3, layers, rows, columns), for pixels that solve an equation."""

    def exitance(self, points: Array, normals: Array, lights: SurfaceLights, tables: PixelTables) -> Array:
        """Return exitance M at points of the surface, (n, 3) float64, >= 0, as pixels have it, lit by `lights`.

        Parameters
        ----------
        points, normals : (n, 3)
            mm; unit, outward.
        lights : SurfaceLights
        tables : PixelTables
            Its own, or those of a whole object of which this is one body.
        """

    @property
    def resolved(self) -> "Resolved | None":
        """Return what matter sends out along rays, in channels whose free paths the nodes resolve; None for none."""

    @property
    def reentering(self) -> Float32 | None:
        """Return the irradiance of light that left the object and enters it again, at `Exchange`'s vertices, (m, 3)."""

    @property
    def estimates_unscattered(self) -> bool:
        """Whether `Unscattered` light was not there yet: what was known of it counts as entering again."""

    def on_layers(self) -> Float32:
        """Return exitance on the layers, (3, *grid.shape), all bodies together; of an equation the flux M dA."""


GoOn = Callable[[Scattered], bool]


class Transport(Protocol):
    """A method of scattering light inside an object."""

    @property
    def smooth(self) -> bool:
        """Whether W are quadratic B-splines rather than tents."""

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Place the layers for a mesh seen with a world-to-view rotation (3, 3), row vectors."""

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the particle-mesh weights W of points (n, 3) in grid coordinates, (nodes, n) sparse."""

    def scatter(self, lit: EnteringFlux, stages: Stages, go_on: GoOn | None = None) -> Scattered:
        """Scatter light inside the object.

        Parameters
        ----------
        lit : EnteringFlux
        stages : Stages
            Keeps the steps' results between calls.
        go_on : callable, optional
            Told what there is on the way, where an equation is solved in steps: first on half the nodes; False ends
            there, and the next call starts from it. Where nobody looks all nodes are solved at once, which takes less
            time in all.
        """

    def material(self, lit: EnteringFlux) -> tuple[object, ...]:
        """Return what it depends on of the material, profiles or media, as a key of stages."""

    def start_cold(self) -> None:
        """Forget the solutions that the next would start from, so that it is what a new transport finds, to the bit.

        Spectra of kernels that are out of use go too: memory stays what one picture needs.
        """

    def release(self) -> None:
        """Release all kernels and results; those needed again are computed again."""


class SeparableTransport(Transport, Protocol):
    """A transport of which `core.transport.separate.OfBodies` makes one in each body of an object alone."""

    kernels: Kernels
    sweeps: int  # how often light may go from body to body

    def tables_of(self, lit: EnteringFlux, atlas: Atlas, parts: Sequence[Scattered | None]) -> PixelTables:
        """Return the tables of pixels where the volume is an atlas of several bodies; None for a dark one."""

    def in_body(self, object_mesh: Mesh, crop: Callable[[LayerGrid], LayerGrid]) -> Transport:
        """Return the transport in one body of an object, which shares all kernels.

        Parameters
        ----------
        object_mesh : Mesh
        crop : callable
            Gives the body's part of the whole object's grid.
        """
