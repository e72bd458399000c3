"""Drives a real window from inside its process, through the very callbacks that GLFW calls: test_window.py runs it.

Nothing but a drag from a file manager makes GLFW's drop callback run, and nothing but a window manager minimises a
window; here is neither, so this plays both parts.
"""

import ctypes
import ctypes.util
import json
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import glfw
from glfw import _glfw as library  # the C library itself: its callbacks get C strings, as from a file manager

from milkglass.viewer.gui.events import Key
from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.window import Window
from tests.support.waiting import DEADLINE, wait_until

NORMAL, ICONIC = 1, 3  # WM_STATE of ICCCM 4.1.3.1
TURNS = ("wait_events", "wait_events_timeout", "poll_events")  # one of them each time that a window goes round


class Inside:
    """A real window and what it shows."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.window = Window(Scene.load(folder / "scene.toml"), folder / "scene.toml", None)
        self.app = self.window.app
        self.drawn = 0
        original = ImguiRenderer.draw

        def counted(*arguments: object) -> None:
            self.drawn += 1
            original(*arguments)

        ImguiRenderer.draw = counted

    def settle(self) -> None:
        wait_until(self._at_rest, lambda: time.sleep(0.02))

    def _at_rest(self) -> bool:
        glfw.poll_events()
        self.window.draw()
        self.app.view.wait(DEADLINE)
        return self.app.view.at_rest() and self.app.next_frame() != 0.0

    def shot(self, name: str) -> None:
        """Keep what the window shows, and the scene that should look so."""
        self.settle()
        self.app.commands.run("dismiss")  # messages lie over the picture
        self.app.actions.capture = self.folder / f"{name}.png"
        self.window.draw()
        self.app.commands.run("dismiss")
        scene = self.app.session.scene
        display = replace(scene.display, image_size=self.app.view.size)
        replace(scene, display=display).save(self.folder / f"{name}.toml")

    def drop(self, *paths: Path) -> None:
        """Call the registered callback as GLFW does."""
        names = [str(path).encode() for path in paths]
        call_back("Drop", self.window, len(names), (ctypes.c_char_p * len(names))(*names))

    def press(self, name: str) -> None:
        """Press a key and let it go."""
        for event in (None, Key(name, True), Key(name, False)):
            if event is not None:
                self.app.handle(event)
            for _ in range(2):
                self.window.draw()

    def minimise(self, minimised: bool) -> None:
        """Ask for it, and be the window manager that does it."""
        handle = self.window.handle
        (glfw.iconify_window if minimised else glfw.restore_window)(handle)
        x11 = ctypes.CDLL(ctypes.util.find_library("X11") or "libX11.so.6")
        display, number = ctypes.c_void_p(glfw.get_x11_display()), ctypes.c_ulong(glfw.get_x11_window(handle))
        x11.XInternAtom.restype = ctypes.c_ulong
        atom = ctypes.c_ulong(x11.XInternAtom(display, b"WM_STATE", 0))
        state = (ctypes.c_ulong * 2)(ICONIC if minimised else NORMAL, 0)
        x11.XChangeProperty(display, number, atom, atom, 32, 0, state, 2)
        (x11.XUnmapWindow if minimised else x11.XMapWindow)(display, number)
        x11.XFlush(display)
        wait_until(
            lambda: bool(glfw.get_window_attrib(handle, glfw.ICONIFIED)) == minimised,
            lambda: glfw.wait_events_timeout(0.05),
        )

    def loop(self, events: int) -> dict[str, int]:
        """Let the window run by itself while events come; returns what it drew and how often it went round."""
        drawn, turns, originals = self.drawn, 0, {name: getattr(glfw, name) for name in TURNS}

        def counted(name: str) -> Callable[..., None]:
            def turn(*arguments: float) -> None:
                nonlocal turns
                turns += 1
                originals[name](*arguments)

            return turn

        def send() -> None:
            for _ in range(events):
                time.sleep(0.02)
                glfw.post_empty_event()
            self.app.actions.closing = True
            glfw.post_empty_event()

        for name in TURNS:
            setattr(glfw, name, counted(name))
        sender = threading.Thread(target=send)
        sender.start()
        self.window.loop()
        sender.join()
        for name, original in originals.items():
            setattr(glfw, name, original)
        self.app.actions.closing = False
        return {"drawn": self.drawn - drawn, "events": events, "turns": turns}


def call_back(name: str, window: Window, *arguments: object) -> None:
    """Call what is registered for an event, a C function, with C arguments."""
    register = getattr(library, f"glfwSet{name}Callback")
    kind = register.restype
    registered = register(window.handle, kind(0))
    register(window.handle, registered)
    registered(window.handle, *arguments)


def main(folder: Path) -> None:
    found: dict[str, dict[str, int]] = {}
    inside = Inside(folder)
    session, other = inside.app.session, folder / "öther.stl"  # not ASCII: the callback decodes it
    inside.shot("start")
    inside.drop(other)
    assert session.scene.model.path == other
    inside.shot("mesh")
    inside.drop(folder / "probe.exr")
    assert session.scene.environment.path == folder / "probe.exr"
    inside.shot("probe")

    session.path = folder / "saved.toml"
    inside.app.commands.run("save")
    inside.drop(folder / "knot.ply", folder / "none.ply")  # the second is an error, which stays an error
    session.edit("material", name="ketchup")
    inside.app.commands.run("view_top")
    inside.shot("changed")
    assert session.modified
    inside.drop(folder / "saved.toml")
    inside.press("d")  # discard the changes
    assert not session.modified
    inside.shot("reopened")

    inside.minimise(True)
    session.edit("material", name="ketchup")
    inside.app.wake()
    found["minimised"] = inside.loop(20)
    session.undo()
    inside.minimise(False)
    inside.shot("restored")

    real = glfw.get_framebuffer_size, glfw.get_window_size
    glfw.get_framebuffer_size = glfw.get_window_size = lambda _: (0, 0)
    call_back("FramebufferSize", inside.window, 0, 0)
    session.edit("material", name="ketchup")
    inside.app.wake()
    found["without pixels"] = inside.loop(20)
    session.undo()
    glfw.get_framebuffer_size, glfw.get_window_size = real
    call_back("FramebufferSize", inside.window, *glfw.get_framebuffer_size(inside.window.handle))
    inside.shot("with pixels")
    (folder / "found.json").write_text(json.dumps(found))
    inside.window.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
