"""`milkglass edit`: the object of a photograph in another material."""

import os
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from milkglass.core.errors import InputError
from milkglass.viewer.commands.options import PHOTO_FLAGS, scene_options
from milkglass.viewer.scene.scene import START, Change, Scene, changed
from milkglass.viewer.scene.settings import BEHIND

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from milkglass.viewer.photograph.edit import Edited
    from milkglass.viewer.render.lighting import Progress

# What the photograph decides is no option here. Rays for the surround's shadows would take longer than all the rest.
FROM_PHOTO = (
    "model", "up", "image_size", "camera_azimuth", "camera_elevation", "camera_view_angle", "camera_zoom",
    "orthographic", "background",
)  # fmt: skip
DEPTH_OUTPUTS = (".png", ".exr", ".npy")


def _edit(
    scene: Scene,
    photo: Annotated[str, typer.Argument(metavar="PHOTO", help="Photograph: PNG, JPEG, TIFF, WebP or BMP.")],
    mask: Annotated[str, typer.Option(metavar="FILE", help="Picture of the same size, white on the object.")],
    output: Annotated[
        list[str], typer.Option(metavar="FILE", help=".png (as many bits as the photo) or .exr (layers); may repeat.")
    ],
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
    parts = any(Path(name).suffix.lower() == ".exr" for name in output)
    edited = _run(scene, photo, mask, samples, parts)
    for warning in edited.warnings:
        typer.echo(f"milkglass: warning: {warning}.", err=True)
    _save(edited, output, depth_output, scene.photo.behind)
    if verbose:
        for stage, milliseconds in edited.timings.items():
            typer.echo(f"{stage:28} {milliseconds:8.1f} ms")


_edit.__name__ = "edit"
edit = scene_options(_edit, FROM_PHOTO, START, PHOTO_FLAGS)


def check(scene: Scene, photo: str, mask: str, outputs: list[str], depth_output: str | None) -> None:
    """Refuse what cannot be written or would overwrite an input, before any work."""
    from milkglass.viewer.files.images import check_output

    written = [*outputs] if depth_output is None else [*outputs, depth_output]
    for output in outputs:
        check_output(output, (".png", ".exr"))
    if depth_output is not None:
        check_output(depth_output, DEPTH_OUTPUTS)
    read = {"photograph": photo, "mask": mask, "depth map": scene.photo.depth, "environment": scene.environment.path}
    for i, output in enumerate(written):
        for role, path in read.items():
            if path is not None and os.path.realpath(path) == os.path.realpath(output):
                raise InputError(f"{output} would overwrite the {role}; choose another name")
        if os.path.realpath(output) in map(os.path.realpath, written[:i]):
            raise InputError(f"{output} is to be written twice; choose another name")


def _run(scene: Scene, photo: str, mask: str, samples: int, parts: bool) -> "Edited":
    from rich.console import Console

    from milkglass.viewer.files.photograph import load_photo
    from milkglass.viewer.gl.context import headless_context
    from milkglass.viewer.photograph.edit import edit as edited

    loaded = load_photo(Path(photo), Path(mask))
    console = Console(stderr=True)

    def work(say: "Progress" = lambda _: None) -> "Edited":
        return edited(loaded, scene, headless_context(), samples=samples, parts=parts, progress=say)

    if not console.is_terminal:
        return work()
    with console.status("starting") as status:
        return work(status.update)


def _save(edited: "Edited", outputs: list[str], depth_output: str | None, background: str) -> None:
    from milkglass.viewer.files.images import write_exr_bands, write_png_bands
    from milkglass.viewer.photograph.composite import Compositor

    compositor = Compositor(edited, "filled" if background == "transparent" else background)
    for output in outputs:
        if Path(output).suffix.lower() == ".png":
            pixels = compositor.bands(transparent=background == "transparent")
            write_png_bands(output, edited.photo.size, pixels, edited.photo.profile)
        else:
            names, bands = compositor.layers()
            write_exr_bands(output, names, edited.photo.size, bands)
    if depth_output is not None:
        _save_depth(edited, Path(depth_output))


def _save_depth(edited: "Edited", path: Path) -> None:
    """Write the height of every pixel of the photograph; a PNG from its lowest to its highest."""
    import numpy as np

    from milkglass.viewer.files.images import write_exr, write_png

    depth = edited.geometry.depth_mm(edited.photo.whole)
    if path.suffix.lower() == ".exr":
        write_exr(path, {"Z": depth})
    elif path.suffix.lower() == ".npy":
        _save_npy(path, depth)
    else:
        span = max(float(depth.max() - depth.min()), 1e-9)
        write_png(path, np.rint((depth - depth.min()) * (65535.0 / span)).astype(np.uint16)[..., None])


def _save_npy(path: Path, depth: "npt.NDArray[np.float32]") -> None:
    import numpy as np

    temporary = path.with_name(f".{secrets.token_hex(8)}.npy")
    try:
        np.save(temporary, depth)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}); check the free space") from error
    finally:
        temporary.unlink(missing_ok=True)
