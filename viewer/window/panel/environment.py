"""The panel's section on the environment: a file or a builtin probe, how it is turned, whether it shows."""

from dataclasses import replace

from milkglass.viewer.gui.controls import RESET_HINT, explained
from milkglass.viewer.gui.toolkit import icons, imgui
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.scene import Change
from milkglass.viewer.scene.settings import BUILTIN_PROBES
from milkglass.viewer.window.panel.section import Section, Seen


class EnvironmentSection(Section):
    """Draws the light probe, its settings, and the built-in probes."""

    title = "Environment"

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        session, controls = self._session, self._controls
        environment = session.scene.environment
        controls.begin_row("Probe")
        name = "choose a file" if environment.path is None else environment.path.name
        if imgui.button(f"{name}##environment.path", (-1.0, 0.0)):
            self._commands.request("open_probe")
        controls.end_row("environment.path", "Probe", "Light from all around: an .hdr or .exr file. Or drop one here.")
        controls.setting("environment.projection", "Projection")  # chosen before a file that needs it is opened
        self._builtin()
        if not environment.given:
            controls.note("no environment: drop an .hdr or .exr file on the window, or choose one that is built in")
            return
        controls.setting("environment.rotation_deg", "Rotation")
        controls.setting("environment.intensity", "Intensity")
        controls.setting("environment.extract", "Sharp sources")
        controls.setting("environment.occluded", "Occluded")
        controls.setting("display.background_blur_deg", "Backdrop blur")
        shown = session.scene.display.background == "environment"
        clicked, shown = imgui.checkbox("show behind the object", shown)
        controls.mark("environment.shown")
        if clicked:
            session.edit("display", background="environment" if shown else "black")
        if imgui.button(f"{icons.ICON_FA_TRASH}  Remove the probe"):
            self._remove()
        controls.mark("environment.remove")

    def _builtin(self) -> None:
        controls, environment = self._controls, self._session.scene.environment
        controls.begin_row("Built in", resettable=True)
        name = controls.choice(
            "environment.builtin", environment.builtin, BUILTIN_PROBES, environment.builtin or "none"
        )
        if name is not None:
            self._session.change([Change("environment", "builtin", name, "environment.builtin")])
        tip = f"{explained(settings_of(environment)['builtin'], None)}\n{RESET_HINT}"
        differs = environment.builtin is not None
        controls.end_row(
            "environment.builtin", "Built in", tip, self._remove if differs else lambda: None, differs=differs
        )

    def _remove(self) -> None:
        scene = self._session.scene
        display = scene.display
        if display.background == "environment":
            display = replace(display, background="black")
        environment = replace(scene.environment, path=None, builtin=None)
        self._session.put(replace(scene, environment=environment, display=display))
