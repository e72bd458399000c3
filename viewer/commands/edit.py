"""`milkglass edit`: the object of a photograph in another material."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from milkglass.core.errors import InputError
from milkglass.viewer.commands.options import PHOTO_FLAGS, scene_options
from milkglass.viewer.files.formats import (
    PICTURE_FORMATS,
    PictureContents,
    check_picture_output,
    format_of,
    write_picture,
)
from milkglass.viewer.scene.scene import START, Change, Scene, changed
from milkglass.viewer.scene.settings import BEHIND

if TYPE_CHECKING:
    from milkglass.viewer.photograph.edit import Edited
    from milkglass.viewer.render.lighting import Progress

# Options of settings that the photograph determines.
EXCLUDED_OPTIONS = (
    "model", "up", "image_size", "camera_azimuth", "camera_elevation", "camera_view_angle", "camera_zoom",
    "orthographic", "background", "display_transform",
)  # fmt: skip
OUTPUT_TYPES = " or ".join(f"{suffix} ({kind.edited})" for suffix, kind in PICTURE_FORMATS.items())


def _edit(
    scene: Scene,
    photo: Annotated[str, typer.Argument(metavar="PHOTO", help="Photograph: PNG, JPEG, TIFF, WebP or BMP.")],
    mask: Annotated[str, typer.Option(metavar="FILE", help="Picture of the same size, white on the object.")],
    output: Annotated[list[str], typer.Option("--output", "-o", metavar="FILE", help=f"{OUTPUT_TYPES}; may repeat.")],
    depth_output: Annotated[
        str | None, typer.Option(metavar="FILE", help="Write the depth: .png of 16 bits, or .exr, .npy in mm.")
    ] = None,
    background: Annotated[
        str | None,
        typer.Option(metavar="|".join(BEHIND), help="Behind soft edges: filled in, or as seen; or no photo at all."),
    ] = None,
    samples: Annotated[int, typer.Option(metavar="N", min=1, max=256, help="Antialiasing samples a pixel.")] = 1,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the time of each stage.")] = False,
) -> None:
    """Give the object of a photograph another material."""
    if background is not None:
        scene = changed(scene, [Change("photo", "behind", background, "--background")])
    check(scene, photo, mask, output, depth_output)
    layers = any(format_of(name).linear for name in output)
    edited = _run(scene, photo, mask, samples, layers=layers)
    for warning in edited.warnings:
        typer.echo(f"milkglass: warning: {warning}.", err=True)
    _save(edited, output, depth_output, scene.photo.behind)
    if verbose:
        for stage, milliseconds in edited.timings.items():
            typer.echo(f"{stage:28} {milliseconds:8.1f} ms")


_edit.__name__ = "edit"
edit = scene_options(_edit, EXCLUDED_OPTIONS, START, PHOTO_FLAGS)


def check(scene: Scene, photo: str, mask: str, outputs: list[str], depth_output: str | None) -> None:
    """Raise InputError for outputs that cannot be written or would overwrite an input, before any work."""
    from milkglass.viewer.files.depth import DEPTH_FORMATS
    from milkglass.viewer.files.images import check_output

    targets = [*outputs] if depth_output is None else [*outputs, depth_output]
    for output in outputs:
        check_picture_output(output)
    if depth_output is not None:
        check_output(depth_output, DEPTH_FORMATS)
    inputs = {"photograph": photo, "mask": mask, "depth map": scene.photo.depth, "environment": scene.environment.path}
    for i, output in enumerate(targets):
        for role, path in inputs.items():
            if path is not None and os.path.realpath(path) == os.path.realpath(output):
                raise InputError(f"{output} would overwrite the {role}; choose another name")
        if os.path.realpath(output) in map(os.path.realpath, targets[:i]):
            raise InputError(f"{output} is to be written twice; choose another name")


def _run(scene: Scene, photo: str, mask: str, samples: int, *, layers: bool) -> "Edited":
    from rich.console import Console

    from milkglass.viewer.files.photograph import load_photo
    from milkglass.viewer.gl.context import headless_context
    from milkglass.viewer.photograph.edit import edit as edited

    loaded = load_photo(Path(photo), Path(mask))
    console = Console(stderr=True)

    def work(report: "Progress" = lambda _: None) -> "Edited":
        return edited(loaded, scene, headless_context(), samples=samples, parts=layers, progress=report)

    if not console.is_terminal:
        return work()
    with console.status("starting") as status:
        return work(status.update)


def _save(edited: "Edited", outputs: list[str], depth_output: str | None, background: str) -> None:
    from milkglass.viewer.files.depth import depth_format_of
    from milkglass.viewer.photograph.composite import Compositor

    photo, transparent = edited.photo, background == "transparent"
    compositor = Compositor(edited, "filled" if transparent else background)
    contents = PictureContents(
        photo.size, lambda: compositor.bands(transparent=transparent), compositor.layers, photo.profile
    )
    for output in outputs:
        write_picture(output, contents)
    if depth_output is not None:
        depth_format_of(Path(depth_output)).write(Path(depth_output), edited.geometry.depth_mm(photo.full_region))
