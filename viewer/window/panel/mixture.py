"""The panel's rows for what is added to a material: a second one, and water."""

from milkglass.viewer.gui.controls import RESET_HINT, Controls
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.scene import own_materials
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.panel.library import LibraryList, swatch

NOTHING = "nothing"
MIX_TIP = "A second material; coefficients and index of refraction are weighted by volume."
SOLIDS = {
    "Apple", "Chicken1", "Chicken2", "Marble", "Potato", "Skin1", "Skin2", "Spectralon", "jade", "wax", "white-marble",
}  # fmt: skip


class MixturePanel:
    """Draws the rows."""

    def __init__(self, session: Session, controls: Controls, requests: list[str]) -> None:
        self._session, self._controls = session, controls
        self._library = LibraryList(session, controls, requests, "mix")

    def draw(self) -> None:
        """Draw them in the current ImGui window."""
        self._other()
        material = self._session.scene.material
        if material.other() is not None:
            self._controls.setting("material.mix_share", "Its share")
        self._controls.setting("material.water", "Water")
        if material.name in SOLIDS and material.water != 0.0:
            self._controls.note(f"{material.name} is no liquid: this is how it would look ground, in water")

    def _other(self) -> None:
        controls, session = self._controls, self._session
        other, name = session.scene.material.other(), session.scene.material.mix_with
        controls.begin_row("Mix with", True)
        if other is not None:
            side = imgui.get_frame_height()
            kept = None if name is not None else own_materials.named_like(other)
            name = kept.name if kept is not None else name or "custom"
            swatch(controls, "mix.swatch", other, (side, side))
            imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
            imgui.set_next_item_width(-side - imgui.get_style().item_inner_spacing.x)
        imgui.set_next_window_size_constraints((20.0 * imgui.get_font_size(), 0.0), (1e4, 1e4))
        if imgui.begin_combo("##material.mix_with", name or NOTHING, imgui.ComboFlags_.height_large.value):
            if other is not None and imgui.selectable(NOTHING, False)[0]:
                self._remove()
            chosen = self._library.choose(name)
            if chosen is not None:
                session.edit("material", mix_with=chosen.name)
            imgui.end_combo()
        tip = f"{MIX_TIP}\n{RESET_HINT}"
        controls.end_row("material.mix_with", "Mix with", tip, self._remove, other is not None)

    def _remove(self) -> None:
        self._session.edit("material", mix_with=None)
