"""The panel's section on a photograph: how deep its object is read, its light, its edges, its mask."""

from milkglass.viewer.gui.controls import RESET_HINT, Reach, Reset, default_of, explained
from milkglass.viewer.gui.toolkit import icons, imgui
from milkglass.viewer.live.photograph_work import LARGEST_BRUSH, SMALLEST_BRUSH, PhotoWork
from milkglass.viewer.scene.declaration import Setting, settings_of
from milkglass.viewer.scene.settings import BEHIND
from milkglass.viewer.window.panel.section import Section, Seen, Tools

DEPTH_GIVEN = "The depth map is taken as it is."
BRUSH_TIP = (
    "Paint the mask: drag; with Alt it takes away; [ ] or Ctrl+wheel: size. The wheel zooms, a middle drag pans, Enter "
    "shows all."
)
BEHIND_TIPS = {
    "filled": "the background, filled in where the object was",
    "seen": "the photograph as it is",
    "transparent": "nothing: the object alone",
}


class PhotographSection(Section):
    """Draws the settings and the tools that a photograph has beside material, lights and transport."""

    title = "Photograph"
    starts_open = True

    def __init__(self, tools: Tools) -> None:
        super().__init__(tools)
        self._start_brush = 0.0 if tools.photo is None else tools.photo.brush  # px

    def shows(self) -> bool:
        """Whether the window shows a photograph."""
        return self._work is not None

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        assert self._work is not None
        controls, work = self._controls, self._work
        self._depth()
        if not self._session.scene.environment.given:
            controls.setting("environment.intensity", "Its light")
            controls.setting("environment.rotation_deg", "Light turned")
        controls.setting("display.key", "Key")
        controls.setting("display.exposure", "Exposure")
        controls.setting("display.white", "White point")
        self._behind()
        self._mask(work)
        if imgui.button(f"{icons.ICON_FA_IMAGE}  Save the picture"):
            self._commands.request("save_picture")
        controls.mark("photo.save")
        if work.trouble:
            controls.note(work.trouble, warning=True)
        elif work.object is None and not work.busy:
            controls.note("no mask yet: paint the object with the brush, or draw a box around it")

    def _depth(self) -> None:
        session, controls, depth = self._session, self._controls, self._session.scene.photo.depth
        controls.begin_row("Depth", resettable=True)
        spare = imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x
        if imgui.button(f"{'estimated' if depth is None else depth.name}##photo.depth", (-spare, 0.0)):
            self._commands.request("open_depth")
        tip = explained(settings_of(session.scene.photo)["depth"], None)
        reset = lambda: session.edit("photo", depth=None)  # noqa: E731
        controls.end_row("photo.depth", "Depth", tip, reset, differs=depth is not None)
        controls.setting("photo.depth_strength", "Depth strength")
        controls.setting("photo.depth_smoothing", "Depth smoothing", off=None if depth is None else DEPTH_GIVEN)

    def _behind(self) -> None:
        session, controls, behind = self._session, self._controls, self._session.scene.photo.behind
        controls.begin_row("Behind edges", resettable=True)
        new = controls.choice("photo.behind", behind, BEHIND, tips=BEHIND_TIPS)
        if new is not None:
            session.edit("photo", behind=new)
        tip = f"{explained(settings_of(session.scene.photo)['behind'], None)}\n{RESET_HINT}"
        default = default_of("photo", "behind")
        controls.end_row(
            "photo.behind",
            "Behind edges",
            tip,
            lambda: session.edit("photo", behind=default),
            differs=behind != default,
        )

    def _mask(self, work: PhotoWork) -> None:
        controls = self._controls
        controls.begin_row("Mask")
        buttons = (
            (
                "brush",
                icons.ICON_FA_PAINTBRUSH,
                BRUSH_TIP,
            ),
            ("box", icons.ICON_FA_VECTOR_SQUARE, "Make a mask: draw a box around the object (GrabCut)"),
        )
        for tool, icon, tip in buttons:
            if controls.icon(f"photo.{tool}", icon, tip, on=work.tool == tool):
                work.tool = None if work.tool == tool else tool
            imgui.same_line()
        if controls.icon("photo.erases", icons.ICON_FA_ERASER, "The brush takes away", on=work.erases):
            work.erases = not work.erases
        imgui.same_line()
        if controls.icon("photo.save_mask", icons.ICON_FA_FLOPPY_DISK, "Save the mask"):
            self._commands.request("save_mask")
        if work.tool == "brush":
            self._brush(work)

    def _brush(self, work: PhotoWork) -> None:
        largest, start = LARGEST_BRUSH * max(work.photo.size), self._start_brush
        declared = Setting("number", "radius of the brush", low=SMALLEST_BRUSH, high=largest)
        new = self._controls.value(
            "photo.brush", "Brush", declared, work.brush, Reset(start, lambda: setattr(work, "brush", start)),
            reach=Reach(SMALLEST_BRUSH, max(SMALLEST_BRUSH + 1.0, largest), True, "%.0f px"),
        )  # fmt: skip
        if new is not None:  # what was typed may lie anywhere
            work.brush = min(max(new, SMALLEST_BRUSH), largest)
