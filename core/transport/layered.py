"""Transport: from the flux of surface samples to a volume from which exitance is read at any surface point.

M(x) = sum of W(x) O over nodes near x + a local term: W spreads flux over the layers and gathers exitance from them, O
is the deposited flux convolved with a kernel, and the local term is what the layers are too coarse for. Two methods:

* `LayeredTransport`, the paper's: layers across the view, W tents, the kernel R_d itself, no local term.
* `EwaldTransport`, closer to equation (1) at the same cost: layers fixed to the object, W quadratic B-splines or tents,
  the kernel R_d smoothed to what the layers can carry, and the rest local (see `core.transport.ewald`).

Each step is kept until something that it depends on changes: kernels with (material, layers), the deposit with
(light, layers).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import LayerGrid, fit_layers, tent_matrix
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum, layer_kernels
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.transport.base import FftTransport, LocalTerm


@dataclass
class LayeredTransport(FftTransport):
    """The paper: layers across the view, every pair convolved, (3) to (6).

    Parameters
    ----------
    n_layers : int
        1 to 128.
    resolution : int
        Texels along the longer side of a map, 16 to 1024.
    threads, effort, keep
        See `core.grid.kernels.Kernels`.
    """

    n_layers: int = 8
    resolution: int = 128

    @property
    def smooth(self) -> bool:
        """Never."""
        return False

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Fit layers across the view to the mesh."""
        return fit_layers(mesh.vertices, rotation, self.n_layers, self.resolution)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Tents."""
        return tent_matrix(grid, coordinates)

    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """Nothing."""
        return LocalTerm(np.zeros((1, 3)), 0.0)

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Padded to twice the size: no tail wraps around."""
        return ConvolutionShape(*grid.shape)

    def _spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        return kernel_spectrum(layer_kernels(profile, grid), shape)
