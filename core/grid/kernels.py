"""Kernels on a grid, as the convolution takes them, and convolvers of their shapes: made once, kept while needed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from milkglass.core.arrays import Float32
from milkglass.core.grid.convolution import LayerConvolver, prepared
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.threads import each

Spectra = tuple[Float32, ...]
Kernel = tuple[Any, ConvolutionShape, float, float]  # what it is of, its shape, texel and layer distance
_Key = tuple[ConvolutionShape, int]

CONVOLVERS = 9  # kept: a camera that orbits changes the shape of layers, a material the padding of each channel
SPECTRA_BYTES = 64 << 20  # kept beyond those in use: materials between which a person goes back and forth


@dataclass
class Kernels:
    """Cache of kernel spectra and of convolvers, by what they depend on.

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
    _convolvers: dict[_Key, LayerConvolver] = field(default_factory=dict, init=False, repr=False)
    _spectra: dict[Kernel, Spectra] = field(default_factory=dict, init=False, repr=False)

    def spectra(
        self, kernels: Sequence[Kernel | None], make: Callable[[Any, ConvolutionShape], Float32]
    ) -> list[Spectra | None]:
        """Return spectra of kernels, as `LayerConvolver.convolve` takes them; those made lately are still there.

        `make` gives the spectrum of what a kernel is of, as `core.grid.spectra.kernel_spectrum` does.
        """
        new = [kernel for kernel in dict.fromkeys(kernels) if kernel is not None and kernel not in self._spectra]

        def prepare(kernel: Kernel) -> Spectra:
            of, shape, *_ = kernel
            return prepared(shape, make(of, shape))

        self._spectra |= zip(new, each(prepare, new), strict=True)
        for kernel in kernels:  # the latest last
            if kernel is not None:
                self._spectra[kernel] = self._spectra.pop(kernel)
        while len(self._spectra) > len(kernels) and self._bytes() > SPECTRA_BYTES:
            self._spectra.pop(next(iter(self._spectra)))
        return [None if kernel is None else self._spectra[kernel] for kernel in kernels]

    def convolver(self, shape: ConvolutionShape, user: int = 0) -> LayerConvolver:
        """Return the convolver of a shape; users whose work is done side by side have their own."""
        key = shape, user
        if key not in self._convolvers:
            if len(self._convolvers) >= self.keep:
                self._convolvers.pop(next(iter(self._convolvers)))
            # Where layers mix by FFT, channels are convolved side by side, which takes two thirds of sharing each.
            threads = self.threads if shape.mixes_pairs else 1
            self._convolvers[key] = LayerConvolver(shape, threads, self.effort)
        return self._convolvers[key]

    def release(self) -> None:
        """Drop all spectra and convolvers; what is needed again is made again."""
        self._convolvers.clear()
        self._spectra.clear()

    def _bytes(self) -> int:
        return sum(part.nbytes for spectra in self._spectra.values() for part in spectra)
