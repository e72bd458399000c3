"""Speed of `milkglass edit`, from the files of a photograph and its mask to the file of the edited one."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from milkglass.viewer.bench.speed import FrameRow, Timing
from milkglass.viewer.files.images import write_png, write_png_bands
from milkglass.viewer.files.photograph import load_photo
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.photograph.composite import Compositor
from milkglass.viewer.photograph.edit import edit
from milkglass.viewer.render.renderer import render
from milkglass.viewer.scene.scene import START, EnvironmentSettings, Scene
from milkglass.viewer.scene.settings import CameraSettings, DisplaySettings, MaterialSettings

MATERIAL = "jade"
CAMERA = CameraSettings(azimuth_deg=0.0, elevation_deg=0.0, zoom=1.36)  # the object covers half of the picture


def photo_rows(sides: Sequence[int], repeats: int) -> Iterator[FrameRow]:
    """Yield times of edits of square pictures of the built-in sculpture under an overcast sky, after a warm-up.

    They exclude the start of the program, its OpenGL context and the compilation of shaders.
    """
    for side in sides:
        with tempfile.TemporaryDirectory() as folder:
            share = _photograph(side, Path(folder))
            edited = [_edited(Path(folder)) for _ in range(repeats + 1)][1:]
        stages = {name: float(np.median([timings.get(name, 0.0) for timings in edited])) for name in edited[0]}
        setting = f"photograph, {side} x {side}, {100.0 * share:.0f} % the object, {MATERIAL}"
        yield FrameRow(setting, "edit, from file to file", Timing(tuple(timings["edit"] for timings in edited)), stages)


def _photograph(side: int, folder: Path) -> float:
    """Write a photograph and its mask, and return the share that the mask covers."""
    display = DisplaySettings(image_size=(side, side), background="environment")
    picture = render(
        Scene(camera=CAMERA, display=display, environment=EnvironmentSettings(builtin="overcast", occluded=False))
    )
    write_png(folder / "photo.png", picture.image)
    write_png(folder / "mask.png", np.rint(picture.alpha * 255.0).astype(np.uint8)[..., None])
    return float(picture.alpha.mean())


def _edited(folder: Path) -> dict[str, float]:
    """Edit as the command does, and return the time of each stage, ms, and of all of them as "edit"."""
    start = time.perf_counter()
    photo = load_photo(folder / "photo.png", folder / "mask.png")
    read = time.perf_counter()
    scene = replace(START, material=MaterialSettings(name=MATERIAL))
    edited = edit(photo, scene, headless_context(), parts=False)
    end = time.perf_counter()
    write_png_bands(folder / "out.png", photo.size, Compositor(edited).bands(), photo.profile)
    written = time.perf_counter()
    measured = {"reading": read - start, "file": written - end, "edit": written - start}
    return edited.timings | {name: 1e3 * seconds for name, seconds in measured.items()}
