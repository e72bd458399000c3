"""The panel's rows for the colours and the relief of the model's surface."""

from milkglass.viewer.files.model_look import Look
from milkglass.viewer.gui.controls import RESET_HINT, Controls, explained
from milkglass.viewer.gui.toolkit import imgui
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.session.session import Session

NO_MAP = "The model has no texture coordinates that a picture could lie on."
NO_COLOURS = "The model has no colours; give it a texture."
NO_COLOURS_NO_MAP = "The model has no colours, and no texture coordinates that a texture could lie on."
NO_RELIEF = "The model has no normal map."
PICTURES = (("texture", "Texture", "has_colours"), ("normal_map", "Normal map", "has_relief"))


def draw_detail(session: Session, controls: Controls, requests: list[str], live: Live) -> None:
    """Draw the rows; `requests` takes what needs a file."""
    model = session.scene.model
    look = live.assets.look(model) if live.assets.has_mesh(model) else None
    for key, label, own in PICTURES:
        _picture(session, controls, requests, look, key, label, own)
    colours, relief = missing(look, model.texture is not None, model.normal_map is not None)
    controls.setting("detail.albedo", "Colours", off=colours)
    controls.setting("detail.normal_strength", "Relief", off=relief)


def missing(look: Look | None, texture: bool, normal_map: bool) -> tuple[str | None, str | None]:
    """Why colours and why relief mean nothing now, sentences; None where they do."""
    mapped = look is not None and look.mapped
    colours = (
        None if texture or (look is not None and look.has_colours) else NO_COLOURS if mapped else NO_COLOURS_NO_MAP
    )
    return colours, None if normal_map or (look is not None and look.has_relief) else NO_RELIEF


def _picture(
    session: Session, controls: Controls, requests: list[str], look: Look | None, key: str, label: str, own: str
) -> None:
    """A picture of one's own, or the file's: a button that asks for one."""
    path = getattr(session.scene.model, key)
    mapped = path is not None or (look is not None and look.mapped)
    shown = "of the file" if look is not None and getattr(look, own) else "none"
    imgui.begin_disabled(not mapped)
    controls.begin_row(label, True)
    spare = imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x
    if imgui.button(f"{shown if path is None else path.name}##model.{key}", (-spare, 0.0)):
        requests.append(f"open_{key}")
    tip = explained(settings_of(session.scene.model)[key], None) + "\n" + (RESET_HINT if mapped else NO_MAP)
    controls.end_row(
        f"model.{key}", label, tip, lambda: session.edit("model", **{key: None}), path is not None, is_off=not mapped
    )
    imgui.end_disabled()
