"""The panel's part for a photograph: how deep its object is read, its light, its edges, its mask."""

from viewer.declaration import Setting
from viewer.gui import icons, imgui
from viewer.panel_controls import RESET_HINT, Controls, Reach
from viewer.photo_mouse import FIXED, LARGEST, SMALLEST
from viewer.photo_pass import SHOWN_BEHIND
from viewer.photo_work import PhotoWork
from viewer.session import Session

STRENGTH = Setting("number", "factor on the depth; 1 makes a disc a hemisphere", low=0.05, high=5.0)
SMOOTHING = Setting("number", "scale of light and dark that shapes it, in object radii", low=0.01, high=1.0)
BEHIND_TIPS = {
    "filled": "the background, filled in where the object was",
    "seen": "the photograph as it is",
    "transparent": "nothing: the object alone",
}
CAMERA = (
    ("azimuth_deg", "Azimuth"), ("elevation_deg", "Elevation"), ("roll_deg", "Roll"),
    ("view_angle_deg", "View angle"), ("zoom", "Zoom"), ("orthographic", "Orthographic"),
)  # fmt: skip


class PhotoPanel:
    """Draws what a photograph has beside material, lights and transport.

    Parameters
    ----------
    session, controls, work
    requests : list of str
        Actions that clicks ask for.
    """

    def __init__(self, session: Session, controls: Controls, work: PhotoWork, requests: list[str]) -> None:
        self._session, self._controls, self._work, self._requests = session, controls, work, requests
        self._defaults = work.strength, work.smoothing, work.behind, work.brush

    def draw(self) -> None:
        """Draw it in the current ImGui window."""
        controls, work = self._controls, self._work
        strength, smoothing, behind, _ = self._defaults
        self._number("strength", "Depth strength", STRENGTH, strength, Reach(0.2, 3.0, True, "%.2f"))
        self._number("smoothing", "Depth smoothing", SMOOTHING, smoothing, Reach(0.02, 0.5, True, "%.3f"))
        if not self._session.scene.environment.given:
            controls.setting("environment.intensity", "Its light")
            controls.setting("environment.rotation_deg", "Light turned")
        controls.setting("display.key", "Key (exposure)")
        controls.setting("display.white", "White point")
        controls.begin_row("Behind edges", True)
        work.behind = controls.choice("photo.behind", work.behind, SHOWN_BEHIND, tips=BEHIND_TIPS) or work.behind
        tip = f"What soft edges of the mask show: the background filled in, or as seen; or no photograph.\n{RESET_HINT}"
        controls.end_row(
            "photo.behind", "Behind edges", tip, lambda: setattr(work, "behind", behind), work.behind != behind
        )
        self._mask()
        if imgui.button(f"{icons.ICON_FA_IMAGE}  Save the picture"):
            self._requests.append("save_picture")
        controls.mark("photo.save")
        if work.trouble:
            controls.note(work.trouble, warning=True)
        elif work.made is None and not work.busy:
            controls.note("no mask yet: paint the object with the brush, or draw a box around it")

    def camera(self) -> None:
        """Draw the camera's rows, off."""
        for key, label in CAMERA:
            self._controls.setting(f"camera.{key}", label, off=f"{FIXED[:1].upper()}{FIXED[1:]}.")
        self._controls.note(FIXED)

    def _mask(self) -> None:
        controls, work = self._controls, self._work
        controls.begin_row("Mask")
        buttons = (
            ("brush", icons.ICON_FA_PAINTBRUSH, "Paint the mask: drag; with Alt it takes away; [ ] or the wheel: size"),
            ("box", icons.ICON_FA_VECTOR_SQUARE, "Make a mask: draw a box around the object (GrabCut)"),
        )
        for tool, icon, tip in buttons:
            if controls.icon(f"photo.{tool}", icon, tip, on=work.tool == tool):
                work.tool = None if work.tool == tool else tool
            imgui.same_line()
        if controls.icon("photo.erases", icons.ICON_FA_ERASER, "The brush takes away", on=work.erases):
            work.erases = not work.erases
        imgui.same_line()
        imgui.begin_disabled(not work.mask.can_undo)
        if controls.icon("photo.undo", icons.ICON_FA_ROTATE_LEFT, "Take the last stroke back (Ctrl+Z while painting)"):
            work.mask.undo()
        imgui.end_disabled()
        imgui.same_line()
        if controls.icon("photo.save_mask", icons.ICON_FA_FLOPPY_DISK, "Save the mask"):
            self._requests.append("save_mask")
        if work.tool == "brush":
            declared = Setting("number", "radius of the brush", low=SMALLEST, high=LARGEST * max(work.photo.size))
            most = max(SMALLEST + 1.0, LARGEST * max(work.photo.size))
            self._number("brush", "Brush", declared, self._defaults[3], Reach(SMALLEST, most, True, "%.0f px"))

    def _number(self, name: str, label: str, declared: Setting, default: float, reach: Reach) -> None:
        work = self._work
        new = self._controls.value(
            f"photo.{name}", label, declared, getattr(work, name), default=default,
            on_reset=lambda: setattr(work, name, default), reach=reach,
        )  # fmt: skip
        if new is not None:  # what was typed may lie anywhere
            setattr(work, name, min(max(new, declared.low or 0.0), declared.high or new))
