"""Colours and relief of a surface as the passes take them: buffers, textures, and their uniforms."""

from dataclasses import dataclass, replace

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.geometry.detail import MeshDetail
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.reference.sources import SourcePieces
from milkglass.viewer.gl.buffers import SampleBuffers
from milkglass.viewer.passes.detail import DetailBuffer, DetailBuffers


@dataclass(frozen=True, eq=False)
class SampledSurface:
    """SampledSurface samples on CPU and GPU, with factors (n, 3) on irradiance where there are colours or relief."""

    samples: SurfaceSamples
    buffers: SampleBuffers
    weights: Float32 | None = None

    def weighted(self, irradiance: Float32) -> Float32:
        """Return irradiance (n, 3) times the factors."""
        return irradiance if self.weights is None else irradiance * self.weights

    def unweighted(self, irradiance: Float32) -> Float32:
        """Return irradiance (n, 3) without the factors, 0 where they are 0."""
        if self.weights is None:
            return irradiance
        return np.divide(irradiance, self.weights, out=np.zeros_like(irradiance), where=self.weights > 0.0)


@dataclass(frozen=True, eq=False)
class SurfaceDetail:
    """Colours and relief of a surface on the GPU, as lighting and shading take them; compared by identity.

    Attributes
    ----------
    detail : MeshDetail
    buffers : DetailBuffers
    before, after : float
        Powers of the colour on irradiance and on exitance.
    strength : float
        Of the relief.
    near : 3-D texture
        Colour^before of the surface near each node of `grid`.
    """

    detail: MeshDetail
    buffers: DetailBuffers
    before: float
    after: float
    strength: float
    near: moderngl.Texture3D
    grid: LayerGrid

    def on_sources(self, sources: SourcePieces) -> tuple[SourcePieces, npt.NDArray[np.float64]]:
        """Return sources of the reference with normals turned by the relief, and factors (n, 3) on their irradiance."""
        pieces = self.detail.pieces_at(sources.points, sources.face_normals, sources.areas)
        normals, weights = sources.normals, np.ones((len(sources), 3))
        if self.before > 0.0:
            weights = self.detail.colour(pieces, self.before).astype(np.float64)
        if self.detail.has_normals and self.strength > 0.0:
            turned, factors = self.detail.relief(pieces, sources.normals, self.strength)
            normals, weights = turned.astype(np.float64), weights * factors[:, None]
        return replace(sources, normals=normals), weights


Drawn = tuple[SurfaceDetail, DetailBuffer]


def entering_uniforms(drawn: Drawn | None) -> dict[str, object]:
    """Return the values for detail_entering.glsl, none where the surface has no detail."""
    if drawn is None:
        return {}
    detail, buffer = drawn
    return {
        "t_colour": buffer.colour,
        "t_shading": buffer.shading,
        "u_before": detail.before,
        "t_near_colour": detail.near,
        "u_world_to_near": detail.grid.world_to_texture,
    }


def leaving_uniforms(drawn: Drawn | None) -> dict[str, object]:
    """Return the values for detail_leaving.glsl, none where the surface has no detail."""
    return {} if drawn is None else {"t_colour": drawn[1].colour, "u_after": drawn[0].after}
