"""Light that left the object and enters it again, by vertices of a refined mesh, drawn at the pixels."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.threads import computed_once
from milkglass.viewer.gl.context import bind_cleared, checked, float_targets
from milkglass.viewer.gl.program import Program
from milkglass.viewer.passes.light_source import LightSource
from milkglass.viewer.passes.refined import RefinedSurface


@dataclass(frozen=True, eq=False)
class Reentry:
    """Irradiance that enters again, of one solution; compared by identity.

    Attributes
    ----------
    surface : RefinedSurface
    irradiance : (n, 3) float32
        E at its vertices.
    source : LightSource
        That stands for it at the pixels.
    """

    surface: RefinedSurface
    irradiance: Float32
    source: LightSource

    @computed_once
    def behind(self) -> Float32:
        """Return E on the other side of the object, seen against each vertex' normal: (n, 3)."""
        return self.surface.behind(self.irradiance)


@dataclass(frozen=True, eq=False)
class ReentryTargets:
    """Float textures of E at every pixel, on its side and on the other, and the framebuffer that draws into them.

    Without thin parts, whose other side counts, both are one texture.
    """

    irradiance: moderngl.Texture
    behind: moderngl.Texture
    framebuffer: moderngl.Framebuffer


class ReentryPass:
    """Draws E of a `Reentry` at every pixel."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "reentry.vert", "reentry.frag")

    def targets(self, size: tuple[int, int], *, thin: bool) -> ReentryTargets:
        """Allocate textures of (width, height) pixels, two where parts are `thin`, with a depth buffer of their own."""
        textures = float_targets(self._context, size, 2 if thin else 1)
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        return ReentryTargets(textures[0], textures[-1], self._context.framebuffer(textures, depth))

    def upload(self, reentry: Reentry, *, thin: bool) -> tuple[moderngl.Buffer, moderngl.Buffer]:
        """Return E of the vertices and E on their other side, which is asked for where parts are `thin`."""
        values = self._context.buffer(reentry.irradiance)
        return values, self._context.buffer(reentry.behind) if thin else values

    def render(
        self,
        surface: RefinedSurface,
        values: tuple[moderngl.Buffer, moderngl.Buffer],
        world_to_clip: npt.NDArray[np.float64],
        target: ReentryTargets,
    ) -> None:
        """Draw what `upload` returned over its mesh, through a world-to-clip matrix (4, 4), row vectors."""
        bind_cleared(target.framebuffer)
        self._context.enable_only(moderngl.DEPTH_TEST | surface.buffers.culling(world_to_clip))
        content = {name: (buffer, "3f") for name, buffer in zip(("a_irradiance", "a_behind"), values, strict=True)}
        vertices = surface.buffers.with_values(self._program, content)
        self._program.set({"u_world_to_clip": world_to_clip})
        vertices.render()
        vertices.release()
