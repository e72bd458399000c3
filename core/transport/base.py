"""A transport: from the flux of surface samples to a volume from which exitance is read at any surface point."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.profiles.base import Profiles
from milkglass.core.stages import Stages


@dataclass(frozen=True, eq=False)
class LocalTerm:
    """The part of exitance that is a factor on irradiance, M += factor(0) E(x) + factor(thickness) E(other side).

    Attributes
    ----------
    factors : (n, 3) float64
        rho_s per channel at n thicknesses evenly from 0 to `reach`; beyond it is 0.
    reach : float
        mm; 0 where there is no such part.
    """

    factors: npt.NDArray[np.float64]
    reach: float


class Transport(Protocol):
    """A way to spread light inside an object."""

    @property
    def smooth(self) -> bool:
        """Whether W are quadratic B-splines rather than tents."""

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Place the layers for a mesh seen with a world-to-view rotation (3, 3), row vectors."""

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """W of points (n, 3) in grid coordinates: (nodes, n) sparse."""

    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """What the layers are too coarse for."""

    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, area: float, stages: Stages
    ) -> Float32:
        """O, the part of exitance that the nodes carry.

        Parameters
        ----------
        grid : from `grid`
        coordinates : (n, 3) float32
            Grid coordinates of the surface samples.
        flux : (n, 3) float32
            E dA, the power that each sample carries.
        profiles : R, G and B
        area : float
            Of the surface, mm^2.
        stages : Stages
            Keeps the steps' results between calls.

        Returns
        -------
        (3, n_layers, height, width) float32
        """
