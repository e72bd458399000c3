"""Transport: from the flux of surface samples to a volume from which exitance is read at any surface point.

One interface, `Transport`, with room for further methods; `LayeredTransport` is the paper's. Each of its steps is
kept until something that it depends on changes: kernels with (material, layers), the deposit with (light, layers).
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from core.convolution import ConvolutionShape, LayerConvolver
from core.layers import LayerGrid, deposit, fit_layers, tent_matrix
from core.mesh import Mesh
from core.spectra import Profile, kernel_spectrum, layer_kernels
from core.stages import Stages

Float32 = npt.NDArray[np.float32]
Profiles = tuple[Profile, Profile, Profile]


class Transport(Protocol):
    """A way to spread light inside the object."""

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Place the maps for a mesh seen with a world-to-view rotation (3, 3), row vectors."""

    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, stages: Stages
    ) -> Float32:
        """Exitance M at the nodes of the grid, to be read by trilinear interpolation.

        Parameters
        ----------
        grid : from `grid`
        coordinates : (n, 3) float32
            Grid coordinates of the surface samples.
        flux : (n, 3) float32
            E dA, the power that each sample carries.
        profiles : R, G and B
        stages : Stages
            Keeps the steps' results between calls.

        Returns
        -------
        (3, n_layers, height, width) float32
        """


@dataclass
class LayeredTransport:
    """The paper: layers across the view, every pair convolved, (3) to (6).

    Parameters
    ----------
    n_layers : int
        1 to 128.
    resolution : int
        Texels along the longer side of a map, 16 to 1024.
    threads : int
        Of the convolution; 0 takes all cores.
    effort : str
        FFTW's planner flag; ``FFTW_ESTIMATE`` gives the same bits in every process.
    """

    n_layers: int
    resolution: int
    threads: int = 0
    effort: str = "FFTW_ESTIMATE"
    _convolvers: dict[ConvolutionShape, LayerConvolver] = field(default_factory=dict, init=False, repr=False)

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Layers fitted to the mesh, across the view."""
        return fit_layers(mesh.vertices, rotation, self.n_layers, self.resolution)

    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, stages: Stages
    ) -> Float32:
        """Deposit (4), kernels and spectra (5), convolution (6); see `Transport.exitance`."""
        convolver = self._convolver(ConvolutionShape(*grid.shape))
        weights = stages.run("weights", (grid, coordinates), lambda: tent_matrix(grid, coordinates))
        layers = stages.run("deposit", (weights, flux), lambda: deposit(grid, weights, flux))
        spectra = stages.run(
            "spectra",
            # one kernel serves every texel size and distance that it was sampled for
            (profiles, grid.shape, grid.texel, grid.layer_distance),
            lambda: [None if p.is_black else _spectrum(p, grid, convolver) for p in profiles],
        )

        def convolve() -> Float32:
            out = np.zeros_like(layers)
            for channel, spectrum in enumerate(spectra):
                if spectrum is not None and layers[channel].any():
                    out[channel] = convolver.convolve(layers[channel], spectrum)
            # M >= 0; the FFT's rounding leaves noise of 1e-7 of the maximum where no light arrives
            return np.maximum(out, 0.0, out=out)

        return stages.run("convolution", (layers, spectra), convolve)

    def _convolver(self, shape: ConvolutionShape) -> LayerConvolver:
        if shape not in self._convolvers:
            if len(self._convolvers) >= 4:  # an orbiting camera changes the shape; plans of a few are kept
                self._convolvers.pop(next(iter(self._convolvers)))
            self._convolvers[shape] = LayerConvolver(shape, self.threads, self.effort)
        return self._convolvers[shape]


def _spectrum(profile: Profile, grid: LayerGrid, convolver: LayerConvolver) -> tuple[Float32, ...]:
    return convolver.prepare(kernel_spectrum(layer_kernels(profile, grid), convolver.shape))
