"""A window, and the end of the process with it."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from milkglass.viewer.live.worker import have_ended
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window import window

if TYPE_CHECKING:
    from milkglass.viewer.live.photograph_work import PhotoWork


def show(scene: Scene, path: Path | None = None, record: Path | None = None, photo: "PhotoWork | None" = None) -> None:
    """Show a window until it is closed, parameters and errors as of `viewer.window.window.run`.

    The process ends here, at once, where something is computed still: Python would wait for it.
    """
    code = window.run(scene, path=path, record=record, photo=photo)
    if not have_ended():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    if code:
        raise typer.Exit(code)
