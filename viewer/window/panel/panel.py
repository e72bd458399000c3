"""The panel: everything that can be changed, from top to bottom."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from milkglass.viewer.gui.controls import RESET_HINT, Box, Controls
from milkglass.viewer.gui.toolkit import Gui, icons, imgui
from milkglass.viewer.live.error import LiveError
from milkglass.viewer.live.live import Live, solves
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.scene.settings import BUILTINS, ModelSettings
from milkglass.viewer.session.session import SHOWN, Session
from milkglass.viewer.window.panel.environment import EnvironmentPanel
from milkglass.viewer.window.panel.error import ErrorPanel
from milkglass.viewer.window.panel.lights import LightsPanel
from milkglass.viewer.window.panel.material import MaterialPanel
from milkglass.viewer.window.panel.model import draw_detail
from milkglass.viewer.window.panel.photograph import CAMERA, PhotoPanel
from milkglass.viewer.window.panel.profile import NO_PROFILE
from milkglass.viewer.window.panel.transport import draw_transport

WIDTH = 25.0  # in letters' heights
SHOWN_TIPS = {
    "beauty": "the picture",
    "irradiance": "light that enters, E",
    "exitance": "light that leaves, M",
    "subsurface": "light that leaves towards the eye, F_t M / π",
    "highlight": "the gloss alone",
    "normal": "direction of the surface",
    "layer in": "light that was put on one layer",
    "layer out": "light that one layer gives",
}


class Panel:
    """Draws the panel; what is not an edit of the scene is left in `requests` for the window.

    Attributes
    ----------
    requests : list of str
        Actions asked for by buttons in this frame.
    """

    def __init__(self, session: Session, gui: Gui, photo: PhotoWork | None = None) -> None:
        self.controls = Controls(session, gui)
        self.requests: list[str] = []
        self._session = session
        self._material = MaterialPanel(session, self.controls, self.requests)
        self._lights = LightsPanel(session, self.controls)
        self._environment = EnvironmentPanel(session, self.controls, self.requests)
        self._error = ErrorPanel(session, self.controls)
        self._photo = None if photo is None else PhotoPanel(session, self.controls, photo, self.requests)
        self._was_measuring = False

    def draw(self, box: Box, live: Live, error: LiveError, frames_per_second: float, recent: list[str]) -> None:
        """Draw it into a box of the window."""
        self.controls.begin()
        self.requests.clear()
        imgui.set_next_window_pos((box[0], box[1]))
        imgui.set_next_window_size((box[2] - box[0], box[3] - box[1]))
        flags = imgui.WindowFlags_.no_decoration.value & ~imgui.WindowFlags_.no_scrollbar.value
        flags |= imgui.WindowFlags_.no_move.value | imgui.WindowFlags_.no_bring_to_front_on_focus.value
        imgui.push_style_var(imgui.StyleVar_.window_rounding.value, 0.0)
        imgui.begin("panel", None, flags)
        imgui.pop_style_var()
        self._toolbar(recent)
        imgui.begin_child("rows")
        self._shown(live)
        self._material.no_profile = NO_PROFILE if solves(live) else None
        for label, is_open, draw in self._sections(live, error):
            if label == "Error" and self._session.view.measure and not self._was_measuring:  # a key asked for it
                imgui.set_next_item_open(True)
                imgui.set_scroll_here_y(0.0)
            if self.controls.section(label, is_open=is_open):
                draw()
                imgui.spacing()
        if self.controls.section("Performance"):
            self._performance(live, frames_per_second)
        imgui.end_child()
        imgui.end()
        self._was_measuring = self._session.view.measure

    def _sections(self, live: Live, error: LiveError) -> tuple[tuple[str, bool, Callable[[], object]], ...]:
        """What folds: a heading, whether it starts open, and what draws it."""
        photo = self._photo
        shared: tuple[tuple[str, bool, Callable[[], object]], ...] = (
            ("Material", True, self._material.draw),
            ("Lights", True, self._lights.draw),
            ("Environment", False, self._environment.draw),
            ("Highlights", False, self._environment.highlights),
        )
        transport = ("Light transport", True, lambda: draw_transport(self.controls, live))
        if photo is not None:
            return ("Photograph", True, photo.draw), *shared, transport, ("Camera", False, photo.camera)
        return (
            *shared,
            ("Tone mapping", False, self._tone_mapping),
            transport,
            ("Error", False, lambda: self._error.draw(error, live)),
            ("Model", False, lambda: self._model(live)),
            ("Camera", False, self._camera),
        )

    def _toolbar(self, recent: list[str]) -> None:
        session, controls = self._session, self.controls
        buttons = (
            ("open_file", icons.ICON_FA_FOLDER_OPEN, "Open a model, probe or scene (Ctrl+O)", True),
            ("recent", icons.ICON_FA_CLOCK_ROTATE_LEFT, "Recent files", bool(recent)),
            ("save", icons.ICON_FA_FLOPPY_DISK, "Save the scene (Ctrl+S)", True),
            ("screenshot", icons.ICON_FA_CAMERA, "Picture of the window (F12); the object alone: Ctrl+F12", True),
            ("undo", icons.ICON_FA_ROTATE_LEFT, "Undo (Ctrl+Z)", session.can_undo),
            ("redo", icons.ICON_FA_ROTATE_RIGHT, "Redo (Ctrl+Shift+Z)", session.can_redo),
            ("flip", icons.ICON_FA_RIGHT_LEFT, "Keep this state, then flip between the two (K, B)", True),
            ("toggle_split", icons.ICON_FA_TABLE_COLUMNS, "Split the view: this state and the kept one (V)", True),
            ("toggle_profiles", icons.ICON_FA_CHART_LINE, "Curves of the profile, below the picture (P)", True),
            ("toggle_help", icons.ICON_FA_CIRCLE_QUESTION, "Mouse and keys (H)", True),
        )  # fmt: skip
        for action, icon, tip, usable in buttons:
            imgui.begin_disabled(not usable)
            on = action == "toggle_split" and session.view.split is not None
            on = on or (action == "toggle_profiles" and session.view.profiles)
            if controls.icon(action, icon, tip, on=on):
                if action == "recent":
                    imgui.open_popup("recent files")
                else:
                    self.requests.append(action)
            imgui.end_disabled()
            imgui.same_line()
        imgui.new_line()
        if imgui.begin_popup("recent files"):
            for name in recent:
                clicked, _ = imgui.selectable(f"{Path(name).name}##{name}", False)
                if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                    controls.tooltip("", name)
                if clicked:
                    self.requests.append(f"open {name}")
            imgui.end_popup()

    def _shown(self, live: Live) -> None:
        view, controls = self._session.view, self.controls
        controls.begin_row("Show", True)
        view.show = (
            controls.choice("show", view.show, SHOWN, tips=SHOWN_TIPS, flags=imgui.ComboFlags_.height_large.value)
            or view.show
        )
        tip = f"What the view shows: the picture, or one of its parts.\n{RESET_HINT}"
        controls.end_row("show", "Show", tip, lambda: setattr(view, "show", "beauty"), view.show != "beauty")
        if view.show in ("layer in", "layer out") and live.finished is not None:
            last = live.finished.lit.grid.n_layers - 1
            view.layer = min(view.layer, last)
            controls.begin_row("Layer", True)
            layer = controls.sliders.integer("layer", view.layer + 1, 1, last + 1, f"{view.layer + 1} of {last + 1}")
            if layer is not None:
                view.layer = min(max(layer - 1, 0), last)
            controls.end_row(
                "layer", "Layer", f"Counted from the camera.\n{RESET_HINT}",
                lambda: setattr(view, "layer", 0), view.layer != 0,
            )  # fmt: skip

    def _tone_mapping(self) -> None:
        session, controls, view = self._session, self.controls, self._session.view
        controls.setting("display.key", "Key (exposure)")
        controls.setting("display.white", "White point")
        controls.begin_row("Lock exposure")
        locked = view.exposure_lock is not None
        clicked, _ = imgui.checkbox("##exposure_lock", locked)
        tip = "Hold the exposure at what it is now, so that pictures can be compared (L)."
        controls.end_row("exposure_lock", "Lock exposure", tip)
        if clicked:
            self.requests.append("toggle_exposure_lock")
        self._background()
        controls.begin_row("Fixed size")
        clicked, fixed = imgui.checkbox("##fixed_size", view.fixed_size)
        tip = "Draw the picture at its own size and fit it into the window, instead of at the window's size."
        controls.end_row("fixed_size", "Fixed size", tip)
        if clicked:
            view.fixed_size = fixed
        if view.fixed_size:
            self._image_size(session)

    def _image_size(self, session: Session) -> None:
        width, height = session.scene.display.image_size
        self.controls.begin_row("Picture size", True)
        changed, size = imgui.input_int2("##image_size", [width, height])
        if changed and imgui.is_item_deactivated_after_edit() | all(16 <= side <= 16384 for side in size):
            session.edit("display", image_size=tuple(size))
        self.controls.end_row(
            "display.image_size", "Picture size", f"Width and height; unit px.\n{RESET_HINT}",
            lambda: session.edit("display", image_size=(1024, 1024)), (width, height) != (1024, 1024),
        )  # fmt: skip

    def _background(self) -> None:
        session, controls = self._session, self.controls
        current = session.scene.display.background
        controls.begin_row("Background", True)
        imgui.set_next_item_width(imgui.get_content_region_avail().x - 2.4 * imgui.get_frame_height())
        kinds = ["black", "transparent", "environment", "colour"]
        if not session.scene.environment.given:
            kinds.remove("environment")
        shown = "colour" if current.startswith("#") else current
        kind = controls.choice("display.background", shown, kinds)
        if kind is not None:
            session.edit("display", background="#3a3d42" if kind == "colour" else kind)
        tip = f"What shows behind the object.\n{RESET_HINT}"
        if shown == "colour":
            imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
            colour = [int(current[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
            changed, new = imgui.color_edit3("##background_colour", colour, imgui.ColorEditFlags_.no_inputs.value)
            if changed:
                session.edit("display", background="#" + "".join(f"{round(255 * channel):02x}" for channel in new))
        controls.end_row(
            "display.background", "Background", tip,
            lambda: session.edit("display", background="black"), current != "black",
        )  # fmt: skip

    def _model(self, live: Live) -> None:
        session, controls = self._session, self.controls
        path = session.scene.model.path
        controls.begin_row("Model")
        if imgui.button(f"{session.scene.model.builtin_name if path is None else path.name}##model", (-1.0, 0.0)):
            self.requests.append("open_model")
        controls.end_row("model.path", "Model", "A mesh file. Or drop one on the window.")
        controls.setting("model.up", "Up axis")
        apart = live.finished is not None and live.finished.lit.bodies is not None
        controls.setting("model.bodies", "Bodies", automatic="separate" if apart else "joined")
        if live.finished is not None and live.finished.lit.bodies is not None:
            count = live.finished.lit.bodies.count
            controls.note(
                "one body: nothing to separate" if count == 1 else f"{count} bodies, each scatters light alone"
            )
        draw_detail(session, controls, self.requests, live)
        if path is not None:
            if imgui.button("Built-in sculpture"):
                model = ModelSettings(builtin=BUILTINS[0], size_mm=session.scene.model.size_mm)
                session.put(replace(session.scene, model=model))
            controls.mark("model.builtin")

    def _camera(self) -> None:
        for key, label in CAMERA:
            self.controls.setting(f"camera.{key}", label)

    def _performance(self, live: Live, frames_per_second: float) -> None:
        rate = f"{frames_per_second:.0f} frames a second" if frames_per_second > 0.0 else "at rest: nothing is drawn"
        imgui.text_disabled(rate)
        if imgui.begin_table("##stages", 2, imgui.TableFlags_.sizing_stretch_prop.value):
            imgui.table_setup_column("stage", imgui.TableColumnFlags_.width_stretch.value, 3.0)
            imgui.table_setup_column("ms", imgui.TableColumnFlags_.width_stretch.value, 1.0)
            for stage, milliseconds in live.stage_times.items():
                imgui.table_next_row()
                ran = stage in live.ran
                write = imgui.text_unformatted if ran else imgui.text_disabled
                imgui.table_next_column()
                write(stage)
                imgui.table_next_column()
                write(f"{live.ran.get(stage, milliseconds):.1f} ms")
            imgui.end_table()
        self.controls.note("Bright: ran for the last picture. Grey: kept from before, with the time it took then.")
