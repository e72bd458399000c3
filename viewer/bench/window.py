"""Speed of the window: its own contents, driven by mouse events, in a framebuffer of the size of a window.

Frames are timed from the event that causes them until OpenGL has drawn them; what shows them is not counted.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.stages import exhausted
from milkglass.viewer.bench.report import Report
from milkglass.viewer.bench.speed import Timing
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.gui.events import MouseButton, MouseMoved
from milkglass.viewer.passes.gbuffer import GBufferPass
from milkglass.viewer.passes.irradiance import PixelIrradiancePass
from milkglass.viewer.passes.tonemap import Background, TonemapPass
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.panel.panel import WIDTH
from milkglass.viewer.window.replay import Headless

HEIGHT = 800  # of the window at least, so that the sliders are in it
TEXT = 15.0  # px, height of letters
TURN = 4.0  # pixels an orbit moves in a frame
SLIDE = 1.5  # pixels a slider moves in a frame
LIMIT = 30.0  # seconds until a volume must be there
ORBIT, ORBIT_DRAFT, PLAIN = "orbit, full quality", "orbit, as dragged", "orbit, without scattering"
EXPOSURE, FIRST, SETTLED = "exposure slider", "material: new light on the screen", "material: settled, antialiased"
REST, PANEL = "user interface, nothing drawn anew", "of which the panel"
WANTED = {ORBIT_DRAFT: "12 a second", EXPOSURE: "50 ms", FIRST: "150 ms", PANEL: "3 ms"}
COUNT = 8  # rows a setting
SHARE_WANTED = 0.6  # of the rate without scattering


@dataclass(frozen=True)
class WindowRow:
    """What the window does, and the time of a frame of it or until it is done."""

    setting: str
    what: str
    time: Timing

    @property
    def rate(self) -> float:
        """Frames a second."""
        return 1e3 / float(np.mean(self.time.times))


class Desk(Headless):
    """The window's contents with a clock that counts the work done, and a hand on the mouse."""

    def __init__(self, scene: Scene) -> None:
        width, height = scene.display.image_size
        super().__init__(scene, (max(width, HEIGHT) + round(WIDTH * TEXT), max(height, HEIGHT)))
        self.app.session.view.fixed_size = True
        self._place = (0.0, 0.0)
        self.settle()

    def frame(self) -> None:
        """Draw a frame; time passes as it takes."""
        self.timed(super().frame)

    def timed(self, work: Callable[[], object]) -> float:
        """Do something and wait for OpenGL; returns ms."""
        start = time.perf_counter()
        work()
        self._context.finish()
        taken = time.perf_counter() - start
        self.now += taken
        return 1e3 * taken

    def at(self, name: str, share: float = 0.5) -> tuple[float, float]:
        """Where a control of the panel is."""
        left, top, right, bottom = self.app.panel.controls.boxes[name]
        return left + share * (right - left), 0.5 * (top + bottom)

    def press(self, place: tuple[float, float]) -> None:
        """Put the pointer somewhere and the button down."""
        self._place = place
        self._send(MouseMoved(*place))
        self._send(MouseButton("left", True))

    def release(self) -> None:
        """Let the button go."""
        self._send(MouseButton("left", False))

    def click(self, place: tuple[float, float]) -> None:
        """Press and release."""
        self.press(place)
        self.release()

    def move(self, by: float) -> float:
        """Move the pointer to the right and draw; returns ms."""
        self._place = (self._place[0] + by, self._place[1])
        self.app.handle(MouseMoved(*self._place))
        return self.timed(lambda: self.app.frame(self.target))

    def until(self, done: Callable[[], bool]) -> float:
        """Draw as a window does until something is so; returns ms."""
        start = time.perf_counter()
        while not done() and time.perf_counter() < start + LIMIT:
            self.timed(self._wait)
            self.frame()
        return 1e3 * (time.perf_counter() - start)

    def _wait(self) -> None:
        """Wait as a window does: until a frame is due, or the worker wakes it."""
        due, live = self.app.next_frame(), self.app.view.live
        if live.working:
            with suppress(TimeoutError):
                live.wait(LIMIT if due is None else due)
        elif due is not None:
            time.sleep(due)

    def _send(self, event: MouseMoved | MouseButton) -> None:
        self.app.handle(event)
        for _ in range(2):
            self.frame()


class Plain:
    """The same picture without scattering: every pixel shows the light that falls on it."""

    def __init__(self, desk: Desk) -> None:
        assert desk.app.view.picture is not None
        self._desk, context = desk, desk.target.ctx
        self._gbuffer, self._light = GBufferPass(context), PixelIrradiancePass(context)
        self._tonemap = TonemapPass(context)
        self._image = desk.app.view.picture.image
        self._nothing = context.texture((1, 1), 3, dtype="f4")
        self._targets = self._gbuffer.targets(self._image.size), self._light.targets(self._image.size)

    def draw(self, scene: Scene) -> None:
        """Draw it and the window around it."""
        finished = self._desk.app.view.live.finished
        assert finished is not None
        lit, (gbuffer, light) = finished.lit, self._targets
        self._gbuffer.render(lit.model.buffers, lit.camera.world_to_clip, gbuffer)
        textures = finished.gather.tables
        local = replace(textures.tables.local, reach=0.0)
        surface = replace(finished.gather, tables=replace(textures, tables=replace(textures.tables, local=local)))
        exhausted(self._light.steps(gbuffer, lit.sources, surface, scene.specular, self._nothing, lit.camera, light))
        average = self._tonemap.log_average(light.irradiance) or 1.0
        nowhere = Background(self._nothing, 0.0, 0.0)
        self._tonemap.render(light.irradiance, average, scene.display, nowhere, lit.camera, self._image)
        self._desk.app.frame(self._desk.target)


