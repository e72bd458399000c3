"""The controls of the panel, how each is used, and a person who uses them and remembers which."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from milkglass.viewer.gui.events import MouseButton, MouseMoved
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window.app import read_pixels
from tests.support.driving import Driver

SIZE = (900, 3200)  # every section open and nothing scrolled
Use = Callable[["Walker"], None]


class Walker(Driver):
    """Remembers which controls there were, and which were used."""

    def __init__(self, scene: Scene) -> None:
        self.seen: set[str] = set()
        self.used: set[str] = set()
        super().__init__(scene, SIZE)

    def frame(self) -> None:
        """Draw a frame that does not reach the framebuffer: `view_pixels` paints what it reads."""
        with self._unpainted():
            super().frame()
        self.seen |= set(self.app.panel.controls.boxes)

    def place(self, name: str, share: float = 0.5) -> tuple[float, float]:
        self.used.add(name)
        return super().place(name, share)

    def shows(self, name: str) -> bool:
        return name in self.app.panel.controls.boxes

    def press(self, place: tuple[float, float]) -> None:
        self.send(MouseMoved(*place), MouseButton("left", True), MouseButton("left", False))

    def view_pixels(self) -> np.ndarray:
        """What the window shows where the picture is."""
        self.settle()
        super().frame()
        left, top, right, bottom = map(round, self.view.drawn_at)
        return read_pixels(self.target, self.target.size)[top:bottom, left:right]


def slide(box: str, share: float) -> Use:
    return lambda walker: walker.click(box, share)


def choose(box: str, choice: str) -> Use:
    def use(walker: Walker) -> None:
        walker.click(box)
        walker.click(f"{box}={choice}", 0.3)

    return use


def tick(box: str, choice: str) -> Use:
    def use(walker: Walker) -> None:
        choose(box, choice)(walker)
        walker.click(box)  # a list of check boxes stays open

    return use


def drag(box: str, by: tuple[float, float]) -> Use:
    return lambda walker: walker.drag(walker.place(box), by)


def move_view(by: tuple[float, float]) -> Use:
    """Drag the object with the middle button: a control of the view, not of the panel."""

    def use(walker: Walker) -> None:
        left, top, right, bottom = walker.view.drawn_at
        walker.drag((0.5 * (left + right), 0.5 * (top + bottom)), by, button="middle")

    return use


def pick_colour(box: str) -> Use:
    """Click into the square of the colour picker that opens below the control."""

    def use(walker: Walker) -> None:
        left, _, _, bottom = walker.app.panel.controls.boxes[box]
        walker.click(box)
        x = min(left + 60.0, SIZE[0] - 220.0)  # the picker keeps inside the window
        for place in ((x, bottom + 70.0), (30.0, 2200.0)):  # then beside it, which closes it
            walker.press(place)

    return use


def open_file(box: str, name: str) -> Use:
    def use(walker: Walker) -> None:
        walker.click(box)
        assert walker.app.actions.dialog.is_open
        walker.type(name)
        walker.key("enter")

    return use


def search(box: str, words: str, name: str, key: str = "material") -> Use:
    def use(walker: Walker) -> None:
        walker.click(box)
        walker.click(f"{key}.search")
        walker.type(words)
        walker.click(f"{key}={name}", 0.3)

    return use


def type_size(box: str, side: int) -> Use:
    def use(walker: Walker) -> None:
        walker.click(box, 0.2)
        walker.key("left_ctrl", "a")
        walker.type(str(side))
        walker.key("enter")

    return use


@dataclass(frozen=True)
class Control:
    """What sets a setting ("table.key"), how it is used, and in which state of the scene it is there."""

    setting: str
    box: str
    use: Use
    state: str = "plain"
    has_reset: bool = True
    also: frozenset[str] = frozenset()  # other tables that it may change


def sliders(state: str, **shares: float) -> list[Control]:
    names = {name.replace("__", "."): share for name, share in shares.items()}
    return [Control(name, name, slide(name, share), state) for name, share in names.items()]


def at(share: float) -> Callable[[str], Use]:
    return lambda box: slide(box, share)


def left(box: str) -> Use:
    return drag(box, (-45.0, 0.0))


# Of lights: key, name of the control, how it is used, whether it has a reset.
OF_ALL = [
    ("position_mm", "X", left, True),
    ("intensity", "intensity", at(0.9), True),
    ("on", "toggle", at(0.5), False),
]
TARGET = [("target_mm", f"Target {axis}", left, True) for axis in "XYZ"]
SIZED = {
    "sphere": [("radius_mm", "radius_mm", at(0.9), True)],
    "rectangle": [
        *TARGET, ("size_mm", "Width", at(0.9), True), ("size_mm", "Height", at(0.9), True),
        ("roll_deg", "roll_deg", at(0.7), True),
    ],
    "spot": [TARGET[0], ("cone_deg", "cone_deg", at(0.1), True), ("softness", "softness", at(0.9), True)],
}  # fmt: skip
KEEPS_TO_MODEL = frozenset({"camera"})
CONTROLS = [
    *sliders(
        "plain", material__eta=0.1, specular__strength=0.9, specular__shininess=0.3,
        transport__layers=0.1, transport__resolution=0.02, display__key=0.9, display__white=0.05, display__exposure=0.7,
        display__average=0.8,
        camera__azimuth_deg=0.2, camera__elevation_deg=0.8, camera__roll_deg=0.8, camera__view_angle_deg=0.9,
        camera__orthographic=0.05,
    ),
    Control("camera.zoom", "camera.zoom", slide("camera.zoom", 0.7), has_reset=False),  # frames anew
    Control("model.size_mm", "model.size_mm", slide("model.size_mm", 0.3), also=KEEPS_TO_MODEL),
    Control("camera.target_mm", "view", move_view((40.0, -25.0)), has_reset=False),
    *sliders("pair in probe", environment__occluded=0.05),
    *sliders(
        "probe", environment__rotation_deg=0.8, environment__intensity=0.9, environment__extract=0.05,
        display__background_blur_deg=0.5,
    ),
    *sliders("plain", ground__on=0.05),
    *sliders("ground", ground__gap_mm=0.2, ground__reflectance=0.9),
    Control("ground.shown", "ground.shown", choose("ground.shown", "shadow"), "ground"),
    Control("ground.color", "ground.color", pick_colour("ground.color"), "ground"),
    *sliders("ewald", transport__error_target=0.9),
    Control("transport.assignment", "transport.assignment", choose("transport.assignment", "tent"), "ewald"),
    Control("transport.exchange", "transport.exchange", choose("transport.exchange", "on"), "pair in probe"),
    Control("transport.light_paths", "transport.light_paths", tick("transport.light_paths", "mirror"), "solved"),
    *(
        Control(f"material.{key}", f"material.{key}.{channel}", slide(f"material.{key}.{channel}", share))
        for key, share in (("sigma_s_prime", 0.3), ("sigma_a", 0.9))
        for channel in "RGB"
    ),
    *(Control("material.g", f"material.g.{c}", slide(f"material.g.{c}", 0.9), "murky") for c in "RGB"),
    *(
        Control(f"material.{k}", f"material.{k}.{c}", slide(f"material.{k}.{c}", share), state)
        for k, share, state in (
            ("diffuse_reflectance", 0.9, "colour"), ("mean_free_path_mm", 0.9, "colour"),
            ("diffuse_mean_free_path_mm", 0.9, "diffuse colour"),
        )
        for c in "RGB"
    ),
    Control("material.mix_with", "material.mix_with", search("material.mix_with", "ketch", "Ketchup", "mix")),
    Control("material.mix_eta", "material.mix_with", search("material.mix_with", "cand", "candle", "mix")),
    *sliders("mixed", material__mix_share=0.8, material__water=0.6),
    Control("material.profile", "material.profile", choose("material.profile", "photon_beam")),
    Control(
        "material.profile_table", "material.profile_table", open_file("material.profile_table", "other.csv"), "table",
        has_reset=False,
    ),
    Control("material.name", "material.name", search("material.name", "ketch", "Ketchup")),
    Control("model.up", "model.up", choose("model.up", "z"), also=KEEPS_TO_MODEL),
    Control("model.bodies", "model.bodies", choose("model.bodies", "separate"), "pair"),
    Control("detail.albedo", "detail.albedo", choose("detail.albedo", "after"), "skin"),
    Control("detail.normal_strength", "detail.normal_strength", slide("detail.normal_strength", 0.9), "skin"),
    Control("model.nested", "model.nested", choose("model.nested", "solid"), "by itself"),
    Control("model.close_holes", "model.close_holes", slide("model.close_holes", 0.05), "holed", also=KEEPS_TO_MODEL),
    Control("model.texture", "model.texture", open_file("model.texture", "texture.png"), "skin"),
    Control("model.normal_map", "model.normal_map", open_file("model.normal_map", "bumps.png"), "skin"),
    Control(
        "model.path", "model.path", open_file("model.path", "other.ply"), has_reset=False, also=KEEPS_TO_MODEL
    ),
    Control(
        "model.builtin", "model.builtin", slide("model.builtin", 0.5), has_reset=False, also=KEEPS_TO_MODEL
    ),
    Control("transport.method", "transport.method", choose("transport.method", "layered"), "ewald"),
    Control("display.transform", "display.transform", choose("display.transform", "agx")),
    Control("display.background", "display.background", choose("display.background", "transparent")),
    Control("display.background", "display.background", pick_colour("display.background"), "coloured"),
    Control("display.background", "environment.shown", slide("environment.shown", 0.05), "probe", has_reset=False),
    Control("display.image_size", "display.image_size", type_size("display.image_size", 96)),
    Control(
        "environment.path", "environment.path", open_file("environment.path", "probe.exr"), has_reset=False,
        also=frozenset({"display"}),
    ),
    Control(
        "environment.path", "environment.remove", slide("environment.remove", 0.5), "probe", has_reset=False,
        also=frozenset({"display"}),
    ),
    Control(
        "environment.projection", "environment.projection", choose("environment.projection", "mirrorball"),
        "square probe",
    ),
    Control(
        "environment.builtin", "environment.builtin", choose("environment.builtin", "window"),
    ),
    Control("specular.model", "specular.model", choose("specular.model", "normalized")),
    Control("directional.direction", "lights.0.sphere", drag("lights.0.sphere", (25.0, 10.0))),
    Control("directional.direction", "lights.0.azimuth", slide("lights.0.azimuth", 0.8)),
    Control("directional.direction", "lights.0.elevation", slide("lights.0.elevation", 0.3)),
    Control("directional.irradiance", "lights.0.colour", pick_colour("lights.0.colour")),
    Control("directional.irradiance", "lights.0.irradiance", slide("lights.0.irradiance", 0.95)),
    Control("directional.on", "lights.0.toggle", slide("lights.0.toggle", 0.5), has_reset=False),
    Control("directional.KIND", "lights.0.kind", choose("lights.0.kind", "point")),
    *(
        Control("point.position_mm", f"lights.0.{axis}", drag(f"lights.0.{axis}", (-45.0, 0.0)), "point")
        for axis in "XYZ"
    ),
    Control("point.intensity", "lights.0.colour", pick_colour("lights.0.colour"), "point"),
    Control("point.intensity", "lights.0.intensity", slide("lights.0.intensity", 0.9), "point"),
    Control("point.on", "lights.0.toggle", slide("lights.0.toggle", 0.5), "point", has_reset=False),
    Control("directional.angle_deg", "lights.0.angle_deg", slide("lights.0.angle_deg", 0.9)),
    *(
        Control(f"{kind}.{key}", f"lights.0.{box}", use(f"lights.0.{box}"), kind, has_reset)
        for kind, controls in SIZED.items()
        for key, box, use, has_reset in (*controls, *OF_ALL)
    ),
    *(
        Control(f"{kind}.fixed_to", "lights.0.fixed_to", choose("lights.0.fixed_to", "camera"), state)
        for kind, state in (("directional", "plain"), ("point", "point"), *zip(SIZED, SIZED, strict=True))
    ),
]  # fmt: skip
