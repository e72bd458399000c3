"""Transport in matter that scatters next to nothing of the light that crosses it: no light leaves by the surface.

It stands in for a method whose pictures follow rays of sight, which find all the light there is.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringFlux, GoOn, SurfaceLights, Transport
from milkglass.core.transport.pixels import LocalTerm, PixelTables

NOTHING = np.zeros((3, 1, 1, 1), np.float32)


@dataclass(frozen=True, eq=False)
class NoExitance:
    """A `core.transport.base.Scattered` of no light.

    Attributes
    ----------
    grid : LayerGrid
        The nodes that another transport would have.
    """

    grid: LayerGrid

    volume = NOTHING
    residuals = 0.0, 0.0, 0.0
    convolutions = 0, 0, 0
    is_solved = True
    boundaries = ()
    windows = resolved = reentering = None
    estimates_unscattered = False

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) from world space to the volume's texture coordinates, row vectors."""
        return self.grid.world_to_texture

    def pixel_tables(self) -> PixelTables:
        """Return tables by which no pixel has light of its own."""
        return PixelTables(LocalTerm(np.zeros((1, 3)), 0.0))

    def mean_fluence(self) -> Float32:
        """Return a volume of one texel of 0."""
        return NOTHING

    def exitance(self, points: Array, normals: Array, lights: SurfaceLights, tables: PixelTables) -> Array:
        """Return 0 at points of the surface, (n, 3)."""
        return np.zeros((len(points), 3))

    def on_layers(self) -> Float32:
        """Return 0 on the layers, (3, *grid.shape)."""
        return np.zeros((3, *self.grid.shape), np.float32)


@dataclass(frozen=True, eq=False)
class ClearTransport:
    """A `core.transport.base.Transport` that scatters nothing.

    Attributes
    ----------
    instead_of : Transport
        The one that it stands in for, whose nodes it names.
    """

    instead_of: Transport

    @property
    def smooth(self) -> bool:
        """Return what it is of the other transport."""
        return self.instead_of.smooth

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Return the other transport's layers."""
        return self.instead_of.grid(mesh, rotation)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the other transport's weights."""
        return self.instead_of.weights(grid, coordinates)

    def scatter(self, lit: EnteringFlux, stages: Stages, go_on: GoOn | None = None) -> NoExitance:
        """Return no light."""
        return NoExitance(lit.grid)

    def material(self, lit: EnteringFlux) -> tuple[object, ...]:
        """Return nothing: no material has any light."""
        return ()

    def start_cold(self) -> None:
        """Forget nothing: there is no solution."""

    def release(self) -> None:
        """Release the other transport."""
        self.instead_of.release()
