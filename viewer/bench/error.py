"""Error of the transport methods relative to equation (1) summed in float64, and their costs.

Irradiance is by rays for the fast path and the reference, so the error is that of transport alone;
`viewer.bench.chain` adds that of the whole renderer. Points are on the visible surface, as dense as the pixels of an
orthographic picture.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.grid import layers
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.material.medium import media
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sheet import SheetRays
from milkglass.core.stages import Stage, Stages, Timings
from milkglass.core.transport.base import EnteringFlux, Transport, WholeObject
from milkglass.core.transport.pixels import LocalTerm
from milkglass.core.transport.quality import Quality, make_transport, sample_spacing
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.bench.lights import LIGHTS, BenchLight
from milkglass.viewer.bench.reference import graded_exitance
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.settings import CameraSettings


def megabytes(stages: Stages, excluded: Iterable[object] = ()) -> float:
    """Return the MB (10^6 bytes) of all arrays in the results of stages and in their keys, each counted once."""
    counted = {id(value) for value in excluded}
    total = 0
    pending: list[Any] = [vars(stages)]
    while pending:
        value = pending.pop()
        while isinstance(value, np.ndarray) and isinstance(value.base, np.ndarray):
            value = value.base  # views share the memory of their base
        if id(value) in counted:
            continue
        counted.add(id(value))
        if isinstance(value, np.ndarray):
            total += value.nbytes
        elif isinstance(value, csc_array):
            pending += [value.data, value.indices, value.indptr]
        elif isinstance(value, dict):
            pending += value.values()
        elif isinstance(value, list | tuple):
            pending += value
        elif hasattr(value, "__dict__"):
            pending.append(vars(value))
    return total / 1e6


PIECES_ALONG_SIDE = 133  # pieces along the longest side, from which points are chosen: not the samples of any scheme
CAMERA = CameraSettings(azimuth_deg=20.0, elevation_deg=10.0, orthographic=True)
MATERIALS = ("marble", "skim milk", "whole milk", "ketchup", "skin1", "jade")


@dataclass(frozen=True, eq=False)
class Target:
    """A shape and the points of its visible surface where exitance is compared.

    Attributes
    ----------
    mesh : Mesh
    occluder : Occluder
    rays : SheetRays
    rotation : (3, 3) float64
        Rotation from world to view, row vectors.
    points : SurfaceSamples
    """

    mesh: Mesh
    occluder: Occluder
    rays: SheetRays
    rotation: Array
    points: SurfaceSamples

    @classmethod
    def of(cls, mesh: Mesh, n_points: int, seed: int = 0, pieces_along: int = PIECES_ALONG_SIDE) -> "Target":
        """Return a target with at most `n_points` points, chosen uniformly over an orthographic picture."""
        camera = place_camera(CAMERA, mesh.radius, (256, 256))
        occluder, pieces = Occluder(mesh), surface_samples(mesh, longest_side(mesh) / pieces_along)
        towards = camera.eye[:3]
        visible_area = np.maximum(0.0, pieces.normals @ towards) * pieces.areas
        visible_area *= occluder.visible(pieces.points, pieces.normals, towards)
        rng = np.random.default_rng(seed)
        count = min(n_points, int(np.count_nonzero(visible_area)))
        chosen = rng.choice(len(pieces), count, replace=False, p=visible_area / visible_area.sum())
        points = SurfaceSamples(pieces.points[chosen], pieces.normals[chosen], pieces.areas[chosen])
        return cls(mesh, occluder, SheetRays(mesh), camera.rotation, points)

    def references(self, lights: Sequence[BenchLight], scattering_materials: Sequence[Material]) -> Array:
        """Return exitance by equation (1) at the points, (n_materials, n_lights, n, 3)."""
        return graded_exitance(self.mesh, self.points.points, lights, scattering_materials)


@dataclass(frozen=True, eq=False)
class PlacedTransport:
    """Transport on a shape: its layers, the samples with their grid coordinates, and the weights of the points."""

    transport: Transport
    grid: LayerGrid
    samples: SurfaceSamples
    coordinates: Float32
    gather: csc_array
    _flux: dict[tuple[str, float], Float32] = field(default_factory=dict)

    def flux(self, light: BenchLight, occluder: Occluder, eta: float) -> Float32:
        """Return E dA of the samples, (n, 3); rays are cast once for a light and eta."""
        key = light.name, eta
        if key not in self._flux:
            irradiance = light.irradiance(occluder, self.samples, eta)
            self._flux[key] = (irradiance * self.samples.areas[:, None]).astype(np.float32)
        return self._flux[key]

    def entering(self, mesh: Mesh, flux: Float32, material: Material) -> EnteringFlux:
        """Return flux (n, 3) of the samples in the form that transport takes."""
        solid, matter = WholeObject(mesh, self.samples), (dipoles(material), media(material))
        return EnteringFlux(solid, self.grid, self.coordinates, flux, (), *matter)


class SchemeRun:
    """A scheme on one shape, which caches results for the next light or material as the renderer does.

    Attributes
    ----------
    timings : dict
        Stage -> ms of its last run.
    """

    def __init__(self, scheme: Scheme, target: Target) -> None:
        self.scheme, self.target, self.stages = scheme, target, Stages()
        self.timings: Timings = {}
        self._assets = Assets()
        self._placed: dict[Quality, PlacedTransport] = {}

    def quality(self, light: BenchLight, material: Material) -> Quality:
        """Return layers and resolution, chosen by the error target where the scheme does not set them."""
        mesh = self.target.mesh
        return self._assets.quality(self.scheme.settings, dipoles(material), mesh, sharp_light=light.sharp)

    def place(self, quality: Quality) -> PlacedTransport:
        """Return the transport of a quality on the shape."""
        if quality not in self._placed:
            mesh = self.target.mesh
            samples = self._assets.samples(mesh, sample_spacing(mesh, self.scheme.settings, quality.resolution))
            transport = make_transport(quality)
            grid = transport.grid(mesh, self.target.rotation)
            coordinates = grid.coordinates(samples.points).astype(np.float32)
            gather = transport.weights(grid, grid.coordinates(self.target.points.points))
            self._placed[quality] = PlacedTransport(transport, grid, samples, coordinates, gather)
        return self._placed[quality]

    def exitance(self, light: BenchLight, material: Material) -> Array:
        """Return exitance M at the points of the target, (n, 3)."""
        target = self.target
        placed = self.place(self.quality(light, material))
        flux = placed.flux(light, target.occluder, material.eta)
        self.stages.begin()
        scattered = placed.transport.scatter(placed.entering(target.mesh, flux, material), self.stages)
        key = placed.transport, dipoles(material)
        term = self.stages.run(Stage.PIXEL_TERMS, key, scattered.pixel_tables).local
        self.timings |= self.stages.timings
        return np.maximum(layers.gather(placed.gather, scattered.volume) + self._local(term, light, material), 0.0)

    def row(self, names: tuple[str, str, str], light: BenchLight, material: Material, reference: Array) -> "ErrorRow":
        """Return the row of a run: its deviation from the reference; `names` are of shape, material and light."""
        deviation = Deviation.of(self.exitance(light, material), reference)
        quality = self.quality(light, material)
        placed = self.place(quality)
        memory = megabytes(self.stages, excluded=[placed.transport])
        return ErrorRow(self.scheme, *names, deviation, dict(self.timings), quality, placed.grid.n_layers, memory)

    def _local(self, term: LocalTerm, light: BenchLight, material: Material) -> Array:
        """Return the local term of exitance, for which layers are too coarse, (n, 3)."""
        target = self.target
        value = term.factors[0] * light.irradiance(target.occluder, target.points, material.eta)
        if term.reach > 0.0:
            thickness, far_side = light.far_irradiance(target.rays, target.points, material.eta, term.reach)
            value += term.at(thickness) * (thickness > 0.0)[:, None] * far_side
        return np.asarray(value)


@dataclass(frozen=True)
class ErrorRow:
    """Result of one scheme on a shape of a material in a light.

    Attributes
    ----------
    timings : dict
        Stage -> ms of its last run.
    quality : Quality
        Resolution and assignment used, and the predicted error.
    n_layers : int
        Number of layers used.
    megabytes : float
        Memory held by transport, see `megabytes`.
    """

    scheme: Scheme
    shape: str
    material: str
    light: str
    deviation: Deviation
    timings: Timings
    quality: Quality
    n_layers: int
    megabytes: float

    @property
    def rms(self) -> float:
        """Rms of the worst channel."""
        return max(self.deviation.rms)


def error_rows(
    schemes: Sequence[Scheme],
    shapes: Mapping[str, Callable[[], Mesh]],
    material_names: Sequence[str],
    light_names: Sequence[str],
    n_points: int,
) -> Iterator[ErrorRow]:
    """Yield a row for every combination, by shape and material.

    Schemes take turns, so that other load on the machine affects all of them equally.
    """
    scattering_materials = [materials.lookup(name) for name in material_names]
    lights = [LIGHTS[name] for name in light_names]
    for shape, make in shapes.items():
        target = Target.of(make(), n_points)
        references = target.references(lights, scattering_materials)
        runs = [SchemeRun(scheme, target) for scheme in schemes]
        for name, material, by_light in zip(material_names, scattering_materials, references, strict=True):
            for run in runs:
                for light, reference in zip(lights, by_light, strict=True):
                    yield run.row((shape, name, light.name), light, material, reference)
