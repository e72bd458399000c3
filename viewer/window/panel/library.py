"""The library of materials inside an open list: swatches, search, filter, and the user's materials."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from milkglass.core.display import srgb
from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.profiles import dipole
from milkglass.viewer.gui.command import Commands
from milkglass.viewer.gui.controls import Controls
from milkglass.viewer.gui.toolkit import ERROR, icons, imgui
from milkglass.viewer.scene import library, own_materials
from milkglass.viewer.session.session import Session

VISIBLE_MATERIALS = 11  # of the list, without scrolling


class LibraryList:
    """Draws the list of materials of one choice, while the list is open.

    Parameters
    ----------
    key : str
        Prefix of the names of the controls, such as "material".
    """

    def __init__(self, session: Session, controls: Controls, commands: Commands[Any], key: str) -> None:
        self._session, self._controls, self._commands, self._key = session, controls, commands, key
        self._search, self._only = "", "all"
        self._at = 0  # the row that Enter takes, which arrows move
        self._name = ""  # typed for what is to be kept or renamed
        self._renaming = self._deleting = ""  # own materials that a button was pressed for

    def choose(self, current: str | None, *, keeps: bool = False) -> Material | None:
        """Draw the list in an open combo box and return the material chosen, None for none.

        `keeps` adds the controls that save, rename and delete the user's materials.
        """
        if imgui.is_window_appearing():
            self._search = self._name = self._renaming = self._deleting = ""
            self._at = 0
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(0.55 * imgui.get_content_region_avail().x)
        hint = f"{icons.ICON_FA_MAGNIFYING_GLASS}  search"
        changed, self._search = imgui.input_text_with_hint(f"##{self._key}.search", hint, self._search)
        searching = imgui.is_item_active()
        self._controls.mark(f"{self._key}.search")
        enter = imgui.is_key_pressed(imgui.Key.enter) and (bool(self._search) or self._at > 0)
        imgui.same_line()
        self._filter()
        problem = None
        try:
            kept: own_materials.Materials = own_materials.stored()
        except InputError as error:
            kept, problem = (), str(error)
        found = library.found(self._only, self._search, kept)
        before = self._at
        if searching or changed:
            down, up = (imgui.is_key_pressed(key) for key in (imgui.Key.down_arrow, imgui.Key.up_arrow))
            self._at = 0 if changed else self._at + int(down) - int(up)
        self._at = max(0, min(self._at, len(found) - 1))
        chosen = self._list(found, current, keeps=keeps, moved=self._at != before)
        if chosen is None and enter and found:
            chosen = found[self._at]
            imgui.close_current_popup()
        if problem is not None:
            self._controls.note(problem, warning=True)
        elif keeps:
            self._keep(kept)
        return chosen

    def _filter(self) -> None:
        imgui.set_next_item_width(-1.0)
        if imgui.begin_combo(f"##{self._key}.filter", library.FILTERS[self._only][0]):
            for only, (label, _) in library.FILTERS.items():
                clicked, _ = imgui.selectable(label, only == self._only)
                self._controls.mark(f"{self._key}.filter={only}")
                if clicked:
                    self._only = only
            imgui.end_combo()
        self._controls.mark(f"{self._key}.filter")

    def _list(self, found: list[Material], current: str | None, *, keeps: bool, moved: bool) -> Material | None:
        controls, row, chosen = self._controls, imgui.get_frame_height(), None
        imgui.begin_child(
            f"##{self._key}.list",
            (0.0, imgui.get_frame_height_with_spacing() * min(VISIBLE_MATERIALS, max(1, len(found)))),
        )
        for i, material in enumerate(found):
            is_marked = i == self._at and (bool(self._search) or i > 0)
            swatch(controls, f"swatch.{material.name}", material, (row, row))
            imgui.same_line()
            imgui.align_text_to_frame_padding()
            is_own = material.source == own_materials.SOURCE
            room = imgui.get_content_region_avail().x - (2.2 * row if is_own and keeps else 0.0)
            label = f"{material.name}{'  (yours)' if is_own else ''}##{material.name}"
            highlighted = imgui.SelectableFlags_.highlight.value if is_marked else 0
            clicked, _ = imgui.selectable(label, material.name == current, highlighted, (room, 0.0))
            if is_marked and moved:
                imgui.set_scroll_here_y()
            controls.mark(f"{self._key}={material.name}")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                controls.tooltip(material.name, described(material))
            if clicked:
                chosen = material
                imgui.close_current_popup()
            if is_own and keeps:
                self._buttons(material.name)
        if not found:
            controls.note("none like it")
        imgui.end_child()
        return chosen

    def _buttons(self, name: str) -> None:
        """Draw the buttons of a material of the user's at the right of its row."""
        controls = self._controls
        imgui.same_line(0.0, 0.0)
        if controls.icon(f"own.rename.{name}", icons.ICON_FA_PEN, "Rename", quiet=True):
            self._renaming = self._name = name
        imgui.same_line(0.0, 0.0)
        asked = self._deleting == name
        if asked:
            imgui.push_style_color(imgui.Col_.text.value, (*ERROR, 1.0))
        tip = "Press again to delete it" if asked else "Delete; scenes keep its coefficients"
        if controls.icon(f"own.delete.{name}", icons.ICON_FA_TRASH, tip, quiet=not asked):
            self._deleting = name
            if asked and self._tried(lambda: own_materials.delete(name)):
                self._deleting = ""
                self._session.origin = None if self._session.origin == name else self._session.origin
        if asked:
            imgui.pop_style_color()

    def _keep(self, kept: own_materials.Materials) -> None:
        """Draw the row that saves the material under a name, and the buttons that import and export."""
        controls, width = self._controls, 5.0 * imgui.get_font_size()
        imgui.set_next_item_width(-width - 2.4 * imgui.get_frame_height())
        hint = "name to keep it by"
        entered, self._name = imgui.input_text_with_hint(
            "##own.name", hint, self._name, imgui.InputTextFlags_.enter_returns_true.value
        )
        controls.mark("own.name")
        imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
        key = materials.key_of(self._name)
        exists = any(materials.key_of(material.name) == key for material in kept)
        verb = "Rename" if self._renaming else "Replace" if exists else "Save as"
        imgui.begin_disabled(not key)
        if (imgui.button(f"{verb}##own.save", (width, 0.0)) or entered) and key:
            self._named()
        imgui.end_disabled()
        controls.mark("own.save")
        for action, icon, tip in (
            ("import_materials", icons.ICON_FA_FILE_IMPORT, "Add the materials of a file (.toml) to your own"),
            ("export_materials", icons.ICON_FA_FILE_EXPORT, "Write your own materials to a file (.toml)"),
        ):
            imgui.same_line(0.0, 0.0)
            if controls.icon(action, icon, tip, quiet=True):
                self._commands.request(action)
                imgui.close_current_popup()

    def _named(self) -> None:
        """Give the typed name to the material that is renamed, or to the one that is seen."""
        session, name, old = self._session, self._name, self._renaming
        if old:
            done = self._tried(lambda: own_materials.rename(old, name))
        else:
            material = session.scene.material.resolve()
            done = self._tried(lambda: own_materials.save(name, material)) and session.edit("material", name=name)
        if not done:
            return
        if not old or session.origin == old:
            session.origin = own_materials.lookup(name).name
        self._name = self._renaming = ""

    def _tried(self, change: Callable[[], object]) -> bool:
        """Make a change to the file; False and a message where it cannot be made."""
        try:
            change()
        except InputError as error:
            self._session.fail(error)
            return False
        return True


