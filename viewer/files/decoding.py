"""Pictures that others' readers open with Pillow: of the formats of textures alone."""

import contextlib
import threading
from collections.abc import Iterator

from PIL import Image

TEXTURE_FORMATS = ("PNG", "JPEG", "MPO", "WEBP", "TIFF", "BMP", "TGA", "GIF", "DDS", "JPEG2000")
_lock = threading.Lock()


@contextlib.contextmanager
def textures_only() -> Iterator[None]:
    """Have Pillow open pictures of `TEXTURE_FORMATS` alone, by their content, while the block lasts.

    Pillow asks every decoder it has, whatever a file is called, and hands PostScript to Ghostscript: a texture would be
    a program that runs.
    """
    with _lock:
        Image.init()
        known = Image.ID[:]
        Image.ID[:] = [name for name in known if name in TEXTURE_FORMATS]
        try:
            yield
        finally:
            Image.ID[:] = known
