"""A scene that has been lit: what transport and shading need of it."""

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.arrays import Float32, Int32, Ints
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.exchange import Exchange
from milkglass.core.light.highlights import LobeFilter
from milkglass.core.light.indices import Indices
from milkglass.core.material.medium import Medium
from milkglass.core.profiles.base import Profiles
from milkglass.core.stages import alike
from milkglass.core.transport.base import (
    EnteringFlux,
    EnteringLight,
    Matter,
    Scattered,
    Transport,
    Unscattered,
    WholeObject,
)
from milkglass.core.transport.quality import Quality
from milkglass.viewer.files.gltf_medium import FileMedium
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.passes.detail_uniforms import SurfaceDetail
from milkglass.viewer.passes.light_source import LightSource
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.render.bodies import BodyMarks
from milkglass.viewer.scene.camera import Camera

if TYPE_CHECKING:
    from milkglass.core.paths.beams import Beams
    from milkglass.core.paths.surface import ClearPart
    from milkglass.viewer.render.ground import Ground


@dataclass(frozen=True, eq=False)
class Model:
    """A loaded mesh, on the CPU and the GPU, with warnings of its flaws.

    Attributes
    ----------
    mesh, buffers
        What scatters light.
    warnings : tuple of str
    clear : tuple of Mesh
        Parts that do not scatter light, in the order of the scene's materials.
    clear_buffers : MeshBuffers, optional
        Of all of them.
    with_clear : Mesh, optional
        The mesh with its clear parts, where it has any.
    whole_buffers : MeshBuffers, optional
        Of that.
    lift : float
        How far the mesh is above the lowest point of the whole, mm.
    file_size : str
        The size that it has in its file, in words; empty where there is no file.
    medium : FileMedium, optional
        What the file says that the surface bounds, where it says so.
    """

    mesh: Mesh
    buffers: MeshBuffers
    warnings: tuple[str, ...]
    clear: tuple[Mesh, ...] = ()
    clear_buffers: MeshBuffers | None = None
    with_clear: Mesh | None = None
    whole_buffers: MeshBuffers | None = None
    lift: float = 0.0
    file_size: str = ""
    medium: FileMedium | None = None

    @property
    def whole(self) -> Mesh:
        """Return all that is seen, clear parts too."""
        return self.with_clear or self.mesh

    def size_of(self, size_mm: float | str) -> float:
        """Return the size that a scene asks for, mm, which is this model's where it asks for the file's."""
        return float(f"{np.ptp(self.whole.bounds, axis=0).max():.6g}") if isinstance(size_mm, str) else size_mm


def kinds_of(bodies: Int32, matter: tuple[Matter, ...]) -> Ints:
    """Return the number of the matter of bodies, (n,)."""
    starts = [of_kind.bodies.start for of_kind in matter]
    return np.asarray(np.searchsorted(starts, bodies, side="right") - 1)


