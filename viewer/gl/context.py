"""OpenGL: the one place that makes a context, and the textures and framebuffers that passes share."""

import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError

T = TypeVar("T")

INSTALL_HINT = "apt-get install libegl1 libgl1 libgl1-mesa-dri"
GLSL_VERSION = 330


@lru_cache(maxsize=1)
def headless_context() -> moderngl.Context:
    """Return the process's context without a window: EGL on Linux, the platform's own elsewhere.

    Raises
    ------
    InputError
        If there is no EGL or no driver for OpenGL 3.3; the sentence says what to install.
    """
    options: dict[str, Any] = {}
    if sys.platform.startswith("linux"):
        # The versioned names: the bare ones exist only where development packages are installed.
        options = {"backend": "egl", "libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
    try:
        context = moderngl.create_context(standalone=True, require=GLSL_VERSION, **options)
    except Exception as problem:  # glcontext raises bare Exception
        reason = str(problem).strip().rstrip(".") or type(problem).__name__
        raise InputError(
            f"cannot create an OpenGL 3.3 context ({reason}); install a driver, on Debian and Ubuntu: {INSTALL_HINT}"
        ) from None
    return prepare_context(context)


def window_context() -> moderngl.Context:
    """Return a context for the window whose own context is current in this thread.

    Raises
    ------
    InputError
        If it is older than OpenGL 3.3.
    """
    try:
        context = moderngl.create_context(require=GLSL_VERSION)
    except Exception as problem:  # glcontext raises bare Exception
        raise InputError(f"the window has no OpenGL 3.3 ({problem}); install a driver") from None
    return prepare_context(context)


def prepare_context(context: moderngl.Context) -> moderngl.Context:
    """Set what every pass takes for granted; for windows' contexts too."""
    context.gc_mode = "auto"
    context.extra = context.simple_framebuffer((1, 1))
    return context


def leave_framebuffer(context: moderngl.Context) -> None:
    """Bind a framebuffer of one pixel that lives as long as the context.

    Making a framebuffer, moderngl binds the one that was bound before; if that is gone, it is GL_INVALID_OPERATION.
    So leave a framebuffer before it is released.
    """
    context.extra.use()


def free_dropped(context: moderngl.Context) -> None:
    """Free what was dropped while `gc_mode` is "context_gc", by whichever thread; for the one that draws."""
    while context.objects:
        dropped = context.objects.popleft()
        if hasattr(dropped, "release"):  # moderngl queues what was released by hand too, and its own gc() trips over it
            dropped.release()


def driver_name(context: moderngl.Context) -> str:
    """Name of the renderer, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
    return str(context.info["GL_RENDERER"])


def float_texture(context: moderngl.Context, size: tuple[int, int], components: int = 4) -> moderngl.Texture:
    """Return a 32-bit float texture that is read texel by texel."""
    texture = checked(
        context, lambda: context.texture(size, components, dtype="f4"), f"a texture of {size[0]} x {size[1]}"
    )
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def float_targets(context: moderngl.Context, size: tuple[int, int], count: int) -> list[moderngl.Texture]:
    """Return RGBA textures to render into."""
    return [float_texture(context, size) for _ in range(count)]


def over_object(
    context: moderngl.Context, textures: list[moderngl.Texture], depth: moderngl.Renderbuffer | None
) -> moderngl.Framebuffer:
    """Return a framebuffer for `draw_over_object`: depth of a G-buffer is tested, never changed."""
    framebuffer = context.framebuffer(textures, depth)
    framebuffer.depth_mask = False
    return framebuffer


def draw_over_object(context: moderngl.Context, triangle: moderngl.VertexArray, has_depth: bool) -> None:
    """Add a full-screen triangle, at the far plane, where the object is: all else costs nothing if depth is known."""
    context.enable_only(moderngl.BLEND | (moderngl.DEPTH_TEST if has_depth else 0))
    context.blend_func = moderngl.ONE, moderngl.ONE
    context.depth_func = ">"
    triangle.render(vertices=3)
    context.depth_func = "<"


def read_rgba(texture: moderngl.Texture) -> npt.NDArray[np.float32]:
    """Read a float texture back: (height, width, 4) float32, top row first."""
    width, height = texture.size
    values = np.empty((height, width, 4), np.float32)
    texture.read_into(values)
    return values[::-1]


def checked(context: moderngl.Context, allocate: Callable[[], T], what: str) -> T:
    """Allocate on the GPU; running out of memory becomes an `InputError`."""
    try:
        result = allocate()
    except Exception as problem:  # moderngl.Error and what drivers add
        raise InputError(f"the GPU cannot hold {what} ({problem}); ask for fewer pixels, layers or texels") from None
    if context.error == "GL_OUT_OF_MEMORY":
        raise InputError(f"the GPU has no memory left for {what}; ask for fewer pixels, layers or texels")
    return result


def latlong_texture(context: moderngl.Context, pixels: npt.NDArray[np.float32]) -> moderngl.Texture:
    """Upload a lat-long map (h, w, 3), row 0 at +y: linear filter, columns wrap around."""
    height, width, _ = pixels.shape
    values = np.ascontiguousarray(pixels, np.float32)
    texture = checked(context, lambda: context.texture((width, height), 3, values, dtype="f4"), "the environment")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x, texture.repeat_y = True, False
    return texture


def table_texture(context: moderngl.Context, values: npt.NDArray[np.floating]) -> moderngl.Texture:
    """Upload a table (n, 3) as a texture of one row, read with a linear filter, clamped at its ends."""
    return clamped_texture(context, values[None])


def clamped_texture(context: moderngl.Context, values: npt.NDArray[np.floating]) -> moderngl.Texture:
    """Upload a table (rows, columns, components), read with a linear filter, clamped at its edges."""
    rows, columns, components = values.shape
    texture = context.texture((columns, rows), components, np.ascontiguousarray(values, np.float32), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def volume_texture(context: moderngl.Context, values: npt.NDArray[np.floating]) -> moderngl.Texture3D:
    """Upload a volume (components, layers, height, width), read trilinearly, clamped at its edges."""
    components, n_layers, height, width = values.shape
    data = np.ascontiguousarray(np.moveaxis(values, 0, -1), np.float32)
    what = f"{n_layers} layers of {width} x {height}"
    texture = checked(context, lambda: context.texture3d((width, height, n_layers), components, data, dtype="f4"), what)
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = texture.repeat_z = False
    return texture


def check_image_size(context: moderngl.Context, size: tuple[int, int]) -> None:
    """Refuse an image larger than the GPU's textures; the sentence names the largest side."""
    largest = min(int(context.info["GL_MAX_TEXTURE_SIZE"]), *map(int, context.info["GL_MAX_VIEWPORT_DIMS"]))
    if max(size) > largest:
        raise InputError(
            f"display.image_size = {size[0]} x {size[1]} exceeds this GPU's limit; the largest side is {largest}"
        )
