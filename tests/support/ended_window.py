"""A window whose scene is edited and whose process then gets a signal, or whose worker never ends: test_leaving.py."""

import os
import signal
import sys
import threading
from pathlib import Path

from milkglass.viewer.commands.cli import main as command_line
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.window.app import App

ASLEEP = 0.3  # seconds after the last frame, when the window waits for events


def edit_then(number: int) -> None:
    """Edit the scene once the picture is at rest, and send a signal once it is so again."""
    frame, edited = App.frame, False

    def framed(app: App, target: object) -> None:
        nonlocal edited
        frame(app, target)
        if not app.at_rest() or app.next_frame() is not None:
            return
        if edited:
            App.frame = frame
            threading.Timer(ASLEEP, os.kill, (os.getpid(), number)).start()
        else:
            edited = app.session.edit("display", key=0.3)
            app.wake()

    App.frame = framed


if __name__ == "__main__":
    what, scene = sys.argv[1], Path(sys.argv[2])
    if what == "stuck":
        Renderer.scatter = lambda *_: threading.Event().wait()
    else:
        edit_then(signal.Signals[what])
    sys.exit(command_line(["view", "--scene", str(scene), *sys.argv[3:]]))
