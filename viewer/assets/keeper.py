"""Assets: what is read of files or computed of them alone (meshes, surface samples, light probes), kept. No OpenGL.

The window fills it in its worker thread, so that the thread that draws finds everything ready; what was used lately is
still there when an edit is undone, even if the file is gone by then.
"""

import threading
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

from milkglass.core.arrays import Array
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import Roughness
from milkglass.core.transport.diffusion.boundary import is_closed
from milkglass.core.transport.quality import Quality
from milkglass.viewer.assets.sources import (
    PROBE_SOURCES,
    BodiesOf,
    DetailOf,
    LoadedDetail,
    PartedProbe,
    PartsOf,
    ProfileFile,
    QualityOf,
    RoughnessOf,
    RowSumsOf,
    SamplesOf,
    Source,
    depends_on,
    files_of,
    model_source,
    probe_source,
    stamp,
)
from milkglass.viewer.files.model import FileModel
from milkglass.viewer.files.model_look import Look
from milkglass.viewer.scene.keys import taken_anew
from milkglass.viewer.scene.light_paths import ALL
from milkglass.viewer.scene.settings import DetailSettings, EnvironmentSettings, ModelSettings, TransportSettings
from milkglass.viewer.scene.tables import ProfileTable

T = TypeVar("T")
LoadedMesh = tuple[Mesh, tuple[str, ...]]


