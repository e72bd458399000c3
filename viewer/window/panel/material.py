"""The panel's section on the material: the library with swatches, coefficients, and what follows from them."""

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from milkglass.core.material import library as materials, single_scattering
from milkglass.core.material.library import Material
from milkglass.viewer.files.conventions import FILE
from milkglass.viewer.gui.command import Commands
from milkglass.viewer.gui.controls import CHANNELS, REACH, RESET_HINT, TYPE_HINT, Controls, Reset, explained
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.live import Live, solves
from milkglass.viewer.render.remarks import warnings
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.material_settings import ADDED, ISOTROPIC
from milkglass.viewer.scene.settings import MaterialSettings
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.panel.library import LibraryList, origin_of, reflectance, swatch
from milkglass.viewer.window.panel.profile import NO_PROFILE, ProfileRows, profile_reflectance
from milkglass.viewer.window.panel.section import Section, Seen, Tools

NOTHING = "nothing"
LIBRARY_TIP = (
    "A material of the library; type to search. The swatch is its colour under white light: click to choose another."
)
MIX_TIP = "A second material; coefficients and index of refraction are weighted by volume."
SOLIDS = {
    "Apple", "Chicken1", "Chicken2", "Marble", "Potato", "Skin1", "Skin2", "Spectralon", "jade", "wax", "white-marble",
}  # fmt: skip


class MixtureRows:
    """Draws the rows of the material mixed in, and of water."""

    def __init__(self, session: Session, controls: Controls, commands: Commands[Any]) -> None:
        self._session, self._controls = session, controls
        self._library = LibraryList(session, controls, commands, "mix")

    def draw(self) -> None:
        """Draw the rows in the current ImGui window."""
        self._admixture()
        material = self._session.scene.material
        if material.admixture() is not None:
            self._controls.setting("material.mix_share", "Its share")
        self._controls.setting("material.water", "Water")
        if material.name in SOLIDS and material.water != 0.0:
            self._controls.note(f"{material.name} is no liquid: this is how it would look ground, in water")

    def _admixture(self) -> None:
        controls, session = self._controls, self._session
        admixture, name = session.scene.material.admixture(), session.scene.material.mix_with
        controls.begin_row("Mix with", resettable=True)
        if admixture is not None:
            side = imgui.get_frame_height()
            kept = None if name is not None else own_materials.named_like(admixture)
            name = kept.name if kept is not None else name or "custom"
            swatch(controls, "mix.swatch", admixture, (side, side))
            imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
            imgui.set_next_item_width(-side - imgui.get_style().item_inner_spacing.x)
        imgui.set_next_window_size_constraints((20.0 * imgui.get_font_size(), 0.0), (1e4, 1e4))
        if imgui.begin_combo("##material.mix_with", name or NOTHING, imgui.ComboFlags_.height_large.value):
            if admixture is not None and imgui.selectable(NOTHING, False)[0]:
                self._remove()
            chosen = self._library.choose(name)
            if chosen is not None:
                session.edit("material", mix_with=chosen.name)
            imgui.end_combo()
        tip = f"{MIX_TIP}\n{RESET_HINT}"
        controls.end_row("material.mix_with", "Mix with", tip, self._remove, differs=admixture is not None)

    def _remove(self) -> None:
        self._session.edit("material", mix_with=None)


ONCE_TIP = (
    "Share of the light that leaves a half space lit along its normal which has scattered only once. Transport "
    "diffusion follows it where nodes resolve the mean free path; elsewhere it is drawn as if it had scattered often: "
    "too wide (but for the profile photon_beam), and without its direction."
)
LARGEST_SIGMA = 100.0  # mm^-1, end of the sliders


