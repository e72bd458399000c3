"""The C library's heap, whose size counts at the peak: it keeps what was freed, and OpenGL's textures come on top."""

import ctypes
import re
import sys
from collections.abc import Callable
from pathlib import Path

from milkglass.core.errors import InputError

# Bytes of a pixel at the peak, measured from 512 x 512 to 4096 x 4096: of a picture alone, and with all its layers.
PICTURE_BYTES, LAYERS_BYTES = 110, 255
# Of malloc.h. Arrays of a MB or more are mapped on their own, so that their memory goes back when they go; the limit
# that glibc chooses grows to 32 MB, and what was freed below it stays, in pieces.
_ARENA_MAX, _MMAP_THRESHOLD, _OWN_BYTES = -8, -3, 2**20


def share_heap() -> None:
    """Let all threads allocate from one small heap, for a process that makes a single picture; before they start.

    With heaps of their own, each thread of transport leaves 20 MB that nobody else can use nor give back. Our threads
    rarely allocate: they do not get into each other's way.
    """
    set_option = _glibc("mallopt")
    if set_option is not None:
        set_option(_ARENA_MAX, 1)
        set_option(_MMAP_THRESHOLD, _OWN_BYTES)


def give_back() -> None:
    """Return freed memory to the system."""
    trim = _glibc("malloc_trim")
    if trim is not None:
        trim(0)


def check_size(size: tuple[int, int], *, layers: bool) -> None:
    """Raise `InputError` for a picture, of a width and height, that the machine has not the memory for at this moment.

    Where the system does not say how much there is, nothing is refused.
    """
    needed, available = size[0] * size[1] * (LAYERS_BYTES if layers else PICTURE_BYTES), available_bytes()
    if available is not None and needed > available:
        kind = " with all its layers" if layers else ""
        raise InputError(
            f"display.image_size: a picture of {size[0]}x{size[1]}{kind} takes about {needed / 1e9:.1f} GB of memory, "
            f"and {available / 1e9:.1f} are free; ask for a smaller --image-size"
        )


def available_bytes() -> int | None:
    """Return the memory that a process may still take, None where the system does not say."""
    free = _number("/proc/meminfo", r"MemAvailable:\s+(\d+) kB", 1024)
    most = _number("/sys/fs/cgroup/memory.max", r"(\d+)\s*", 1)  # of a container, whose caches count as used
    return min((limit for limit in (free, most) if limit is not None), default=None)


def _number(path: str, pattern: str, unit: int) -> int | None:
    """Return a number that a file of the system has, in bytes."""
    try:
        found = re.search(pattern, Path(path).read_text(encoding="ascii"))
    except OSError:
        return None
    return int(found[1]) * unit if found else None


def _glibc(name: str) -> Callable[..., int] | None:
    """A function of glibc's own; None with another C library."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
