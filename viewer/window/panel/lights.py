"""The panel's section on the lights: a list, and for each its direction on a small sphere, colour and brightness."""

from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.gui.controls import RESET_HINT, TYPE_HINT, Reach, Reset, explained
from milkglass.viewer.gui.toolkit import ACCENT, icons, imgui
from milkglass.viewer.scene.camera import view_rotation
from milkglass.viewer.scene.declaration import Setting, plain, settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS, DirectionalLight, Light, as_kind
from milkglass.viewer.scene.settings import DEFAULT_LIGHTS
from milkglass.viewer.session.navigation import direction_angles, direction_of, turn_matrix
from milkglass.viewer.window.panel.section import Section, Seen


def draw_ball(corner: tuple[float, float], side: float, direction: Any, light: Light) -> None:
    """Shade a ball by the light: rings of growing brightness around the point that faces it."""
    draw: Any = imgui.get_window_draw_list()
    radius = 0.5 * side - 2.0
    centre = (corner[0] + 0.5 * side, corner[1] + 0.5 * side)
    draw.add_circle_filled(centre, radius, _colour(0.10, 0.105, 0.115), 48)
    facing = max(0.0, float(direction[2]))
    for i in range(12):
        share = (i + 1) / 12.0
        inner = radius * (1.0 - share)
        offset = 0.92 * radius * share
        grey = (0.10 + 0.42 * share * (0.25 + 0.75 * facing)) if facing > 0.0 else 0.10
        place = (centre[0] + offset * float(direction[0]), centre[1] - offset * float(direction[1]))
        draw.add_circle_filled(place, inner, _colour(grey, grey, grey * 1.02), 40)
    draw.add_circle(centre, radius, _colour(0.33, 0.34, 0.36), 48, 1.0)
    spot = (centre[0] + 0.9 * radius * float(direction[0]), centre[1] - 0.9 * radius * float(direction[1]))
    colour = _colour(*ACCENT) if light.on else _colour(0.5, 0.5, 0.5)
    if direction[2] >= 0.0:
        draw.add_circle_filled(spot, 5.0, colour)
    else:
        draw.add_circle(spot, 4.5, colour, 0, 2.0)


def _colour(red: float, green: float, blue: float) -> Any:
    return imgui.get_color_u32((red, green, blue, 1.0))


SPHERE = 4.0  # diameter, in rows
NEW_LIGHT = DirectionalLight((0.5, 0.7, 0.5))
BRIGHT = {"irradiance": Reach(0.01, 100.0, True, "%.2f"), "intensity": Reach(100.0, 1e7, True, "%.0f")}
KIND_HELP = (
    "directional is the sun, the others are near and weaker with distance: a point, a ball or a panel with a size, a "
    "spot light with a cone"
)
# Of keys whose label is not their name, or whose slider spans less than they may be: label and reach.
ROWS = {
    "angle_deg": ("Size", Reach(0.0, 40.0, False, "%.1f")),
    "radius_mm": ("Radius", Reach(1.0, 500.0, True, "%.1f")),
    "cone_deg": ("Cone", Reach(1.0, 120.0, False, "%.1f")),
    "softness": ("Soft edge", Reach(0.0, 1.0, False, "%.2f")),
    "roll_deg": ("Roll", Reach(-180.0, 180.0, False, "%.1f")),
}
AXES = {"position_mm": ("X", "Y", "Z"), "target_mm": ("Target X", "Target Y", "Target Z")}
SIDES = "Width", "Height"
SIDE_REACH = Reach(1.0, 1000.0, True, "%.1f")