class MaterialSection(Section):
    """Draws the material: of the library or by its coefficients, the mixture, the profile, what follows from them."""

    title = "Material"
    starts_open = True

    def __init__(self, tools: Tools) -> None:
        super().__init__(tools)
        parts = tools.session, tools.controls, tools.commands
        self._profile = ProfileRows(*parts)
        self._list = LibraryList(*parts, "material")
        self._mixture = MixtureRows(*parts)

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        no_profile = NO_PROFILE if solves(seen.live) else None
        self._library()
        self._profile.picker()
        if self._profile.quantities():
            self._profile.colour(CHANNELS)
        else:
            self._coefficients("sigma_s_prime", "σs′")
            self._coefficients("sigma_a", "σa")
        self._eta()
        self._forward()
        self._mixture.draw()
        self._profile.chooser(no_profile)
        self._size(seen.live)
        if self._session.scene.model.path is not None:
            self._of_file(seen.live)
        self._derived(seen.live, has_profile=no_profile is None)

    def _size(self, live: Live) -> None:
        """Draw the size of the object."""
        shown = None if live.finished is None else live.finished.lit.model
        asked = self._session.scene.model.size_mm
        automatic = None if shown is None or not isinstance(asked, str) else shown.size_of(asked)
        self._controls.setting("model.size_mm", "Object size", automatic)

    def _of_file(self, live: Live) -> None:
        """Draw the size that the object has in its file, and the medium that this tells, which clicks take.

        As high before the file is read as after: no row below moves.
        """
        session, controls = self._session, self._controls
        shown = None if live.finished is None else live.finished.lit.model
        size = "" if shown is None else shown.file_size
        controls.note(f"in its file {size}" if size else "in its file ...")
        imgui.begin_disabled(not size or session.scene.model.size_mm == FILE)
        if imgui.button("Size of the file"):
            session.edit("model", size_mm=FILE)
        imgui.end_disabled()
        controls.mark("model.size_mm.file")
        if shown is None or shown.medium is None:
            return
        material = MaterialSettings.of(shown.medium.material)
        imgui.same_line()
        imgui.begin_disabled(session.scene.material == material)
        if imgui.button("Material of the file"):
            session.put(replace(session.scene, material=material))
        imgui.end_disabled()
        controls.mark("material.file")

    def _library(self) -> None:
        controls, session = self._controls, self._session
        settings = session.scene.material
        current, name = settings.base(), settings.name
        kept = None if name is not None else own_materials.named_like(current)
        name = name if kept is None else kept.name
        shown = name or ("custom" if session.origin is None else f"custom, from {session.origin}")
        controls.begin_row("Material", resettable=True)
        side = imgui.get_frame_height()
        swatch(controls, "material.swatch", current, (side, side))
        controls.mark("material.swatch")
        if imgui.is_item_clicked():
            self._profile.open_picker()
        imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
        imgui.set_next_item_width(-side - imgui.get_style().item_inner_spacing.x)
        imgui.set_next_window_size_constraints((20.0 * imgui.get_font_size(), 0.0), (1e4, 1e4))
        opened = imgui.begin_combo("##material.name", shown, imgui.ComboFlags_.height_large.value)
        if opened:
            chosen = self._list.choose(name, keeps=True)
            if chosen is not None and session.edit("material", name=chosen.name):
                session.origin = chosen.name
            imgui.end_combo()
        tip = f"{LIBRARY_TIP}\n{RESET_HINT}"
        default = MaterialSettings(name="marble").name
        controls.end_row(
            "material.name", "Material", tip, lambda: session.edit("material", name=default), differs=name != default
        )

    def _coefficients(self, key: str, symbol: str) -> None:
        """Draw three logarithmic sliders, whose change takes the material out of the library."""
        session, controls = self._session, self._controls
        material = session.scene.material.base()
        values: Sequence[float] = getattr(material, key)
        origin = origin_of(session)
        default = getattr(origin, key) if origin else None
        declared = settings_of(session.scene.material)[key]
        for channel, (letter, colour) in enumerate(CHANNELS):
            name, label = f"material.{key}.{letter}", f"{symbol} {letter}"
            controls.begin_row(label, resettable=True)
            text = f"{significant(values[channel])} /mm"
            new = controls.sliders.number(
                name, values[channel], 0.0, LARGEST_SIGMA, text, logarithmic=True, colour=colour
            )
            if new is not None:
                self._change(material, key, channel, new)

            def reset(channel: int = channel) -> None:
                if default is not None:
                    self._change(material, key, channel, default[channel])

            tip = f"{explained(declared, None)}\n{TYPE_HINT}"
            differs = default is not None and default[channel] != values[channel]
            controls.end_row(name, label, tip, reset, differs=differs)

    def _change(self, material: Material, key: str, channel: int, value: float) -> None:
        """Change one coefficient; coefficients equal to the library's become that material again."""
        given = {"sigma_s_prime": material.sigma_s_prime, "sigma_a": material.sigma_a}
        changed = list(given[key])
        changed[channel] = value
        given[key] = (changed[0], changed[1], changed[2])
        origin, settings = origin_of(self._session), self._session.scene.material
        optical = {"eta": material.eta, "g": material.g}
        if origin is not None and (origin.sigma_s_prime, origin.sigma_a) == (given["sigma_s_prime"], given["sigma_a"]):
            changed_too = {key: None if value == getattr(origin, key) else value for key, value in optical.items()}
            added = {name: getattr(settings, name) for name in ADDED}
            self._session.edit("material", name=origin.name, **changed_too, **added)
        else:
            self._session.edit("material", **given, **optical)

    def _eta(self) -> None:
        session = self._session
        material = session.scene.material
        declared = settings_of(material)["eta"]
        found = origin_of(session)
        origin = material.DEFAULT_ETA if found is None else found.eta
        new = self._controls.value(
            "material.eta", "η", declared, material.base().eta,
            Reset(origin, lambda: session.edit("material", eta=None if material.name else origin)),
        )  # fmt: skip
        if new is not None:
            session.edit("material", eta=new)

    def _forward(self) -> None:
        """Draw three sliders of the mean cosine of scattering."""
        session = self._session
        material, origin = session.scene.material, origin_of(session)
        declared, values = settings_of(material)["g"], material.base().g
        default = ISOTROPIC if origin is None else origin.g

        for channel, (letter, colour) in enumerate(CHANNELS):
            name, label, reach = f"material.g.{letter}", f"forward g {letter}", REACH["material.g"]
            self._controls.begin_row(label, resettable=True)
            text = reach.format % values[channel]
            new = self._controls.sliders.number(name, values[channel], reach.low, reach.high, text, colour=colour)
            put = functools.partial(self._put_forward, values, channel)
            if new is not None:
                put(new)

            tip = f"{explained(declared, None)}\n{TYPE_HINT}"
            reset = functools.partial(put, default[channel])
            self._controls.end_row(name, label, tip, reset, differs=values[channel] != default[channel])

    def _put_forward(self, values: Sequence[float], channel: int, value: float) -> None:
        changed = (*values[:channel], value, *values[channel + 1 :])
        material = self._session.scene.material
        is_library = material.name is not None and changed == materials.lookup(material.name).g
        self._session.edit("material", g=None if is_library else changed)

    def _derived(self, live: Live, *, has_profile: bool) -> None:
        """Draw mean free path, reflectance and share of single scattering of the whole mixture."""
        settings = self._session.scene.material
        material = settings.resolve()
        leaving = profile_reflectance(settings) if has_profile else reflectance(material)
        rows = (
            ("mean free path", material.mean_free_path, "mm", "1 / σt′: how far light goes before it scatters."),
            ("reflectance", leaving, "", "Share of white light that leaves again, R_d: the colour."),
            ("scattered once", 100.0 * single_scattering.share(material), "%", ONCE_TIP),
        )
        flags = imgui.TableFlags_.sizing_stretch_prop.value
        if not imgui.begin_table("##derived", 5, flags):
            return
        imgui.table_next_row()
        imgui.table_next_column()
        for letter, colour in CHANNELS:
            imgui.table_next_column()
            imgui.text_colored((*colour, 1.0), letter)
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
        of_profile = not self._session.scene.transport.facts.follows_sight
        for note in materials.validity_notes(material, of_profile=of_profile):
            self._controls.note(note)
        if of_profile and np.max(single_scattering.share(material)) > single_scattering.NOTABLE_SHARE:
            self._controls.note(f"single scattering is missing: {single_scattering.statement(material)}", warning=True)
        if live.finished is not None:
            for lacking in warnings(self._session.scene, live.finished.lit):
                self._controls.note(lacking, warning=True)
