"""Speed of the window beside other viewers that draw the same mesh opaque, in turns, by processor time.

The window's contents are driven by mouse events, in a framebuffer of the size of a window. Frames are timed from the
event that causes them until OpenGL has drawn them; presentation is not included, of the other viewers neither.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.bench import opaque_viewers
from milkglass.viewer.bench.opaque_viewers import TURN_DEG, OpaqueViewer
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import Timing
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.gui.events import MouseButton, MouseMoved
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.layout import PANEL_WIDTH
from milkglass.viewer.window.replay import Headless

OURS, ANCHOR = "milkglass", "Polyscope"
MIN_HEIGHT = 800  # of the window, px, so that it contains the sliders
TEXT_HEIGHT = 15.0  # px
TURN_PIXELS = 4.0  # of the pointer in a frame of an orbit
SLIDE_PIXELS = 1.5  # of the pointer in a frame of a slider
TIMEOUT = 120.0  # seconds, for a picture
OPENED = "first picture, the process from its start"
ORBIT, ORBIT_DRAGGED = "orbit, at rest", "orbit, as dragged"
EXPOSURE, FIRST, SETTLED = "exposure slider", "material slider, first new picture", "material slider, until at rest"
REST, PANEL = "user interface, nothing drawn anew", "of which the panel"
CASES = (ORBIT, ORBIT_DRAGGED, FIRST, SETTLED, EXPOSURE, REST, PANEL)
WANTED_MS = {FIRST: 60.0, EXPOSURE: 50.0, PANEL: 3.0}  # at most
WANTED_RATIOS = {ORBIT_DRAGGED: 0.4}  # to the anchor's picture of an orbit, at most


@dataclass(frozen=True)
class WindowRow:
    """Processor times of one case by one program: of a picture, or until it is there."""

    program: str
    case: str
    time: Timing


class DrivenWindow(Headless):
    """Contents of the window, driven by mouse events, with a clock that advances by the time of the work."""

    def __init__(self, scene: Scene) -> None:
        width, height = scene.display.image_size
        super().__init__(scene, (max(width, MIN_HEIGHT) + round(PANEL_WIDTH * TEXT_HEIGHT), max(height, MIN_HEIGHT)))
        self.app.session.view.fixed_size = True
        self._place = (0.0, 0.0)
        self.settle()

    def frame(self) -> None:
        """Draw a frame, and advance the clock by its time."""
        self.timed(super().frame)

    def timed(self, work: Callable[[], object]) -> float:
        """Run a task, wait for OpenGL, advance the clock, and return the processor time of all threads, ms."""
        start, used = time.perf_counter(), time.process_time()
        work()
        self._context.finish()
        self.now += time.perf_counter() - start
        return 1e3 * (time.process_time() - used)

    def at(self, name: str, share: float = 0.5) -> tuple[float, float]:
        """Return the position of a control of the panel, at a share of its width."""
        left, top, right, bottom = self.app.panel.controls.boxes[name]
        return left + share * (right - left), 0.5 * (top + bottom)

    def press(self, place: tuple[float, float]) -> None:
        """Move the pointer to a position and press the left button."""
        self._place = place
        self._send(MouseMoved(*place))
        self._send(MouseButton("left", pressed=True))

    def release(self) -> None:
        """Release the left button."""
        self._send(MouseButton("left", pressed=False))

    def click(self, place: tuple[float, float]) -> None:
        """Press and release the left button at a position."""
        self.press(place)
        self.release()

    def move(self, by: float) -> float:
        """Move the pointer to the right, draw, and return the processor time, ms."""
        self._place = (self._place[0] + by, self._place[1])
        self.app.handle(MouseMoved(*self._place))
        return self.timed(lambda: self.app.frame(self.target))

    def until(self, condition: Callable[[], bool]) -> float:
        """Draw as a window does until a condition holds, and return the processor time, ms."""
        start, used = time.perf_counter(), time.process_time()
        while not condition() and time.perf_counter() < start + TIMEOUT:
            self.timed(self._wait)
            self.frame()
        return 1e3 * (time.process_time() - used)

    def _wait(self) -> None:
        """Wait as a window does, until a frame is due or the worker is done."""
        due, live = self.app.next_frame(), self.app.view.live
        if live.working:
            with suppress(TimeoutError):
                live.wait(TIMEOUT if due is None else due)
        elif due is not None:
            time.sleep(due)

    def _send(self, event: MouseMoved | MouseButton) -> None:
        self.app.handle(event)
        for _ in range(2):
            self.frame()


def window_rows(scene: Scene, repeats: int) -> Iterator[WindowRow]:
    """Yield times of the window of a scene: orbit, sliders, and the user interface alone; those of other viewers too.

    Other viewers that are installed draw one picture for each one of an orbit.
    """
    with tempfile.TemporaryDirectory() as folder, current(headless_context()):
        path = Path(folder) / "model.ply"
        mesh, _ = Assets().mesh(scene.model)
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
        started = opaque_viewers.started(path, min(scene.display.image_size))
        with started as rivals, closing(DrivenWindow(scene)) as window:
            yield from (WindowRow(name, OPENED, Timing((other.first,))) for name, other in rivals.items())
            for program, case, times in _measured(window, rivals, repeats):
                yield WindowRow(program, case, Timing(tuple(times)))


def n_rows() -> int:
    """Return the number of rows of `window_rows`, for a progress bar."""
    return len(CASES) + 2 * len(opaque_viewers.installed())


def _measured(
    window: DrivenWindow, rivals: Mapping[str, OpaqueViewer], repeats: int
) -> Iterator[tuple[str, str, list[float]]]:
    yield from _orbits(window, rivals, repeats)
    yield from _materials(window, max(3, repeats // 4))
    for section in ("Material", "Lights", "Tone mapping"):  # folded to make room
        window.click(window.at(f"section.{section}", 0.3))
    window.press(window.at("display.key", 0.4))
    yield OURS, EXPOSURE, [window.move(SLIDE_PIXELS) for _ in range(repeats)]
    window.release()
    window.settle()
    with_panel: list[float] = []
    without_panel: list[float] = []
    for _ in range(repeats):
        for panel_shown, times in ((True, with_panel), (False, without_panel)):
            window.app.actions.panel_shown = panel_shown
            window.frame()  # for the layout
            times.append(window.timed(lambda: window.app.frame(window.target)))
    yield OURS, REST, with_panel
    # Of medians: differences of single frames are mostly noise.
    yield OURS, PANEL, [float(np.median(with_panel) - np.median(without_panel))]


def _orbits(
    window: DrivenWindow, rivals: Mapping[str, OpaqueViewer], repeats: int
) -> Iterator[tuple[str, str, list[float]]]:
    """Yield times of an orbit: at full quality, then as dragged by the mouse and by other viewers in turns."""
    session, live = window.app.session, window.app.view.live
    at_rest: list[float] = []
    start = window.now
    for i in range(repeats + 1):
        camera = session.scene.camera
        session.look(replace(camera, azimuth_deg=camera.azimuth_deg + TURN_DEG))
        elapsed = window.timed(lambda: window.app.frame(window.target)) + window.timed(lambda: live.wait(TIMEOUT))
        elapsed += window.timed(lambda: window.app.frame(window.target))  # takes what the worker has for the new view
        window.now = start  # the clock is reset, so that nothing is antialiased in between
        if i:
            at_rest.append(elapsed)
    window.settle()
    width, height = window.app.view.size
    window.press((0.3 * width, 0.5 * height))
    window.move(TURN_PIXELS)  # what every drag does once
    dragged: list[float] = []
    opaque: dict[str, list[float]] = {name: [] for name in rivals}
    for _ in range(repeats):
        dragged.append(window.move(TURN_PIXELS))
        for name, other in rivals.items():
            opaque[name].append(other.turn())
    window.release()
    window.settle()
    yield from ((OURS, ORBIT, at_rest), (OURS, ORBIT_DRAGGED, dragged))
    yield from ((name, ORBIT_DRAGGED, times) for name, times in opaque.items() if np.isfinite(times).all())


def _materials(window: DrivenWindow, repeats: int) -> Iterator[tuple[str, str, list[float]]]:
    """Yield times of a step of a slider of the material, until its volume is drawn and until the picture is settled."""
    live, first, settled = window.app.view.live, [], []
    for i in range(repeats + 1):
        window.press(window.at("material.sigma_a.R", 0.4 + 0.03 * i))
        window.settle()  # the press itself sets a value
        previous = live.finished
        elapsed = window.move(4.0 * SLIDE_PIXELS)
        elapsed += window.until(lambda previous=previous: live.finished is not previous)  # type: ignore[misc]
        window.release()
        remaining = window.until(window.app.view.at_rest)
        if i:
            first.append(elapsed)
            settled.append(elapsed + remaining)
    yield from ((OURS, FIRST, first), (OURS, SETTLED, settled))


def report_window(report: BenchReport, title: str, rows: Sequence[WindowRow]) -> None:
    """Report a table, with ratios to the anchor's picture of an orbit where it is installed, and `window.csv`."""
    anchor = next((row.time.median for row in rows if (row.program, row.case) == (ANCHOR, ORBIT_DRAGGED)), None)
    report.table(
        f"The window, {title}",
        ["program", "case", "CPU ms, minimum / median", f"of an orbit's picture by {ANCHOR}", "wanted"],
        (
            [
                row.program,
                row.case,
                f"{row.time.minimum:.1f} / {row.time.median:.1f}",
                f"{row.time.median / anchor:.2f}" if anchor else "",
                _wanted(row),
            ]
            for row in rows
        ),
    )
    missing = set(opaque_viewers.installed()) - {row.program for row in rows if row.case == ORBIT_DRAGGED}
    for name in sorted(missing):
        report.say(f"{name} is installed, but did not draw: it has no row of an orbit.")
    if anchor is None:
        report.say(f'Without {ANCHOR} there is nothing to compare with: pip install "milkglass[rivals]".')
    report.csv("window.csv", [{"program": row.program, "case": row.case, "cpu_ms": row.time.median} for row in rows])


def _wanted(row: WindowRow) -> str:
    if row.program != OURS:
        return ""
    if row.case in WANTED_MS:
        return f"{WANTED_MS[row.case]:g} ms"
    return f"{WANTED_RATIOS[row.case]:g}" if row.case in WANTED_RATIOS else ""
