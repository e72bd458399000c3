"""Detail: colour and relief of the visible surface at every pixel, where the model has any."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.geometry.detail import MeshDetail
from milkglass.core.geometry.texture import COLOUR, Texture
from milkglass.viewer.gl.context import bind_cleared, checked, driver_name, float_targets
from milkglass.viewer.gl.program import Program

SRGB8 = 0x8C41  # OpenGL's internal format
MAX_ANISOTROPY = 8.0  # of the texture filter, where a GPU has it


@dataclass(frozen=True, eq=False)
class DetailBuffer:
    """Colour and shading normal of the visible surface as float textures of one image size, see detail.frag."""

    colour: moderngl.Texture
    shading: moderngl.Texture
    framebuffer: moderngl.Framebuffer


@dataclass(frozen=True)
class Group:
    """Range of the index buffer that holds the faces of one texture set."""

    texture_set: int
    first: int
    count: int


class DetailBuffers:
    """A mesh with its colours and textures on the GPU."""

    def __init__(self, context: moderngl.Context, detail: MeshDetail) -> None:
        self.detail, vertices = detail, detail.vertices
        order = np.argsort(detail.texture_set, kind="stable")
        counts = np.bincount(detail.texture_set, minlength=len(detail.texture_sets))
        starts = np.cumsum(counts) - counts
        self.groups = [
            Group(i, int(first), int(n)) for i, (first, n) in enumerate(zip(starts, counts, strict=True)) if n
        ]
        columns = vertices.positions, vertices.normals, vertices.coordinates, vertices.colours, vertices.tangents
        self.vertices = context.buffer(np.concatenate(columns, axis=1).astype(np.float32))
        self.faces = context.buffer(np.ascontiguousarray(vertices.faces[order]))
        self._textures: dict[Texture, moderngl.Texture] = {}
        self._white = context.texture((1, 1), 3, b"\xff\xff\xff", alignment=1)
        for textures in detail.texture_sets:
            for texture in (textures.colour, textures.normal):
                if texture is not None and texture not in self._textures:
                    self._textures[texture] = _upload(context, texture)

    def texture(self, texture: Texture | None) -> moderngl.Texture:
        """Return the uploaded texture, or a white one for None."""
        return self._white if texture is None else self._textures[texture]


class DetailPass:
    """Rasterises a mesh with its own vertices: texture coordinates may jump where the surface does not."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = Program(context, "detail.vert", "detail.frag")

    def targets(self, size: tuple[int, int]) -> DetailBuffer:
        """Allocate the textures of (width, height) pixels that `render` fills."""
        colour, shading = float_targets(self._context, size, 2)
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        return DetailBuffer(colour, shading, self._context.framebuffer([colour, shading], depth))

    def render(
        self, buffers: DetailBuffers, world_to_clip: npt.NDArray[np.float64], strength: float, target: DetailBuffer
    ) -> None:
        """Draw the mesh through a world-to-clip matrix (4, 4), row vectors; slopes of relief are times `strength`."""
        bind_cleared(target.framebuffer)
        self._context.enable_only(moderngl.DEPTH_TEST)
        attributes = ("a_position", "a_normal", "a_coordinates", "a_colour", "a_tangent")
        content = [(buffers.vertices, "3f 3f 2f 3f 4f", *attributes)]
        vertices = self._context.vertex_array(self._program.program, content, buffers.faces)
        for group in buffers.groups:
            texture_set = buffers.detail.texture_sets[group.texture_set]
            self._program.set(
                {
                    "u_world_to_clip": world_to_clip,
                    "u_factor": texture_set.factor,
                    "u_has_colours": texture_set.colour is not None,
                    "t_colours": buffers.texture(texture_set.colour),
                    "u_has_relief": texture_set.normal is not None and strength > 0.0,
                    "t_relief": buffers.texture(texture_set.normal),
                    "u_strength": strength,
                }
            )
            vertices.render(vertices=3 * group.count, first=3 * group.first)
        vertices.release()


def _upload(context: moderngl.Context, texture: Texture) -> moderngl.Texture:
    """Make a texture with its mip levels that repeats; colours are decoded before they are filtered."""
    width, height = texture.size
    largest = int(context.info["GL_MAX_TEXTURE_SIZE"])
    pixels, step = texture.pixels, -(-max(width, height) // largest)
    if step > 1:
        pixels = np.ascontiguousarray(pixels[::step, ::step])
    internal = SRGB8 if texture.kind == COLOUR else None
    size = pixels.shape[1], pixels.shape[0]
    uploaded = checked(
        context,
        lambda: context.texture(size, 3, pixels, alignment=1, internal_format=internal),
        f"a texture of {width} x {height}",
    )
    uploaded.build_mipmaps()
    uploaded.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    uploaded.repeat_x = uploaded.repeat_y = True
    if "llvmpipe" not in driver_name(context):  # which takes many times longer for it
        uploaded.anisotropy = min(MAX_ANISOTROPY, context.max_anisotropy)
    return uploaded
