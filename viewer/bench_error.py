"""Error of the transport methods against equation (1) summed in float64, and what each costs.

Irradiance is cast by rays for the fast path and the reference alike, so the error is the transport's alone;
`viewer.bench_chain` measures what the whole renderer adds. The points are those of the visible surface, as dense as
the pixels of an orthographic picture.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from core import layers, materials
from core.dipole import dipoles
from core.materials import Material
from core.mesh import Mesh
from core.reference import Occluder, direct_exitance
from core.samples import SurfaceSamples, surface_samples
from core.spectra import Profile
from core.stages import Stages
from core.transport import LayeredTransport, Transport
from viewer.bench_shapes import SHAPES
from viewer.camera import place_camera
from viewer.settings import CameraSettings

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
        if self.stripe > 0.0:
            across = np.cross([0.0, 1.0, 0.0], self.direction)
            place = samples.points @ (across / np.linalg.norm(across)) / self.stripe
            entering *= (np.floor(place) % 2.0 == 0.0)[:, None]
        return entering


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
    """A transport method with its settings; `METHODS` makes it. 0 layers: as the method chooses."""

    method: str
    layers: int
    resolution: int

    def __str__(self) -> str:
        return f"{self.method} {f'{self.layers} x ' if self.layers else ''}{self.resolution}"


# A further method is one more line here and its schemes below.
METHODS: dict[str, Callable[[Scheme], Transport]] = {
    "layered": lambda scheme: LayeredTransport(n_layers=scheme.layers, resolution=scheme.resolution),
}
PAPER = Scheme("layered", 4, 256)
SCHEMES = (PAPER, *(Scheme("layered", n, 128) for n in (8, 16, 32, 64, 128)))


@dataclass(frozen=True, eq=False)
class Target:
    """A shape and the points of its visible surface where exitance is compared.

    Attributes
    ----------
    mesh, occluder
    rotation : (3, 3) float64
        World to view, row vectors.
    sources : SurfaceSamples
        Of the reference.
    points : SurfaceSamples
    """

    mesh: Mesh
    occluder: Occluder
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
        return cls(mesh, occluder, camera.rotation, sources, points)

    def reference(self, light: BenchLight, material: Material) -> Array:
        """Sum equation (1) directly: (n, 3) exitance at the points."""
        flux = light.irradiance(self.occluder, self.sources, material.eta) * self.sources.areas[:, None]
        return parallel_exitance(self.points.points, self.sources.points, flux, dipoles(material))


@dataclass
class Run:
    """A scheme on one shape; keeps what the next light or material can use again, as the renderer does."""

    scheme: Scheme
    target: Target
    stages: Stages = field(default_factory=Stages, init=False)

    def __post_init__(self) -> None:
        mesh = self.target.mesh
        self._transport = METHODS[self.scheme.method](self.scheme)
        self._grid = self._transport.grid(mesh, self.target.rotation)
        self._samples = surface_samples(mesh, self._transport.sample_edge(mesh))
        self._coordinates = self._grid.coordinates(self._samples.points).astype(np.float32)
        self._gather = self._transport.weights(self._grid, self._grid.coordinates(self.target.points.points))

    def exitance(self, light: BenchLight, material: Material) -> Float32:
        """M at the target's points, (n, 3); `stages.timings` tells the cost of O, all that changes with light."""
        target, profiles = self.target, dipoles(material)
        irradiance = light.irradiance(target.occluder, self._samples, material.eta)
        flux = (irradiance * self._samples.areas[:, None]).astype(np.float32)
        self.stages.begin()
        nodes = self._transport.exitance(self._grid, self._coordinates, flux, profiles, target.mesh.area, self.stages)
        smooth = layers.gather(self._gather, nodes)
        here = light.irradiance(target.occluder, target.points, material.eta)
        local = np.asarray(self._transport.local(self._grid, profiles))
        return np.maximum(smooth + local * here, 0.0).astype(np.float32)


@dataclass(frozen=True)
class Deviation:
    """How far exitance is from the reference, per channel, as shares of the reference's rms over the points.

    Attributes
    ----------
    rms, p99 : (3,) tuples
        Root mean square and 99th percentile of |M - M_ref|.
    ratio : (3,) tuple
        Mean of M over mean of M_ref: below 1 where light is lost.
    """

    rms: tuple[float, ...]
    p99: tuple[float, ...]
    ratio: tuple[float, ...]

    @classmethod
    def of(cls, exitance: npt.ArrayLike, reference: Array) -> "Deviation":
        """Compare (n, 3) arrays; a channel that is black in both has no error."""
        M, M_ref = np.asarray(exitance, np.float64), reference
        size = np.sqrt(np.mean(M_ref**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        difference = np.abs(M - M_ref)
        mean = M_ref.mean(axis=0)
        return cls(
            rms=tuple((np.sqrt(np.mean(difference**2, axis=0)) / size).tolist()),
            p99=tuple((np.percentile(difference, 99.0, axis=0) / size).tolist()),
            ratio=tuple(np.divide(M.mean(axis=0), mean, out=np.ones(3), where=mean > 0.0).tolist()),
        )


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
