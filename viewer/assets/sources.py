"""Sources of assets: files, built-in shapes and objects in memory, and what is computed of them.

A source is a value: equal sources give the same asset, which `viewer.assets.keeper.Assets` keeps under its source.
Meshes and probes compare by identity, and a kept source holds its own: no other can take over its identity.
"""

import threading
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeVar

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import Bodies, bodies_of_kinds, find_bodies
from milkglass.core.geometry.detail import MeshDetail
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.geometry.vessels import VESSELS
from milkglass.core.light.crossing import LEAST_ALBEDO, USUAL_ETA, Crossings, Needed, few_crossings
from milkglass.core.light.exchange import Hits
from milkglass.core.light.ground import GroundPlane, GroundRays
from milkglass.core.light.highlights import LobeFilter
from milkglass.core.light.indices import Indices
from milkglass.core.light.maps import PROJECTIONS
from milkglass.core.light.presets import preset
from milkglass.core.light.probe import Probe
from milkglass.core.light.sources import ProbeSource, extract_sources
from milkglass.core.material.medium import Medium
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import Roughness, roughness
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.core.transport.quality import Quality, choose_quality, survey_spacing
from milkglass.viewer.assets.exchange import find_crossings, find_hits
from milkglass.viewer.assets.ground import find_ground_rays
from milkglass.viewer.assets.visibility import BakedVisibility, bake_visibility, refine
from milkglass.viewer.files.builtin import builtin_model
from milkglass.viewer.files.model import FileModel, builtin_vessel, read_model
from milkglass.viewer.files.model_look import detail_of
from milkglass.viewer.files.radiance import read_probe
from milkglass.viewer.scene.settings import DetailSettings, EnvironmentSettings, ModelSettings, TransportSettings
from milkglass.viewer.scene.tables import ProfileTable, read_profile_table

if TYPE_CHECKING:
    from milkglass.viewer.assets.keeper import Assets

T_co = TypeVar("T_co", covariant=True)
LoadedDetail = tuple[MeshDetail | None, tuple[str, ...]]
PartedProbe = tuple[tuple[ProbeSource, ...], Probe]


class Source(Hashable, Protocol[T_co]):
    """What an asset is read from or computed of."""

    def load(self, assets: "Assets") -> T_co:
        """Read or compute the asset, from other assets where it needs some; raises `InputError` for unusable files."""


class ModelSource(Source[FileModel], Protocol):
    """Source of a model."""

    @property
    def name(self) -> str:
        """What sentences about the model call it."""


@dataclass(frozen=True)
class ModelFile:
    """A model in a file; parameters and errors as `viewer.files.model.read_model`."""

    path: Path
    size_mm: float | str
    up: str | None
    close_holes: bool = True

    @property
    def name(self) -> str:
        """What sentences about the model call it."""
        return str(self.path)

    def load(self, assets: "Assets") -> FileModel:
        """Read the file."""
        return read_model(self.path, self.size_mm, self.up, close_holes=self.close_holes)


@dataclass(frozen=True)
class BuiltinModel:
    """A shape that needs no file, see `viewer.files.builtin.builtin_model`."""

    shape: str
    size_mm: float | str
    up: str

    @property
    def name(self) -> str:
        """What sentences about the model call it."""
        return f"the built-in {self.shape}"

    def load(self, assets: "Assets") -> FileModel:
        """Make the shape."""
        if isinstance(self.size_mm, str):
            raise InputError(
                f'model.size_mm = "{self.size_mm}" needs a model of a file; {self.name} has no size, give mm'
            )
        if self.shape in VESSELS:
            return builtin_vessel(self.shape, self.size_mm, self.up)
        return FileModel(builtin_model(self.size_mm, self.up))


@dataclass(frozen=True)
class ModelInMemory:
    """A mesh that was computed in this process, as that of a photograph's object."""

    mesh: Mesh
    name: str = "the model in memory"

    def load(self, assets: "Assets") -> FileModel:
        """Return the mesh as a model without a look of its own."""
        return FileModel(self.mesh)


