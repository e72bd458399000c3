"""`milkglass view --photo`: a photograph in the window, from options of the command line."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from milkglass.core.errors import InputError
from milkglass.viewer.commands.edit import EXCLUDED_OPTIONS
from milkglass.viewer.commands.options import PHOTO_FLAGS, scene_from_options
from milkglass.viewer.files.photograph import load_photo
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.geometry import read_depth
from milkglass.viewer.scene.scene import START, Scene

DEPTH_PARAMETERS = tuple(flag.parameter for flag in PHOTO_FLAGS)


def run(options: Mapping[str, Any], *, has_display: bool) -> None:
    """Show the photograph of `view`'s options in a window until that is closed; errors as `work_and_scene`."""
    work, scene = work_and_scene(options)
    if not has_display:
        raise InputError("there is no display for a window; write a picture with `milkglass edit PHOTO --mask MASK`")
    from milkglass.viewer.commands.show import show

    path = options["scene"]
    show(scene, None if path is None else Path(path), photo=work)


def work_and_scene(options: Mapping[str, Any]) -> tuple[PhotoWork, Scene]:
    """Return the photograph of the options, with its mask if there is one, and the scene that they describe.

    Raises
    ------
    InputError
        For files that cannot be used, and for options that conflict with a photograph.
    """
    photo, mask = options["photo"], options["mask"]
    if photo is None:
        option = next(name for name in ("mask", *DEPTH_PARAMETERS) if options.get(name) is not None)
        raise InputError(f"--{option.replace('_', '-')} says something of no photograph: name it with --photo")
    for name in (*EXCLUDED_OPTIONS, "record", "play"):
        if options.get(name) is not None:
            option = "MODEL" if name == "model" else f"--{name.replace('_', '-')}"
            is_recording = name in ("record", "play")
            reason = "recordings hold none" if is_recording else "object, camera and size are the photograph's"
            raise InputError(f"{option} and --photo do not go together ({reason}); leave one of them out")
    loaded = load_photo(Path(photo), None if mask is None else Path(mask))
    if mask is not None:
        loaded.outline  # noqa: B018 (raises if there is no object)
    scene = scene_from_options(options, START)
    if scene.photo.depth is not None:
        read_depth(scene.photo.depth, loaded)
    # The default pair of lights is for models; a photograph is lit by its surround.
    return PhotoWork(loaded), scene if scene.lights is not None else replace(scene, lights=())
