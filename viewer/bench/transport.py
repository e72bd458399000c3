"""Error of the methods relative to photons, and their costs.

Two errors are measured: that of the model, relative to photons, and, for `diffusion`, that of its numerics, relative to
its solution on a grid twice as fine. Irradiance is by rays for all, so neither includes shadow maps; exitance is
compared over the whole surface, see `core.reference.transport_error`. Constants of `diffusion` were fitted to some of
the shapes or chosen on them (`core.transport.diffusion.constants`); others are held out, and only their errors are
those to expect of a new shape.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.material.medium import media
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.provenance import shapes_in_sample
from milkglass.core.reference.photon_lights import Beam
from milkglass.core.reference.transport_error import TransportError, photon_reference, transport_error
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringFlux, EnteringLight, Scattered, Transport, WholeObject
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.quality import Quality, make_transport, sample_spacing
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.bench.error import CAMERA
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.shapes import (
    ball,
    bolt,
    bowl,
    box,
    dish,
    gear,
    gyroid,
    plate,
    torus,
    torus_knot,
    washer,
)
from milkglass.viewer.error.point_exitance import Evaluate, RayLights, exitance_in
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.lights import DirectionalLight

N_REGIONS = 100
FINER = 2  # times as many nodes along the object, for the numerical error of diffusion
ALBEDOS = Material("albedos", (0.9, 0.99, 0.999), (0.1, 0.01, 0.001), 1.3)  # sigma_t' = 1/mm in all channels
MATERIALS = (ALBEDOS.name, "marble", "skim milk")
LIGHTS = {"front": (0.3, 0.4, 1.0), "back": (-0.3, 0.2, -1.0)}  # towards the light, and the camera of `layered` at +z
SHAPES: dict[str, Callable[[], Mesh]] = {
    "ball, 4 mm": lambda: ball(4.0),
    "ball, 16 mm": lambda: ball(16.0),
    "knot": torus_knot,
    "plate, 2 mm": lambda: plate(20.0, 2.0),
    "bowl, 3 mm": bowl,
    "torus, 8 mm": torus,
    "washer, 10 mm": washer,
    "washer, 6 mm": lambda: washer(10.0, 4.0, 6.0),
    "dish, 3 mm": dish,
    "cube, 8 mm": box,
    # Held out: no constant was fitted to these or chosen on them.
    "gyroid, 3 mm": gyroid,
    "bolt, 15 mm": bolt,
    "gear, 5 mm": gear,
}
METHODS = Scheme("layered", 8, 128), Scheme("ewald"), Scheme("diffusion")
ALL, LIGHT, MATERIAL = "all", "light", "material"


@dataclass(frozen=True)
class TransportRow:
    """Result of one method on a shape of a material in a light.

    Attributes
    ----------
    error : TransportError
    changed : str
        Change since the last run: LIGHT, MATERIAL, or ALL for the first.
    ms : float
        Time of transport.
    resolution : int
        Resolution used.
    products : int
        Matvecs of the slowest channel; 0 for methods that do not solve, as the next two.
    residual : float
        Largest relative residual of the channels.
    numerical : (3,) tuple
        Rms difference from a grid `FINER` times as fine, over the rms.
    """

    scheme: Scheme
    shape: str
    material: str
    light: str
    error: TransportError
    changed: str
    ms: float
    resolution: int
    products: int = 0
    residual: float = 0.0
    numerical: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class PlacedMethod:
    """Transport on a shape, with its samples and their flux by light and eta."""

    transport: Transport
    grid: LayerGrid
    samples: SurfaceSamples
    coordinates: Float32
    entering: dict[tuple[str, float], EnteringLight]


class ShapeLights:
    """Lights of the benchmark on one shape: `RayLights` of each light and eta, cached."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._lights: dict[tuple[str, float], RayLights] = {}

    def __call__(self, name: str, eta: float) -> RayLights:
        """Return a light of irradiance 1."""
        key = name, eta
        if key not in self._lights:
            light = DirectionalLight(LIGHTS[name], (1.0, 1.0, 1.0))
            self._lights[key] = RayLights(self._mesh, Illumination((light,), None, np.eye(3), 1.0), eta)
        return self._lights[key]


