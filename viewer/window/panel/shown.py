"""The panel's first rows: which part of the picture the view shows."""

from milkglass.viewer.gui.controls import RESET_HINT, Controls
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.light_paths import PARTS
from milkglass.viewer.session.session import SHOWN, Session

TIPS = {
    "beauty": "the picture",
    "irradiance": "light that enters, E",
    "exitance": "light that leaves, M",
    "subsurface": "light from inside towards the eye",
    "highlight": "the gloss alone",
    "unscattered": "what is seen through the object",
    "once": "light that has scattered once inside",
    "often": "light that has scattered twice and more, and all that is not told apart",
    "normal": "direction of the surface",
    "layer in": "light that was put on one layer",
    "layer out": "light that one layer gives",
}


class ShownRows:
    """Draws the choice of what the view shows, and of the layer where it shows one."""

    def __init__(self, session: Session, controls: Controls) -> None:
        self._session, self._controls = session, controls

    def draw(self, live: Live) -> None:
        """Draw the rows in the current ImGui window."""
        view, controls = self._session.view, self._controls
        controls.begin_row("Show", resettable=True)
        view.show = (
            controls.choice("show", view.show, SHOWN, tips=TIPS, flags=imgui.ComboFlags_.height_large.value)
            or view.show
        )
        tip = f"What the view shows: the picture, or one of its parts.\n{RESET_HINT}"
        controls.end_row("show", "Show", tip, lambda: setattr(view, "show", "beauty"), differs=view.show != "beauty")
        transport = self._session.scene.transport
        if view.show in PARTS and not transport.facts.follows_sight:
            controls.note(f"Transport {transport.method} does not tell these parts of light apart: it has but one.")
        if view.show in ("layer in", "layer out") and live.finished is not None:
            last = live.finished.lit.grid.n_layers - 1
            view.layer = min(view.layer, last)
            controls.begin_row("Layer", resettable=True)
            layer = controls.sliders.integer("layer", view.layer + 1, 1, last + 1, f"{view.layer + 1} of {last + 1}")
            if layer is not None:
                view.layer = min(max(layer - 1, 0), last)
            controls.end_row(
                "layer", "Layer", f"Counted from the camera.\n{RESET_HINT}",
                lambda: setattr(view, "layer", 0), differs=view.layer != 0,
            )  # fmt: skip
