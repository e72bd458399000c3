"""Error of the transport methods against equation (1) summed in float64, and what each costs.

Irradiance is cast by rays for the fast path and the reference alike, so the error is the transport's alone;
`viewer.bench.chain` measures what the whole renderer adds. The points are those of the visible surface, as dense as
the pixels of an orthographic picture.
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


def megabytes(stages: Stages, leave_out: Iterable[object] = ()) -> float:
    """MB (10^6 bytes) of all arrays that the stages' results, and what these depend on, hold; each counted once."""
    seen = {id(thing) for thing in leave_out}
    total = 0
    waiting: list[Any] = [vars(stages)]
    while waiting:
        thing = waiting.pop()
        while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
            thing = thing.base  # views share what they show
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            total += thing.nbytes
        elif isinstance(thing, csc_array):
            waiting += [thing.data, thing.indices, thing.indptr]
        elif isinstance(thing, dict):
            waiting += thing.values()
        elif isinstance(thing, list | tuple):
            waiting += thing
        elif hasattr(thing, "__dict__"):
            waiting.append(vars(thing))
    return total / 1e6


POINT_PIECES = 133  # pieces along the longest side that points are chosen from: not the samples of any scheme
CAMERA = CameraSettings(azimuth_deg=20.0, elevation_deg=10.0, orthographic=True)
MATERIALS = ("marble", "skim milk", "whole milk", "ketchup", "skin1", "jade")


@dataclass(frozen=True, eq=False)
class Target:
    """A shape and the points of its visible surface where exitance is compared.

    Attributes
    ----------
    mesh, occluder, rays
    rotation : (3, 3) float64
        World to view, row vectors.
    points : SurfaceSamples
    """

    mesh: Mesh
    occluder: Occluder
    rays: SheetRays
    rotation: Array
    points: SurfaceSamples

    @classmethod
    def of(cls, mesh: Mesh, n_points: int, seed: int = 0, pieces_along: int = POINT_PIECES) -> "Target":
        """Choose at most `n_points` points, as likely as an orthographic picture shows them."""
        camera = place_camera(CAMERA, mesh.radius, (256, 256))
        occluder, pieces = Occluder(mesh), surface_samples(mesh, longest_side(mesh) / pieces_along)
        towards = camera.eye[:3]
        shown = np.maximum(0.0, pieces.normals @ towards) * pieces.areas
        shown *= occluder.visible(pieces.points, pieces.normals, towards)
        rng = np.random.default_rng(seed)
        count = min(n_points, int(np.count_nonzero(shown)))
        chosen = rng.choice(len(pieces), count, replace=False, p=shown / shown.sum())
        points = SurfaceSamples(pieces.points[chosen], pieces.normals[chosen], pieces.areas[chosen])
        return cls(mesh, occluder, SheetRays(mesh), camera.rotation, points)

    def references(self, lights: Sequence[BenchLight], several: Sequence[Material]) -> Array:
        """Sum equation (1): exitance at the points, (n_materials, n_lights, n, 3)."""
        return graded_exitance(self.mesh, self.points.points, lights, several)


@dataclass(frozen=True, eq=False)
class Placed:
    """Transport placed on a shape: its layers, the samples and their places on them, and the weights of the points."""

    transport: Transport
    grid: LayerGrid
    samples: SurfaceSamples
    coordinates: Float32
    gather: csc_array
    _flux: dict[tuple[str, float], Float32] = field(default_factory=dict)

    def flux(self, light: BenchLight, occluder: Occluder, eta: float) -> Float32:
        """E dA of the samples, (n, 3): rays are cast once a light and eta."""
        key = light.name, eta
        if key not in self._flux:
            irradiance = light.irradiance(occluder, self.samples, eta)
            self._flux[key] = (irradiance * self.samples.areas[:, None]).astype(np.float32)
        return self._flux[key]

    def entering(self, mesh: Mesh, flux: Float32, material: Material) -> EnteringFlux:
        """Return a flux (n, 3) of the samples as transport takes it."""
        solid, matter = WholeObject(mesh, self.samples), (dipoles(material), media(material))
        return EnteringFlux(solid, self.grid, self.coordinates, flux, (), *matter)