@dataclass(frozen=True, eq=False)
class LitScene:
    """A scene ready for transport, which needs no OpenGL, and for shading.

    Attributes
    ----------
    model, camera
    sources : lights with their shadow maps
    quality : Quality
        What the transport was made for, with the error to expect.
    transport : Transport
        In each body alone, where bodies are separate.
    grid, profiles
    coordinates : (n, 3) float32
        Grid coordinates of the samples.
    flux : (n, 3) float32
        E dA of the samples, all lights that enter first.
    lights : tuple of EnteringLight
        Light by light, where the method takes each light.
    matter : tuple of Matter
        What its bodies are of, in their order.
    samples : SurfaceSamples
    lobes : LobeFilter, optional
        Of the environment less the sources that shine as lamps: what highlights mirror.
    bodies : Bodies, optional
        Where they are to be separate.
    body_marks : BodyMarks, optional
        Where they are more than one.
    detail : SurfaceDetail, optional
        Colours and relief of the surface.
    troubles : tuple of str
        What of them could not be had.
    exchange : Exchange, optional
        Of light between parts of the surface.
    unscattered : Unscattered, optional
        Light that has met the surface before, mirrored or through thin parts; computed with transport.
    surface : RefinedSurface, optional
        Where light or its occlusion is known at the vertices of a refined mesh.
    beams : Beams, optional
        Of all lights through the object, where it needs them.
    clear : tuple of ClearPart
        Parts that only rays know, where the method follows any.
    ground : Ground, optional
        That the object stands on.
    indices : Indices, optional
        Of refraction, of the surface refined for exchange, where they are not all alike.
    """

    model: Model
    camera: Camera = field(compare=False)
    sources: tuple[LightSource, ...]
    quality: Quality = field(compare=False)
    transport: Transport
    grid: LayerGrid
    profiles: Profiles
    coordinates: Float32
    flux: Float32
    lights: tuple[EnteringLight, ...]
    matter: tuple[Matter, ...]
    samples: SurfaceSamples = field(compare=False)
    lobes: LobeFilter | None = field(default=None, compare=False)
    bodies: Bodies | None = None
    body_marks: BodyMarks | None = field(default=None, compare=False)
    detail: SurfaceDetail | None = None
    troubles: tuple[str, ...] = field(default=(), compare=False)
    exchange: Exchange | None = None
    unscattered: Unscattered | None = None
    surface: RefinedSurface | None = field(default=None, compare=False)
    beams: "Beams | None" = None
    clear: "tuple[ClearPart, ...]" = ()
    ground: "Ground | None" = field(default=None, compare=False)
    indices: Indices | None = field(default=None, compare=False)

    @property
    def media(self) -> tuple[Medium, ...]:
        """Return the media of R, G and B, of the first of its bodies."""
        return self.matter[0].media

    @property
    def eta(self) -> float:
        """Return the relative index of refraction of the first of its bodies."""
        return self.matter[0].eta

    @property
    def kind_of_vertex(self) -> Ints:
        """Return the number of the matter behind each vertex of the mesh, (n,)."""
        if self.body_marks is None:
            return np.zeros(len(self.model.mesh.vertices), np.int64)
        return kinds_of(self.body_marks.of_vertex, self.matter)

    @property
    def scattering(self) -> int:
        """Return the number of bodies that scatter, after which clear parts are numbered."""
        return 1 if self.body_marks is None or self.bodies is None else self.bodies.count

    @property
    def occlusion(self) -> Occlusion | None:
        """Return what keeps the environment's light from the surface, where that is known."""
        return next((source.occlusion for source in self.sources if source.occlusion is not None), None)

    @property
    def entering(self) -> EnteringFlux:
        """Return the light that enters the object, as transport takes it."""
        solid = WholeObject(self.model.mesh, self.samples)
        placed = solid, self.grid, self.coordinates, self.flux, self.lights, self.profiles, self.media
        several = self.matter if len(self.matter) > 1 else ()
        return EnteringFlux(*placed, self.exchange, self.beams, several, unscattered=self.unscattered)

    def entering_again(self, scattered: Scattered) -> Float32 | None:
        """Return the irradiance that meets the surface again, (n, 3) at the exchange's vertices; None for none."""
        unscattered = None if scattered.estimates_unscattered else self.unscattered
        known = None if unscattered is None else unscattered.irradiance
        found = [part for part in (scattered.reentering, known) if part is not None]
        return np.asarray(np.sum(found, axis=0), np.float32) if found else None

    def is_same_light(self, other: "LitScene") -> bool:
        """Tell whether transport would have the same work: stages return the very same arrays where nothing changed.

        What follows of the rest, or only pixels look at, is declared so by its field (`compare=False`).
        """
        return alike(self._compared(), other._compared())

    def _compared(self) -> tuple[object, ...]:
        return tuple(getattr(self, item.name) for item in fields(self) if item.compare)

    def without_tint(self) -> "LitScene":
        """Return the scene without what colours do to light that leaves: exitance is then that of equation (1)."""
        return self if self.detail is None else replace(self, detail=replace(self.detail, after=0.0))
