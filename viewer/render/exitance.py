"""Exitance at points of the surface, by the shaders of every picture."""

from dataclasses import replace

import moderngl
import numpy as np

from milkglass.core.arrays import Float32, Floats
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.stages import exhausted
from milkglass.viewer.gl.context import checked, float_texture, read_rgba
from milkglass.viewer.passes.composite import CompositePass
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.irradiance import Highlights, PixelIrradiancePass
from milkglass.viewer.passes.reentry import ReentryTargets
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.lights.sub_lights import PARTS
from milkglass.viewer.scene.settings import Gloss


class SurfaceExitance:
    """Computes exitance at points of a lit object in one OpenGL context, as pixels have it."""

    def __init__(
        self,
        context: moderngl.Context,
        irradiance: PixelIrradiancePass,
        composite: CompositePass,
        no_probe: moderngl.Texture,
    ) -> None:
        self._context, self._irradiance, self._composite = context, irradiance, composite
        self._no_probe = no_probe

    def at(self, samples: SurfaceSamples, lit: LitScene, gather: Gather) -> Float32:
        """Return exitance M at samples of the surface: (n, 3)."""
        n = len(samples)
        size = (int(np.ceil(np.sqrt(n))),) * 2

        def pixels(rgb: Floats, alpha: Floats | float) -> moderngl.Texture:
            values = np.zeros((size[0] * size[1], 4), np.float32)
            values[:n, :3], values[:n, 3] = rgb, alpha
            texture = float_texture(self._context, size)
            texture.write(values)
            return texture

        bodies: Floats | float = 0.0
        if lit.body_marks is not None:
            bodies = lit.body_marks.of_vertex[lit.model.mesh.faces[samples.faces, 0]]
        points, normals, occlusion = samples.points, samples.normals, lit.occlusion
        position, normal, visible, again = pixels(points, 1.0), pixels(normals, bodies), None, None
        if occlusion is not None:
            far_side = occlusion.surface.at(occlusion.surface.behind(occlusion.shares), points, normals)
            behind = np.rint(255.0 * far_side) @ (1.0, 256.0, 65536.0)  # visible.glsl
            visible = pixels(occlusion.at(points, normals), behind)
        # With depth, as of a picture: the driver would compile shaders anew for targets without.
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        self._context.framebuffer([], depth).clear(depth=0.0)
        targets = self._irradiance.targets(size, depth)
        sources = lit.sources
        if (reentry := gather.reentry) is not None:
            near, far = (
                pixels(reentry.surface.at(values, points, normals), 0.0)
                for values in (reentry.irradiance, reentry.behind)
            )
            again, sources = ReentryTargets(near, far, targets.framebuffer), (*sources, reentry.source)
        gbuffer = GBuffer(position, normal, targets.framebuffer, visible, reentry=again)
        no_highlights = Highlights(Gloss(0.0, 1.0, "none", normalized=False), self._no_probe)
        exhausted(self._irradiance.steps(gbuffer, sources, gather, no_highlights, lit.camera, targets, 0, PARTS))
        # Radiance without an interface and over 1 sr is exitance, by the shader of every picture.
        bare = replace(gather, eta=1.0, exit_normalisation=1.0)
        composite = self._composite.targets(size, parts=False, depth=depth)
        composite.framebuffer.clear()
        self._composite.render(gbuffer, targets, bare, no_highlights, lit.camera, 1.0, composite)
        exitance = read_rgba(composite.textures["radiance"])[::-1].reshape(-1, 4)[:n, :3]
        if lit.detail is not None and lit.detail.after > 0.0:
            detail = lit.detail.detail
            pieces = detail.pieces(points, samples.faces, samples.areas)
            exitance = exitance * detail.colour(pieces, lit.detail.after)
        return np.ascontiguousarray(exitance)
