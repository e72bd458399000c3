"""EGL's word on which context a thread has; glcontext makes contexts current, and does not say whether it could."""

import ctypes
import functools
import sys
from typing import Any, NamedTuple

LIBRARY = "libEGL.so.1"  # the versioned name: the bare one exists only where development packages are installed
DRAW, READ = 0x3059, 0x305A


class Binding(NamedTuple):
    """A context that is current in a thread, and what it draws to and reads from."""

    display: int
    draw: int | None
    read: int | None
    context: int


def binding() -> Binding | None:
    """Return the binding of this thread; None where no context of EGL is current."""
    egl = _egl()
    context = None if egl is None else egl.eglGetCurrentContext()
    if context is None:
        return None
    surfaces = egl.eglGetCurrentSurface(DRAW), egl.eglGetCurrentSurface(READ)
    return Binding(egl.eglGetCurrentDisplay(), *surfaces, context)


def bind(before: Binding) -> None:
    """Make the context of a binding current in this thread again."""
    _egl().eglMakeCurrent(*before)


@functools.cache
def _egl() -> Any:
    if not sys.platform.startswith("linux"):
        return None
    try:
        egl = ctypes.CDLL(LIBRARY)
    except OSError:  # there will be no context either
        return None
    pointer = ctypes.c_void_p
    egl.eglGetCurrentContext.restype = egl.eglGetCurrentDisplay.restype = egl.eglGetCurrentSurface.restype = pointer
    egl.eglMakeCurrent.argtypes = [pointer] * 4
    return egl
