"""Pictures of pictures: a contact sheet with labels, and films of turntables."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from milkglass.core.errors import InputError
from milkglass.viewer.scene.given_file import reason_of
from milkglass.viewer.scene.whole_file import replacement

THUMBNAIL, MARGIN, LETTER = 160, 6, 11  # pixels
MOST_THUMBNAILS = 400  # the rest of a sweep is evenly left out
GREY, WHITE = (40, 40, 40), (230, 230, 230)


def write_sheet(folder: Path, rows: Sequence[Mapping[str, Any]], title: str) -> Path | None:
    """Write `contact_sheet.png` of the pictures that have a PNG; None where none has."""
    shown = [row for row in rows if row["files"][0].endswith(".png")]
    if not shown:
        return None
    step = math.ceil(len(shown) / MOST_THUMBNAILS)
    shown = shown[::step]
    columns = min(len(shown), max(1, math.ceil(math.sqrt(1.5 * len(shown)))))
    lines = max(1, max(len(row["values"]) for row in shown))
    cell = THUMBNAIL + MARGIN, THUMBNAIL + MARGIN + lines * (LETTER + 2)
    height = MARGIN + 2 * LETTER + math.ceil(len(shown) / columns) * cell[1]
    sheet = Image.new("RGB", (MARGIN + columns * cell[0], height), GREY)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(LETTER)
    left_out = f", every {step}th of {len(rows)}" if step > 1 else ""
    draw.text((MARGIN, MARGIN // 2), f"{title}: {len(shown)} pictures{left_out}", WHITE, font)
    for i, row in enumerate(shown):
        x, y = MARGIN + i % columns * cell[0], MARGIN + 2 * LETTER + i // columns * cell[1]
        with Image.open(folder / row["files"][0]) as picture:
            small = picture.convert("RGBA")
        small.thumbnail((THUMBNAIL, THUMBNAIL))
        sheet.paste(small, (x + (THUMBNAIL - small.width) // 2, y + (THUMBNAIL - small.height) // 2), small)
        for line, (key, value) in enumerate(row["values"].items()):
            draw.text((x, y + THUMBNAIL + line * (LETTER + 2)), _fitting(key, value, draw, font), WHITE, font)
    path = folder / "contact_sheet.png"
    _save(path, lambda temporary: sheet.save(temporary))
    return path


def write_films(
    folder: Path, rows: Sequence[Mapping[str, Any]], frames: int, kind: str, frames_per_second: float
) -> list[Path]:
    """Write a film of each turntable whose pictures are all there, and return the files."""
    written = []
    for number, turn in groupby(rows, key=lambda row: row["index"] // frames):
        paths = [folder / row["files"][0] for row in turn if row["files"][0].endswith(".png")]
        if len(paths) != frames:
            continue
        path = folder / f"turntable-{number:05d}.{kind}"
        pictures = list(_opaque(paths))
        if kind == "mp4":
            _save(path, lambda temporary: _film(temporary, pictures, frames_per_second))  # noqa: B023 (called at once)
        else:
            first, *rest = pictures
            timing = round(1000 / frames_per_second)
            more: dict[str, Any] = {"save_all": True, "append_images": rest, "loop": 0}
            _save(path, lambda temporary: first.save(temporary, duration=timing, **more))  # noqa: B023 (called at once)
        written.append(path)
    return written


def check_film(kind: str | None, kinds: Sequence[str]) -> None:
    """Raise `InputError` where films cannot be written, before any work."""
    if kind is None:
        return
    if "png" not in kinds:
        raise InputError('output.animation needs "png" in output.files, of which films are made')
    if kind == "mp4":
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            raise InputError("output.animation = \"mp4\" needs the extra: pip install 'milkglass[video]'") from None


def _opaque(paths: Sequence[Path]) -> Iterator[Image.Image]:
    for path in paths:
        with Image.open(path) as picture:
            yield picture.convert("RGB")


def _film(path: Path, pictures: Sequence[Image.Image], frames_per_second: float) -> None:
    import imageio_ffmpeg

    width, height = (side + side % 2 for side in pictures[0].size)
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=frames_per_second, codec="libx264", quality=8, macro_block_size=1
    )
    writer.send(None)
    for picture in pictures:
        # H.264 has even sizes: the last row and column are there twice, and no pixel is resampled.
        more = ((0, height - picture.height), (0, width - picture.width), (0, 0))
        writer.send(np.pad(np.asarray(picture), more, "edge").tobytes())
    writer.close()


def _save(path: Path, write: Any) -> None:
    try:
        with replacement(path) as temporary:
            write(temporary)
    except OSError as error:
        raise InputError(f"{path} could not be written ({reason_of(error)})") from error


def _fitting(key: str, value: Any, draw: ImageDraw.ImageDraw, font: Any) -> str:
    """Return a label that fits below a thumbnail: the key's last word, and the value with four digits."""
    short = f"{value:.4g}" if isinstance(value, float) else str(value)
    text = f"{key.rpartition('.')[2]} {short}"
    while text and draw.textlength(text, font) > THUMBNAIL:
        text = text[:-1]
    return text
