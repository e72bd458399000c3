"""A mesh in light cast by rays: exitance by the Ewald split and by the direct sum, without OpenGL."""

from dataclasses import replace

import numpy as np

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.grid.layers import gather
from milkglass.core.material.library import Material
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.stages import Stages
from milkglass.core.transport.ewald import EwaldTransport
from tests.support.rendering import FRONT


class Lit:
    """A mesh lit from a direction, seen at random points of its surface; exitance by the split and summed directly."""

    def __init__(self, mesh: Mesh, material: Material, direction=FRONT, n_points: int = 80) -> None:
        self.mesh, self.profiles = mesh, dipoles(material)
        occluder, sources = Occluder(mesh), surface_samples(mesh, 0.3)

        def irradiance(samples):
            return occluder.irradiance(
                samples.points, samples.normals, samples.normals, direction, (3, 3, 3), material.eta
            )

        chosen = np.random.default_rng(0).choice(len(sources), n_points, replace=False)
        E = irradiance(sources)
        self.points, self.E = sources.points[chosen].astype(np.float64), E[chosen]
        self.flux, self.sources = E * sources.areas[:, None], sources.points

    def mask(self, lit):
        """Leave the rest of the surface in shadow; `lit` tells of points (n, 3) whether light reaches them."""
        self.flux = self.flux * lit(self.sources)[:, None]
        self.E = self.E * lit(self.points)[:, None]

    def direct(self):
        return direct_exitance(self.points, self.sources, self.flux, self.profiles)

    def split(self, resolution: int, phase=(0.0, 0.0, 0.0)):
        """(n, 3) exitance with the grid moved by a phase, in spacings."""
        transport = EwaldTransport(resolution=resolution)
        grid = transport.grid(self.mesh, np.eye(3))
        matrix = np.array(grid.world_to_grid)
        matrix[3, :3] += phase
        grid = replace(grid, world_to_grid=tuple(map(tuple, matrix.tolist())))
        u = grid.coordinates(self.sources).astype(np.float32)
        nodes = transport.node_exitance(grid, u, self.flux.astype(np.float32), self.profiles, self.mesh.area, Stages())
        local = transport.local(grid, self.profiles).factors[0] * self.E
        return gather(transport.weights(grid, grid.coordinates(self.points)), nodes) + local


def of_coefficients(sigma_s_prime: float, sigma_a: float) -> Material:
    return Material("test", (sigma_s_prime,) * 3, (sigma_a,) * 3, 1.3, "test")
