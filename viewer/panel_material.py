"""The panel's part for the material: the library with swatches, coefficients, and what follows from them."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from core import dipole, materials
from core.materials import Material
from core.tonemap import srgb
from viewer.declaration import settings_of
from viewer.gui import icons, imgui
from viewer.panel_controls import RESET_HINT, TYPE_HINT, Controls, explained
from viewer.panel_profile import ProfilePanel, profile_reflectance
from viewer.session import Session
from viewer.settings import MaterialSettings
from viewer.sliders import significant

CHANNELS = (("R", (0.93, 0.42, 0.40)), ("G", (0.45, 0.80, 0.45)), ("B", (0.45, 0.62, 0.95)))
SIGMA_HIGH = 100.0  # 1/mm, end of the sliders
LISTED = 11  # materials that the list shows at once


class MaterialPanel:
    """Draws the rows of the material.

    Attributes
    ----------
    no_profile : str, optional
        Why the choice of a profile means nothing now.
    """

    def __init__(self, session: Session, controls: Controls, requests: list[str]) -> None:
        self._session = session
        self._controls = controls
        self._profile = ProfilePanel(session, controls, requests)
        self._search = ""
        self.no_profile: str | None = None

    def draw(self) -> None:
        """Draw it in the current ImGui window."""
        self._library()
        if self._profile.way():
            self._profile.colour(CHANNELS)
        else:
            self._coefficients("sigma_s_prime", "σs′")
            self._coefficients("sigma_a", "σa")
        self._profile.chooser(self.no_profile)
        self._eta()
        self._controls.setting("model.size_mm", "Object size")
        self._derived()

    def _library(self) -> None:
        controls, session = self._controls, self._session
        current = session.scene.material.resolve()
        name = session.scene.material.name
        shown = name or ("custom" if session.origin is None else f"custom, from {session.origin}")
        controls.begin_row("Material", resettable=True)
        side = imgui.get_frame_height()
        swatch(controls, "material.swatch", current, (side, side))
        imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
        imgui.set_next_item_width(-side - imgui.get_style().item_inner_spacing.x)
        imgui.set_next_window_size_constraints((17.0 * imgui.get_font_size(), 0.0), (1e4, 1e4))
        opened = imgui.begin_combo("##material.name", shown, imgui.ComboFlags_.height_large.value)
        if opened:
            self._choose(name)
            imgui.end_combo()
        tip = f"A material of the library; type to search. The swatch is its colour under white light.\n{RESET_HINT}"
        default = MaterialSettings(name="marble").name
        controls.end_row(
            "material.name", "Material", tip, lambda: session.edit("material", name=default), name != default
        )

    def _choose(self, current: str | None) -> None:
        """List the library inside the open combo box."""
        if imgui.is_window_appearing():
            self._search = ""
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1.0)
        hint = f"{icons.ICON_FA_MAGNIFYING_GLASS}  search"
        _, self._search = imgui.input_text_with_hint("##material.search", hint, self._search)
        self._controls.mark("material.search")
        enter = imgui.is_key_pressed(imgui.Key.enter)
        found = [material for material in materials.library() if matches(material, self._search)]
        row = imgui.get_frame_height()
        imgui.begin_child("##material.list", (0.0, row * min(LISTED, max(1, len(found)))))
        for material in found:
            swatch(self._controls, f"swatch.{material.name}", material, (row - 4.0, row - 4.0))
            imgui.same_line()
            clicked, _ = imgui.selectable(f"{material.name}##{material.name}", material.name == current)
            self._controls.mark(f"material={material.name}")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                self._controls.tooltip(material.name, described(material))
            if clicked or (enter and material is found[0] and self._search):
                self._session.edit("material", name=material.name)
                imgui.close_current_popup()
        if not found:
            self._controls.note("none like it")
        imgui.end_child()

    def _coefficients(self, key: str, symbol: str) -> None:
        """Three logarithmic sliders; moving one makes the material one's own."""
        session, controls = self._session, self._controls
        material = session.scene.material.resolve()
        values: Sequence[float] = getattr(material, key)
        origin = materials.lookup(session.origin) if session.origin else None
        default = getattr(origin, key) if origin else None
        declared = settings_of(session.scene.material)[key]
        for channel, (letter, colour) in enumerate(CHANNELS):
            name, label = f"material.{key}.{letter}", f"{symbol} {letter}"
            controls.begin_row(label, True)
            text = f"{significant(values[channel])} /mm"
            new = controls.sliders.number(name, values[channel], 0.0, SIGMA_HIGH, text, logarithmic=True, colour=colour)
            if new is not None:
                self._own(material, key, channel, new)

            def reset(channel: int = channel) -> None:
                if default is not None:
                    self._own(material, key, channel, default[channel])

            tip = f"{explained(declared, None)}\n{TYPE_HINT}"
            differs = default is not None and default[channel] != values[channel]
            controls.end_row(name, label, tip, reset, differs)

    def _own(self, material: Material, key: str, channel: int, value: float) -> None:
        """Change one coefficient; back at a library material's, become that material again."""
        given = {"sigma_s_prime": material.sigma_s_prime, "sigma_a": material.sigma_a}
        changed = list(given[key])
        changed[channel] = value
        given[key] = (changed[0], changed[1], changed[2])
        origin = materials.lookup(self._session.origin) if self._session.origin else None
        if origin is not None and (origin.sigma_s_prime, origin.sigma_a) == (given["sigma_s_prime"], given["sigma_a"]):
            eta = None if material.eta == origin.eta else material.eta
            self._session.edit("material", name=origin.name, eta=eta)
        else:
            self._session.edit("material", **given, eta=material.eta)

    def _eta(self) -> None:
        session = self._session
        material = session.scene.material
        declared = settings_of(material)["eta"]
        origin = materials.lookup(session.origin).eta if session.origin else material.DEFAULT_ETA
        new = self._controls.value(
            "material.eta", "η", declared, material.resolve().eta, default=origin,
            on_reset=lambda: session.edit("material", eta=None if material.name else origin),
        )  # fmt: skip
        if new is not None:
            session.edit("material", eta=new)

    def _derived(self) -> None:
        """Mean free path and reflectance, which say more than the coefficients."""
        settings = self._session.scene.material
        material = settings.resolve()
        leaving = reflectance(material) if self.no_profile else profile_reflectance(settings)
        rows = (
            ("mean free path", material.mean_free_path, "mm", "1 / σt′: how far light goes before it scatters."),
            ("reflectance", leaving, "", "Share of white light that leaves again, R_d: the colour."),
        )
        flags = imgui.TableFlags_.sizing_stretch_prop.value
        if not imgui.begin_table("##derived", 5, flags):
            return
        for label, values, unit, tip in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_disabled(label)
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                self._controls.tooltip(label, tip)
            for value, (_, colour) in zip(values, CHANNELS, strict=True):
                imgui.table_next_column()
                imgui.text_colored((*colour, 1.0), f"{value:.3g}")
            imgui.table_next_column()
            imgui.text_disabled(unit)
        imgui.end_table()
        for note in materials.validity_notes(material):
            self._controls.note(note)