class MethodRun:
    """A method on one shape, which caches results for the next light or material as the renderer does."""

    def __init__(
        self, scheme: Scheme, mesh: Mesh, lights_of_shape: ShapeLights, assets: Assets, finer: int = 1
    ) -> None:
        self.scheme, self.stages = scheme, Stages()
        self._mesh, self._lights_of_shape, self._assets, self._finer = mesh, lights_of_shape, assets, finer
        self._placed: dict[Quality, PlacedMethod] = {}
        self.scattered: Scattered | None = None

    def quality(self, material: Material) -> Quality:
        """Return the layers and resolution of the scheme for a material."""
        return self._assets.quality(self.scheme.settings, dipoles(material), self._mesh, sharp_light=True)

    def exitance(self, light: str, material: Material) -> Evaluate:
        """Run transport, and return M of its result; `stages.timings` then has the times of the stages that ran."""
        placed, lights = self._place(self.quality(material)), self._lights_of_shape(light, material.eta)
        entering = self._entering(placed, light, lights)
        solid, matter = WholeObject(self._mesh, placed.samples), (dipoles(material), media(material))
        lit = EnteringFlux(solid, placed.grid, placed.coordinates, entering.flux, (entering,), *matter)
        self.stages.begin()
        self.scattered = placed.transport.scatter(lit, self.stages)
        return exitance_in(self.scattered, lights)

    def _place(self, quality: Quality) -> PlacedMethod:
        if quality not in self._placed:
            mesh = self._mesh
            spacing = sample_spacing(mesh, self.scheme.settings, quality.resolution * self._finer)
            samples = self._assets.samples(mesh, spacing)
            transport = make_transport(replace(quality, resolution=quality.resolution * self._finer))
            grid = transport.grid(mesh, place_camera(CAMERA, mesh.radius, (256, 256)).rotation)
            coordinates = grid.coordinates(samples.points).astype(np.float32)
            self._placed[quality] = PlacedMethod(transport, grid, samples, coordinates, {})
        return self._placed[quality]

    def _entering(self, placed: PlacedMethod, light: str, lights: RayLights) -> EnteringLight:
        key = light, lights.eta
        if key not in placed.entering:
            samples, (direction,) = placed.samples, lights.directions()
            normals = samples.normals.astype(np.float64)
            (irradiance,) = lights.irradiance(samples.points.astype(np.float64), normals)
            flux = (irradiance * samples.areas[:, None]).astype(np.float32)
            placed.entering[key] = EnteringLight(flux, direction=direction)
        return placed.entering[key]


def is_in_sample(shape: str) -> bool:
    """Return whether a constant of `diffusion` was fitted to shapes of this family or chosen on them.

    The family is the name's first word: "ball" of "ball, 4 mm", "dragon" of "dragon_100k, 100 mm".
    """
    (family,) = re.findall(r"\A[a-z]*", shape.lower())
    return family in shapes_in_sample(CONSTANTS)


def material_of(name: str) -> Material:
    """Return `ALBEDOS` or a material of the library."""
    return ALBEDOS if name == ALBEDOS.name else materials.lookup(name)


def transport_rows(
    schemes: Sequence[Scheme], shapes: Mapping[str, Callable[[], Mesh]], material_names: Sequence[str], photons: int
) -> Iterator[TransportRow]:
    """Yield a row for every combination with both lights.

    From one run of a method to the next either the light or the material changes, not both.
    """
    for shape, make in shapes.items():
        mesh, assets = make(), Assets(keep=4)
        lights_of_shape = ShapeLights(mesh)
        runs = [MethodRun(scheme, mesh, lights_of_shape, assets) for scheme in schemes]
        fine = MethodRun(Scheme("diffusion"), mesh, lights_of_shape, assets, FINER)
        changed = ALL
        for i, name in enumerate(material_names):
            material = material_of(name)
            for light in list(LIGHTS)[:: -1 if i % 2 else 1]:
                beam = Beam(LIGHTS[light])
                reference = photon_reference(mesh, material, [beam], N_REGIONS, photons)
                for run in runs:
                    evaluate = run.exitance(light, material)
                    ms = sum(run.stages.timings.values())
                    error = transport_error(reference, evaluate)
                    resolution = run.quality(material).resolution
                    row = TransportRow(run.scheme, shape, name, light, error, changed, ms, resolution)
                    scattered = run.scattered
                    if scattered is not None and run.scheme.settings.facts.solves:
                        surface = reference.regions.samples
                        row = replace(
                            row,
                            products=max(scattered.convolutions),
                            residual=max(scattered.residuals),
                            numerical=numerical_error(evaluate, fine.exitance(light, material), surface),
                        )
                    yield row
                changed = LIGHT
            changed = MATERIAL


def numerical_error(evaluate: Evaluate, finer: Evaluate, surface: SurfaceSamples) -> tuple[float, ...]:
    """Return the rms difference over the surface, over the rms of the finer solution, (3,)."""
    points, normals = surface.points.astype(np.float64), surface.normals.astype(np.float64)
    coarse, fine = evaluate(points, normals), finer(points, normals)
    areas = surface.areas[:, None].astype(np.float64)
    size2 = np.sum(areas * fine**2, axis=0)
    share2 = np.sum(areas * (coarse - fine) ** 2, axis=0) / np.where(size2 > 0.0, size2, 1.0)
    return tuple(np.sqrt(share2).tolist())
