"""Error of the transport methods against equation (1) summed in float64, and what each costs.

Irradiance is cast by rays for the fast path and the reference alike, so the error is the transport's alone;
`viewer.bench_chain` measures what the whole renderer adds. The points are those of the visible surface, as dense as
the pixels of an orthographic picture.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from core import layers, materials
from core.dipole import dipoles
from core.fresnel import transmittance
from core.layers import LayerGrid
from core.materials import Material
from core.mesh import Mesh
from core.reference import Occluder, direct_exitance
from core.samples import SurfaceSamples, surface_samples
from core.spectra import Profile
from core.stages import Stages
from core.transport import EwaldTransport, LayeredTransport, LocalTerm, Transport
from viewer.assets import Assets
from viewer.bench_shapes import SHAPES
from viewer.bench_sheet import SheetRays
from viewer.camera import place_camera
from viewer.deviation import Deviation
from viewer.quality import Quality, sample_spacing
from viewer.settings import CameraSettings, TransportSettings

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

REFERENCE_EDGE = 0.15  # mm; longest edge of the reference's pieces: under the shortest mean free path, 0.26 mm
CAMERA = CameraSettings(azimuth_deg=20.0, elevation_deg=10.0, orthographic=True)


@dataclass(frozen=True)
class BenchLight:
    """A directional light of irradiance 1, seen through slats if `stripe` > 0: bars of that width in mm, and gaps."""

    name: str
    direction: tuple[float, float, float]
    stripe: float = 0.0

    def irradiance(self, occluder: Occluder, samples: SurfaceSamples, eta: float) -> Array:
        """E at the samples, (n, 3), shadows cast by rays."""
        entering = occluder.irradiance(
            samples.points, samples.normals, samples.normals, self.direction, np.ones(3), eta
        )
        return np.asarray(entering * self._slats(samples.points)[:, None])

    def across(self, rays: SheetRays, samples: SurfaceSamples, eta: float, reach: float) -> tuple[Array, Array]:
        """Thickness (n,) of the sheet between the samples and where light enters, mm, and E (n, 3) over there.

        As sheet.glsl has it: for samples that face away from the light; 0 where there is no sheet.
        """
        towards = np.asarray(self.direction) / np.linalg.norm(self.direction)
        other = rays.other_side(samples.points, samples.normals, towards, reach)
        entering = transmittance(eta, other.cosine) * other.cosine * other.share * self._slats(samples.points)
        return other.thickness, np.tile(entering[:, None], 3)

    def _slats(self, points: Float32) -> Array:
        """1 in the light and 0 in the shadow of the bars, (n,)."""
        if self.stripe <= 0.0:
            return np.ones(len(points))
        across = np.cross([0.0, 1.0, 0.0], self.direction)
        place = np.floor(points @ (across / np.linalg.norm(across)) / self.stripe)
        return np.where(place % 2.0 == 0.0, 1.0, 0.0)


LIGHTS = {
    light.name: light
    for light in (
        BenchLight("front", (0.3, 0.4, 1.0)),
        BenchLight("back", (-0.3, 0.2, -1.0)),
        BenchLight("stripes", (0.3, 0.4, 1.0), stripe=3.0),
    )
}
MATERIALS = ("marble", "skim milk", "whole milk", "ketchup", "wax")


@dataclass(frozen=True)
class Scheme:
    """A transport method with its settings, as a scene file has them."""

    method: str
    layers: int | None = None
    resolution: int | None = None
    error_target: float | None = None

    @property
    def settings(self) -> TransportSettings:
        """Table of the scene."""
        return TransportSettings(self.method, self.layers, self.resolution, self.error_target)

    def __str__(self) -> str:
        sizes = [f"{n}" for n in (self.layers, self.resolution) if n is not None]
        target = [] if self.error_target is None else [f"{100.0 * self.error_target:g} %"]
        return " ".join([self.method, *([" x ".join(sizes)] if sizes else target)])


# A further method is one more line here and its schemes below.
METHODS: dict[str, Callable[[Quality], Transport]] = {
    "layered": lambda quality: LayeredTransport(n_layers=quality.layers or 1, resolution=quality.resolution),
    "ewald": lambda quality: EwaldTransport(
        n_layers=quality.layers, resolution=quality.resolution, assignment=quality.assignment
    ),
}
PAPER = Scheme("layered", 4, 256)
LAYERED = (PAPER, *(Scheme("layered", n, 128) for n in (8, 16, 32, 64, 128)))
EWALD = tuple(Scheme("ewald", error_target=target) for target in (0.02, 0.01, 0.005))


@dataclass(frozen=True, eq=False)
class Target:
    """A shape and the points of its visible surface where exitance is compared.

    Attributes
    ----------
    mesh, occluder, rays
    rotation : (3, 3) float64
        World to view, row vectors.
    sources : SurfaceSamples
        Of the reference.
    points : SurfaceSamples
    """

    mesh: Mesh
    occluder: Occluder
    rays: SheetRays
    rotation: Array
    sources: SurfaceSamples
    points: SurfaceSamples

    @classmethod
    def of(cls, mesh: Mesh, n_points: int, seed: int = 0, edge: float = REFERENCE_EDGE) -> "Target":
        """Choose points as likely as an orthographic picture shows them."""
        camera = place_camera(CAMERA, mesh.radius, (256, 256))
        occluder, sources = Occluder(mesh), surface_samples(mesh, edge)
        towards = camera.eye[:3]
        shown = np.maximum(0.0, sources.normals @ towards) * sources.areas
        shown *= occluder.visible(sources.points, sources.normals, towards)
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(sources), n_points, replace=False, p=shown / shown.sum())
        points = SurfaceSamples(sources.points[chosen], sources.normals[chosen], sources.areas[chosen])
        return cls(mesh, occluder, SheetRays(mesh), camera.rotation, sources, points)

    def reference(self, light: BenchLight, material: Material) -> Array:
        """Sum equation (1) directly: (n, 3) exitance at the points."""
        flux = light.irradiance(self.occluder, self.sources, material.eta) * self.sources.areas[:, None]
        return parallel_exitance(self.points.points, self.sources.points, flux, dipoles(material))


@dataclass(frozen=True, eq=False)
class Placed:
    """Transport placed on a shape: its layers, and the weights of samples and points on them."""

    transport: Transport
    grid: LayerGrid
    coordinates: Float32
    gather: csc_array


class Run:
    """A scheme on one shape; keeps what the next light or material can use again, as the renderer does."""

    def __init__(self, scheme: Scheme, target: Target) -> None:
        self.scheme, self.target, self.stages = scheme, target, Stages()
        self._assets = Assets()
        self._placed: dict[Quality, Placed] = {}

    def exitance(self, light: BenchLight, material: Material) -> Array:
        """M at the target's points, (n, 3); `stages.timings` tells what transport did anew."""
        target, profiles = self.target, dipoles(material)
        quality = self._assets.quality(self.scheme.settings, profiles, target.mesh, sharp_light=True)
        samples = self._samples(quality)
        placed = self._place(quality, samples)
        irradiance = light.irradiance(target.occluder, samples, material.eta)
        flux = (irradiance * samples.areas[:, None]).astype(np.float32)
        self.stages.begin()
        transport, grid = placed.transport, placed.grid
        nodes = transport.exitance(grid, placed.coordinates, flux, profiles, target.mesh.area, self.stages)
        term = self.stages.run("local", [transport, profiles], lambda: transport.local(grid, profiles))
        return np.maximum(layers.gather(placed.gather, nodes) + self._local(term, light, material), 0.0)

    def _local(self, term: LocalTerm, light: BenchLight, material: Material) -> Array:
        """The part of exitance that layers are too coarse for, (n, 3)."""
        target = self.target
        value = term.factors[0] * light.irradiance(target.occluder, target.points, material.eta)
        if term.reach > 0.0:
            thickness, other_side = light.across(target.rays, target.points, material.eta, term.reach)
            nodes = np.linspace(0.0, term.reach, len(term.factors))
            factors = np.stack([np.interp(thickness, nodes, f, right=0.0) for f in term.factors.T], axis=-1)
            value += factors * (thickness > 0.0)[:, None] * other_side
        return np.asarray(value)

    def _samples(self, quality: Quality) -> SurfaceSamples:
        mesh = self.target.mesh
        return self._assets.samples(mesh, sample_spacing(mesh, self.scheme.settings, quality.resolution))

    def _place(self, quality: Quality, samples: SurfaceSamples) -> Placed:
        if quality not in self._placed:
            transport = METHODS[quality.method](quality)
            grid = transport.grid(self.target.mesh, self.target.rotation)
            coordinates = grid.coordinates(samples.points).astype(np.float32)
            gather = transport.weights(grid, grid.coordinates(self.target.points.points))
            self._placed[quality] = Placed(transport, grid, coordinates, gather)
        return self._placed[quality]


