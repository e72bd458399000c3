"""The panel's section on the model: its file, its bodies, the colours and the relief of its surface."""

from dataclasses import replace

from milkglass.viewer.assets.sources import model_source
from milkglass.viewer.files.model_look import Look
from milkglass.viewer.gui.controls import RESET_HINT, explained
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.settings import BUILTINS, ModelSettings
from milkglass.viewer.window.panel.parts import PartRows
from milkglass.viewer.window.panel.section import Section, Seen, Tools

NO_MAP = "The model has no texture coordinates that a picture could lie on."
NO_COLOURS = "The model has no colours; give it a texture."
NO_COLOURS_NO_MAP = "The model has no colours, and no texture coordinates that a texture could lie on."
NO_RELIEF = "The model has no normal map."
PICTURES = (("texture", "Texture", "has_colours"), ("normal_map", "Normal map", "has_relief"))


class ModelSection(Section):
    """Draws the model's file, its up axis, its bodies, the colours and the relief of its surface."""

    title = "Model"

    def __init__(self, tools: Tools) -> None:
        super().__init__(tools)
        self._parts = PartRows(tools.session, tools.controls)

    def shows(self) -> bool:
        """Whether the window shows a model."""
        return self._work is None

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        session, controls, live = self._session, self._controls, seen.live
        path = session.scene.model.path
        controls.begin_row("Model")
        if imgui.button(f"{session.scene.model.builtin_name if path is None else path.name}##model", (-1.0, 0.0)):
            self._commands.request("open_model")
        controls.end_row("model.path", "Model", "A mesh file. Or drop one on the window.")
        controls.setting("model.up", "Up axis", automatic="y" if path is None else "of the file")
        bodies = None if live.finished is None else live.finished.lit.bodies
        controls.setting("model.bodies", "Bodies", automatic="joined" if bodies is None else "separate")
        if bodies is not None:
            controls.note(
                "one body: nothing to separate"
                if bodies.count == 1
                else f"{bodies.count} bodies, each scatters light alone"
            )
        if path is not None:
            controls.setting("model.nested", "Shell in shell")
            controls.setting("model.close_holes", "Close holes")
        self._parts.draw(live)
        self._surface(live)
        if path is not None:
            if imgui.button("Built-in sculpture"):
                model = ModelSettings(builtin=BUILTINS[0], size_mm=session.scene.model.size_mm)
                if isinstance(model.size_mm, str):
                    model = ModelSettings(builtin=BUILTINS[0])
                session.put(replace(session.scene, model=model, materials=()))
            controls.mark("model.builtin")

    def _surface(self, live: Live) -> None:
        """Draw the rows for the colours and the relief of the surface."""
        model, controls = self._session.scene.model, self._controls
        look = live.assets.look(model) if live.assets.has(model_source(model)) else None
        for key, label, fact in PICTURES:
            self._picture(look, key, label, of_file=look is not None and getattr(look, fact))
        colours, relief = missing(look, model)
        controls.setting("detail.albedo", "Colours", off=colours)
        controls.setting("detail.normal_strength", "Relief", off=relief)

    def _picture(self, look: Look | None, key: str, label: str, *, of_file: bool) -> None:
        """Draw a button that asks for a picture on the surface, which takes the place of that `of_file`."""
        session, controls = self._session, self._controls
        path = getattr(session.scene.model, key)
        mapped = path is not None or (look is not None and look.mapped)
        imgui.begin_disabled(not mapped)
        controls.begin_row(label, resettable=True)
        spare = imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x
        name = ("of the file" if of_file else "none") if path is None else path.name
        if imgui.button(f"{name}##model.{key}", (-spare, 0.0)):
            self._commands.request(f"open_{key}")
        tip = explained(settings_of(session.scene.model)[key], None) + "\n" + (RESET_HINT if mapped else NO_MAP)
        reset = lambda: session.edit("model", **{key: None})  # noqa: E731
        controls.end_row(f"model.{key}", label, tip, reset, differs=path is not None, is_off=not mapped)
        imgui.end_disabled()


def missing(look: Look | None, model: ModelSettings) -> tuple[str | None, str | None]:
    """Return the reasons, sentences, for which the model lacks colours and relief; None where it has them."""
    mapped = look is not None and look.mapped
    has_colours = model.texture is not None or (look is not None and look.has_colours)
    has_relief = model.normal_map is not None or (look is not None and look.has_relief)
    return None if has_colours else NO_COLOURS if mapped else NO_COLOURS_NO_MAP, None if has_relief else NO_RELIEF
