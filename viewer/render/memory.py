"""The C library's heap, whose size counts at the peak: it keeps what was freed, and OpenGL's textures come on top."""

import ctypes
import sys
from collections.abc import Callable

_ARENA_MAX = -8  # M_ARENA_MAX of malloc.h


def share_heap() -> None:
    """Let all threads allocate from one heap, for a process that makes a single picture; before they start.

    With heaps of their own, each thread of transport leaves 20 MB that nobody else can use nor give back. Our threads
    rarely allocate: they do not get into each other's way.
    """
    set_option = _glibc("mallopt")
    if set_option is not None:
        set_option(_ARENA_MAX, 1)


def give_back() -> None:
    """Return freed memory to the system."""
    trim = _glibc("malloc_trim")
    if trim is not None:
        trim(0)


def _glibc(name: str) -> Callable[..., int] | None:
    """A function of glibc's own; None with another C library."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
