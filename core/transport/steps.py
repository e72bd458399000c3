"""The steps that both transports share, each run only when what it depends on has changed, channel by channel.

The weights of the samples depend on (mesh, layers), the deposit on the light, kernels on (profile, layers): a slider of
one channel makes one kernel and one convolution anew, a light three convolutions and no kernel. Black channels and dark
layers cost nothing, channels that are alike are convolved once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Float32
from milkglass.core.grid.kernels import Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid, deposit
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.stages import Stages
from milkglass.core.threads import thread_pool


@dataclass
class FftTransport(Kernels):
    """Deposit, kernels and convolution; what differs between the methods is left to them."""

    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, area: float, stages: Stages
    ) -> Float32:
        """See `core.transport.base.Transport.exitance`."""
        convolvers = [self.convolver(self.shape(grid, profile, area), i) for i, profile in enumerate(profiles)]
        weights = stages.run("weights", (grid, coordinates), lambda: self.weights(grid, coordinates))
        layers = stages.run("deposit", (weights, flux), lambda: deposit(grid, weights, flux))
        kernels = tuple(
            None if p.is_black else (p, c.shape, grid.texel, grid.layer_distance)
            for p, c in zip(profiles, convolvers, strict=True)
        )

        def make(profile: Profile, shape: ConvolutionShape) -> Float32:
            return self._spectrum(profile, grid, shape)

        spectra = stages.run("spectra", kernels, lambda: self.spectra(kernels, make))
        before = stages.kept("convolution")

        def convolve() -> Float32:
            lit = [i for i, spectrum in enumerate(spectra) if spectrum is not None and layers[i].any()]
            twins = {i: _twin(i, lit, layers, spectra) for i in lit}
            known = {i: _known(i, layers, spectra, before) for i in lit if twins[i] == i}

            def convolved(i: int) -> Float32:
                spectrum, done = spectra[i], known[i]
                assert spectrum is not None
                return convolvers[i].convolve(layers[i], spectrum) if done is None else done

            # Layers that mix pair by pair have all threads in one convolution; others are convolved side by side.
            run = map if convolvers[0].shape.mixes_pairs else thread_pool().map
            found = dict(zip(known, run(convolved, known), strict=True))
            dark = np.zeros_like(layers[0])
            return np.stack([found[twins[i]] if i in twins else dark for i in range(len(layers))])

        return stages.run("convolution", (layers, spectra), convolve)

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
