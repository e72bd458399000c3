"""Vertex buffers of a mesh and of its surface samples: uploaded once, drawn by several passes."""

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.morton import morton_order
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.viewer.gl.context import leave_framebuffer
from milkglass.viewer.gl.program import Program


class MeshBuffers:
    """Vertices, normals and faces of a mesh on the GPU, the faces in Morton order.

    Drivers shade the vertices of a run of faces once: in the order of a file every vertex several times.

    Attributes
    ----------
    faces : buffer
        Three int32 a face.
    """

    def __init__(self, context: moderngl.Context, mesh: Mesh) -> None:
        self._context, self._mesh = context, mesh
        self._positions = context.buffer(mesh.vertices)
        self._normals = context.buffer(mesh.normals)
        order = morton_order(mesh.vertices[mesh.faces].mean(axis=1))
        self.faces = context.buffer(np.ascontiguousarray(mesh.faces[order]))

    def culling(self, world_to_clip: npt.NDArray[np.float64]) -> int:
        """Return the flag that culls back faces where a matrix (4, 4), row vectors, shows none of them, else 0.

        They may be seen of open surfaces, and where the near plane cuts the mesh.
        """
        if not self._mesh.outward:
            return 0
        near = world_to_clip[:, 2] + world_to_clip[:, 3]  # z + w > 0 before the near plane, of the bounding sphere too
        is_whole = near[3] > self._mesh.radius * np.linalg.norm(near[:3])
        return moderngl.CULL_FACE if is_whole else 0

    def positions(self, program: Program, bodies: moderngl.Buffer | None = None) -> moderngl.VertexArray:
        """Bind a program that reads ``a_position``, and ``a_body`` if given: one float a vertex."""
        content = [(self._positions, "3f", "a_position")]
        return self._bound(program, content, bodies)

    def positions_and_normals(self, program: Program, bodies: moderngl.Buffer | None = None) -> moderngl.VertexArray:
        """Bind a program that reads ``a_position`` and ``a_normal``, and ``a_body`` if given: one float a vertex."""
        content = [(self._positions, "3f", "a_position"), (self._normals, "3f", "a_normal")]
        return self._bound(program, content, bodies)

    def points(self, program: Program) -> moderngl.VertexArray:
        """Bind a program that reads ``a_position`` and ``a_normal`` of each vertex once."""
        content = [(self._positions, "3f", "a_position"), (self._normals, "3f", "a_normal")]
        return self._context.vertex_array(program.program, content)

    def with_values(self, program: Program, values: dict[str, tuple[moderngl.Buffer, str]]) -> moderngl.VertexArray:
        """Bind a program that reads more of each vertex, and perhaps no normal: buffers by attribute, with formats."""
        content = [(self._positions, "3f", "a_position")]
        if "a_normal" in program.program:
            content.append((self._normals, "3f", "a_normal"))
        attributes = [(buffer, layout, name) for name, (buffer, layout) in values.items()]
        return self._bound(program, content + attributes, None)

    def _bound(
        self, program: Program, content: list[tuple[moderngl.Buffer, str, str]], bodies: moderngl.Buffer | None
    ) -> moderngl.VertexArray:
        if bodies is not None:
            content.append((bodies, "1f", "a_body"))
        return self._context.vertex_array(program.program, content, self.faces)


class SampleBuffers:
    """Surface samples on the GPU, and the transform feedback that reads values of theirs back."""

    def __init__(self, context: moderngl.Context, samples: SurfaceSamples) -> None:
        self._context = context
        self.count = len(samples)
        self._positions = context.buffer(samples.points)
        self._normals = context.buffer(samples.normals)
        self._output = context.buffer(reserve=12 * self.count)

    def transform(self, program: Program, first: int = 0, count: int | None = None) -> memoryview:
        """Run a vertex program over all samples, or some; returns its one vec3 output, 12 bytes a sample."""
        count = self.count - first if count is None else count
        content = [(self._positions, "3f", "a_position")]
        if "a_normal" in program.program:
            content.append((self._normals, "3f", "a_normal"))
        vertices = self._context.vertex_array(program.program, content)
        # Nothing is rasterised, yet a surfaceless context refuses to draw without a complete framebuffer.
        leave_framebuffer(self._context)
        vertices.transform(self._output, moderngl.POINTS, count, first=first)
        vertices.release()
        return memoryview(self._output.read(12 * count))
