"""G-buffer: position, normal and body of the visible surface at every pixel."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import bind_cleared, checked, float_targets
from milkglass.viewer.gl.program import Program
from milkglass.viewer.passes.detail_uniforms import Drawn
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.reentry import ReentryTargets


@dataclass(frozen=True, eq=False)
class GBuffer:
    """Position and normal of the visible surface as float textures of one image size.

    The alpha of `position` is 1 where the object is, that of `normal` is the body: clear parts after those that
    scatter.

    `visible` is there where the environment's light is occluded, `lobe` where its highlights are: see
    `viewer.render.occlusion` and `viewer.passes.highlights`; `detail` where the surface has colours or relief,
    `reentry` where light enters again.
    """

    position: moderngl.Texture
    normal: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    visible: moderngl.Texture | None = None
    lobe: moderngl.Texture | None = None
    detail: Drawn | None = None
    reentry: ReentryTargets | None = None


@dataclass(frozen=True, eq=False)
class ClearBuffers:
    """Clear parts of an object, with the body of each vertex, one float."""

    mesh: MeshBuffers
    bodies: moderngl.Buffer


@dataclass(frozen=True, eq=False)
class LitVertices:
    """Light at the vertices of a mesh on the GPU; compared by identity.

    Attributes
    ----------
    mesh : MeshBuffers
    exitance : buffer
        M, three floats a vertex.
    first_lamps, last_lamps : buffers
        Visible shares of up to MOST_LAMPS lamps, three floats a vertex each.
    """

    mesh: MeshBuffers
    exitance: moderngl.Buffer
    first_lamps: moderngl.Buffer
    last_lamps: moderngl.Buffer


class GBufferPass:
    """Rasterises the mesh into a G-buffer."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "gbuffer.vert", "gbuffer.frag")
        self._bodies_program = Program(context, "gbuffer.vert", "gbuffer.frag", bodies=True)
        self._visible_program = Program(context, "gbuffer.vert", "gbuffer.frag", bodies=True, visible=True)
        self._lit_program = Program(context, "gbuffer.vert", "gbuffer.frag", bodies=True, lit=True)
        # What all vertices share where nothing better is known of each.
        constant = [np.ones(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(1)]
        self._all, self._no_lobe, self._one_body = (context.buffer(values.astype("f4")) for values in constant)

    def depth(self, size: tuple[int, int]) -> moderngl.Renderbuffer:
        """Allocate a depth buffer of (width, height) pixels."""
        return checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")

    def targets(
        self,
        size: tuple[int, int],
        *,
        occluded: bool = False,
        lobes: bool = False,
        depth: moderngl.Renderbuffer | None = None,
    ) -> GBuffer:
        """Allocate a G-buffer of (width, height) pixels, with a `depth` that others read too if it is given."""
        position, normal, *visible = float_targets(self._context, size, 2 + occluded + lobes)
        framebuffer = self._context.framebuffer([position, normal, *visible], depth or self.depth(size))
        return GBuffer(position, normal, framebuffer, visible[0] if occluded else None, visible[-1] if lobes else None)

    def render(
        self,
        buffers: MeshBuffers,
        world_to_clip: npt.NDArray[np.float64],
        target: GBuffer,
        bodies: moderngl.Buffer | None = None,
        occlusion: Occlusion | None = None,
        behind: moderngl.Buffer | None = None,
        lobes: moderngl.Buffer | None = None,
        clear: "ClearBuffers | None" = None,
    ) -> None:
        """Draw the mesh seen through a world-to-clip matrix (4, 4), row vectors; both sides of open meshes.

        `bodies` holds the body of each vertex where there are several. `buffers` are those of an `occlusion`, if there
        is one; of it, `behind` and `lobes` (`viewer.passes.highlights`) where they are wanted. `clear` parts are drawn
        with it.
        """
        bind_cleared(target.framebuffer)
        program = self._program if bodies is None else self._bodies_program
        if occlusion is not None:
            program = self._visible_program
            vertices = buffers.with_values(
                program,
                {
                    "a_visible": (occlusion.values, "3f"),
                    "a_behind": (self._all, "3f/i") if behind is None else (behind, "3f"),
                    **self._of_vertices(bodies, lobes),
                },
            )
        else:
            vertices = buffers.positions_and_normals(program, bodies)
        drawn = [(program, vertices, buffers.culling(world_to_clip))]
        if clear is not None:
            program = self._visible_program if occlusion is not None else self._bodies_program
            all_seen = {
                "a_visible": (self._all, "3f/i"),
                "a_behind": (self._all, "3f/i"),
                "a_lobe": (self._no_lobe, "4f/i"),
            }
            of_bodies = {"a_body": (clear.bodies, "1f")}
            of_clear = clear.mesh.with_values(program, all_seen | of_bodies if occlusion else of_bodies)
            drawn.append((program, of_clear, 0))
        self._draw(drawn, world_to_clip)

    def render_lit(
        self,
        light: LitVertices,
        world_to_clip: npt.NDArray[np.float64],
        target: GBuffer,
        bodies: moderngl.Buffer | None = None,
        lobes: moderngl.Buffer | None = None,
    ) -> None:
        """Draw a mesh as `render` does, with the light that is known at its vertices in place of `visible`."""
        bind_cleared(target.framebuffer)
        values = {
            "a_exitance": (light.exitance, "3f"),
            "a_first_lamps": (light.first_lamps, "3f"),
            "a_last_lamps": (light.last_lamps, "3f"),
            **self._of_vertices(bodies, lobes),
        }
        vertices = light.mesh.with_values(self._lit_program, values)
        self._draw([(self._lit_program, vertices, light.mesh.culling(world_to_clip))], world_to_clip)

    def _of_vertices(
        self, bodies: moderngl.Buffer | None, lobes: moderngl.Buffer | None
    ) -> dict[str, tuple[moderngl.Buffer, str]]:
        """Return the attributes of each vertex that may be alike for all of them."""
        return {
            "a_lobe": (self._no_lobe, "4f/i") if lobes is None else (lobes, "4f"),
            "a_body": (self._one_body, "1f/i") if bodies is None else (bodies, "1f"),
        }

    def _draw(
        self, drawn: list[tuple[Program, moderngl.VertexArray, int]], world_to_clip: npt.NDArray[np.float64]
    ) -> None:
        for program, vertices, culling in drawn:
            self._context.enable_only(moderngl.DEPTH_TEST | culling)
            program.set({"u_world_to_clip": world_to_clip})
            vertices.render()
            vertices.release()
