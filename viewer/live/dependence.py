"""What a picture depends on, for deciding what to do again."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from milkglass.core.stages import Part
from milkglass.core.transport.quality import sample_spacing
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import (
    BodiesOf,
    DetailOf,
    PartsOf,
    ProfileFile,
    RoughnessOf,
    RowSumsOf,
    SamplesOf,
    Source,
    model_source,
    probe_source,
)
from milkglass.viewer.render.lighting import quality_of
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.keys import LIGHTS, Key, paths
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import TABLES, CameraSettings, ModelSettings, TransportSettings

CAMERA = (CameraSettings.TABLE,)
DRAGGED = {*TABLES, LIGHTS} - {ModelSettings.TABLE, TransportSettings.TABLE}  # what a drag keeps its grid for


def files(scene: Scene) -> Key:
    """Return the key of what is read and sampled before a scene is lit: where it is the same, that fails alike."""
    return scene.key(Part.SURFACE), paths(scene)


def scene_sources(scene: Scene, assets: Assets, *, draft: bool = False) -> Iterator[Source[object]]:
    """Yield the sources of all that lighting a scene needs, each once those before it are at hand.

    A draft lights whatever samples there are.
    """
    model, environment, table = model_source(scene.model), scene.environment, scene.material.table_in_use
    yield model
    yield DetailOf.asked(scene.model, scene.detail)
    if environment.given:
        yield (probe := probe_source(environment))
        if environment.extract:
            yield PartsOf(assets.get(probe))
    if table is not None:
        yield ProfileFile(table)
    mesh = assets.get(model).mesh
    if scene.separate:
        yield BodiesOf(mesh)
    if scene.transport.facts.on_open_surface is not None:
        yield RowSumsOf(mesh, scene.separate)
    if draft:
        return
    settings = assets.possible(scene.transport, mesh, separate=scene.separate)
    if settings.facts.needs_roughness:
        yield RoughnessOf(mesh)
    yield SamplesOf(mesh, sample_spacing(mesh, settings, quality_of(scene, mesh, assets).resolution))


def most_sources(scene: Scene) -> int:
    """Return how many sources `scene_sources` yields, unless transport has to fall back to another method."""
    environment, facts = scene.environment, scene.transport.facts
    further = (
        environment.given, environment.given and environment.extract, scene.material.table_in_use is not None,
        scene.separate, facts.on_open_surface is not None, facts.needs_roughness,
    )  # fmt: skip
    return 3 + sum(further)


def missing_file(scene: Scene, assets: Assets) -> str | None:
    """Return the name of the first file of a scene that has not been read yet, None where all have been."""
    environment, table = scene.environment, scene.material.table_in_use
    needed: list[tuple[Path | None, Source[object]]] = [(scene.model.path, model_source(scene.model))]
    needed += [(environment.path, probe_source(environment))] if environment.given else []
    needed += [(table, ProfileFile(table))] if table is not None else []
    return next((path.name for path, source in needed if path is not None and not assets.has(source)), None)


def light_key(scene: Scene) -> Key:
    """Return everything that light and transport depend on, but for where the camera stands."""
    return scene.key(Part.TRANSPORT, without=CAMERA)


def turn_deg(a: CameraSettings, b: CameraSettings) -> float:
    """Return the largest difference between the angles of two cameras, degrees."""
    turn = abs(a.azimuth_deg - b.azimuth_deg) % 360.0
    return max(min(turn, 360.0 - turn), abs(a.elevation_deg - b.elevation_deg), abs(a.roll_deg - b.roll_deg))


def radiance_of(scene: Scene, lit: LitScene, *further: Part) -> Key:
    """Return all that the radiance of pixels depends on, but for its volume and its size; and `further` parts."""
    sized = replace(scene, display=replace(scene.display, image_size=(16, 16)))
    return *sized.moving(Part.VIEW, Part.LOOK, *further), lit.model, lit.detail, lit.sources


def looks_of(scene: Scene, lit: LitScene) -> Key:
    """Return all that a picture depends on, but for its volume and its size."""
    return radiance_of(scene, lit, Part.GROUND, Part.DISPLAY, Part.PHOTOGRAPH)


@dataclass(frozen=True)
class LitFor:
    """Keys of the light that was asked for.

    Attributes
    ----------
    key : Key
        Of light and transport.
    still : Key
        The same, but for where the camera stands.
    shape : Key
        Of the mesh.
    rays : tuple of Source
        What rays have found by then: the object in the way of its environment's light, and light between its parts.
    camera : CameraSettings
    drafted : bool
        Whether it was given a coarser grid, or lights with fewer sub-lights.
    """

    key: Key
    still: Key
    shape: Key
    rays: Key
    camera: CameraSettings = field(compare=False)
    drafted: bool = False

    @classmethod
    def of(cls, scene: Scene, *, rays: Key) -> "LitFor":
        """Return the keys of a scene's light."""
        keys = scene.key(Part.TRANSPORT), light_key(scene), scene.key(Part.SHAPE)
        return cls(*keys, rays, scene.camera)

    def is_turned(self, other: "LitFor") -> bool:
        """Tell whether another differs by no more than its camera and how well it was drawn."""
        return self.still == other.still and self.rays == other.rays

    def is_drafted(self, other: "LitFor") -> bool:
        """Tell whether another differs by no more than how well it was drawn."""
        return self == replace(other, drafted=self.drafted)


@dataclass(frozen=True)
class Drag:
    """A resolution that is kept while something is dragged, and the object and grid that it was chosen for."""

    key: Key
    resolution: int | None

    @classmethod
    def of(cls, scene: Scene, resolution: int | None) -> "Drag":
        """Return a resolution chosen for the object and grid that a scene asks for."""
        return cls(drag_key(scene), resolution)

    def is_of(self, scene: Scene) -> bool:
        """Tell whether it was chosen for the object and grid that a scene asks for."""
        return self.key == drag_key(scene)


def drag_key(scene: Scene) -> Key:
    """Return the key of transport, of the object and its grid alone."""
    return scene.key(Part.TRANSPORT, without=DRAGGED)
