"""OpenGL: the one place that makes a context, and the textures and framebuffers that passes share."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.errors import InputError
from milkglass.viewer.gl import egl

T = TypeVar("T")

INSTALL_HINT = "apt-get install libegl1 libgl1 libgl1-mesa-dri"
GLSL_VERSION = 330
FORKED = (
    "OpenGL was in use before this process was forked, which its drivers do not survive: start the process with "
    'multiprocessing\'s method "spawn", or fork before anything is drawn'
)
OCCUPIED = "a window's or another library's OpenGL context is current in this thread; draw in another thread"


@dataclass(eq=False)
class _Turns:
    """Which thread has a context: one at a time, each as often as it likes (`moderngl.Context.extra`).

    Attributes
    ----------
    framebuffer : moderngl.Framebuffer
        Of one pixel.
    of_window : bool
        Whether a window's toolkit keeps the context current in the thread that made it.
    handle : int, optional
        EGL's name of the context.
    depth : int
        How many blocks of `current` the thread that has the context is in.
    before : egl.Binding, optional
        What that thread had of EGL's before it entered the first of them.
    """

    framebuffer: moderngl.Framebuffer
    of_window: bool
    handle: int | None = None
    process: int = field(default_factory=os.getpid)
    thread: int = field(default_factory=threading.get_ident)
    lock: threading.RLock = field(default_factory=threading.RLock)
    depth: int = 0
    before: egl.Binding | None = None


class _Process:
    """The context without a window of this process, and whether its parent has used OpenGL."""

    def __init__(self, *, parent_used_opengl: bool) -> None:
        self.making = threading.Lock()
        self.context: moderngl.Context | None = None
        self.has_window = False
        self.parent_used_opengl = parent_used_opengl

    def forked(self) -> "_Process":
        """Return that of a child: its lock is free, whichever thread of the parent held the parent's."""
        return _Process(parent_used_opengl=self.parent_used_opengl or self.has_window or self.context is not None)


_process = _Process(parent_used_opengl=False)


def _after_fork() -> None:
    global _process
    _process = _process.forked()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def headless_context() -> moderngl.Context:
    """Return the process's context without a window, current in no thread: EGL on Linux, the platform's own elsewhere.

    Raises
    ------
    InputError
        If there is no EGL or no driver for OpenGL 3.3; the sentence says what to install. Also in a process that was
        forked from one that had a context.
    """
    with _process.making:
        if _process.context is None:
            if _process.parent_used_opengl:
                raise InputError(FORKED)
            _process.context = _made_headless()
        return _process.context


def _made_headless() -> moderngl.Context:
    options: dict[str, Any] = {}
    if sys.platform.startswith("linux"):
        # The versioned names: the bare ones exist only where development packages are installed.
        options = {"backend": "egl", "libgl": "libGL.so.1", "libegl": egl.LIBRARY}
    before = egl.binding()
    try:
        context = moderngl.create_context(standalone=True, require=GLSL_VERSION, **options)
    except Exception as problem:  # glcontext raises bare Exception
        reason = str(problem).strip().rstrip(".") or type(problem).__name__
        raise InputError(
            f"cannot create an OpenGL 3.3 context ({reason}); install a driver, on Debian and Ubuntu: {INSTALL_HINT}"
        ) from None
    bound = egl.binding()
    if options and (bound is None or bound == before):
        raise InputError(OCCUPIED)
    prepare_context(context)
    context.extra.before, context.extra.handle = before, bound and bound.context
    _leave(context)  # making it made it current
    return context


def window_context() -> moderngl.Context:
    """Return a context for the window whose own context is current in this thread, and stays so.

    Raises
    ------
    InputError
        If it is older than OpenGL 3.3.
    """
    try:
        context = moderngl.create_context(require=GLSL_VERSION)
    except Exception as problem:  # glcontext raises bare Exception
        raise InputError(f"the window has no OpenGL 3.3 ({problem}); install a driver") from None
    _process.has_window = True
    return prepare_context(context, of_window=True)


def prepare_context(context: moderngl.Context, *, of_window: bool = False) -> moderngl.Context:
    """Set what every pass takes for granted on a context that is current in this thread, and return it."""
    # The last reference to a texture may go in any thread, and the garbage collector runs in all of them: what is
    # dropped waits in a queue for the thread that has the context, see `free_dropped`.
    context.gc_mode = "context_gc"
    context.extra = _Turns(context.simple_framebuffer((1, 1)), of_window)
    return context


