"""The panel's section on the ground, the plane that the object stands on."""

from milkglass.viewer.gui.controls import RESET_HINT, explained
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.settings import GroundSettings
from milkglass.viewer.window.panel.section import Section, Seen


class GroundSection(Section):
    """Draws the switch of the ground, what of it is shown, its place and its colour."""

    title = "Ground"

    def shows(self) -> bool:
        """Whether the window shows a model, which can stand on something."""
        return self._work is None

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        self._controls.setting("ground.on", "Ground")
        if not self._session.scene.ground.on:
            return
        self._controls.setting("ground.shown", "Shown")
        self._controls.setting("ground.gap_mm", "Gap")
        self._controls.setting("ground.reflectance", "Reflectance")
        self._color()

    def _color(self) -> None:
        session, controls, default = self._session, self._controls, GroundSettings().color
        color = session.scene.ground.color
        controls.begin_row("Colour", resettable=True)
        flags = imgui.ColorEditFlags_.float.value | imgui.ColorEditFlags_.no_inputs.value
        changed, new = imgui.color_edit3("##ground.color", list(color), flags)
        if changed:
            session.edit("ground", color=tuple(float(f"{channel:.6g}") for channel in new))
        tip = f"{explained(settings_of(session.scene.ground)['color'], default)}\n{RESET_HINT}"
        reset = lambda: session.edit("ground", color=default)  # noqa: E731
        controls.end_row("ground.color", "Colour", tip, reset, differs=color != default)