@dataclass(frozen=True)
class SolidModel:
    """A model in its matter: parts with materials of their own taken out, and what bounds the matter of each made out.

    See `viewer.files.model.FileModel.parted` and, where the model is of a file, `FileModel.solid`.
    """

    model: ModelSource
    parts: tuple[tuple[str, ...], tuple[str, ...]] | None
    nested: str

    @property
    def name(self) -> str:
        """What sentences about the model call it."""
        return self.model.name

    def load(self, assets: "Assets") -> FileModel:
        """Take the parts out of the model and make out what bounds their matter."""
        model = assets.get(self.model)
        if self.parts is not None:
            model = model.parted(*self.parts, self.name)
        if isinstance(self.model, ModelFile):
            model = model.solid(self.name, self.nested)
        if model.mesh.kinds is None:
            return model
        # Bodies of different matter are closed each by itself, though they may overlap.
        bodies, _ = bodies_of_kinds(model.mesh, joined=False)
        return replace(model, mesh=replace(model.mesh, closed=is_closed(row_sums(model.mesh, body=bodies.of_face))))


@dataclass(frozen=True)
class ProbeFile:
    """A light probe in a file; errors as `viewer.files.radiance.read_probe` and `Probe.from_pixels`."""

    path: Path
    projection: str

    def load(self, assets: "Assets") -> Probe:
        """Read the file."""
        pixels, said = read_probe(self.path)
        known = next((name for name in PROJECTIONS if name == self.projection), None)  # none is "auto"
        try:
            return Probe.from_pixels(pixels, known, said)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error


@dataclass(frozen=True)
class BuiltinProbe:
    """A light probe that needs no file, see `core.light.presets.preset`."""

    name: str

    def load(self, assets: "Assets") -> Probe:
        """Compute the probe."""
        return Probe.from_pixels(preset(self.name))


@dataclass(frozen=True)
class ProbeInMemory:
    """A light probe that was computed in this process, as the light around a photograph's object."""

    probe: Probe

    def load(self, assets: "Assets") -> Probe:
        """Return the probe."""
        return self.probe


PROBE_SOURCES = (ProbeFile, BuiltinProbe, ProbeInMemory)


@dataclass(frozen=True)
class ProfileFile:
    """Measured profiles in a file; errors as `viewer.scene.tables.read_profile_table`."""

    path: Path

    def load(self, assets: "Assets") -> ProfileTable:
        """Read the file."""
        return read_profile_table(self.path)


@dataclass(frozen=True)
class DetailOf:
    """Colours and relief of a model's surface, see `viewer.files.model_look.detail_of`.

    Attributes
    ----------
    model : ModelSource
    texture, normal_map : Path, optional
        Pictures in place of the file's own.
    colours, relief : bool
        Which of them are asked for.
    """

    model: ModelSource
    texture: Path | None
    normal_map: Path | None
    colours: bool
    relief: bool

    @classmethod
    def asked(cls, model: ModelSettings, settings: DetailSettings) -> "DetailOf":
        """Return the source of the detail that a scene's settings ask for."""
        shown = settings.albedo != "off", settings.normal_strength > 0.0
        return cls(model_source(model), model.texture, model.normal_map, *shown)

    def load(self, assets: "Assets") -> LoadedDetail:
        """Decode the pictures; returns the detail, and sentences on what of it failed."""
        model = assets.get(self.model)
        pictures = self.texture, self.normal_map
        return detail_of(model.look, model.mesh, self.model.name, *pictures, colours=self.colours, relief=self.relief)


@dataclass(frozen=True)
class PartsOf:
    """A probe's strong small sources and the rest of its light, see `core.light.sources.extract_sources`."""

    probe: Probe

    def load(self, assets: "Assets") -> PartedProbe:
        """Take the sources out of the probe."""
        return extract_sources(self.probe)


@dataclass(frozen=True)
class LobesOf:
    """What prefilters a probe for highlights."""

    probe: Probe

    def load(self, assets: "Assets") -> LobeFilter:
        """Prepare the filter."""
        return LobeFilter(self.probe)


@dataclass(frozen=True)
class SamplesOf:
    """Samples of a mesh's surface, `spacing` mm apart, see `core.geometry.samples.surface_samples`."""

    mesh: Mesh
    spacing: float

    def load(self, assets: "Assets") -> SurfaceSamples:
        """Sample the surface."""
        return surface_samples(self.mesh, self.spacing)


@dataclass(frozen=True)
class BodiesOf:
    """Connected bodies of a mesh, see `core.geometry.bodies.find_bodies`."""

    mesh: Mesh

    def load(self, assets: "Assets") -> Bodies:
        """Find the bodies."""
        return find_bodies(self.mesh) if self.mesh.kinds is None else bodies_of_kinds(self.mesh, joined=False)[0]


