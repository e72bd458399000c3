"""Draws Dear ImGui's triangles with moderngl, into a window or a framebuffer without one."""

import ctypes
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.viewer.gl.program import Program
from milkglass.viewer.gui.toolkit import imgui

VERTEX = np.dtype([("a_position", "2f4"), ("a_uv", "2f4"), ("a_colour", "4u1")])  # ImDrawVert
GROWTH = 2  # buffers double, so that a growing list seldom needs a new one


class ImguiRenderer:
    """Keeps the textures of one ImGui context and draws its lists.

    Parameters
    ----------
    context : moderngl.Context
    """

    def __init__(self, context: moderngl.Context) -> None:
        assert VERTEX.itemsize == imgui.VERTEX_SIZE
        self._context = context
        self._program = Program(context, "imgui.vert", "imgui.frag")
        self._fonts: dict[int, moderngl.Texture] = {}  # textures that ImGui asks for
        self._shown: dict[int, moderngl.Texture] = {}  # pictures of this frame
        self._vertices = self._indices = None
        self._array: moderngl.VertexArray | None = None

    def show(self, texture: moderngl.Texture | moderngl.Renderbuffer) -> Any:
        """Return a texture as ImGui's image functions take it; to be called in every frame that shows it."""
        assert isinstance(texture, moderngl.Texture)
        self._shown[texture.glo] = texture
        return imgui.ImTextureRef(texture.glo)

    def draw(self, data: Any, target: Any, pixels: tuple[int, int]) -> None:
        """Draw a frame's `imgui.get_draw_data()` into a `moderngl.Framebuffer` of (width, height) pixels.

        The size is given because moderngl does not know that of a window's own framebuffer once it has changed.
        """
        self._update_textures()
        scale = tuple(data.framebuffer_scale)
        lists = [commands for commands in data.cmd_lists if commands.idx_buffer.size()]
        if not lists or min(data.display_size) <= 0.0:
            self._shown.clear()
            return
        array = self._upload(lists)
        context = self._context
        target.use()
        context.enable_only(moderngl.BLEND)
        # Colour over, and coverage that stays what a transparent screenshot needs.
        over = moderngl.ONE_MINUS_SRC_ALPHA
        context.blend_func = moderngl.SRC_ALPHA, over, moderngl.ONE, over  # type: ignore[assignment]
        size = tuple(data.display_size)
        first = 0
        bound = None
        for commands in lists:
            for command in commands.cmd_buffer:
                box = _scissor(command.clip_rect, data.display_pos, scale, pixels)
                texture = self._texture(command.get_tex_id())
                if box is None or texture is None:
                    continue
                target.scissor = box
                if texture is not bound:
                    self._program.set({"u_display_size": size, "t_texture": texture})
                    bound = texture
                array.render(moderngl.TRIANGLES, vertices=command.elem_count, first=first + command.idx_offset)
            first += commands.idx_buffer.size()
        target.scissor = None
        self._shown.clear()

    def release(self) -> None:
        """Free the textures that ImGui asked for."""
        for texture in self._fonts.values():
            texture.release()
        self._fonts.clear()

    def _texture(self, identity: int) -> moderngl.Texture | None:
        return self._shown.get(identity) or self._fonts.get(identity)

    def _update_textures(self) -> None:
        """Do what ImGui asks for: fonts grow as glyphs and sizes come into use."""
        for wanted in imgui.get_platform_io().textures:
            status = imgui.ImTextureStatus(wanted.status)
            if status == imgui.ImTextureStatus.want_create:
                texture = self._context.texture((wanted.width, wanted.height), 4, _pixels(wanted))
                self._fonts[texture.glo] = texture
                wanted.set_tex_id(texture.glo)
            elif status == imgui.ImTextureStatus.want_updates:
                self._fonts[wanted.tex_id].write(_pixels(wanted))
            elif status == imgui.ImTextureStatus.want_destroy and wanted.unused_frames > 0:
                texture = self._fonts.pop(wanted.tex_id)
                texture.release()
                wanted.set_tex_id(0)
                wanted.set_status(imgui.ImTextureStatus.destroyed)
                continue
            else:
                continue
            wanted.set_status(imgui.ImTextureStatus.ok)

    def _upload(self, lists: list[Any]) -> moderngl.VertexArray:
        """Put the vertices and indices of all lists behind each other."""
        vertices, indices, base = [], [], 0
        for commands in lists:
            vertices.append(_view(commands.vtx_buffer, VERTEX.itemsize).view(VERTEX))
            triangles = _view(commands.idx_buffer, imgui.INDEX_SIZE).view(f"u{imgui.INDEX_SIZE}")
            indices.append(triangles.astype(np.uint32) + np.uint32(base))
            base += len(vertices[-1])
        self._write("_vertices", np.concatenate(vertices))
        self._write("_indices", np.concatenate(indices))
        if self._array is None:
            content = [(self._vertices, "2f4 2f4 4f1", "a_position", "a_uv", "a_colour")]
            self._array = self._context.vertex_array(self._program.program, content, self._indices)
        return self._array

    def _write(self, name: str, values: npt.NDArray[Any]) -> None:
        buffer = getattr(self, name)
        if buffer is None or buffer.size < values.nbytes:
            if self._array is not None:
                self._array.release()
                self._array = None
            if buffer is not None:
                buffer.release()
            buffer = self._context.buffer(reserve=values.nbytes * GROWTH)
            setattr(self, name, buffer)
        buffer.orphan()
        buffer.write(values)


def _view(vector: Any, itemsize: int) -> npt.NDArray[np.uint8]:
    """Bytes of one of ImGui's vectors, not copied: valid until its next frame."""
    count = vector.size() * itemsize
    return np.ctypeslib.as_array((ctypes.c_uint8 * count).from_address(vector.data_address()))


def _pixels(texture: Any) -> bytes:
    values = np.asarray(texture.get_pixels_array(), np.uint8).reshape(texture.height, texture.width, -1)
    if values.shape[2] == 1:  # coverage alone
        values = np.concatenate([np.full((*values.shape[:2], 3), 255, np.uint8), values], axis=2)
    return values.tobytes()


def _scissor(
    clip: Any, origin: Any, scale: tuple[float, ...], size: tuple[int, int]
) -> tuple[int, int, int, int] | None:
    """A clip rectangle (left, top, right, bottom; y down) as OpenGL's (x, y, width, height), None where empty."""
    left = max(0, int((clip.x - origin.x) * scale[0]))
    top = max(0, int((clip.y - origin.y) * scale[1]))
    right = min(size[0], int((clip.z - origin.x) * scale[0]))
    bottom = min(size[1], int((clip.w - origin.y) * scale[1]))
    if right <= left or bottom <= top:
        return None
    return left, size[1] - bottom, right - left, bottom - top


Show = Callable[[moderngl.Texture], Any]
