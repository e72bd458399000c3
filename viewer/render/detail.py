"""A model's colours and relief in a scene: at the pixels, and at the samples that scattering starts from."""

from dataclasses import replace

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.geometry.detail import FacePieces, MeshDetail
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import LayerGrid, fit_nodes, tent_matrix
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.gl.buffers import SampleBuffers
from milkglass.viewer.gl.context import volume_texture
from milkglass.viewer.passes.detail import DetailBuffers, DetailPass
from milkglass.viewer.passes.detail_uniforms import Drawn, SampledSurface, SurfaceDetail
from milkglass.viewer.scene.scene import Scene

BESIDE_PARTS = "colours and relief of the model's surface are left out beside parts with a material of their own"
NEAR_NODES = 48  # along the object's longest side, where the colour of the other side of a thin slab is looked up


class DetailStages:
    """Uploads colours and relief in one OpenGL context; a step runs only when what it depends on has changed."""

    def __init__(self, context: moderngl.Context, stages: Stages, assets: Assets) -> None:
        self._context, self._run, self._assets = context, stages.run, assets

    def surface(
        self, scene: Scene, samples: SurfaceSamples
    ) -> tuple[SampledSurface, SurfaceDetail | None, tuple[str, ...]]:
        """Return the uploaded samples, the colours and relief of the model if any, and sentences on what failed."""
        detail, troubles = self._assets.detail(scene.model, scene.detail)
        if detail is None or scene.materials:
            left_out = () if detail is None else (BESIDE_PARTS,)
            return self._uploaded(samples, samples, None), None, (*troubles, *left_out)
        run, (before, after) = self._run, scene.detail.powers
        strength = scene.detail.normal_strength
        buffers = run(Stage.DETAIL, [detail], lambda: DetailBuffers(self._context, detail))
        pieces = run(
            Stage.SAMPLE_DETAIL, [detail, samples], lambda: detail.pieces(samples.points, samples.faces, samples.areas)
        )
        turned, factors = run(
            Stage.SAMPLE_RELIEF, [pieces, strength], lambda: _relief(detail, samples, pieces, strength)
        )
        tints = run(Stage.SAMPLE_TINTS, [pieces, before], lambda: _tints(detail, pieces, before))
        weights = run(Stage.SAMPLE_WEIGHTS, [tints, factors], lambda: tints * factors[:, None])
        surface_detail = run(
            Stage.NODE_TINTS,
            [buffers, tints, before, after, strength],
            lambda: self._detail(buffers, samples, tints, (before, after), strength),
        )
        return self._uploaded(samples, turned, weights), surface_detail, troubles

    def leaving(self, detail: SurfaceDetail, samples: SurfaceSamples) -> Float32:
        """Return what the surface's colours let out, as factors on exitance at the samples: (n, 3)."""
        pieces = self._run(
            Stage.SAMPLE_DETAIL,
            [detail.detail, samples],
            lambda: detail.detail.pieces(samples.points, samples.faces, samples.areas),
        )
        return self._run(
            Stage.SAMPLE_LEAVING, [pieces, detail.after], lambda: _tints(detail.detail, pieces, detail.after)
        )

    def _uploaded(self, samples: SurfaceSamples, lit: SurfaceSamples, weights: Float32 | None) -> SampledSurface:
        """Upload samples with the normals that light meets."""
        context = self._context
        return self._run(
            Stage.SAMPLE_BUFFERS, [lit, weights], lambda: SampledSurface(samples, SampleBuffers(context, lit), weights)
        )

    def _detail(
        self,
        buffers: DetailBuffers,
        samples: SurfaceSamples,
        tints: Float32,
        powers: tuple[float, float],
        strength: float,
    ) -> SurfaceDetail:
        detail = buffers.detail
        grid = fit_nodes(detail.mesh.bounds, NEAR_NODES)
        near = volume_texture(self._context, _near(tints, samples, grid))
        return SurfaceDetail(detail, buffers, *powers, strength, near, grid)


class DrawnDetail:
    """Draws detail in one OpenGL context."""

    def __init__(self, context: moderngl.Context, stages: Stages) -> None:
        self._context, self._run = context, stages.run
        self._pass: DetailPass | None = None  # most models need none

    def draw(self, detail: SurfaceDetail | None, clip: npt.NDArray[np.float64], size: tuple[int, int]) -> Drawn | None:
        """Draw the colours and relief of the surface at every pixel, and return them with their buffer."""
        if detail is None:
            return None
        if self._pass is None:
            self._pass = DetailPass(self._context)
        detail_pass, strength = self._pass, detail.strength
        buffer = self._run(Stage.DETAIL_TARGETS, [size], lambda: detail_pass.targets(size))
        depends = [detail.buffers, strength, clip.tobytes(), buffer]
        self._run(Stage.PIXEL_DETAIL, depends, lambda: detail_pass.render(detail.buffers, clip, strength, buffer))
        return detail, buffer


def _tints(detail: MeshDetail, pieces: FacePieces, power: float) -> Float32:
    """Colours to a power, (n, 3)."""
    return detail.colour(pieces, power) if power > 0.0 else np.ones((len(pieces.faces), 3), np.float32)


def _relief(
    detail: MeshDetail, samples: SurfaceSamples, pieces: FacePieces, strength: float
) -> tuple[SurfaceSamples, Float32]:
    """Samples with the normals that light meets, and factors (n,) on irradiance there."""
    if not detail.has_normals or strength == 0.0:
        return samples, np.ones(len(samples), np.float32)
    normals, factors = detail.relief(pieces, samples.normals, strength)
    return replace(samples, normals=normals), factors


def _near(tints: Float32, samples: SurfaceSamples, grid: LayerGrid) -> Float32:
    """Mean of values (n, 3) of samples near each node, (3, n_layers, height, width)."""
    weights = tent_matrix(grid, grid.coordinates(samples.points))
    total = weights @ samples.areas
    mean = (weights @ (samples.areas[:, None] * tints)) / np.maximum(total, np.finfo(np.float32).tiny)[:, None]
    mean[total == 0.0] = (samples.areas @ tints) / max(float(samples.areas.sum()), 1e-30)
    return np.ascontiguousarray(mean.T, np.float32).reshape(3, *grid.shape)
