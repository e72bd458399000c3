"""A transport that is none of the product's: exitance is a share of the irradiance at the point itself.

Its module has what the `home` of a row in `core.transport.methods` must have, and nothing else of the program knows it.
"""

from dataclasses import dataclass

import numpy as np

from milkglass.core.geometry.mesh import longest_side
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.layers import LayerGrid, fit_nodes, tent_matrix
from milkglass.core.transport.methods import Method
from milkglass.core.transport.pixels import LocalTerm, PixelTables
from milkglass.core.transport.quality import Quality

NAME, SHARE = "uniform", np.array([0.5, 0.25, 0.125])
ROW = Method("tests.support.uniform", "nothing is missed", uses_profile=False)


@dataclass(frozen=True, eq=False)
class UniformlyScattered:
    """A `core.transport.base.Scattered` whose nodes carry nothing."""

    grid: LayerGrid
    volume: np.ndarray

    windows = resolved = None
    residuals = 0.0, 0.0, 0.0
    convolutions = 0, 0, 0
    is_solved, estimates_unscattered = True, False
    boundaries = ()
    reentering = None

    @property
    def world_to_texture(self):
        return self.grid.world_to_texture

    def pixel_tables(self):
        return PixelTables(LocalTerm(SHARE[None], 0.0))

    def mean_fluence(self):
        return np.zeros_like(self.volume)

    def exitance(self, points, normals, lights, tables):
        return SHARE * sum(light.irradiance for light in lights.at(points, normals, 0.0, thin=False))

    def on_layers(self):
        return self.volume


@dataclass(eq=False)
class UniformTransport:
    """A `core.transport.base.SeparableTransport`."""

    resolution: int
    kernels: Kernels
    sweeps = 1

    smooth = False

    def grid(self, mesh, rotation):
        return fit_nodes(mesh.bounds, self.resolution)

    def weights(self, grid, coordinates):
        return tent_matrix(grid, coordinates)

    def scatter(self, lit, stages, go_on=None):
        return UniformlyScattered(lit.grid, np.zeros((3, *lit.grid.shape), np.float32))

    def material(self, lit):
        return ()

    def tables_of(self, lit, atlas, parts):
        return PixelTables(LocalTerm(SHARE[None], 0.0))

    def in_body(self, whole, crop):
        return self

    def release(self):
        self.kernels.release()


def choose_quality(asked, profiles, mesh, shape, *, sharp_light=True):
    return Quality(asked.method, None, asked.resolution or 16)


def make_transport(quality, kernels):
    return UniformTransport(quality.resolution, kernels)


def sample_spacing(mesh, asked, resolution):
    return longest_side(mesh) / resolution