def swatch(controls: Controls, name: str, material: Material, size: tuple[float, float]) -> None:
    """Draw a material's colour under white light."""
    red, green, blue = swatch_colour(material)
    flags = imgui.ColorEditFlags_.no_tooltip.value | imgui.ColorEditFlags_.no_drag_drop.value
    imgui.color_button(f"##{name}", (red, green, blue, 1.0), flags, size)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
        controls.tooltip(material.name, described(material))


@lru_cache(maxsize=256)
def reflectance(material: Material) -> tuple[float, float, float]:
    """Diffuse reflectance R_d per channel."""
    red, green, blue = dipole.diffuse_reflectance(material).tolist()
    return red, green, blue


def swatch_colour(material: Material) -> tuple[float, float, float]:
    """Diffuse reflectance as sRGB in [0, 1]."""
    red, green, blue = srgb(np.array(reflectance(material))).tolist()
    return red, green, blue


def described(material: Material) -> str:
    """Return the lines of a material's tooltip."""
    lines = [
        f"mean free path {', '.join(f'{value:.3g}' for value in material.mean_free_path)} mm",
        f"reflectance {', '.join(f'{value:.3g}' for value in reflectance(material))}",
        f"η {material.eta:g}, source {material.source}",
    ]
    return "\n".join([*lines, *materials.validity_notes(material)])


def matches(material: Material, search: str) -> bool:
    """Whether a material's name has all words of a search, however capitalised and spaced."""
    name = material.name.casefold()
    joined = "".join(character for character in name if character.isalnum())
    return all(word in name or word in joined for word in search.casefold().split())
