"""Depth of the mesh as lights see it: views as tiles of one texture, and bodies where they are told apart."""

from collections.abc import Sequence

import moderngl

from milkglass.core.arrays import Array
from milkglass.core.stages import Steps
from milkglass.core.threads import computed_once
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import bind_cleared, checked, float_texture, leave_framebuffer
from milkglass.viewer.gl.program import Program


class DepthTiles:
    """Draws the tiles of shadow maps in one OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context

    @computed_once
    def _program(self) -> Program:
        return Program(self._context, "shadows.vert", "shadows.frag")

    @computed_once
    def _bodies_program(self) -> Program:
        return Program(self._context, "shadows.vert", "shadows.frag", bodies=True)

    @computed_once
    def no_bodies(self) -> moderngl.Texture:
        """Texture of one texel that stands for the bodies where they are not told apart."""
        return float_texture(self._context, (1, 1), 1)

    def texture(self, size: tuple[int, int], purpose: str) -> moderngl.Texture:
        """Allocate a depth texture that is read texel by texel; `purpose` names it in the error where memory is out."""
        texture = checked(self._context, lambda: self._context.depth_texture(size), purpose)
        texture.compare_func = ""
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def steps(
        self,
        texture: moderngl.Texture,
        columns: int,
        side: int,
        matrices: Sequence[Array] | Array,
        buffers: MeshBuffers,
        bodies: moderngl.Buffer | None,
    ) -> Steps[moderngl.Texture]:
        """Draw the mesh by each matrix, in rows of `columns` tiles of `side` texels; return the body at each texel."""
        program, body_texture, colours = self._program, self.no_bodies, []
        if bodies is not None:
            program, body_texture = self._bodies_program, float_texture(self._context, texture.size, 1)
            colours = [body_texture]
        framebuffer = self._context.framebuffer(colours, texture)
        bind_cleared(framebuffer)
        vertices = buffers.positions(program, bodies)
        for i, matrix in enumerate(matrices):
            if i > 0:
                yield None
            framebuffer.use()
            self._context.enable_only(moderngl.DEPTH_TEST)  # both sides cast: open meshes have no closed back
            framebuffer.viewport = (side * (i % columns), side * (i // columns), side, side)
            program.set({"u_world_to_clip": matrix})
            vertices.render()
            leave_framebuffer(self._context)
        vertices.release()
        framebuffer.release()
        return body_texture
