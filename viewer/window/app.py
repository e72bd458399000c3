"""The contents of the window: events in, frames out, in any framebuffer.

`viewer.window.window` feeds it from GLFW; tests and replays feed it without a display.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.viewer.files.photograph import load_photo
from milkglass.viewer.gl.context import free_dropped
from milkglass.viewer.gui.controls import Box, Controls
from milkglass.viewer.gui.events import Closed, Drawn, Dropped, Event, Focused, Invoked, Key, MouseButton
from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.gui.sliders import percent
from milkglass.viewer.gui.toolkit import BACKGROUND, Gui, imgui
from milkglass.viewer.live.error import LiveError
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.scene.scene import START, Scene
from milkglass.viewer.session.autosave import Autosave, LeftBehind
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.commands import Workspace, cheat_sheet, commands_of
from milkglass.viewer.window.curves.view import ProfileView
from milkglass.viewer.window.layout import view_and_panel
from milkglass.viewer.window.panel.error import walk_verdict
from milkglass.viewer.window.panel.panel import Panel
from milkglass.viewer.window.panel.section import Seen, Tools
from milkglass.viewer.window.photograph.actions import PhotoActions
from milkglass.viewer.window.photograph.subject import PhotographSubject
from milkglass.viewer.window.status import progress_status, subject_status
from milkglass.viewer.window.view.actions import Actions, Clipboard, MemoryClipboard
from milkglass.viewer.window.view.area import ViewArea
from milkglass.viewer.window.view.error_overlay import ErrorOverlay
from milkglass.viewer.window.view.overlays import GAP, Messages, draw_help, draw_status
from milkglass.viewer.window.view.subject import ModelSubject


def make_contents(
    graphics: tuple[moderngl.Context, Gui, ImguiRenderer],
    session: Session,
    preferences: Preferences,
    clipboard: Clipboard,
    wake: Callable[[], object],
    photo: PhotoWork | None,
) -> tuple[ViewArea, Actions, PhotoActions | None]:
    """Make the view of a session and what commands do to both; parameters as of `viewer.window.app.App`."""
    if photo is None:
        view = ViewArea(*graphics, session, wake, ModelSubject(session))
        return view, Actions(session, view, preferences, clipboard), None
    session.view.photograph = photo.photo.path.name
    subject = PhotographSubject(graphics[0], graphics[2], session, photo)
    view = ViewArea(*graphics, session, wake, subject)
    actions = Actions(session, view, preferences, clipboard)
    return view, actions, PhotoActions(session, view, subject, photo, actions)


FRAMES_AN_EVENT = 3  # ImGui needs a few to come to rest: one to see, one to lay out, one to draw
PATIENCE = 0.06  # seconds that all but the first leave the processor to the worker that a drag waits for
TOOLTIP_SECONDS = 0.75  # after the pointer has come to rest
RATE_WEIGHT = 0.2  # of the newest frame in the rate that is shown


class App:
    """Holds the session, the view, the panel and the commands; takes events and draws frames.

    Parameters
    ----------
    context : moderngl.Context
        Current in this thread, see `viewer.gl.context.current`.
    scene : Scene
    path : Path, optional
        The scene file that it came from.
    preferences : Preferences, optional
    wake : callable, optional
        Called from any thread when a frame should be drawn.
    clipboard : Clipboard, optional
    clock : callable, optional
        Seconds, from any start.
    photo : PhotoWork, optional

    Attributes
    ----------
    help_boxes : pair of Box, optional
        Where the cheat sheet and all that is in it were last drawn.
    """

    def __init__(
        self,
        context: moderngl.Context,
        scene: Scene,
        *,
        path: Path | None = None,
        preferences: Preferences | None = None,
        wake: Callable[[], object] = lambda: None,
        clipboard: Clipboard | None = None,
        clock: Callable[[], float] = time.monotonic,
        photo: PhotoWork | None = None,
    ) -> None:
        self.preferences = preferences or Preferences()
        self.clock = clock
        self.frames_per_second = 0.0
        self.help_boxes: tuple[Box, Box] | None = None
        self.error_overlay = ErrorOverlay()
        self._context, self._wake, self._clipboard = context, wake, clipboard or MemoryClipboard()
        self._gui = Gui()
        self._gui.share_clipboard(self._clipboard.get, self._clipboard.set)
        self._painter = ImguiRenderer(context)
        self._messages = Messages()
        self._wanted: PhotoWork | None = None  # a photograph that the next frame shows
        self._fill(scene, path, photo)
        self._autosave: Autosave | None = None
        self._left_behind: LeftBehind | None = None
        self._frames_due = FRAMES_AN_EVENT
        self._last_event = self.clock()
        self._tooltip_due = False
        self._gestures = 0
        self._last_frame: float | None = None

    def _fill(self, scene: Scene, path: Path | None, photo: PhotoWork | None) -> None:
        """Make a session of a scene and all that shows it."""
        self.session, wake = Session(scene, path), self._wake
        graphics = self._context, self._gui, self._painter
        parts = make_contents(graphics, self.session, self.preferences, self._clipboard, wake, photo)
        self.view, self.actions, photo_actions = parts
        self.actions.show_photograph = self._want_photograph
        self.workspace = Workspace(self.session, self.actions, photo_actions, self._messages.clear, self.cancel)
        self.commands = commands_of(self.workspace)
        self.error = LiveError(self._context, wake)
        controls = Controls(self.session, self._gui)
        self.panel = Panel(Tools(self.session, controls, self.commands, photo), self._gui)
        self.profiles = ProfileView(self.session, controls, self.commands, wake)

    def _want_photograph(self, path: Path) -> None:
        """Have the next frame show a photograph, whose mask is to be painted."""
        self._wanted = PhotoWork(load_photo(path, None))
        self.wake()

    def _show_wanted(self) -> None:
        """Show the photograph that is wanted in place of all there is, in the material that there is."""
        work, self._wanted = self._wanted, None
        if work is None:
            return
        self.leave(is_done=True)
        self.stop()
        self.profiles.close()
        self._autosave = None
        self._fill(replace(START, material=self.session.scene.material, lights=()), None, work)

    @property
    def messages(self) -> list[str]:
        """Messages that show."""
        return self._messages.texts

    @property
    def title(self) -> str:
        """Title of the window: the name of the file, with a star while the scene is not saved."""
        is_changed = self.session.modified or any(work.unsaved() for work in self.actions.work)
        return f"{self.session.file_name}{' *' if is_changed else ''} - milkglass"

    def handle(self, event: Event) -> None:
        """Take an event for the next frames."""
        self._frames_due, self._last_event, self._tooltip_due = FRAMES_AN_EVENT, self.clock(), True
        if isinstance(event, MouseButton | Key):
            if event.pressed or isinstance(event, MouseButton):
                self._gestures += 1
            self.session.gesture = self._gestures
        if isinstance(event, Dropped):
            for dropped in event.paths:
                self.commands.run("open", dropped)
        elif isinstance(event, Invoked):
            self.commands.run(event.command, event.argument)
        elif isinstance(event, Closed):
            self.actions.quit()
        elif not isinstance(event, Drawn):
            self._gui.feed(event)
        if event == Focused(True):  # whoever comes back may have edited a file meanwhile
            self.commands.run("reread_files")

    def wake(self) -> None:
        """Have a frame drawn soon: a worker has finished."""
        self._frames_due = max(self._frames_due, 1)

    def next_frame(self) -> float | None:
        """Return the seconds until a frame is due, 0 for now, None if only an event can make one."""
        if self._frames_due > 0:
            waits_for_worker = self._frames_due < FRAMES_AN_EVENT and self.view.detail.draft and self.view.working
            return max(0.0, self._last_event + PATIENCE - self.clock()) if waits_for_worker else 0.0
        now = self.clock()
        waits = [self.view.next_change(now)]
        end = self._messages.next_end()
        waits.append(None if end is None else max(0.0, end - now))
        if self._tooltip_due:
            waits.append(max(0.0, self._last_event + TOOLTIP_SECONDS - now))
        if self._autosave is not None:
            waits.append(self._autosave.due(self.session, now))
        return min((wait for wait in waits if wait is not None), default=None)

    def frame(self, target: moderngl.Framebuffer) -> None:
        """Draw a frame into a framebuffer."""
        now = self.clock()
        self._frames_due = max(0, self._frames_due - 1)
        if self._tooltip_due and now >= self._last_event + TOOLTIP_SECONDS:
            self._tooltip_due = False
            self._frames_due = max(self._frames_due, 1)  # ImGui sees that the pointer rests, then shows it
        self._show_wanted()
        if min(self._gui.pixels) <= 0 or min(self._gui.size) <= 0:  # minimised
            return
        self._gui.begin(now)
        self._keys()
        view_box, panel_box = self.boxes()
        view_box, profile_box = self.profiles.split(view_box)
        if self.actions.panel_shown:
            self.panel.follow_keys(entered=self.actions.panel_entered)
            self.panel.draw(panel_box, Seen(self.view.live, self.error, self.frames_per_second))
            self.commands.run_requests()
        self._draw_view(view_box, now)
        if profile_box is not None:
            self.profiles.draw(profile_box, self.view.live)
            self.commands.run_requests()
        self._keep(now)
        self.actions.dialog.draw()
        self.actions.questions.draw()
        self._messages.take(self.session.messages, now)
        self._messages.draw(view_box)
        if self.actions.help_shown:
            self.help_boxes = draw_help(self._gui, cheat_sheet())
        data = self._gui.end()
        if self._gui.has_events:
            self._frames_due = FRAMES_AN_EVENT
        target.use()
        target.clear(*BACKGROUND)
        self._painter.draw(data, target, self._gui.pixels)
        free_dropped(self._context)
        self._count(now)
        if self.actions.capture is not None:
            self.actions.write_capture(read_pixels(target, self._gui.pixels))
            self._frames_due = FRAMES_AN_EVENT
        if self.session.messages:
            self._frames_due = FRAMES_AN_EVENT

    def at_rest(self) -> bool:
        """Whether the picture, the error and the curves are final."""
        return self.view.at_rest() and self.error.progress is None and not self.profiles.busy

    def keep_in(self, autosave: Autosave) -> None:
        """Keep unsaved edits from now on, and offer those that an earlier process left."""
        self._autosave, self._left_behind = autosave, autosave.left_behind()

    def leave(self, *, is_done: bool) -> None:
        """Drop what is kept of unsaved edits, unless the person is not done with them: then keep the last of them."""
        if self._autosave is not None and is_done:
            self._autosave.clear()
        elif self._autosave is not None:
            self._autosave.follow(self.session, np.inf)

    def stop(self) -> None:
        """Have the workers give up what they do, and wait for none of them."""
        self.error.stop()
        self.profiles.stop()
        self.view.stop()

    def close(self) -> None:
        """Stop the workers and free ImGui's objects."""
        self.error.close()
        self.profiles.close()
        self.view.close()
        self._painter.release()
        self._gui.close()
        free_dropped(self._context)

    def mouse_cursor(self) -> str:
        """Return the shape of the pointer, by its name in `imgui.MouseCursor_`."""
        return str(imgui.MouseCursor_(imgui.get_mouse_cursor()).name)

    def boxes(self) -> tuple[Box, Box]:
        """Return the boxes of the view and of the panel in the window."""
        return view_and_panel(self._gui.size, imgui.get_font_size(), panel_shown=self.actions.panel_shown)

    def _keep(self, now: float) -> None:
        """Keep unsaved edits, and offer those that an earlier process left once there is a scene to go back to."""
        if self._autosave is None:
            return
        if self._left_behind is not None and self.session.has_worked:
            left, self._left_behind = self._left_behind, None
            self.actions.offer(left, self._autosave)
        self._autosave.follow(self.session, now)

    def _keys(self) -> None:
        if imgui.get_io().want_text_input or self.actions.dialog.is_open or self.actions.questions.current is not None:
            return
        if not self._moves_in_panel():
            self.commands.run_pressed()

    def _moves_in_panel(self) -> bool:
        """Run the keys of commands while others move in the panel; return whether they do."""
        actions = self.actions
        any_popup = imgui.PopupFlags_.any_popup_id.value | imgui.PopupFlags_.any_popup_level.value
        is_left = imgui.is_key_pressed(imgui.Key.escape) and not imgui.is_popup_open("", any_popup)
        if not actions.panel_entered:
            return False
        if is_left or imgui.is_mouse_clicked(imgui.MouseButton_.left.value) or not actions.panel_shown:
            actions.panel_entered = False
        else:
            self.commands.run_pressed(only_modified=True)
        return True

    def _draw_view(self, box: Box, now: float) -> None:
        flags = imgui.WindowFlags_
        bare = flags.no_decoration.value | flags.no_move.value | flags.no_background.value
        bare |= flags.no_bring_to_front_on_focus.value | flags.no_nav.value | flags.no_scroll_with_mouse.value
        imgui.set_next_window_pos((box[0], box[1]))
        imgui.set_next_window_size((box[2] - box[0], box[3] - box[1]))
        imgui.push_style_var(imgui.StyleVar_.window_padding.value, (0.0, 0.0))
        imgui.begin("view", None, bare)
        imgui.pop_style_var()
        self.view.steer(box, now)
        points = self.session.view.error_points if self.session.view.measure else None
        self.error.follow(self.view.shown, points)
        self.view.draw()
        self._measure()
        if self.view.at_rest():
            self.session.settles()
        draw_status(box, *self.status())
        imgui.end()

    def _measure(self) -> None:
        """Measure the error of what is on screen, if that is wanted, and show where it sits."""
        view = self.session.view
        at_rest = self.view.at_rest() and not any(imgui.get_io().mouse_down[:3])
        if self.error.update(self.view.shown, self.view.live, at_rest=at_rest):
            self._frames_due = max(self._frames_due, 1)
        dots, picture = self.error.dots, self.view.drawn_at
        hides = view.show in ("layer in", "layer out") or not (view.measure and view.error_map)
        if dots is None or hides or not len(dots.rows) or not dots.lies_in(self.view.shown):
            return
        right = picture[2] if view.split is None else picture[0] + view.split * (picture[2] - picture[0])
        hovered = imgui.is_window_hovered()
        self.error_overlay.draw(dots, picture, right, faded=self.error.outdated, is_hovered=hovered)

    def status(self) -> tuple[str, str]:
        """Return what the picture is of, and what goes on, in words."""
        can_cancel = self.session.can_cancel or self.error.progress is not None
        going_on = progress_status(self.view, self.session.scene, self.error_status(), can_cancel=can_cancel)
        rate = f"{self.frames_per_second:.0f} fps" if self.frames_per_second > 0.0 else ""
        return subject_status(self.session, self.view.live), GAP.join(filter(None, (going_on, rate)))

    def cancel(self) -> None:
        """Give up what is computed: the measurement of the error, else what has changed since the last picture."""
        if self.error.progress is not None:
            self.session.view.measure = False
        elif self.session.can_cancel and self.view.live.doing(self.session.scene) is not None:
            self.session.cancel()
            self.view.live.give_up()
            self.session.say("cancelled: everything is as it was before")

    def error_status(self) -> str:
        """Return the error of the picture in a few words, or how far its measurement is; else nothing."""
        result, walked = self.error.result, self.error.walked
        if self.error.progress is not None:
            so_far = "" if walked is None or self.error.outdated else f"   so far {walk_verdict(walked)}"
            return f"measuring the error: {100.0 * self.error.progress:.0f} %{so_far}   Esc cancels"
        if not self.session.view.measure or self.error.outdated:
            return ""
        if walked is not None:
            return walk_verdict(walked)
        if result is None or result.is_dark:
            return ""
        return f"error {percent(max(result.error.deviation.rms))}"

    def _count(self, now: float) -> None:
        """Keep the rate of pictures while they come one after another."""
        if self.view.changed and self._last_frame is not None and 0.0 < now - self._last_frame < 1.0:
            rate = 1.0 / (now - self._last_frame)
            old = self.frames_per_second or rate
            self.frames_per_second = old + RATE_WEIGHT * (rate - old)
        self._last_frame = now if self.view.changed else None
        if self.frames_per_second and self.view.at_rest():
            self.frames_per_second = 0.0
            self._frames_due = max(self._frames_due, 1)  # without it


def read_pixels(target: moderngl.Framebuffer, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return the pixels of a framebuffer of a size (width, height): (height, width, 3) uint8, top row first."""
    width, height = size
    data = target.read(viewport=(0, 0, width, height), components=3, alignment=1)
    pixels = np.frombuffer(data, np.uint8).reshape(height, width, 3)
    return np.ascontiguousarray(pixels[::-1])