@dataclass(frozen=True)
class RoughnessOf:
    """How rough a mesh is, see `core.transport.accuracy.roughness`."""

    mesh: Mesh

    def load(self, assets: "Assets") -> Roughness:
        """Measure the mesh, by samples that serve most grids too."""
        return roughness(assets.samples(self.mesh, survey_spacing(self.mesh)), self.mesh.bounds)


@dataclass(frozen=True)
class RowSumsOf:
    """How closed a mesh is, or each of its bodies if `separate`, see `core.transport.diffusion.boundary.row_sums`."""

    mesh: Mesh
    separate: bool

    def load(self, assets: "Assets") -> Array:
        """Measure the mesh, unless it is closed by construction."""
        if self.mesh.closed:
            return np.full(1, -0.5)
        bodies = assets.bodies(self.mesh) if self.separate else None
        return row_sums(self.mesh, body=None if bodies is None or bodies.count == 1 else bodies.of_face)


@dataclass(frozen=True)
class QualityOf:
    """Layers and resolution of transport, see `core.transport.quality.choose_quality`."""

    settings: TransportSettings
    profiles: Profiles
    mesh: Mesh
    sharp_light: bool
    separate: bool

    def load(self, assets: "Assets") -> Quality:
        """Choose the quality, by the shape where the method needs to know it."""
        mesh, settings = self.mesh, assets.possible(self.settings, self.mesh, separate=self.separate)
        shape = assets.roughness(mesh) if settings.facts.needs_roughness else None
        quality = choose_quality(settings, self.profiles, mesh, shape, sharp_light=self.sharp_light)
        if settings != self.settings:
            sums = assets.row_sums(mesh, separate=self.separate)
            worst = float(sums[np.abs(sums + 0.5).argmax()])
            quality = replace(quality, instead_of=self.settings.method, open_surface=worst)
        return quality


@dataclass(frozen=True)
class VisibilityOf:
    """What a mesh's vertices see of what is around; parameters as of `viewer.assets.visibility.bake_visibility`."""

    CASTING: ClassVar[str] = "environment's shadows"

    mesh: Mesh
    progress: Callable[[float], object] = field(default=lambda _: None, compare=False)
    cancelled: threading.Event | None = field(default=None, compare=False)

    def load(self, assets: "Assets") -> BakedVisibility:
        """Cast the rays; a window, which does not wait for them, may ask for all that they tell at any time."""
        fine = assets.get(RefinedOf(self.mesh))
        return bake_visibility(fine, self.progress, self.cancelled, ahead=not assets.bakes)


@dataclass(frozen=True)
class RefinedOf:
    """A mesh with vertices wherever values are to be known on its surface, see `viewer.assets.visibility.refine`."""

    mesh: Mesh

    def load(self, assets: "Assets") -> Refined:
        """Refine the mesh."""
        return refine(self.mesh)


@dataclass(frozen=True)
class HitsOf:
    """Rays between parts of a mesh; parameters as of `viewer.assets.exchange.find_hits`."""

    CASTING: ClassVar[str] = "light between parts"

    mesh: Mesh
    progress: Callable[[float], object] = field(default=lambda _: None, compare=False)
    cancelled: threading.Event | None = field(default=None, compare=False)

    def load(self, assets: "Assets") -> Hits | None:
        """Cast the rays; None where the mesh does not see itself."""
        return find_hits(assets.get(RefinedOf(self.mesh)), self.progress, self.cancelled)


@dataclass(frozen=True)
class IndicesOf:
    """Indices of refraction of a mesh around several kinds of matter, refined to where light between parts is known."""

    mesh: Mesh
    etas: tuple[float, ...]

    def load(self, assets: "Assets") -> Indices:
        """Put them at vertices and faces."""
        return Indices.of(self.etas, self.mesh, assets.get(RefinedOf(self.mesh)))


