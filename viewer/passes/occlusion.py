"""Shares of the environment that vertices see, as the passes take them."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.viewer.assets.visibility import BakedVisibility
from milkglass.viewer.passes.refined import RefinedSurface


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Shares of one environment's light, on both sides.

    Attributes
    ----------
    baked : BakedVisibility
    shares : (n, 3) float32
        Of the vertices of the refined mesh, in [0, 1].
    surface : RefinedSurface
        Of that mesh.
    values : buffer
        Shares, three floats a vertex.
    """

    baked: BakedVisibility
    shares: Float32
    surface: RefinedSurface
    values: moderngl.Buffer

    def at(self, points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return shares (n, 3) at points of the surface with normals: of the nearest vertices that face that way."""
        return self.surface.at(self.shares, points, normals)

    def behind(self, context: moderngl.Context) -> moderngl.Buffer:
        """Return the shares seen against each vertex' normal, as a buffer of three floats a vertex."""
        return context.buffer(self.surface.behind(self.shares))