class Run:
    """A scheme on one shape; keeps what the next light or material can use again, as the renderer does.

    Attributes
    ----------
    timings : dict
        Stage -> ms, of the last time that each had to be run.
    """

    def __init__(self, scheme: Scheme, target: Target) -> None:
        self.scheme, self.target, self.stages = scheme, target, Stages()
        self.timings: Timings = {}
        self._assets = Assets()
        self._placed: dict[Quality, Placed] = {}

    def quality(self, light: BenchLight, material: Material) -> Quality:
        """Return layers and resolution, chosen for an error target where the scheme names none."""
        mesh = self.target.mesh
        return self._assets.quality(self.scheme.settings, dipoles(material), mesh, sharp_light=light.sharp)

    def place(self, quality: Quality) -> Placed:
        """Return transport placed on the shape."""
        if quality not in self._placed:
            mesh = self.target.mesh
            samples = self._assets.samples(mesh, sample_spacing(mesh, self.scheme.settings, quality.resolution))
            transport = make_transport(quality)
            grid = transport.grid(mesh, self.target.rotation)
            coordinates = grid.coordinates(samples.points).astype(np.float32)
            gather = transport.weights(grid, grid.coordinates(self.target.points.points))
            self._placed[quality] = Placed(transport, grid, samples, coordinates, gather)
        return self._placed[quality]

    def exitance(self, light: BenchLight, material: Material) -> Array:
        """M at the target's points, (n, 3)."""
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
        """Run and compare; names of shape, material and light."""
        deviation = Deviation.of(self.exitance(light, material), reference)
        quality = self.quality(light, material)
        placed = self.place(quality)
        memory = megabytes(self.stages, leave_out=[placed.transport])
        return ErrorRow(self.scheme, *names, deviation, dict(self.timings), quality, placed.grid.n_layers, memory)

    def _local(self, term: LocalTerm, light: BenchLight, material: Material) -> Array:
        """The part of exitance that layers are too coarse for, (n, 3)."""
        target = self.target
        value = term.factors[0] * light.irradiance(target.occluder, target.points, material.eta)
        if term.reach > 0.0:
            thickness, other_side = light.across(target.rays, target.points, material.eta, term.reach)
            value += term.at(thickness) * (thickness > 0.0)[:, None] * other_side
        return np.asarray(value)


@dataclass(frozen=True)
class ErrorRow:
    """One run: a scheme on a shape of a material in a light.

    Attributes
    ----------
    timings : dict
        Stage -> ms; of a stage whose result was kept, what it took when it last ran.
    quality : Quality
        Resolution and assignment really used, and the error predicted.
    n_layers : int
        Really used.
    megabytes : float
        That transport keeps, see `viewer.bench.error`.
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
        """Of the worst channel."""
        return max(self.deviation.rms)


def error_rows(
    schemes: Sequence[Scheme],
    shapes: Mapping[str, Callable[[], Mesh]],
    material_names: Sequence[str],
    light_names: Sequence[str],
    n_points: int,
) -> Iterator[ErrorRow]:
    """Run every combination; rows come as they are ready, shape by shape and material by material.

    Schemes take turns: what else the machine does then meets all alike.
    """
    several, lights = [materials.lookup(name) for name in material_names], [LIGHTS[name] for name in light_names]
    for shape, make in shapes.items():
        target = Target.of(make(), n_points)
        references = target.references(lights, several)
        runs = [Run(scheme, target) for scheme in schemes]
        for name, material, by_light in zip(material_names, several, references, strict=True):
            for run in runs:
                for light, reference in zip(lights, by_light, strict=True):
                    yield run.row((shape, name, light.name), light, material, reference)
