"""The diffusion equation solved in the object itself, as a boundary integral equation on the layers."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.transport.diffusion.boundary import Boundary as Boundary
    from milkglass.core.transport.diffusion.solution import Solution as Solution
    from milkglass.core.transport.diffusion.solver import DiffusionTransport as DiffusionTransport
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
