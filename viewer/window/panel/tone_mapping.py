"""The panel's section on how radiance becomes a picture: exposure, display transform, background, size."""

from milkglass.viewer.display.registry import transform
from milkglass.viewer.gui.controls import RESET_HINT
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.window.panel.section import Section, Seen


class ToneMappingSection(Section):
    """Draws the exposure, the display transform, the background and the size of the picture."""

    title = "Tone mapping"

    def shows(self) -> bool:
        """Whether the window shows a model: a photograph is exposed as it was taken."""
        return self._work is None

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        controls, session, view = self._controls, self._session, self._session.view
        controls.setting("display.transform", "Transform")
        controls.setting("display.key", "Key")
        controls.setting("display.exposure", "Exposure")
        has_white = transform(session.scene.display.transform).in_shader
        controls.setting("display.white", "White point", off=None if has_white else "The transform has its own white.")
        picture = seen.live.picture
        controls.setting("display.average", "Average", automatic=None if picture is None else picture.log_average)
        controls.begin_row("Lock exposure")
        locked = session.scene.display.average is not None
        clicked, _ = imgui.checkbox("##exposure_lock", locked)
        tip = "Keep the average of now in the scene, so that pictures can be compared (L)."
        controls.end_row("exposure_lock", "Lock exposure", tip)
        if clicked:
            self._commands.request("toggle_exposure_lock")
        self._background()
        controls.begin_row("Fixed size")
        clicked, fixed = imgui.checkbox("##fixed_size", view.fixed_size)
        tip = "Draw the picture at its own size and fit it into the window, instead of at the window's size."
        controls.end_row("fixed_size", "Fixed size", tip)
        if clicked:
            view.fixed_size = fixed
        if view.fixed_size:
            self._image_size()

    def _image_size(self) -> None:
        session = self._session
        width, height = session.scene.display.image_size
        self._controls.begin_row("Picture size", resettable=True)
        changed, size = imgui.input_int2("##image_size", [width, height])
        if changed and imgui.is_item_deactivated_after_edit() | all(16 <= side <= 16384 for side in size):
            session.edit("display", image_size=tuple(size))
        self._controls.end_row(
            "display.image_size", "Picture size", f"Width and height; unit px.\n{RESET_HINT}",
            lambda: session.edit("display", image_size=(1024, 1024)), differs=(width, height) != (1024, 1024),
        )  # fmt: skip

    def _background(self) -> None:
        session, controls = self._session, self._controls
        current = session.scene.display.background
        controls.begin_row("Background", resettable=True)
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
            lambda: session.edit("display", background="black"), differs=current != "black",
        )  # fmt: skip
