"""The steps that both transports share, each run only when what it depends on has changed, channel by channel.

The weights of the samples depend on (mesh, layers), the deposit on the light, kernels on (profile, layers): a slider of
one channel makes one kernel and one convolution anew, a light three convolutions and no kernel. Black channels and dark
layers cost nothing, channels that are alike are convolved once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from core.convolution import ConvolutionShape, LayerConvolver, prepared, thread_pool
from core.layers import LayerGrid, deposit
from core.spectra import Profile, Profiles
from core.stages import Stages

Float32 = npt.NDArray[np.float32]
Kernel = tuple[Profile, ConvolutionShape, float, float]  # with texel and layer distance
Spectra = tuple[Float32, ...]

CONVOLVERS = 6  # kept: a camera that orbits changes the shape of layers, a material the padding of each channel
SPECTRA_BYTES = 64 << 20  # kept beyond those in use: materials between which a person goes back and forth


@dataclass
class FftTransport:
    """Deposit, kernels and convolution; what differs between the methods is left to them.

    Parameters
    ----------
    threads : int
        Of the convolution; 0 takes all cores.
    effort : str
        FFTW's planner flag; ``FFTW_ESTIMATE`` gives the same bits in every process.
    keep : int
        Convolvers, one a shape of layers, that are kept for the next call.
    """

    threads: int = 0
    effort: str = "FFTW_ESTIMATE"
    keep: int = CONVOLVERS
    _convolvers: dict[ConvolutionShape, LayerConvolver] = field(default_factory=dict, init=False, repr=False)
    _spectra: dict[Kernel, Spectra] = field(default_factory=dict, init=False, repr=False)

    def exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, area: float, stages: Stages
    ) -> Float32:
        """See `core.transport.Transport.exitance`."""
        convolvers = [self._convolver(self.shape(grid, profile, area)) for profile in profiles]
        weights = stages.run("weights", (grid, coordinates), lambda: self.weights(grid, coordinates))
        layers = stages.run("deposit", (weights, flux), lambda: deposit(grid, weights, flux))
        kernels = tuple(
            None if p.is_black else (p, c.shape, grid.texel, grid.layer_distance)
            for p, c in zip(profiles, convolvers, strict=True)
        )
        spectra = stages.run("spectra", kernels, lambda: self._prepared(kernels, grid))
        before = stages.kept("convolution")

        def convolve() -> Float32:
            out = np.zeros_like(layers)
            for channel, (spectrum, convolver) in enumerate(zip(spectra, convolvers, strict=True)):
                if spectrum is None or not layers[channel].any():
                    continue
                known = _known(channel, layers, spectra, out, before)
                out[channel] = convolver.convolve(layers[channel], spectrum) if known is None else known
            return out

        return stages.run("convolution", (layers, spectra), convolve)

    def _prepared(self, kernels: Sequence[Kernel | None], grid: LayerGrid) -> list[Spectra | None]:
        """Spectra of kernels, as `LayerConvolver.convolve` takes them; those made lately are still there."""
        new = [kernel for kernel in dict.fromkeys(kernels) if kernel is not None and kernel not in self._spectra]

        def prepare(kernel: Kernel) -> Spectra:
            profile, shape, *_ = kernel
            return prepared(shape, self._spectrum(profile, grid, shape))

        self._spectra |= zip(new, thread_pool().map(prepare, new), strict=True)
        for kernel in kernels:  # the latest last
            if kernel is not None:
                self._spectra[kernel] = self._spectra.pop(kernel)
        while len(self._spectra) > len(kernels) and self._spectra_bytes() > SPECTRA_BYTES:
            self._spectra.pop(next(iter(self._spectra)))
        return [None if kernel is None else self._spectra[kernel] for kernel in kernels]

    def _spectra_bytes(self) -> int:
        return sum(part.nbytes for spectra in self._spectra.values() for part in spectra)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """See `core.transport.Transport.weights`."""
        raise NotImplementedError

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Return the sizes of a channel's transforms, on an object of `area` mm^2."""
        raise NotImplementedError

    def _spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        raise NotImplementedError

    def _convolver(self, shape: ConvolutionShape) -> LayerConvolver:
        if shape not in self._convolvers:
            if len(self._convolvers) >= self.keep:
                self._convolvers.pop(next(iter(self._convolvers)))
            self._convolvers[shape] = LayerConvolver(shape, self.threads, self.effort)
        return self._convolvers[shape]


def _known(
    channel: int,
    layers: Float32,
    spectra: Sequence[Spectra | None],
    out: Float32,
    before: tuple[tuple[Any, ...], Float32] | None,
) -> Float32 | None:
    """Return a channel's convolution if it is that of another channel, or was done before; None if it is new."""
    for other in range(channel):
        if spectra[other] is spectra[channel] and np.array_equal(layers[other], layers[channel]):
            return np.asarray(out[other])
    if before is not None:
        (old_layers, old_spectra), old = before
        if old_layers is layers and old_spectra[channel] is spectra[channel]:
            return np.asarray(old[channel])
    return None