@dataclass(frozen=True)
class ErrorRow:
    """One run: a scheme on a shape of a material in a light. Times in ms, 0 for stages that were kept."""

    scheme: Scheme
    shape: str
    material: str
    light: str
    deviation: Deviation
    timings: dict[str, float]


def error_rows(
    schemes: Sequence[Scheme],
    shapes: Sequence[str],
    material_names: Sequence[str],
    light_names: Sequence[str],
    n_points: int,
) -> Iterator[ErrorRow]:
    """Run every combination; rows come as they are ready, shape by shape and material by material."""
    for shape in shapes:
        target = Target.of(SHAPES[shape](), n_points)
        runs = [Run(scheme, target) for scheme in schemes]
        for name in material_names:
            material = materials.lookup(name)
            references = {light: target.reference(LIGHTS[light], material) for light in light_names}
            for run in runs:
                for light, reference in references.items():
                    deviation = Deviation.of(run.exitance(LIGHTS[light], material), reference)
                    yield ErrorRow(run.scheme, shape, name, light, deviation, dict(run.stages.timings))


def parallel_exitance(
    points: npt.ArrayLike, sources: npt.ArrayLike, flux: npt.ArrayLike, profiles: Sequence[Profile]
) -> Array:
    """`core.reference.direct_exitance`, a share of the points a core."""
    threads = os.cpu_count() or 1
    shares = np.array_split(np.asarray(points), 4 * threads)
    with ThreadPoolExecutor(threads) as pool:
        parts = pool.map(lambda share: direct_exitance(share, sources, flux, profiles), shares)
        return np.concatenate(list(parts))
