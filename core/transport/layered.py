"""The paper's transport: layers across the view, W tents, the kernel R_d itself between all layers, (3) to (6)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.grid.assignment import TENT
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.layers import LayerGrid, fit_layers, tent_matrix
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum, layer_kernels
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.transport.accuracy import Roughness
from milkglass.core.transport.fft import FftTransport
from milkglass.core.transport.pixels import LocalTerm
from milkglass.core.transport.quality import SAMPLE_EDGE, Quality, QualityRequest

DEFAULT_LAYERS, DEFAULT_RESOLUTION = 8, 128


@dataclass(eq=False)
class LayeredTransport(FftTransport):
    """Layers across the view, every pair of which is convolved, (3) to (6); it has no local term.

    Parameters
    ----------
    n_layers : int
        1 to 128.
    resolution : int
        Texels along the longer side of a map, 16 to 1024.
    kernels : Kernels
    """

    n_layers: int = DEFAULT_LAYERS
    resolution: int = DEFAULT_RESOLUTION

    @property
    def smooth(self) -> bool:
        """Return False: W are tents."""
        return False

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Fit layers across the view to the mesh."""
        return fit_layers(mesh.vertices, rotation, self.n_layers, self.resolution)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the tents of points, see `core.grid.layers.tent_matrix`."""
        return tent_matrix(grid, coordinates)

    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """Return no factors: all exitance is on the layers."""
        return LocalTerm(np.zeros((1, 3)), 0.0)

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Return sizes padded to twice the layers', so that no tail wraps around."""
        return ConvolutionShape(*grid.shape)

    def spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        """Return the spectra of the profile between all layers, (5)."""
        return kernel_spectrum(layer_kernels(profile, grid), shape)


def choose_quality(
    request: QualityRequest, profiles: Profiles, mesh: Mesh, shape: Roughness | None, *, sharp_light: bool = True
) -> Quality:
    """Return the quality for a request, without a predicted error; see `core.transport.quality.choose_quality`."""
    layers, resolution = request.layers or DEFAULT_LAYERS, request.resolution or DEFAULT_RESOLUTION
    return Quality(request.method, layers, resolution, TENT)


def make_transport(quality: Quality, kernels: Kernels) -> LayeredTransport:
    """Make the transport of a quality."""
    return LayeredTransport(n_layers=quality.layers or 1, resolution=quality.resolution, kernels=kernels)


def sample_spacing(mesh: Mesh, request: QualityRequest, resolution: int) -> float:
    """Return the distance of surface samples for a request, mm; see `core.transport.quality.sample_spacing`."""
    return SAMPLE_EDGE * longest_side(mesh) / ((request.resolution or DEFAULT_RESOLUTION) - 1)
