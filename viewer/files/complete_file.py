"""Whether an image file was written to its end."""

from pathlib import Path

import OpenImageIO as oiio  # noqa: N813 (its own documentation's name)

_PNG_END = b"\0\0\0\0IEND\xaeB\x60\x82"  # the last chunk: length, name, checksum


def is_complete(path: Path, height: int) -> bool:
    """Whether a file just written has its end: on a full disk OpenImageIO reports success for PNG, and for EXR too
    where only the last few kilobytes are missing.
    """
    if path.suffix == ".png":
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 12))
            return file.read() == _PNG_END
    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()
        return False
    last_row = source.read_scanline(height - 1, 0, "float")
    source.geterror()
    source.close()
    return last_row is not None
