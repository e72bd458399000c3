"""Sketch: a model in clay, whose light needs no more than its normals."""

import moderngl

from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.program import Program
from milkglass.viewer.scene.camera import Camera


class SketchPass:
    """Rasterises a mesh as clay under one wide light from above the eye."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "sketch.vert", "sketch.frag")

    def render(self, buffers: MeshBuffers, camera: Camera, target: moderngl.Framebuffer) -> None:
        """Draw the mesh into a framebuffer with a depth buffer, over what is in its viewport; sRGB, both sides."""
        target.use()
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._program.set({"u_world_to_clip": camera.world_to_clip, "u_world_to_view": camera.rotation})
        vertices = buffers.positions_and_normals(self._program)
        vertices.render()
        vertices.release()
