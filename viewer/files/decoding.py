"""What others' readers open beside a file and how they say that they could not.

Pictures are of the formats of textures alone. trimesh reads nothing outside the file's folder.
"""

import contextlib
import re
import threading
from collections.abc import Iterator

from PIL import Image

from milkglass.viewer.scene.given_file import reason_of

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


def cause_of(problem: BaseException) -> str:
    """Return why a reader of others' gave up, without what it says to programmers alone."""
    outside = re.match(r"(?:Invalid name )?('.+?')(?: escapes resolver root|$)", str(problem))
    return f"{outside[1]} is outside the model's folder" if outside else reason_of(problem)