def window_rows(scene: Scene, setting: str, repeats: int) -> Iterator[WindowRow]:
    """Measure the window of a scene: orbit, sliders and the user interface by itself."""
    with current(headless_context()), closing(Desk(scene)) as desk:
        for what, times in _measured(desk, repeats):
            yield WindowRow(setting, what, Timing(tuple(times)))


def _measured(desk: Desk, repeats: int) -> Iterator[tuple[str, list[float]]]:
    yield from _orbits(desk, repeats)
    yield from _materials(desk, max(3, repeats // 4))
    for section in ("Material", "Lights", "Tone mapping"):  # folded ones make room
        desk.click(desk.at(f"section.{section}", 0.3))
    desk.press(desk.at("display.key", 0.4))
    yield EXPOSURE, [desk.move(SLIDE) for _ in range(repeats)]
    desk.release()
    desk.settle()
    shown: list[float] = []
    hidden: list[float] = []
    for _ in range(repeats):
        for panel_shown, times in ((True, shown), (False, hidden)):
            desk.app.actions.panel_shown = panel_shown
            desk.frame()  # lays out
            times.append(desk.timed(lambda: desk.app.frame(desk.target)))
    yield REST, shown
    yield PANEL, [float(np.median(shown) - np.median(hidden))]  # single differences are mostly noise


def _orbits(desk: Desk, repeats: int) -> Iterator[tuple[str, list[float]]]:
    """Turn the object: at full quality in turns with no scattering at all, then as the mouse does."""
    session, live, plain = desk.app.session, desk.app.view.live, Plain(desk)
    full, without, start = [], [], desk.now
    for i in range(repeats + 1):
        camera = session.scene.camera
        session.look(replace(camera, azimuth_deg=camera.azimuth_deg + TURN * 0.35))
        taken = desk.timed(lambda: desk.app.frame(desk.target))
        live.wait(LIMIT)
        desk.frame()  # takes what the worker did for the new view
        desk.now = start  # no time has passed: nothing is antialiased in between
        taken_without = desk.timed(lambda: plain.draw(session.scene))
        if i:
            full.append(taken)
            without.append(taken_without)
    desk.settle()
    width, height = desk.app.view.size
    desk.press((0.3 * width, 0.5 * height))
    dragged = [desk.move(TURN) for _ in range(repeats)]
    desk.release()
    desk.settle()
    yield from ((ORBIT, full), (ORBIT_DRAFT, dragged), (PLAIN, without))


def _materials(desk: Desk, repeats: int) -> Iterator[tuple[str, list[float]]]:
    """Move a slider of the material one step: until a volume of the new material is drawn, and until all is done."""
    live, first, settled = desk.app.view.live, [], []
    for i in range(repeats + 1):
        desk.press(desk.at("material.sigma_a.R", 0.4 + 0.03 * i))
        desk.settle()  # the press itself set a value
        before = live.finished
        taken = desk.move(4.0 * SLIDE)
        taken += desk.until(lambda before=before: live.finished is not before)  # type: ignore[misc]
        desk.release()
        rest = desk.until(desk.app.view.at_rest)
        if i:
            first.append(taken)
            settled.append(taken + rest)
    yield from ((FIRST, first), (SETTLED, settled))


def report_window(report: Report, rows: Sequence[WindowRow]) -> None:
    """One table a setting, and how orbiting compares with a picture without scattering."""
    for setting in dict.fromkeys(row.setting for row in rows):
        found = {row.what: row for row in rows if row.setting == setting}
        report.table(
            f"The window, {setting}",
            ["what", "ms, minimum / median", "frames a second", "wanted"],
            (
                [
                    row.what,
                    f"{row.time.least:.1f} / {row.time.median:.1f}",
                    f"{row.rate:.1f}" if row.what in (ORBIT, ORBIT_DRAFT, PLAIN, EXPOSURE) else "",
                    WANTED.get(row.what, ""),
                ]
                for row in found.values()
            ),
        )
        share = found[PLAIN].time.median / found[ORBIT].time.median
        report.say(
            f"Orbiting has {100.0 * share:.0f} % of the rate without scattering at full quality (wanted: "
            f"{100.0 * SHARE_WANTED:.0f} %), {100.0 * found[PLAIN].time.median / found[ORBIT_DRAFT].time.median:.0f} % "
            "as dragged."
        )
    report.csv(
        "window.csv",
        [
            {
                "setting": row.setting,
                "what": row.what,
                "min_ms": row.time.least,
                "median_ms": row.time.median,
                "frames_a_second": row.rate,
            }
            for row in rows
        ],
    )
