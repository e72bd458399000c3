"""Speed of the window: its contents, driven by mouse events, in a framebuffer of the size of a window.

Frames are timed from the event that causes them until OpenGL has drawn them; presentation is not included.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.stages import exhausted
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import Timing
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.gui.events import MouseButton, MouseMoved
from milkglass.viewer.passes.gbuffer import GBufferPass
from milkglass.viewer.passes.irradiance import Highlights, PixelIrradiancePass
from milkglass.viewer.passes.tonemap import Background, TonemapPass
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.layout import PANEL_WIDTH
from milkglass.viewer.window.replay import Headless

MIN_HEIGHT = 800  # of the window, px, so that it contains the sliders
TEXT_HEIGHT = 15.0  # px
TURN_PIXELS = 4.0  # of the pointer in a frame of an orbit
SLIDE_PIXELS = 1.5  # of the pointer in a frame of a slider
TIMEOUT = 30.0  # seconds, for a volume
ORBIT, ORBIT_DRAFT, PLAIN = "orbit, full quality", "orbit, as dragged", "orbit, without scattering"
EXPOSURE, FIRST, SETTLED = "exposure slider", "material: new light on the screen", "material: settled, antialiased"
REST, PANEL = "user interface, nothing drawn anew", "of which the panel"
TARGETS = {ORBIT_DRAFT: "12 a second", EXPOSURE: "50 ms", FIRST: "150 ms", PANEL: "3 ms"}
ROWS_A_SETTING = 8
TARGET_SHARE = 0.6  # of the frame rate without scattering


@dataclass(frozen=True)
class WindowRow:
    """Times of one action in the window: of a frame of it, or until its end."""

    setting: str
    action: str
    time: Timing

    @property
    def rate(self) -> float:
        """Mean number of frames a second."""
        return 1e3 / float(np.mean(self.time.times))


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
        """Run a task, wait for OpenGL, advance the clock, and return the time, ms."""
        start = time.perf_counter()
        work()
        self._context.finish()
        elapsed = time.perf_counter() - start
        self.now += elapsed
        return 1e3 * elapsed

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
        """Move the pointer to the right, draw, and return the time, ms."""
        self._place = (self._place[0] + by, self._place[1])
        self.app.handle(MouseMoved(*self._place))
        return self.timed(lambda: self.app.frame(self.target))

    def until(self, condition: Callable[[], bool]) -> float:
        """Draw as a window does until a condition holds, and return the time, ms."""
        start = time.perf_counter()
        while not condition() and time.perf_counter() < start + TIMEOUT:
            self.timed(self._wait)
            self.frame()
        return 1e3 * (time.perf_counter() - start)

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


class UnscatteredPicture:
    """The picture of a window without scattering: irradiance at every pixel."""

    def __init__(self, window: DrivenWindow) -> None:
        assert window.app.view.picture is not None
        self._window, context = window, window.target.ctx
        self._gbuffer, self._light = GBufferPass(context), PixelIrradiancePass(context)
        self._tonemap = TonemapPass(context)
        self._image = window.app.view.picture.image
        self._black = context.texture((1, 1), 3, dtype="f4")
        self._targets = self._gbuffer.targets(self._image.size), self._light.targets(self._image.size)

    def draw(self, scene: Scene) -> None:
        """Draw the picture and the contents of the window."""
        finished = self._window.app.view.live.finished
        assert finished is not None
        lit, (gbuffer, light) = finished.lit, self._targets
        self._gbuffer.render(lit.model.buffers, lit.camera.world_to_clip, gbuffer)
        kind = finished.gather.kinds[0]
        textures = kind.tables
        local = replace(textures.tables.local, reach=0.0)
        flat = replace(kind, tables=replace(textures, tables=replace(textures.tables, local=local)))
        surface = replace(finished.gather, kinds=(flat,))
        highlights = Highlights(scene.gloss, self._black)
        exhausted(self._light.steps(gbuffer, lit.sources, surface, highlights, lit.camera, light))
        average = self._tonemap.log_average(light.irradiance) or 1.0
        no_background = Background(self._black, 0.0, 0.0)
        self._tonemap.render(light.irradiance, average, scene.display, no_background, lit.camera, self._image)
        self._window.app.frame(self._window.target)


def window_rows(scene: Scene, setting: str, repeats: int) -> Iterator[WindowRow]:
    """Yield times of the window of a scene: orbit, sliders, and the user interface alone."""
    with current(headless_context()), closing(DrivenWindow(scene)) as window:
        for action, times in _measured(window, repeats):
            yield WindowRow(setting, action, Timing(tuple(times)))


def _measured(window: DrivenWindow, repeats: int) -> Iterator[tuple[str, list[float]]]:
    yield from _orbits(window, repeats)
    yield from _materials(window, max(3, repeats // 4))
    for section in ("Material", "Lights", "Tone mapping"):  # folded to make room
        window.click(window.at(f"section.{section}", 0.3))
    window.press(window.at("display.key", 0.4))
    yield EXPOSURE, [window.move(SLIDE_PIXELS) for _ in range(repeats)]
    window.release()
    window.settle()
    with_panel: list[float] = []
    without_panel: list[float] = []
    for _ in range(repeats):
        for panel_shown, times in ((True, with_panel), (False, without_panel)):
            window.app.actions.panel_shown = panel_shown
            window.frame()  # for the layout
            times.append(window.timed(lambda: window.app.frame(window.target)))
    yield REST, with_panel
    # Of medians: differences of single frames are mostly noise.
    yield PANEL, [float(np.median(with_panel) - np.median(without_panel))]


def _orbits(window: DrivenWindow, repeats: int) -> Iterator[tuple[str, list[float]]]:
    """Yield times of an orbit: at full quality and without scattering in turns, then as dragged by the mouse."""
    session, live, unscattered = window.app.session, window.app.view.live, UnscatteredPicture(window)
    full_times, unscattered_times, start = [], [], window.now
    for i in range(repeats + 1):
        camera = session.scene.camera
        session.look(replace(camera, azimuth_deg=camera.azimuth_deg + TURN_PIXELS * 0.35))
        elapsed = window.timed(lambda: window.app.frame(window.target))
        live.wait(TIMEOUT)
        window.frame()  # takes the result of the worker for the new view
        window.now = start  # the clock is reset, so that nothing is antialiased in between
        elapsed_unscattered = window.timed(lambda: unscattered.draw(session.scene))
        if i:
            full_times.append(elapsed)
            unscattered_times.append(elapsed_unscattered)
    window.settle()
    width, height = window.app.view.size
    window.press((0.3 * width, 0.5 * height))
    dragged = [window.move(TURN_PIXELS) for _ in range(repeats)]
    window.release()
    window.settle()
    yield from ((ORBIT, full_times), (ORBIT_DRAFT, dragged), (PLAIN, unscattered_times))


def _materials(window: DrivenWindow, repeats: int) -> Iterator[tuple[str, list[float]]]:
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
    yield from ((FIRST, first), (SETTLED, settled))


def report_window(report: BenchReport, rows: Sequence[WindowRow]) -> None:
    """Report a table a setting, and the rate of orbiting relative to a picture without scattering."""
    for setting in dict.fromkeys(row.setting for row in rows):
        rows_by_action = {row.action: row for row in rows if row.setting == setting}
        report.table(
            f"The window, {setting}",
            ["what", "ms, minimum / median", "frames a second", "wanted"],
            (
                [
                    row.action,
                    f"{row.time.minimum:.1f} / {row.time.median:.1f}",
                    f"{row.rate:.1f}" if row.action in (ORBIT, ORBIT_DRAFT, PLAIN, EXPOSURE) else "",
                    TARGETS.get(row.action, ""),
                ]
                for row in rows_by_action.values()
            ),
        )
        orbit, draft = (rows_by_action[PLAIN].time.median / rows_by_action[a].time.median for a in (ORBIT, ORBIT_DRAFT))
        report.say(
            f"Orbiting has {100.0 * orbit:.0f} % of the rate without scattering at full quality (wanted: "
            f"{100.0 * TARGET_SHARE:.0f} %), {100.0 * draft:.0f} % as dragged."
        )
    report.csv(
        "window.csv",
        [
            {
                "setting": row.setting,
                "what": row.action,
                "min_ms": row.time.minimum,
                "median_ms": row.time.median,
                "frames_a_second": row.rate,
            }
            for row in rows
        ],
    )
