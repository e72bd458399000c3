"""Replays a recorded interaction, in a window or without one: the same events, the same frames, the same clock."""

import time
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path

import moderngl

from milkglass.core.errors import InputError
from milkglass.core.threads import one_blas_thread
from milkglass.viewer.gl.context import current, headless_context, leave_framebuffer
from milkglass.viewer.gui.command import find
from milkglass.viewer.gui.events import Drawn, Event, Invoked, Resized, read_recording
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.whole_file import confined
from milkglass.viewer.window import commands
from milkglass.viewer.window.app import App

LONGEST = 600.0  # seconds that a picture may take to come to rest


@one_blas_thread()
def play(path: Path, *, in_window: bool, into: Path | None = None) -> Scene:
    """Replay a recording and return the scene that it ends with.

    A recording acts with the rights of whoever plays it: it writes files into the folder `into` alone, or none.

    Raises
    ------
    InputError
        The file is not a recording, asks for a command that does not exist, or what it opens cannot be used.
    """
    text, events = read_recording(path)
    _check_commands(path, events)
    try:
        scene = Scene.from_toml(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if into is not None and not into.is_dir():
        raise InputError(f"--into {into}: there is no such folder; create it for what the replay writes")
    with confined(into):
        if in_window:
            from milkglass.viewer.window.window import Window

            window = Window(scene, None, None)
            try:
                feed(window.app, events, window.draw, at_its_pace=True)
                return window.app.session.scene
            finally:
                window.close()
        with current(headless_context()), closing(Headless(scene)) as replay:
            replay.feed(events)
            return replay.app.session.scene


def _check_commands(path: Path, events: Iterable[Event]) -> None:
    for event in events:
        if isinstance(event, Invoked):
            try:
                find(commands.COMMANDS, event.command, event.argument)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None


class Headless:
    """Holds the contents of the window in a framebuffer, driven by events: for replays and tests.

    To be used while the context without a window is current, see `viewer.gl.context.current`.

    Attributes
    ----------
    app : App
    now : float
        The clock's time, seconds, set by recorded frames.
    """

    def __init__(self, scene: Scene, size: tuple[int, int] = (1280, 800), photo: PhotoWork | None = None) -> None:
        self.now = 0.0
        self._was_final = False  # whether the frame that is drawn again was
        self._context = headless_context()
        self.app = App(self._context, scene, clock=lambda: self.now, photo=photo)
        self.target = self._target(size)
        self.app.handle(Resized(size, size))

    def feed(self, events: Iterable[Event]) -> None:
        """Pass recorded events on, draw the frames that were drawn, and let the picture come to rest.

        A picture that had come to rest before the next event comes to rest here too, however long it takes: a model
        that is loaded later would be framed as another camera sees it.
        """
        feed(self.app, events, self._redraw, self._take)
        self.settle()

    def frame(self) -> None:
        """Draw a frame into the framebuffer."""
        self.app.frame(self.target)

    def settle(self) -> None:
        """Draw frames until nothing changes any more, 0.1 s apart by the clock.

        Raises
        ------
        TimeoutError
            If something still changes after LONGEST seconds.
        """
        end = time.monotonic() + LONGEST
        while time.monotonic() < end:
            self.frame()
            self.app.view.wait(LONGEST)
            self.app.error.wait(LONGEST)
            self.app.profiles.wait(LONGEST)
            self.now += 0.1
            if self.app.at_rest() and self.app.next_frame() != 0.0:
                return
        raise TimeoutError(f"the picture did not come to rest in {LONGEST:g} s")

    def close(self) -> None:
        """Stop the workers and free the framebuffer."""
        self.app.close()
        leave_framebuffer(self._context)
        self.target.release()

    def _redraw(self) -> None:
        self.frame()
        if self._was_final and not self.app.at_rest():
            self.settle()

    def _take(self, event: Event) -> None:
        if isinstance(event, Drawn):
            self.now, self._was_final = max(self.now, event.time), event.final
        if isinstance(event, Resized) and min(event.pixels) > 0 and event.pixels != self.target.size:
            leave_framebuffer(self._context)
            self.target.release()
            self.target = self._target(event.pixels)

    def _target(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        return self._context.simple_framebuffer(size)


def feed(
    app: App,
    events: Iterable[Event],
    draw: Callable[[], object],
    before: Callable[[Event], object] = lambda _: None,
    *,
    at_its_pace: bool = False,
) -> None:
    """Pass events on to an app until it closes; each `Drawn` draws a frame."""
    start: tuple[float, float] | None = None
    for event in events:
        before(event)
        if app.actions.closing:
            return
        if isinstance(event, Drawn):
            if at_its_pace:
                start = start or (event.time, time.monotonic())
                time.sleep(max(0.0, event.time - start[0] - (time.monotonic() - start[1])))
            draw()
        elif not (at_its_pace and isinstance(event, Resized)):  # a real window keeps its own size
            app.handle(event)
