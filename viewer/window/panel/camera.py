"""The panel's section on the camera."""

from milkglass.viewer.live.photograph_work import CAMERA_FIXED
from milkglass.viewer.window.panel.section import Section, Seen

LABELS = {
    "azimuth_deg": "Azimuth", "elevation_deg": "Elevation", "roll_deg": "Roll",
    "view_angle_deg": "View angle", "zoom": "Zoom", "orthographic": "Orthographic",
}  # fmt: skip


class CameraSection(Section):
    """Draws the camera's settings; off where the camera is a photograph's."""

    title = "Camera"

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        is_fixed = self._work is not None
        for key, label in LABELS.items():
            off = f"{CAMERA_FIXED[:1].upper()}{CAMERA_FIXED[1:]}." if is_fixed else None
            self._controls.setting(f"camera.{key}", label, automatic=1.0, off=off)
        if is_fixed:
            self._controls.note(CAMERA_FIXED)
