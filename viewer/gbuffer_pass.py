"""G-buffer: position, normal and body of the visible surface at every pixel."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from viewer.buffers import MeshBuffers
from viewer.detail import Drawn
from viewer.gl import Program, checked, float_targets
from viewer.occlusion import Occlusion


@dataclass(frozen=True, eq=False)
class GBuffer:
    """Float textures of one image size; position's alpha is 1 where the object is, normal's is the body.

    `visible` is there where the environment's light is occluded, see `viewer.occlusion`; `detail` where the surface
    has colours or relief.
    """

    position: moderngl.Texture
    normal: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    visible: moderngl.Texture | None = None
    detail: Drawn | None = None


class GBufferPass:
    """Rasterises the mesh."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "gbuffer.vert", "gbuffer.frag")
        self._bodies_program = Program(context, "gbuffer_bodies.vert", "gbuffer_bodies.frag")
        self._visible_program = Program(context, "gbuffer_visible.vert", "gbuffer_visible.frag")

    def targets(self, size: tuple[int, int], occluded: bool = False) -> GBuffer:
        """Allocate a G-buffer of (width, height) pixels."""
        position, normal, *visible = float_targets(self._context, size, 3 if occluded else 2)
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        framebuffer = self._context.framebuffer([position, normal, *visible], depth)
        return GBuffer(position, normal, framebuffer, visible[0] if visible else None)

    def render(
        self,
        buffers: MeshBuffers,
        world_to_clip: npt.NDArray[np.float64],
        out: GBuffer,
        bodies: moderngl.Buffer | None = None,
        occlusion: Occlusion | None = None,
    ) -> None:
        """Draw the mesh seen through a world-to-clip matrix (4, 4), row vectors; both sides of open meshes.

        `bodies` holds the body of each vertex where there are several; of its mesh if there is an `occlusion`.
        """
        out.framebuffer.use()
        out.framebuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        program = self._program if bodies is None else self._bodies_program
        if occlusion is not None:
            program = self._visible_program
            vertices = occlusion.buffers.visible(program, occlusion.values, bodies or occlusion.no_body)
        else:
            vertices = buffers.positions_and_normals(program, bodies)
        program.set({"u_world_to_clip": world_to_clip})
        vertices.render()
        vertices.release()
