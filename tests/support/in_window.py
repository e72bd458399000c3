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
from dataclasses import replace
from pathlib import Path

import glfw
from glfw import _glfw as library  # the C library itself: its callbacks get C strings, as from a file manager

from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.window import Window

NORMAL, ICONIC = 1, 3  # WM_STATE of ICCCM 4.1.3.1


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
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            glfw.poll_events()
            self.window.draw()
            for live in self.app.view.lives():
                live.wait()
            if self.app.view.at_rest() and self.app.next_frame() != 0.0:
                return
            time.sleep(0.02)
        raise AssertionError("the window does not come to rest")

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

    def minimise(self, minimised: bool) -> None:
        """Ask for it, and be the window manager that does it."""
        handle = self.window._handle
        (glfw.iconify_window if minimised else glfw.restore_window)(handle)
        x11 = ctypes.CDLL(ctypes.util.find_library("X11") or "libX11.so.6")
        display, number = ctypes.c_void_p(glfw.get_x11_display()), ctypes.c_ulong(glfw.get_x11_window(handle))
        x11.XInternAtom.restype = ctypes.c_ulong
        atom = ctypes.c_ulong(x11.XInternAtom(display, b"WM_STATE", 0))
        state = (ctypes.c_ulong * 2)(ICONIC if minimised else NORMAL, 0)
        x11.XChangeProperty(display, number, atom, atom, 32, 0, state, 2)
        (x11.XUnmapWindow if minimised else x11.XMapWindow)(display, number)
        x11.XFlush(display)
        end = time.monotonic() + 10.0
        while bool(glfw.get_window_attrib(handle, glfw.ICONIFIED)) != minimised and time.monotonic() < end:
            glfw.wait_events_timeout(0.05)
        assert bool(glfw.get_window_attrib(handle, glfw.ICONIFIED)) == minimised

    def loop(self, seconds: float) -> dict[str, float]:
        """Let the window run by itself for a while; returns what it drew and the CPU time that it took."""
        drawn, start = self.drawn, time.process_time()

        def end() -> None:
            self.app.actions.closing = True
            glfw.post_empty_event()

        timer = threading.Timer(seconds, end)
        timer.start()
        self.window.loop()
        timer.join()
        self.app.actions.closing = False
        return {"drawn": self.drawn - drawn, "seconds": time.process_time() - start}


def call_back(name: str, window: Window, *arguments: object) -> None:
    """Call what is registered for an event, a C function, with C arguments."""
    register = getattr(library, f"glfwSet{name}Callback")
    kind = register.restype
    registered = register(window._handle, kind(0))
    register(window._handle, registered)
    registered(window._handle, *arguments)


def main(folder: Path) -> None:
    found: dict[str, dict[str, float]] = {}
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
    assert not session.modified
    inside.shot("reopened")

    inside.minimise(True)
    session.edit("material", name="ketchup")
    inside.app.wake()
    found["minimised"] = inside.loop(1.5)
    session.undo()
    inside.minimise(False)
    inside.shot("restored")

    real = glfw.get_framebuffer_size, glfw.get_window_size
    glfw.get_framebuffer_size = glfw.get_window_size = lambda _: (0, 0)
    call_back("FramebufferSize", inside.window, 0, 0)
    session.edit("material", name="ketchup")
    inside.app.wake()
    found["without pixels"] = inside.loop(1.5)
    session.undo()
    glfw.get_framebuffer_size, glfw.get_window_size = real
    call_back("FramebufferSize", inside.window, *glfw.get_framebuffer_size(inside.window._handle))
    inside.shot("with pixels")
    (folder / "found.json").write_text(json.dumps(found))
    inside.window.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