@dataclass(frozen=True)
class FewCrossingsOf:
    """A few paths of light through the matter of a mesh, see `core.light.crossing.few_crossings`."""

    CASTING: ClassVar[str] = "light through thin parts"

    mesh: Mesh
    progress: Callable[[float], object] = field(default=lambda _: None, compare=False)
    cancelled: threading.Event | None = field(default=None, compare=False)

    def load(self, assets: "Assets") -> Crossings | None:
        """Follow the paths; None where the mesh does not see itself."""
        if assets.get(HitsOf(self.mesh)) is None:
            return None
        fine, kinds = assets.get(RefinedOf(self.mesh)), self.mesh.kinds
        eta = USUAL_ETA if kinds is None else Indices.of((USUAL_ETA,) * int(kinds.max() + 1), self.mesh, fine)
        return few_crossings(fine.mesh, eta)


@dataclass(frozen=True)
class CrossingsOf:
    """Paths of light through the matter of a mesh; parameters as of `viewer.assets.exchange.find_crossings`."""

    CASTING: ClassVar[str] = "light through thin parts"

    mesh: Mesh
    etas: tuple[float, ...]
    needed: Needed
    progress: Callable[[float], object] = field(default=lambda _: None, compare=False)
    cancelled: threading.Event | None = field(default=None, compare=False)

    @classmethod
    def of(cls, mesh: Mesh, media: Sequence[Sequence[Medium]], few: Crossings | None) -> "CrossingsOf | None":
        """Return the source for media of R, G and B of each kind; None where a `few` paths tell that it needs none."""
        extinctions = [
            [medium.sigma_t_prime for medium in channel]
            for channel in zip(*media, strict=True)
            if any(medium.albedo > LEAST_ALBEDO for medium in channel)
        ]
        needed = None if few is None else Needed.of(few, extinctions)
        return None if needed is None else cls(mesh, tuple(of_kind[0].eta for of_kind in media), needed)

    def load(self, assets: "Assets") -> Crossings:
        """Follow the paths."""
        eta = self.etas[0] if self.mesh.kinds is None else assets.get(IndicesOf(self.mesh, self.etas))
        return find_crossings(assets.get(RefinedOf(self.mesh)), eta, self.needed, self.progress, self.cancelled)


@dataclass(frozen=True)
class GroundRaysOf:
    """Rays from the plane `gap` mm below a mesh; parameters as of `viewer.assets.ground.find_ground_rays`."""

    CASTING: ClassVar[str] = "the ground's shadows"

    mesh: Mesh
    gap: float
    progress: Callable[[float], object] = field(default=lambda _: None, compare=False)
    cancelled: threading.Event | None = field(default=None, compare=False)

    def load(self, assets: "Assets") -> GroundRays:
        """Cast the rays."""
        plane = GroundPlane.below(self.mesh, self.gap)
        return find_ground_rays(assets.get(RefinedOf(self.mesh)), plane, self.progress, self.cancelled)


def model_source(settings: ModelSettings) -> ModelSource:
    """Return the source of a scene's model in its matter, without its clear parts."""
    whole = whole_source(settings)
    if settings.parts is None and not isinstance(whole, ModelFile):
        return whole
    return SolidModel(whole, settings.parts, settings.nested)


def whole_source(settings: ModelSettings) -> ModelSource:
    """Return the source of a scene's model with all of its parts."""
    if settings.mesh is not None:
        return ModelInMemory(settings.mesh)
    if settings.path is not None:
        return ModelFile(settings.path, settings.size_mm, settings.up, settings.close_holes)
    assert settings.builtin_name is not None
    return BuiltinModel(settings.builtin_name, settings.size_mm, settings.up or "y")


def probe_source(environment: EnvironmentSettings) -> Source[Probe]:
    """Return the source of the light probe of a scene's environment, which has one."""
    if environment.probe is not None:
        return ProbeInMemory(environment.probe)
    if environment.path is not None:
        return ProbeFile(environment.path, environment.projection)
    assert environment.builtin is not None
    return BuiltinProbe(environment.builtin)


def files_of(source: object) -> list[Path]:
    """Return the files that a source itself reads."""
    return [part for part in vars(source).values() if isinstance(part, Path)]


def depends_on(source: object, path: Path) -> bool:
    """Tell whether a source reads a file, or is computed of a model in it."""
    models = [part for part in vars(source).values() if isinstance(part, ModelFile | SolidModel)]
    return path in files_of(source) or any(depends_on(model, path) for model in models)


def stamp(path: Path) -> tuple[int, int] | None:
    """Return what tells a file from what it was before: the time of its last change, ns, and its size; None if gone."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
