"""Diffusion in a mesh: what its tests have in common."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.material import fresnel
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.entry import second_scattering
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem, Solution

DOWN = (0.0, 0.0, -1.0)
MARBLE, SKIM_MILK, WHOLE_MILK = Medium(2.62, 0.0041, 1.5), Medium(0.70, 0.0014, 1.3), Medium(3.77, 0.014, 1.3)


def samples_of(mesh: Mesh, resolution: int = 48) -> SurfaceSamples:
    """As dense as the program has them at rest, or a little less."""
    return surface_samples(mesh, 1.2 * float(np.ptp(mesh.bounds, axis=0).max()) / resolution)


def collimated(samples: SurfaceSamples, direction=DOWN, eta=None, lit=None) -> EnteringLight:
    """Light of unit irradiance; unshadowed, so for convex shapes unless `lit` (n,) says what it reaches.

    `eta` takes Fresnel's share off; without it all light enters.
    """
    cosine = np.maximum(-samples.normals.astype(float) @ np.array(direction), 0.0)
    E = cosine if eta is None else cosine * fresnel.transmittance(eta, cosine)
    flux = E * samples.areas * (1.0 if lit is None else lit)
    return EnteringLight(np.repeat(flux[:, None], 3, axis=1).astype(np.float32), direction=tuple(direction))


@dataclass
class Solved:
    """A solution with what it was made of."""

    mesh: Mesh
    samples: SurfaceSamples
    media: Sequence[Medium]
    solution: Solution
    stages: Stages
    transport: DiffusionTransport

    @property
    def boundary(self) -> Boundary:
        return self.stages.kept("boundary")[1]

    @property
    def patches(self):
        return self.boundary.patches

    def exitance(self, channel: int) -> Array:
        """(n,) M of the patches."""
        return self.solution.two_A_M[channel] / (2.0 * self.media[channel].extrapolation_factor)

    def leaving(self, channel: int) -> float:
        """Flux."""
        return float(self.patches.areas @ self.exitance(channel))

    def scattered(self, channel: int) -> float:
        """Flux that has entered, less what crosses the object without scattering."""
        entry, medium = self.stages.kept("entry of light 1")[1], self.media[channel]
        _, shares = first_scattering(entry.chords_in(medium))
        again, _, more = second_scattering(entry, medium)
        flux = entry.flux[:, channel]
        return float(flux @ shares.sum(axis=1) + flux[entry.second.rays[again]] @ more.sum(axis=1))

    def of_faces(self, channel: int) -> Array:
        """(m,) mean exitance of the mesh's faces."""
        return self.mean_of_faces(self.exitance(channel))

    def bending_of_faces(self, channel: int) -> Array:
        """(m,) of the mesh's faces."""
        return self.mean_of_faces(self.boundary.bending(self.media[channel]))

    def mean_of_faces(self, values: Array) -> Array:
        """(m,) of what patches have."""
        at_samples = self.patches.sums.T @ values
        n = len(self.mesh.faces)
        areas = np.bincount(self.samples.faces, self.samples.areas, n)
        return np.bincount(self.samples.faces, self.samples.areas * at_samples, n) / areas


PATCH = 0.5  # cells: patches are compared with faces and sorted into bins whole


def diffuse(mesh, media, resolution=48, light=None, tolerance=1e-4, phase=None, samples=None, stages=None) -> Solved:
    """Solve; `light` is an `EnteringLight` or makes one of samples, `phase` moves the grid, in nodes.

    `stages` of a solution for the same mesh and samples keep its boundary, and the rays from it.
    """
    transport = DiffusionTransport(resolution=resolution, tolerance=tolerance, patch=PATCH)
    stages = Stages() if stages is None else stages
    samples = samples_of(mesh, resolution) if samples is None else samples
    grid = transport.grid(mesh, np.eye(3))
    if phase is not None:
        matrix = np.array(grid.world_to_grid)
        matrix[3, :3] += phase
        grid = type(grid)(*grid.shape, grid.texel, grid.layer_distance, tuple(map(tuple, matrix.tolist())))
    light = collimated(samples) if light is None else light(samples) if callable(light) else light
    solution = transport.solve(Problem(mesh, samples, grid, [light], media), stages)
    return Solved(mesh, samples, media, solution, stages, transport)


def slab(medium: Medium, thickness: float, depths: Array, weights: Array) -> tuple[float, float]:
    """R and T, without what crosses unscattered, of a slab in mm with sources at `depths`; a' included."""
    q, z_b = max(medium.attenuation, 1e-6), 2.0 * medium.diffusion * medium.extrapolation_factor

    def u(z):
        return np.sinh(q * z) + q * z_b * np.cosh(q * z)

    W = (1.0 + (q * z_b) ** 2) * np.sinh(q * thickness) + 2.0 * q * z_b * np.cosh(q * thickness)
    return (
        medium.albedo * float(np.sum(weights * u(thickness - depths))) / W,
        medium.albedo * float(np.sum(weights * u(depths))) / W,
    )
