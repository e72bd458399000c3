"""Corrections of diffusion beyond its boundary integral equation, where a surface is curved or has edges.

`curvature`
    2 H of the patches, which changes the extrapolation length on a curved surface
    (`core.material.medium.Medium.bending`).
`pairs`
    Edges as pairs of a patch and another face: distance, angle, and the curvature that they stand for.
`wedge`, `crossing`
    Light that scatters once beside a convex edge and leaves by the other face: tables, and the light taken from
    diffusion and added to the exitance.
`last_flight`
    Exitance beside a concave edge, which diffusion has the same on wall and floor: the flight from the last scattering
    is followed.
"""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.transport.diffusion.edges.crossing import Crossing as Crossing
    from milkglass.core.transport.diffusion.edges.curvature import Curvature as Curvature
    from milkglass.core.transport.diffusion.edges.last_flight import LastFlight as LastFlight
    from milkglass.core.transport.diffusion.edges.pairs import Edges as Edges
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