def swatch(controls: Controls, name: str, material: Material, size: tuple[float, float]) -> None:
    """Draw a button in a material's colour under white light, with a tooltip."""
    red, green, blue = swatch_colour(material)
    flags = imgui.ColorEditFlags_.no_tooltip.value | imgui.ColorEditFlags_.no_drag_drop.value
    imgui.color_button(f"##{name}", (red, green, blue, 1.0), flags, size)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
        controls.tooltip(material.name, described(material))


@lru_cache(maxsize=256)
def reflectance(material: Material) -> tuple[float, float, float]:
    """Return the diffuse reflectance R_d of the dipole, per channel."""
    red, green, blue = dipole.diffuse_reflectance(material).tolist()
    return red, green, blue


def swatch_colour(material: Material) -> tuple[float, float, float]:
    """Return the diffuse reflectance R_d as sRGB in [0, 1]."""
    red, green, blue = srgb(np.array(reflectance(material))).tolist()
    return red, green, blue


def described(material: Material) -> str:
    """Return the lines of a material's tooltip."""
    lines = [
        f"mean free path {', '.join(f'{value:.3g}' for value in material.mean_free_path)} mm",
        f"reflectance {', '.join(f'{value:.3g}' for value in reflectance(material))}",
        f"η {material.eta:g}, source {material.source}",
    ]
    return "\n".join([*lines, *materials.validity_notes(material, of_profile=False)])


def origin_of(session: Session) -> Material | None:
    """Return the material of the library that edited coefficients started from, None if there is none."""
    try:
        return own_materials.lookup(session.origin) if session.origin else None
    except InputError:  # no longer there
        return None