@contextmanager
def current(context: moderngl.Context) -> Iterator[moderngl.Context]:
    """Make a context current in this thread until the block ends; other threads wait for their turn.

    Blocks nest. A window's context is current already, in one thread for good.

    Raises
    ------
    InputError
        In a process that was forked from the context's, or where another library's context cannot be replaced.
    """
    turns: _Turns = context.extra
    if turns.process != os.getpid():
        raise InputError(FORKED)
    if turns.of_window and turns.thread != threading.get_ident():
        raise RuntimeError("the window's OpenGL context is used outside the window's thread")
    with turns.lock:
        if turns.depth == 0 and not turns.of_window:
            _enter(context)
        turns.depth += 1
        try:
            yield context
        finally:
            turns.depth -= 1
            if turns.depth == 0 and not turns.of_window:
                _leave(context)


def _enter(context: moderngl.Context) -> None:
    turns: _Turns = context.extra
    turns.before = egl.binding()
    context.mglo.__enter__()
    have = egl.binding()
    if turns.handle is not None and (have is None or have.context != turns.handle):
        raise InputError(OCCUPIED)
    free_dropped(context)


def _leave(context: moderngl.Context) -> None:
    free_dropped(context)
    leave_framebuffer(context)
    context.mglo.__exit__(None, None, None)
    if context.extra.before is not None:
        egl.bind(context.extra.before)


def leave_framebuffer(context: moderngl.Context) -> None:
    """Bind a framebuffer of one pixel that lives as long as the context.

    Making a framebuffer, moderngl binds the one that was bound before; if that is gone, it is GL_INVALID_OPERATION.
    So leave a framebuffer before it is released.
    """
    context.extra.framebuffer.use()


def free_dropped(context: moderngl.Context) -> None:
    """Free what was dropped by whichever thread; for the thread that has the context."""
    while context.objects:
        dropped = context.objects.popleft()
        if hasattr(dropped, "release"):  # moderngl queues what was released by hand too, and its own gc() trips over it
            dropped.release()


def bind_cleared(framebuffer: moderngl.Framebuffer, depth: float = 1.0) -> None:
    """Bind a framebuffer and clear it: its colours to 0, its depth to `depth`.

    Clearing a framebuffer that is not bound, moderngl keeps to the scissor of the one that is.
    """
    framebuffer.use()
    framebuffer.clear(depth=depth)


@contextmanager
def band(framebuffer: moderngl.Framebuffer, low: int, rows: int) -> Iterator[None]:
    """Bind a framebuffer, and draw into its rows from `low` on alone, until the block ends.

    A context's scissor is that of whichever framebuffer is bound, which between the steps of a stage may be any.
    """
    framebuffer.use()
    framebuffer.scissor = 0, low, framebuffer.width, rows
    try:
        yield
    finally:
        framebuffer.scissor = None  # type: ignore[assignment]  # as moderngl allows


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


def draw_over_object(
    context: moderngl.Context, triangle: moderngl.VertexArray, *, has_depth: bool, adds: bool = True
) -> None:
    """Draw a full-screen triangle, at the far plane, where the object is: all else costs nothing if depth is known.

    It `adds` to what is there, or else replaces it.
    """
    context.enable_only((moderngl.BLEND if adds else 0) | (moderngl.DEPTH_TEST if has_depth else 0))
    context.blend_func = moderngl.ONE, moderngl.ONE
    context.depth_func = ">"
    triangle.render(vertices=3)
    context.depth_func = "<"


def read_rgba(texture: moderngl.Texture) -> npt.NDArray[np.float32]:
    """Read a float texture back: (height, width, 4) float32, top row first."""
    width, height = texture.size
    values = np.empty((height, width, 4), np.float32)
    with current(texture.ctx):
        texture.read_into(values)
    return values[::-1]


def checked(context: moderngl.Context, allocate: Callable[[], T], purpose: str) -> T:
    """Return what a function allocates on the GPU, after dropped objects are freed; a failure raises `InputError`.

    `purpose` names the allocation in the message, which says so where memory is out.
    """
    free_dropped(context)
    try:
        result = allocate()
    except Exception as problem:  # moderngl.Error and what drivers add
        if context.error == "GL_OUT_OF_MEMORY":
            raise InputError(_no_memory(purpose)) from None
        raise InputError(f"the GPU cannot make {purpose}: {problem}") from None
    if context.error == "GL_OUT_OF_MEMORY":
        raise InputError(_no_memory(purpose))
    return result


def _no_memory(purpose: str) -> str:
    return f"the GPU has no memory left for {purpose}; ask for fewer pixels, layers or texels"


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
    purpose = f"{n_layers} layers of {width} x {height}"
    texture = checked(
        context, lambda: context.texture3d((width, height, n_layers), components, data, dtype="f4"), purpose
    )
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
