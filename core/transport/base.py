"""A transport: from the flux of surface samples to a volume from which exitance is read at any surface point."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.kernels import Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid, deposit
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import each, one_blas_thread


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
class FftTransport(Kernels):
    """Deposit, kernels and convolution; what differs between the methods is left to them."""

    @one_blas_thread()
    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, area: float, stages: Stages
    ) -> Float32:
        """See `core.transport.base.Transport.exitance`."""
        convolvers = [self.convolver(self.shape(grid, profile, area), i) for i, profile in enumerate(profiles)]
        weights = stages.run(Stage.WEIGHTS, (grid, coordinates), lambda: self.weights(grid, coordinates))
        layers = stages.run(Stage.DEPOSIT, (weights, flux), lambda: deposit(grid, weights, flux))
        kernels = tuple(
            None if p.is_black else (p, c.shape, grid.texel, grid.layer_distance)
            for p, c in zip(profiles, convolvers, strict=True)
        )

        def make(profile: Profile, shape: ConvolutionShape) -> Float32:
            return self._spectrum(profile, grid, shape)

        spectra = stages.run(Stage.SPECTRA, kernels, lambda: self.spectra(kernels, make))
        before = stages.kept(Stage.CONVOLUTION)

        def convolve() -> Float32:
            lit = [i for i, spectrum in enumerate(spectra) if spectrum is not None and layers[i].any()]
            twins = {i: _twin(i, lit, layers, spectra) for i in lit}
            known = {i: _known(i, layers, spectra, before) for i in lit if twins[i] == i}

            def convolved(i: int) -> Float32:
                spectrum, done = spectra[i], known[i]
                assert spectrum is not None
                return convolvers[i].convolve(layers[i], spectrum) if done is None else done

            # Layers that mix pair by pair have all threads in one convolution; others are convolved side by side.
            shared = convolvers[0].shape.mixes_pairs
            found = dict(zip(known, map(convolved, known) if shared else each(convolved, known), strict=True))
            dark = np.zeros_like(layers[0])
            return np.stack([found[twins[i]] if i in twins else dark for i in range(len(layers))])

        return stages.run(Stage.CONVOLUTION, (layers, spectra), convolve)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """See `core.transport.base.Transport.weights`."""
        raise NotImplementedError

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Return the sizes of a channel's transforms, on an object of `area` mm^2."""
        raise NotImplementedError

    def _spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        raise NotImplementedError


def _twin(i: int, lit: Sequence[int], layers: Float32, spectra: Sequence[Spectra | None]) -> int:
    """Return the first of the lit channels that is convolved alike; it may be the channel itself."""
    return next(k for k in lit if spectra[k] is spectra[i] and np.array_equal(layers[k], layers[i]))


def _known(
    i: int, layers: Float32, spectra: Sequence[Spectra | None], before: tuple[tuple[Any, ...], Float32] | None
) -> Float32 | None:
    """Return a channel's convolution if it was done before; None if it is new."""
    if before is not None:
        (old_layers, old_spectra), old = before
        if old_layers is layers and old_spectra[i] is spectra[i]:
            return np.asarray(old[i])
    return None
