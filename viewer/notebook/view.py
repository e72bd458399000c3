"""A picture that the mouse turns, beside sliders; frames are drawn as fast as the browser takes them, and no faster."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import ipywidgets
import numpy as np
import numpy.typing as npt
from jupyter_rfb import RemoteFrameBuffer

from milkglass.core.errors import InputError
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.render.picture import PictureRequest, read_image
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import framed, pixel_offsets
from milkglass.viewer.scene.declaration import Setting
from milkglass.viewer.scene.library import materials
from milkglass.viewer.scene.scene import Scene, change_to, changed, setting_at
from milkglass.viewer.session import navigation

LARGEST = 640  # pixels a side
DECADES = 2.0  # of a logarithmic slider, the value in its middle
LEFT, RIGHT = 1, 2  # buttons
REST_SAMPLES = 8  # antialiasing, of a picture that nobody is turning


class View(ipywidgets.HBox):  # type: ignore[misc]
    """A scene's picture and controls of some of its keys.

    Attributes
    ----------
    scene : Scene
        What is shown.
    picture : Picture
    controls : tuple of Widget
    message : HTML
        What is wrong with a value that was chosen; the scene then stays as it was.
    """

    def __init__(self, scene: Scene, keys: Sequence[str]) -> None:
        scale = min(1.0, LARGEST / max(scene.display.image_size))
        width, height = (max(1, round(scale * side)) for side in scene.display.image_size)
        self.scene = replace(scene, display=replace(scene.display, image_size=(width, height)))
        self.picture, self.message = Picture(self), ipywidgets.HTML()
        self.controls = tuple(self._control(key) for key in keys)
        super().__init__([self.picture, ipywidgets.VBox([*self.controls, self.message])])

    def put(self, scene: Scene) -> None:
        """Show another scene."""
        self.scene = navigation.following(self.scene, scene)
        self.picture.request_draw()

    def _control(self, key: str) -> ipywidgets.Widget:
        table, name, declared = setting_at(key, key)
        control = control_of(declared, getattr(getattr(self.scene, table), name), key)

        def change(event: Mapping[str, Any]) -> None:
            self.message.value = ""
            try:
                self.put(changed(self.scene, [change_to(key, event["new"], key)]))
            except InputError as error:
                self.message.value = str(error)

        control.observe(change, "value")
        return control


class Picture(RemoteFrameBuffer):  # type: ignore[misc]
    """The picture of a view: the left button orbits, the right one turns the lights, the wheel zooms."""

    def __init__(self, view: View) -> None:
        width, height = view.scene.display.image_size
        super().__init__(css_width=f"{width}px", css_height=f"{height}px", resizable=False)
        self._view, self._assets, self._held, self._at = view, Assets(), 0, (0.0, 0.0)
        self._renderer = Renderer(assets=self._assets)

    def get_frame(self) -> npt.NDArray[np.uint8]:
        """Return the picture of the view's scene, (height, width, 3 or 4), a quick one while a button is held."""
        samples = 1 if self._held else REST_SAMPLES
        request = PictureRequest(pixel_offsets(samples), at_vertices=bool(self._held), drafts_sight=bool(self._held))
        try:
            return read_image(self._renderer.draw(self._view.scene, request))
        except InputError as error:
            self._view.message.value = str(error)
            return np.zeros((1, 1, 3), np.uint8)

    def handle_event(self, event: Mapping[str, Any]) -> None:
        """Follow the mouse; events are those of jupyter_rfb."""
        kind, scene = event["type"], self._view.scene
        if kind == "pointer_down":
            self._held, self._at = event["button"], (event["x"], event["y"])
        elif kind == "pointer_up":
            self._held = 0
            self.request_draw()  # at its best
        elif kind == "pointer_move" and self._held:
            dx, dy = event["x"] - self._at[0], event["y"] - self._at[1]
            self._at, height = (event["x"], event["y"]), scene.display.image_size[1]
            if self._held == RIGHT:
                self._view.put(navigation.lights_turned(scene, dx, dy, height))
            else:
                self._view.put(replace(scene, camera=navigation.orbited(scene.camera, dx, dy, height)))
        elif kind == "wheel":
            camera = framed(scene.camera, self._assets.mesh(scene.model)[0], scene.display.image_size)
            self._view.put(replace(scene, camera=navigation.zoomed(camera, -event["dy"] / 100.0)))


def control_of(declared: Setting, value: Any, key: str) -> ipywidgets.Widget:
    """Return the widget by which a value of a setting is chosen.

    Raises
    ------
    InputError
        For a vector, or a number that is not given.
    """
    common: dict[str, Any] = {"description": key, "style": {"description_width": "initial"}}
    if key.endswith("material.name") or (declared.choices and not declared.is_number):
        choices = materials if key.endswith("material.name") else declared.choices
        return ipywidgets.Dropdown(options=tuple(choices), value=value, **common)
    if declared.kind == "boolean":
        return ipywidgets.Checkbox(value=value, **common)
    if declared.length is not None or isinstance(value, str) or value is None:
        raise InputError(f"{key} has no slider; choose keys whose value is one number, a choice or a truth value")
    common |= {"value": value, "continuous_update": False}
    low, high = declared.low, declared.high
    if declared.kind == "integer":
        return ipywidgets.IntSlider(min=low or 0, max=high or 10 * value, **common)
    if value > 0.0 and not (low == 0.0 and high is not None and high <= 1.0):
        middle = float(np.log10(value))
        return ipywidgets.FloatLogSlider(min=middle - DECADES / 2, max=middle + DECADES / 2, **common)
    return ipywidgets.FloatSlider(min=low or 0.0, max=high or 1.0, step=0.01, **common)
