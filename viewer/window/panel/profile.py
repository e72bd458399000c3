"""The panel's rows for the diffusion profile, and for a material given by colour and mean free path."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from milkglass.core.display import linear, srgb
from milkglass.core.errors import InputError
from milkglass.core.profiles.choose import reflectance
from milkglass.core.profiles.registry import DIPOLE, TABLE
from milkglass.viewer.gui.command import Commands
from milkglass.viewer.gui.controls import TYPE_HINT, Controls, Reset, explained
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.gui.toolkit import icons, imgui
from milkglass.viewer.scene.declaration import plain, settings_of
from milkglass.viewer.scene.material_settings import COMBINATIONS, MaterialSettings
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.panel.library import origin_of

NO_PROFILE = "This transport solves the object's own equation and has no profile; others sum one."
COEFFICIENTS, COLOUR, DIFFUSE = "coefficients", "colour and mean free path", "colour and diffuse mean free path"
WAYS_TIP = (
    "Scattering and absorption coefficients; or a colour under white light and a mean free path, which the profile's "
    "own reflectance turns into coefficients. The diffuse mean free path, 1 / σtr, is how far light gets before it is "
    "absorbed."
)
LENGTH_KEYS = {
    COLOUR: ("mean_free_path_mm", "mean free path"),
    DIFFUSE: ("diffuse_mean_free_path_mm", "diffuse m.f.p."),
}
PICKER = "##material.picker"
COLOUR_TIP = "The material's colour under white light. Click to choose it."
PATH_ENDS = (0.001, 100.0)  # mm, of the sliders
LONGEST_PATH = 1e6  # mm: of a channel without matter
LEAST_ABSORBED = 1e-9  # 1 - albedo: without absorption a diffuse mean free path would be infinite
REREAD_TIP = "Read the file again if it has changed. So does coming back to the window."
NOTABLE_TAIL = 0.02  # share of the flux beyond the last radius of a table


class ProfileRows:
    """Draws the choice of the profile, and the material where a colour and a mean free path give it."""

    def __init__(self, session: Session, controls: Controls, commands: Commands[Any]) -> None:
        self._session, self._controls, self._commands = session, controls, commands

    def chooser(self, off: str | None) -> None:
        """Draw the choice of the profile, and a table's file; `off` says why it means nothing now."""
        session, controls = self._session, self._controls
        material = session.scene.material
        declared = settings_of(material)["profile"]
        new = controls.value(
            "material.profile", "Profile", declared, material.profile,
            Reset(DIPOLE, lambda: session.edit("material", profile=DIPOLE)), off=off,
        )  # fmt: skip
        if new == TABLE and material.profile_table is None:
            self._commands.request("open_profile")
        elif new is not None:
            session.edit("material", profile=new)
        if off is not None:
            controls.note("this transport has no profile")
        if material.profile != TABLE or material.profile_table is None:
            return
        controls.begin_row("Table")
        if imgui.button(f"{material.profile_table.name}##material.profile_table", (_spare(), 0.0)):
            self._commands.request("open_profile")
        controls.end_row("material.profile_table", "Table", explained(settings_of(material)["profile_table"], None))
        imgui.same_line(0.0, imgui.get_style().item_inner_spacing.x)
        if controls.icon("material.profile_table.reread", icons.ICON_FA_ROTATE, REREAD_TIP, quiet=True):
            self._commands.request("reread_files")
        for note in table_notes(material):
            controls.note(note)

    def quantities(self) -> bool:
        """Draw the choice of the quantities that give the material; True for a colour and a mean free path."""
        session, controls = self._session, self._controls
        material = session.scene.material
        shown = DIFFUSE if material.diffuse_mean_free_path_mm is not None else COLOUR
        shown = COEFFICIENTS if material.diffuse_reflectance is None else shown
        controls.begin_row("Given by")
        chosen = controls.choice("material.way", shown, (COEFFICIENTS, COLOUR, DIFFUSE))
        if chosen is not None:
            session.edit("material", **given_by(session.scene.material, chosen))
        controls.end_row("material.way", "Given by", WAYS_TIP)
        return session.scene.material.diffuse_reflectance is not None  # which a click has changed just now

    def open_picker(self) -> None:
        """Have `picker` show the colour under white light."""
        imgui.open_popup(PICKER)

    def picker(self) -> None:
        """Draw the picker of the colour while it is open; coefficients become a colour and a mean free path by it."""
        if not imgui.begin_popup(PICKER):
            return
        material = self._session.scene.material
        given = given_by(material, COLOUR) if material.diffuse_reflectance is None else {"eta": material.base().eta}
        colour = material.diffuse_reflectance or given["diffuse_reflectance"]
        flags = imgui.ColorEditFlags_.no_side_preview.value | imgui.ColorEditFlags_.float.value
        changed, new = imgui.color_picker3(PICKER, srgb(colour).tolist(), flags)
        self._controls.mark(PICKER)
        if changed:
            red, green, blue = (plain(value) for value in linear(np.array(new)).tolist())
            self._session.edit("material", **{**given, "diffuse_reflectance": (red, green, blue)})
        imgui.end_popup()

    def colour(self, channels: Sequence[tuple[str, tuple[float, float, float]]]) -> None:
        """Draw three sliders of the colour and three of the mean free path, for (letter, colour) of the channels."""
        material = self._session.scene.material
        quantities = COLOUR if material.diffuse_mean_free_path_mm is None else DIFFUSE
        key, label = LENGTH_KEYS[quantities]
        origin = origin_of(self._session)
        start: dict[str, Any] = {}
        if origin is not None:
            given = {key: getattr(origin, key) for key in (*COMBINATIONS[1], "eta", "g")}
            given |= {key: getattr(material, key) for key in ("profile", "profile_table")}
            start = given_by(MaterialSettings(**given), quantities)
        self._controls.begin_row("Colour")
        red, green, blue = srgb(material.diffuse_reflectance or (0.0, 0.0, 0.0)).tolist()
        flags = imgui.ColorEditFlags_.no_tooltip.value | imgui.ColorEditFlags_.no_drag_drop.value
        if imgui.color_button("##material.colour", (red, green, blue, 1.0), flags, (_spare(), 0.0)):
            self.open_picker()
        self._controls.end_row("material.colour", "Colour", COLOUR_TIP)
        for i, channel in enumerate(channels):
            value = (material.diffuse_reflectance or ())[i]
            self._slider("diffuse_reflectance", "colour", i, channel, f"{value:.3f}", start)
        for i, channel in enumerate(channels):
            self._slider(key, label, i, channel, f"{significant(getattr(material, key)[i])} mm", start, PATH_ENDS)

    def _slider(
        self, key: str, label: str, i: int, channel: tuple[str, tuple[float, float, float]], text: str,
        start: dict[str, Any], ends: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        controls, material = self._controls, self._session.scene.material
        letter, tint = channel
        name, label, values = f"material.{key}.{letter}", f"{label} {letter}", getattr(material, key)
        controls.begin_row(label, resettable=True)
        low, high = ends or (0.0, 1.0)
        new = controls.sliders.number(name, values[i], low, high, text, logarithmic=ends is not None, colour=tint)

        def put(value: float) -> None:
            changed = [*values]
            changed[i] = value
            self._session.edit("material", **{key: tuple(changed)}, eta=material.base().eta)

        if new is not None:
            put(new)
        first = start[key][i] if start else values[i]
        tip = f"{explained(settings_of(material)[key], None)}\n{TYPE_HINT}"
        controls.end_row(name, label, tip, lambda: put(first), differs=values[i] != first)


def _spare() -> float:
    """Return the width of a button that leaves room for an icon beside it."""
    return -float(imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x)


def given_by(settings: MaterialSettings, quantities: str) -> dict[str, Any]:
    """Return the keys of a material given by other quantities: the same material, or the nearest there is."""
    material = settings.base()
    if quantities == COEFFICIENTS:
        return {key: getattr(material, key) for key in (*COMBINATIONS[1], "eta", "g")}
    largest = 1.0 if quantities == COLOUR else 1.0 - LEAST_ABSORBED
    albedos = np.minimum(material.alpha_prime, largest)
    lengths = (
        material.mean_free_path if quantities == COLOUR else material.mean_free_path / np.sqrt(3.0 * (1.0 - albedos))
    )
    colour = tuple(min(1.0, reflectance(float(a), material.eta, settings.profile)) for a in albedos)
    return {
        "diffuse_reflectance": colour,
        LENGTH_KEYS[quantities][0]: tuple(np.minimum(lengths, LONGEST_PATH).tolist()),
        "eta": material.eta,
        "g": material.g,
    }


def profile_reflectance(settings: MaterialSettings) -> tuple[float, float, float]:
    """Return the diffuse reflectance T(0) of the profile per channel; the dipole's if its table is unreadable."""
    try:
        red, green, blue = (float(profile.total(0.0)) for profile in settings.profiles())
    except InputError:
        material = settings.resolve()
        red, green, blue = (reflectance(float(a), material.eta) for a in material.alpha_prime)
    return red, green, blue


def table_notes(settings: MaterialSettings) -> list[str]:
    """Return sentences on the flux beyond the last radius of a table, or on a file that cannot be read."""
    try:
        channels = settings.profiles()
    except InputError as error:
        return [str(error)]
    shares = [float(getattr(profile, "tail_share", 0.0)) for profile in channels]
    if max(shares) < NOTABLE_TAIL:
        return []
    listed = ", ".join(f"{100.0 * share:.0f} %" for share in shares)
    return [f"beyond the last radius, by an exponential tail: {listed} of the light"]
