"""Files and what is computed of them alone, kept: meshes, their surface samples, light probes. No OpenGL in here.

The window fills it in its worker thread, so that the thread that draws finds everything ready; what was used lately is
still there when an edit is undone, even if the file is gone by then.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from milkglass.core.geometry.bodies import Bodies, find_bodies
from milkglass.core.geometry.detail import Detail
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.light.highlights import LobeFilter
from milkglass.core.light.presets import preset
from milkglass.core.light.probe import Probe
from milkglass.core.light.sources import ProbeSource, extract
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import Roughness, roughness
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.viewer.assets.quality import Quality, choose_quality, survey_spacing
from milkglass.viewer.assets.visibility import BakedVisibility, bake_visibility
from milkglass.viewer.files.images import read_radiance
from milkglass.viewer.files.model import FileModel, builtin_model, read_model
from milkglass.viewer.files.model_look import Look, detail_of
from milkglass.viewer.scene.keys import taken_anew
from milkglass.viewer.scene.settings import DetailSettings, EnvironmentSettings, ModelSettings, TransportSettings
from milkglass.viewer.scene.tables import ProfileTable, read_profile_table

LoadedMesh = tuple[Mesh, tuple[str, ...]]
LoadedDetail = tuple[Detail | None, tuple[str, ...]]
PartedProbe = tuple[tuple[ProbeSource, ...], Probe]


class Assets:
    """Keeps the last few of each kind. Any thread may ask; two that ask for the same at once both compute it.

    Parameters
    ----------
    keep : int
        Meshes, probes and sets of samples that are kept, each.
    """

    def __init__(self, keep: int = 1) -> None:
        self.accept_finer = False  # whether lighting may use finer samples that are there: while something moves
        self.bakes = True  # whether lighting waits for visibility; else it does without until it is there
        self._keep = keep
        self._lock = threading.Lock()
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}

    def mesh(self, settings: ModelSettings) -> LoadedMesh:
        """Return a model in world space and what is wrong with it; errors as `viewer.files.model.read_model`."""
        model = self._model(settings)
        return model.mesh, model.warnings

    def detail(self, model: ModelSettings, settings: DetailSettings) -> LoadedDetail:
        """Return the colours and relief of a model that are wanted, and what failed; errors as `detail_of`."""

        def decode() -> LoadedDetail:
            file, builtin = self._model(model), model.builtin_name
            name = str(model.path) if builtin is None else f"the built-in {builtin}"
            return detail_of(file.look, file.mesh, name, *_detail_key(model, settings)[1:])

        return self._get("detail", _detail_key(model, settings), decode)  # type: ignore[no-any-return]

    def look(self, model: ModelSettings) -> Look | None:
        """Return what a model's file says of its surface, if anything."""
        return self._model(model).look

    def probe(self, source: Path | str) -> Probe:
        """Return a light probe of a file, or a builtin one by its name; errors as `files.images.read_radiance`."""

        def load() -> Probe:
            return Probe.from_pixels(preset(source) if isinstance(source, str) else read_radiance(source))

        return self._get("probe", source, load)  # type: ignore[no-any-return]

    def parted(self, probe: Probe) -> PartedProbe:
        """Return a probe's strong small sources and the rest, see `core.light.sources.extract`."""
        return self._get("parted probe", id(probe), lambda: (probe, extract(probe)))[1]  # type: ignore[no-any-return]

    def surround(self, environment: EnvironmentSettings) -> PartedProbe:
        """Return the sources of an environment's probe that shine as lamps, and the probe of the rest."""
        assert environment.source is not None
        probe = self.probe(environment.source)
        return self.parted(probe) if environment.extract else ((), probe)

    def lobes(self, probe: Probe) -> LobeFilter:
        """Return what prefilters a probe for highlights."""
        return self._get("lobes", id(probe), lambda: (probe, LobeFilter(probe)))[1]  # type: ignore[no-any-return]

    def profile_table(self, path: Path) -> ProfileTable:
        """Return the profiles of a file; errors as `viewer.scene.tables.read_profile_table`."""
        return self._get("profile table", path, lambda: read_profile_table(path))  # type: ignore[no-any-return]

    def reread_profile(self, path: Path) -> bool:
        """Take a table's file anew if it has changed since; False if not, or if nobody has asked for it yet.

        Raises
        ------
        InputError
            As `profile_table`; what was read before stays.
        """
        if not self.has_profile_table(path):
            return False
        new = read_profile_table(path)
        if new == self.profile_table(path):
            return False
        self.forget(path)
        self.profile_table(path)
        taken_anew(path)
        return True

    def samples(self, mesh: Mesh, spacing: float, accept_finer: bool = False) -> SurfaceSamples:
        """Return surface samples of a mesh, see `geometry.samples.surface_samples`; perhaps finer ones kept."""
        # The mesh is kept with its samples: its identity cannot be taken over by another.
        key = (id(mesh), self._spacing_at_hand(mesh, spacing) if accept_finer else spacing)
        _, samples = self._get("samples", key, lambda: (mesh, surface_samples(mesh, spacing)))
        return samples  # type: ignore[no-any-return]

    def bodies(self, mesh: Mesh) -> Bodies:
        """Return the bodies of a mesh, see `core.geometry.bodies.find_bodies`."""
        # The mesh is kept with them, as with its samples.
        return self._get("bodies", id(mesh), lambda: (mesh, find_bodies(mesh)))[1]  # type: ignore[no-any-return]

    def roughness(self, mesh: Mesh) -> Roughness:
        """Return how rough a mesh is, from samples that serve most grids too."""

        def measure() -> tuple[Mesh, Roughness]:
            return mesh, roughness(self.samples(mesh, survey_spacing(mesh)), mesh.bounds)

        return self._get("roughness", id(mesh), measure)[1]  # type: ignore[no-any-return]

    def row_sums(self, mesh: Mesh, separate: bool = False) -> npt.NDArray[np.float64]:
        """Return how closed a mesh is, or each of its bodies, see `core.transport.diffusion.boundary.row_sums`."""

        def measure() -> tuple[Mesh, npt.NDArray[np.float64]]:
            bodies = self.bodies(mesh) if separate else None
            return mesh, row_sums(mesh, body=None if bodies is None or bodies.count == 1 else bodies.of_face)

        return self._get("row sums", (id(mesh), separate), measure)[1]  # type: ignore[no-any-return]

    def possible(self, settings: TransportSettings, mesh: Mesh, separate: bool = False) -> TransportSettings:
        """Return the settings that are used: another method's where one needs a closed mesh and this is not.

        `separate` bodies are closed each for itself.
        """
        instead = settings.facts.on_open_surface
        if instead is None or is_closed(self.row_sums(mesh, separate)):
            return settings
        return replace(settings, method=instead)

    def quality(
        self,
        settings: TransportSettings,
        profiles: Profiles,
        mesh: Mesh,
        sharp_light: bool,
        separate: bool = False,
    ) -> Quality:
        """Return layers and resolution, see `assets.quality.choose_quality`."""
        asked, settings = settings, self.possible(settings, mesh, separate)
        shape = self.roughness(mesh) if settings.facts.needs_roughness else None

        def choose() -> tuple[Mesh, Quality]:
            quality = choose_quality(settings, profiles, mesh, shape, sharp_light)
            if settings != asked:
                sums = self.row_sums(mesh, separate)
                quality = replace(quality, open_surface=float(sums[np.abs(sums + 0.5).argmax()]))
            return mesh, quality

        key = (asked, tuple(profiles), id(mesh), sharp_light, separate)
        return self._get("quality", key, choose)[1]  # type: ignore[no-any-return]

    def visibility(
        self,
        mesh: Mesh,
        progress: Callable[[float], object] = lambda _: None,
        cancelled: threading.Event | None = None,
    ) -> BakedVisibility:
        """Return what a mesh's vertices see, see `viewer.assets.visibility`."""
        ahead = not self.bakes  # a window may want all of it at any time
        compute = lambda: (mesh, bake_visibility(mesh, progress, cancelled, ahead))  # noqa: E731
        return self._get("visibility", id(mesh), compute)[1]  # type: ignore[no-any-return]

    def has_visibility(self, mesh: Mesh) -> bool:
        """Whether `visibility` would return at once."""
        return self._has("visibility", id(mesh))

    def has_mesh(self, settings: ModelSettings) -> bool:
        """Whether `mesh` would return at once."""
        return self._has("mesh", shape_of(settings))

    def has_detail(self, model: ModelSettings, settings: DetailSettings) -> bool:
        """Whether `mesh` and `detail` would return at once."""
        return self.has_mesh(model) and self._has("detail", _detail_key(model, settings))

    def has_probe(self, source: Path | str) -> bool:
        """Whether `probe` would return at once."""
        return self._has("probe", source)

    def has_surround(self, environment: EnvironmentSettings) -> bool:
        """Whether there is no environment, or `surround` would return at once."""
        if environment.source is None:
            return True
        if not self.has_probe(environment.source):
            return False
        return not environment.extract or self._has("parted probe", id(self.probe(environment.source)))

    def has_profile_table(self, path: Path | None) -> bool:
        """Whether `profile_table` would return at once, or there is none to read."""
        return path is None or self._has("profile table", path)

    def has_bodies(self, mesh: Mesh) -> bool:
        """Whether `bodies` would return at once."""
        return self._has("bodies", id(mesh))

    def has_row_sums(self, mesh: Mesh, separate: bool = False) -> bool:
        """Whether `row_sums` would return at once."""
        return self._has("row sums", (id(mesh), separate))

    def has_roughness(self, mesh: Mesh) -> bool:
        """Whether `roughness` would return at once."""
        return self._has("roughness", id(mesh))

    def has_samples(self, mesh: Mesh, spacing: float) -> bool:
        """Whether `samples` would return at once."""
        return self._has("samples", (id(mesh), spacing))

    def forget(self, path: Path) -> None:
        """Read a file again when it is next asked for."""
        with self._lock:
            for kept in self._kept.values():
                for key in [key for key in kept if _is_of(key, path)]:
                    del kept[key]

    def keep_probes(self) -> None:
        """Let go of all but the probes."""
        with self._lock:
            self._kept = {kind: kept for kind, kept in self._kept.items() if kind == "probe"}

    def _model(self, settings: ModelSettings) -> FileModel:
        return self._get("mesh", shape_of(settings), lambda: _load(settings))  # type: ignore[no-any-return]

    def _spacing_at_hand(self, mesh: Mesh, spacing: float) -> float:
        with self._lock:
            keys: list[Any] = list(self._kept.get("samples", ()))
        finer = [own for identity, own in keys if identity == id(mesh) and own <= spacing]
        return float(max(finer, default=spacing))

    def _has(self, kind: str, key: Hashable) -> bool:
        with self._lock:
            return key in self._kept.get(kind, ())

    def _get(self, kind: str, key: Hashable, compute: Callable[[], Any]) -> Any:
        with self._lock:
            kept = self._kept.setdefault(kind, OrderedDict())
            if key in kept:
                kept.move_to_end(key)
                return kept[key]
        value = compute()
        with self._lock:
            kept[key] = value
            while len(kept) > self._keep:
                kept.popitem(last=False)
        return value


def _is_of(key: Any, path: Path) -> bool:
    """Whether a key names a file: itself, as a model's, or among others."""
    if isinstance(key, tuple):
        return any(_is_of(part, path) for part in key)
    return key == path or getattr(key, "path", None) == path


def shape_of(settings: ModelSettings) -> ModelSettings:
    """Return what a mesh depends on: the settings of its model, but for the bodies and pictures on it."""
    return replace(settings, bodies="joined", texture=None, normal_map=None)


def _detail_key(
    model: ModelSettings, settings: DetailSettings
) -> tuple[ModelSettings, Path | None, Path | None, bool, bool]:
    wanted = settings.albedo != "off", settings.normal_strength > 0.0
    return shape_of(model), model.texture, model.normal_map, *wanted


def _load(settings: ModelSettings) -> FileModel:
    if settings.path is None:
        return FileModel(builtin_model(settings.size_mm, settings.up))
    return read_model(settings.path, settings.size_mm, settings.up)