class Assets:
    """Keeps the last few assets of each kind, each under its source. Any thread may ask; two that ask at once compute.

    Parameters
    ----------
    keep : int
        Number of assets of each kind of source that are kept, >= 1.
    """

    def __init__(self, keep: int = 1) -> None:
        self.accept_finer = False  # whether lighting may use finer samples that are there: while something moves
        self.bakes = True  # whether lighting waits for visibility; else it does without until it is there
        self._keep = keep
        self._lock = threading.Lock()
        self._kept: dict[type, OrderedDict[Hashable, Any]] = {}
        self._stamps: dict[Path, tuple[int, int] | None] = {}  # of files as they were read

    def get(self, source: Source[T]) -> T:
        """Return the asset of a source, loading it unless it is kept; errors as its `load`."""
        with self._lock:
            kept = self._kept.setdefault(type(source), OrderedDict())
            if source in kept:
                kept.move_to_end(source)
                return cast(T, kept[source])
        stamps = {path: stamp(path) for path in files_of(source)}
        asset = source.load(self)
        self._stamps |= stamps
        self.take(source, asset)
        return asset

    def take(self, source: Source[T], asset: T) -> None:
        """Keep an asset that was loaded elsewhere."""
        with self._lock:
            for path in files_of(source):
                self._stamps.setdefault(path, stamp(path))
            kept = self._kept.setdefault(type(source), OrderedDict())
            kept[source] = asset
            while len(kept) > self._keep:
                kept.popitem(last=False)

    def has(self, source: Source[object]) -> bool:
        """Tell whether `get` would return at once."""
        with self._lock:
            return source in self._kept.get(type(source), ())

    def forget(self, path: Path) -> None:
        """Drop what was read of a file, and the detail of its model: the file is read when it is next asked for."""
        with self._lock:
            for kept in self._kept.values():
                for source in [source for source in kept if depends_on(source, path)]:
                    del kept[source]

    def keep_probes(self) -> None:
        """Drop everything but the light probes."""
        with self._lock:
            self._kept = {kind: kept for kind, kept in self._kept.items() if kind in PROBE_SOURCES}

    # files

    def model(self, settings: ModelSettings) -> FileModel:
        """Return a model in world space; errors as `viewer.files.model.read_model`, and as `FileModel.parted`."""
        return self.get(model_source(settings))

    def mesh(self, settings: ModelSettings) -> LoadedMesh:
        """Return the mesh of a model and what is wrong with it, as `model`."""
        model = self.model(settings)
        return model.mesh, model.warnings

    def look(self, settings: ModelSettings) -> Look | None:
        """Return what a model's file says of its surface, if anything."""
        return self.get(model_source(settings)).look

    def detail(self, model: ModelSettings, settings: DetailSettings) -> LoadedDetail:
        """Return the colours and relief of a model that are asked for, and what failed; errors as `detail_of`."""
        return self.get(DetailOf.asked(model, settings))

    def surround(self, environment: EnvironmentSettings) -> PartedProbe:
        """Return the sources of an environment's probe that shine as lamps, and the probe of the rest."""
        probe = self.get(probe_source(environment))
        return self.get(PartsOf(probe)) if environment.extract else ((), probe)

    def profile_table(self, path: Path) -> ProfileTable:
        """Return the profiles of a file; errors as `viewer.scene.tables.read_profile_table`."""
        return self.get(ProfileFile(path))

    def reread(self, path: Path) -> bool:
        """Read a file again if it has changed since; False if not, if it has gone, or if it is not in use.

        Raises
        ------
        InputError
            As its source's `load`; what was read before stays.
        """
        with self._lock:
            kept_sources = (cast(Source[Any], source) for kept in self._kept.values() for source in kept)
            sources = [source for source in kept_sources if path in files_of(source)]
            before, now = self._stamps.get(path), stamp(path)
        if not sources or now is None or now == before:
            return False
        self._stamps[path] = now  # one that cannot be read is told once
        anew = [(source, source.load(self)) for source in sources]
        self.forget(path)
        for source, asset in anew:
            self.take(source, asset)
        taken_anew(path)
        return True

    # what is computed of them

    def samples(self, mesh: Mesh, spacing: float, accept_finer: bool = False) -> SurfaceSamples:
        """Return samples of a mesh's surface, `spacing` mm apart, or finer ones that are kept if those do too."""
        return self.get(SamplesOf(mesh, self._spacing_at_hand(mesh, spacing) if accept_finer else spacing))

    def bodies(self, mesh: Mesh) -> Bodies:
        """Return the bodies of a mesh, see `core.geometry.bodies.find_bodies`."""
        return self.get(BodiesOf(mesh))

    def roughness(self, mesh: Mesh) -> Roughness:
        """Return how rough a mesh is, see `core.transport.accuracy.roughness`."""
        return self.get(RoughnessOf(mesh))

    def row_sums(self, mesh: Mesh, *, separate: bool = False) -> Array:
        """Return how closed a mesh is, or each of its bodies, see `core.transport.diffusion.boundary.row_sums`."""
        return self.get(RowSumsOf(mesh, separate))

    def possible(self, settings: TransportSettings, mesh: Mesh, *, separate: bool = False) -> TransportSettings:
        """Return the settings that are used: another method's where one needs a closed mesh and this is not.

        `separate` bodies are closed each for itself.
        """
        instead = settings.facts.on_open_surface
        if instead is None or is_closed(self.row_sums(mesh, separate=separate)):
            return settings
        return replace(settings, method=instead, light_paths=ALL)  # which it may not tell apart

    def quality(
        self,
        settings: TransportSettings,
        profiles: Profiles,
        mesh: Mesh,
        *,
        sharp_light: bool,
        separate: bool = False,
    ) -> Quality:
        """Return layers and resolution of transport, see `core.transport.quality.choose_quality`."""
        return self.get(QualityOf(settings, profiles, mesh, sharp_light, separate))

    def _spacing_at_hand(self, mesh: Mesh, spacing: float) -> float:
        with self._lock:
            sources: list[Any] = list(self._kept.get(SamplesOf, ()))
        finer = [source.spacing for source in sources if source.mesh is mesh and source.spacing <= spacing]
        return float(max(finer, default=spacing))


def shape_of(settings: ModelSettings) -> ModelSettings:
    """Return what a mesh depends on: the settings of its model, but for the bodies and pictures on it."""
    return replace(settings, bodies="joined", texture=None, normal_map=None)
