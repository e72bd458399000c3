"""Transport: from the flux of surface samples to a volume from which exitance is read at any surface point.

M(x) = sum of W(x) O over nodes near x + a local term: W spreads flux over the layers and gathers exitance from them, O
is the deposited flux convolved with a kernel, and the local term is what the layers are too coarse for. Two methods:

* `LayeredTransport`, the paper's: layers across the view, W tents, the kernel R_d itself, no local term.
* `EwaldTransport`, closer to equation (1) at the same cost: layers fixed to the object, W quadratic B-splines or tents,
  the kernel R_d smoothed to what the layers can carry, and the rest local (see `core.ewald`).

Each step is kept until something that it depends on changes: kernels with (material, layers), the deposit with
(light, layers).
"""

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from core import ewald
from core.convolution_shape import ConvolutionShape
from core.layers import LayerGrid, fit_layers, fit_nodes, smooth_matrix, tent_matrix
from core.mesh import Mesh
from core.spectra import Profile, Profiles, kernel_spectrum, layer_kernels
from core.stages import Stages
from core.transport_steps import FftTransport

Float32 = npt.NDArray[np.float32]

SHEET_NODES = 64  # thicknesses at which a local term is tabulated
# Share of a channel's reflectance that may wrap around its padded box: next to nothing, for a ball's dark side shows
# LOOSE_TAIL; enough where the nodes err by more.
TAIL, LOOSE_TAIL = 1e-4, 0.02


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
        See `core.kernels.Kernels`.
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


@dataclass
class EwaldTransport(FftTransport):
    """Particle-mesh Ewald split on layers that are fixed to the object, so that orbiting convolves nothing.

    Parameters
    ----------
    resolution : int
        Nodes along the object's longest side.
    n_layers : int, optional
        Layers over the object's z extent; as dense as the nodes if not given, which is best.
    assignment : str
        ``tsc``, quadratic B-splines over 27 nodes, or ``tent``, linear ones over 8.
    tail : float
        See `tail_reach`; the padding follows from it.
    threads, effort, keep
        See `core.kernels.Kernels`.
    """

    resolution: int = 60
    n_layers: int | None = None
    assignment: str = ewald.TSC
    tail: float = TAIL

    @property
    def smooth(self) -> bool:
        """With TSC."""
        return self.assignment == ewald.TSC

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Fit layers to the mesh itself, whatever the view."""
        return fit_nodes(mesh.bounds, self.resolution, self.n_layers)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """B-splines of the assignment's order."""
        return smooth_matrix(grid, coordinates) if self.smooth else tent_matrix(grid, coordinates)

    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """The rho_s of `core.ewald.local_table`."""
        s = self._window_width(grid)
        thickness = np.linspace(0.0, ewald.SHEET_REACH * s, SHEET_NODES)
        factors = [np.zeros(SHEET_NODES) if p.is_black else ewald.local_table(p, s)(thickness) for p in profiles]
        return LocalTerm(np.stack(factors, axis=-1), float(thickness[-1]))

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Pad a channel by its `tail_reach`; at most by the extent."""
        spacing = np.array([grid.layer_distance, grid.texel, grid.texel])
        counts = np.array(grid.shape)
        extra = np.minimum(np.ceil(tail_reach(profile, area, self.tail) / spacing), np.maximum(counts - 2, 0))
        depth, height, width = (int(n) for n in counts + extra)
        return ConvolutionShape(*grid.shape, padding=(depth, height, width))

    def _window_width(self, grid: LayerGrid) -> float:
        return ewald.WINDOW[self.assignment] * max(grid.texel, grid.layer_distance)

    def _spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        spacing = np.array([grid.layer_distance, grid.texel, grid.texel])
        furthest = float(np.linalg.norm(spacing * (np.array(shape.quadrant) - 1)))
        kernel = ewald.long_range(profile, self._window_width(grid), furthest)
        return ewald.node_spectrum(kernel, grid, shape, self.assignment)


@functools.lru_cache(maxsize=1024)  # every body asks again
def tail_reach(profile: Profile, area: float, tail: float) -> float:
    """Distance, mm, beyond which the tails of all sources together are negligible, on an object of `area` mm^2.

    The smallest D with A R_d(D) <= tail T(0), by bisection: R_d falls with distance. 0 for black.
    """
    if profile.is_black:
        return 0.0
    enough = tail * float(profile.total(0.0)) / area
    low, high = 0.0, np.sqrt(area)
    while float(profile.radial(high)) > enough:
        high *= 2.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(profile.radial(middle)) > enough else (low, middle)
    return float(high)
