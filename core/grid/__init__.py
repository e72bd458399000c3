"""Layers of nodes: deposit and gather, kernels between them and their spectra, and convolution by FFT."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.grid.convolution import LayerConvolver as LayerConvolver, prepared as prepared
    from milkglass.core.grid.layers import LayerGrid as LayerGrid, deposit as deposit, gather as gather
    from milkglass.core.grid.shape import ConvolutionShape as ConvolutionShape
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
