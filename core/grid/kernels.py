"""Caches of kernel spectra, in the form that convolution takes, and of convolvers of their shapes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from milkglass.core.arrays import Float32
from milkglass.core.grid.convolution import LayerConvolver, prepared
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.threads import pool_map

Spectra = tuple[Float32, ...]
Kernel = tuple[Any, ConvolutionShape, float, float]  # source, shape, texel and layer distance, mm
_Key = tuple[ConvolutionShape, int]

MAX_CONVOLVERS = 9  # an orbiting camera changes the shape of layers, a material the padding of each channel
SPECTRA_BYTES = 64 << 20  # beyond the spectra in use: for materials between which a person switches


@dataclass
class Kernels:
    """Cache of kernel spectra, by their `Kernel`, and of convolvers, by their shape.

    Parameters
    ----------
    threads : int
        Threads of a convolution; 0 takes all cores.
    effort : str
        Planner flag of FFTW; ``FFTW_ESTIMATE`` gives the same bits in every process.
    keep : int
        Number of convolvers that are cached.
    """

    threads: int = 0
    effort: str = "FFTW_ESTIMATE"
    keep: int = MAX_CONVOLVERS
    _convolvers: dict[_Key, LayerConvolver] = field(default_factory=dict, init=False, repr=False)
    _spectra: dict[Kernel, Spectra] = field(default_factory=dict, init=False, repr=False)
    _in_use: int = field(default=0, init=False, repr=False)  # the most recently used of the spectra

    def spectra(
        self, kernels: Sequence[Kernel | None], make: Callable[[Any, ConvolutionShape], Float32]
    ) -> list[Spectra | None]:
        """Return the spectra of kernels, as `LayerConvolver.convolve` takes them, from the cache or from `make`.

        make(source, shape) returns a kernel's spectrum, as `core.grid.spectra.kernel_spectrum` does. None has none.
        """
        missing = [kernel for kernel in dict.fromkeys(kernels) if kernel is not None and kernel not in self._spectra]

        def prepare(kernel: Kernel) -> Spectra:
            source, shape, *_ = kernel
            return prepared(shape, make(source, shape))

        self._spectra |= zip(missing, pool_map(prepare, missing), strict=True)
        for kernel in kernels:  # most recently used last
            if kernel is not None:
                self._spectra[kernel] = self._spectra.pop(kernel)
        self._in_use = len({kernel for kernel in kernels if kernel is not None})
        while len(self._spectra) > len(kernels) and self._bytes() > SPECTRA_BYTES:
            self._spectra.pop(next(iter(self._spectra)))
        return [None if kernel is None else self._spectra[kernel] for kernel in kernels]

    def convolver(self, shape: ConvolutionShape, user: int = 0) -> LayerConvolver:
        """Return the convolver of a shape; concurrent users pass different numbers `user` to get different ones."""
        key = shape, user
        if key not in self._convolvers:
            if len(self._convolvers) >= self.keep:
                self._convolvers.pop(next(iter(self._convolvers)))
            # Where layers mix by FFT, channels are convolved concurrently: two thirds of the time of threads in each.
            threads = self.threads if shape.mixes_pairs else 1
            self._convolvers[key] = LayerConvolver(shape, threads, self.effort)
        return self._convolvers[key]

    def keep_used(self) -> None:
        """Let go of all spectra but those of the last call: where materials follow each other, none comes back."""
        while len(self._spectra) > self._in_use:
            self._spectra.pop(next(iter(self._spectra)))

    def release(self) -> None:
        """Empty both caches."""
        self._convolvers.clear()
        self._spectra.clear()

    def _bytes(self) -> int:
        return sum(part.nbytes for spectra in self._spectra.values() for part in spectra)