class LightsSection(Section):
    """Draws the list of lights, and the settings of every light under a heading of its own."""

    title = "Lights"
    starts_open = True

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        lights = list(self._session.scene.all_lights())
        for i, light in enumerate(lights):
            imgui.push_id(i)
            edited = self._light(i, light)
            imgui.pop_id()
            if edited is not None:
                lights[i : i + 1] = edited
                self._session.edit_lights(lights)
                return
        if imgui.button(f"{icons.ICON_FA_PLUS}  Add light"):
            self._session.edit_lights([*lights, NEW_LIGHT])
        self._controls.mark("lights.add")
        if self._session.scene.lights is not None:
            imgui.same_line()
            if imgui.button("Default lights"):
                self._session.put(replace(self._session.scene, lights=None))
            self._controls.mark("lights.default")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                self._controls.tooltip("", "Back to the pair that lights a new scene: from behind, and a fill.")

    def _light(self, i: int, light: Light) -> list[Light] | None:
        """Draw one light; returns what takes its place, None if nothing changed."""
        name = f"lights.{i}"
        flags = imgui.TreeNodeFlags_.framed.value | imgui.TreeNodeFlags_.allow_overlap.value
        flags |= imgui.TreeNodeFlags_.default_open.value if i == 0 else 0
        right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
        shown = imgui.tree_node_ex(f"{light.KIND.capitalize()} {i + 1}###light", flags)
        self._controls.mark(name)
        action = self._buttons(name, light, right)
        new = light if not shown else self._rows(name, light)
        if shown:
            imgui.tree_pop()
        if action == "remove":
            return []
        if action == "duplicate":
            return [light, light]
        if action == "toggle":
            return [light.with_values(on=not light.on)]
        return None if new == light else [new]

    def _buttons(self, name: str, light: Light, right: float) -> str:
        """Draw the buttons at the right end of a light's heading."""
        controls, side = self._controls, imgui.get_frame_height()
        buttons = (
            ("toggle", icons.ICON_FA_LIGHTBULB if light.on else icons.ICON_FA_POWER_OFF, "On or off"),
            ("duplicate", icons.ICON_FA_CLONE, "Duplicate"),
            ("remove", icons.ICON_FA_TRASH, "Remove"),
        )
        imgui.same_line(right - len(buttons) * side)
        chosen = ""
        for action, icon, tip in buttons:
            lit = action == "toggle" and light.on
            if lit:
                imgui.push_style_color(imgui.Col_.text_disabled.value, (1.0, 0.85, 0.5, 1.0))
            if controls.icon(f"{name}.{action}", icon, tip, quiet=not lit, on=False):
                chosen = action
            if lit:
                imgui.pop_style_color()
            imgui.same_line(0.0, 0.0)
        imgui.new_line()
        return chosen

    def _rows(self, name: str, light: Light) -> Light:
        controls = self._controls
        chosen: list[str] = []
        kinds = Setting("text", KIND_HELP, choices=tuple(LIGHT_KINDS))
        kind = controls.value(
            f"{name}.kind", "Kind", kinds, light.KIND,
            Reset(DirectionalLight.KIND, lambda: chosen.append(DirectionalLight.KIND)),
        )  # fmt: skip
        chosen += [] if kind is None else [kind]
        if chosen:
            light = as_kind(light, chosen[-1])
        for key in light.VECTORS:
            light = self._direction(name, light) if light.DISTANT else self._point(name, light, key)
        return self._rest(name, self._colour(name, light))

    def _rest(self, name: str, light: Light) -> Light:
        """Draw the rows of what is left after place, colour and brightness, such as the size and the cone."""
        chosen: dict[str, Any] = {}
        defaults = {field.name: field.default for field in fields(light)}
        for key, declared in settings_of(light).items():
            if key in (*light.VECTORS, light.BRIGHTNESS, "on"):
                continue
            if declared.length is not None:
                chosen |= self._sides(name, key, declared, getattr(light, key), defaults[key])
                continue
            label, reach = ROWS.get(key, (_label(key), None))
            reset = Reset(defaults[key], partial(chosen.__setitem__, key, defaults[key]))
            new = self._controls.value(f"{name}.{key}", label, declared, getattr(light, key), reset, reach=reach)
            if new is not None:
                chosen[key] = plain(new) if isinstance(new, float) else new
        fixed_to = chosen.pop("fixed_to", light.fixed_to)
        if fixed_to != light.fixed_to:
            return light.refixed(fixed_to, view_rotation(self._session.scene.camera))
        return light.with_values(**chosen) if chosen else light

    def _sides(self, name: str, key: str, declared: Setting, value: Any, default: Any) -> dict[str, Any]:
        sides, side = list(value), replace(declared, length=None)
        for i, label in enumerate(SIDES):
            reset = Reset(default[i], partial(sides.__setitem__, i, default[i]))
            new = self._controls.value(f"{name}.{label}", label, side, value[i], reset, reach=SIDE_REACH)
            if new is not None:
                sides[i] = plain(new)
        return {key: tuple(sides)} if tuple(sides) != value else {}

    def _direction(self, name: str, light: Light) -> Light:
        """Draw the rows of a distant light's direction."""
        (key,) = light.VECTORS
        default = _default(name, light.KIND, key, NEW_LIGHT.direction)
        self._controls.begin_row("Direction", resettable=True)
        dragged = self._sphere(f"{name}.sphere", light)

        new = light if dragged is None else light.with_values(**{key: dragged})
        was_reset: list[bool] = []
        tip = explained(settings_of(light)[key], None)
        tip += "\nDrag the sphere: it shows the light as the camera sees it; hollow is behind.\n" + RESET_HINT
        self._controls.end_row(
            f"{name}.sphere", "Direction", tip, lambda: was_reset.append(True), differs=new.vector != default
        )
        if was_reset:
            new = light.with_values(**{key: default})
        azimuth, elevation = direction_angles(new.vector)
        for angle, label, value, default_angle in (
            ("azimuth", "Azimuth", azimuth, direction_angles(default)[0]),
            ("elevation", "Elevation", elevation, direction_angles(default)[1]),
        ):
            turned = self._angle(f"{name}.{angle}", label, value, default_angle)
            if turned is not None:
                angles = (turned, elevation) if angle == "azimuth" else (azimuth, turned)
                # straight up has no azimuth: stay a hair off, so that it is kept
                direction = direction_of(angles[0], min(89.99, max(-89.99, angles[1])))
                new = light.with_values(**{key: direction})
        return new

    def _angle(self, name: str, label: str, value: float, default: float) -> float | None:
        result: list[float] = []
        span = 180.0 if label == "Azimuth" else 90.0
        self._controls.begin_row(label, resettable=True)
        new = self._controls.sliders.number(name, value, -span, span, f"{value:.1f}°")
        if new is not None:
            result.append(new)
        tip = f"{'Around the up axis, 0 is +z' if span > 90 else 'Above the horizon'}; unit deg.\n{TYPE_HINT}"
        differs = abs(value - default) > 0.05
        self._controls.end_row(name, label, tip, lambda: result.append(default), differs=differs)
        return result[-1] if result else None

    def _point(self, name: str, light: Light, key: str) -> Light:
        """Draw the rows of a near light's place or target, one an axis."""
        declared, position = settings_of(light)[key], list(getattr(light, key))
        defaults = getattr(as_kind(NEW_LIGHT, light.KIND), key)
        for axis, label in enumerate(AXES[key]):
            reset: list[float] = []
            self._controls.begin_row(label, resettable=True)
            flags = imgui.SliderFlags_.none.value
            changed, new = imgui.drag_float(f"##{name}.{label}", position[axis], 1.0, 0.0, 0.0, "%.1f mm", flags)
            if changed:
                position[axis] = plain(new)
            tip = f"{explained(declared, None)}\nDrag, or {TYPE_HINT[0].lower()}{TYPE_HINT[1:]}"
            differs = position[axis] != defaults[axis]
            self._controls.end_row(
                f"{name}.{label}", label, tip, partial(reset.append, defaults[axis]), differs=differs
            )
            position[axis] = reset[-1] if reset else position[axis]
        try:
            return light.with_values(**{key: tuple(position)})
        except InputError as error:  # a light that would face itself
            self._session.fail(error)
            return light

    def _colour(self, name: str, light: Light) -> Light:
        """Draw the rows of colour and brightness, whose product the scene keeps."""
        key = light.BRIGHTNESS
        declared, value = settings_of(light)[key], light.brightness
        default = _default(name, light.KIND, key, getattr(as_kind(NEW_LIGHT, light.KIND), key))
        default_colour = tuple(plain(channel / max(default)) for channel in default)
        brightest = max(value)
        colour = tuple(channel / brightest for channel in value) if brightest > 0.0 else (1.0, 1.0, 1.0)
        chosen: dict[str, Any] = {}
        self._controls.begin_row("Colour", resettable=True)
        flags = imgui.ColorEditFlags_.float.value | imgui.ColorEditFlags_.no_inputs.value
        changed, new = imgui.color_edit3(f"##{name}.colour", list(colour), flags)
        if changed and max(new) > 0.0:
            chosen["colour"] = tuple(plain(channel / max(new)) for channel in new)
        tip = f"Linear RGB, the brightest channel is 1. Click to choose.\n{RESET_HINT}"
        self._controls.end_row(
            f"{name}.colour", "Colour", tip, lambda: chosen.update(colour=default_colour),
            differs=max(abs(a - b) for a, b in zip(colour, default_colour, strict=True)) > 1e-4,
        )  # fmt: skip
        label = key.capitalize()
        new_brightness = self._controls.value(
            f"{name}.{key}", label, replace(declared, length=None), brightest,
            Reset(max(default), lambda: chosen.update(brightness=max(default))), reach=BRIGHT[key],
        )  # fmt: skip
        if new_brightness is not None:
            chosen["brightness"] = max(new_brightness, 0.0)
        if not chosen:
            return light
        bright = chosen.get("brightness", brightest)
        red, green, blue = (plain(bright * channel) for channel in chosen.get("colour", colour))
        return light.brightened((red, green, blue))

    def _sphere(self, name: str, light: Light) -> tuple[float, float, float] | None:
        """Draw the light on a ball seen by the camera; a drag turns it, as a trackball."""
        side = SPHERE * imgui.get_frame_height()
        corner = imgui.get_cursor_screen_pos()
        imgui.invisible_button(f"##{name}", (side, side))
        rotation = view_rotation(self._session.scene.camera)
        if light.fixed_to == "camera":
            rotation = np.eye(3)
        direction = np.array(light.vector) / np.linalg.norm(light.vector)
        draw_ball((corner.x, corner.y), side, direction @ rotation, light)
        if not imgui.is_item_active():
            return None
        delta = imgui.get_io().mouse_delta
        if delta.x == 0.0 and delta.y == 0.0:
            return None
        step = 180.0 / side
        turn = turn_matrix(rotation[:, 1], step * delta.x) @ turn_matrix(rotation[:, 0], step * delta.y)
        x, y, z = (direction @ turn).tolist()
        return plain(x), plain(y), plain(z)


def _label(key: str) -> str:
    """Return the label of a key, without its unit."""
    return key.removesuffix("_mm").removesuffix("_deg").replace("_", " ").capitalize()


def _default(name: str, kind: str, key: str, otherwise: Any) -> Any:
    """Return what a light's value is reset to: the default light's of the same place in the list."""
    i = int(name.split(".")[1])
    if i < len(DEFAULT_LIGHTS) and kind == DEFAULT_LIGHTS[i].KIND:
        return getattr(DEFAULT_LIGHTS[i], key)
    return otherwise
