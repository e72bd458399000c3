"""The object of a photograph drawn while its material, light and depth change, and put into the photograph."""

from dataclasses import replace

import moderngl

from milkglass.core.display import luminance
from milkglass.core.stages import Stage
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.live import Live
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.photograph.edit import KEY, exposure_match
from milkglass.viewer.photograph.gpu_composite import PhotoPass
from milkglass.viewer.photograph.made import Made
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import Picture
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.scene import Scene


class PhotoLive(Live):
    """Draws the newest object that is ready through the photograph's camera.

    Its scenes are those of `viewer.live.photograph_work.PhotoWork.placed`.

    Attributes
    ----------
    shown : (Made, Scene), optional
        What the last picture is of: of an object of a moment ago while the newest is on its way.
    """

    def __init__(self, context: moderngl.Context, work: PhotoWork, photo_pass: PhotoPass) -> None:
        super().__init__(context, work.wake, work.assets)
        self.shown: tuple[Made, Scene] | None = None
        self._work, self._pass = work, photo_pass
        self._target = photo_pass.target()
        self.renderer.develops = False

    @property
    def working(self) -> bool:
        """Whether a worker has something to do."""
        return super().working or self._work.busy

    @property
    def caught_up(self) -> bool:
        """Whether the newest object is on screen, or nothing is being done to get it there."""
        return not super().working or (self.shown is not None and self.shown[0] is self._work.made)

    def draw(
        self, scene: Scene, detail: Detail, show: str = "radiance", exposure_for: float | None = None
    ) -> Picture | None:
        """Draw the photograph, or the parts that the object's radiance is made of alone; as `Live.draw`."""
        before, picture = self.picture, super().draw(scene, detail, show)
        if picture is None or show != "radiance" or (self.spreading and picture is before):
            return picture  # there is none yet, or it is one of before
        assert self.shown is not None
        made, behind, run = self.shown[0], scene.photo.behind, self.renderer.stages.run
        textures = run(Stage.PHOTO_TEXTURES, [made], lambda: self._pass.upload(made))
        exposure, radiance = self.exposure(), picture.composite.textures["radiance"]
        pyramid = run(Stage.PYRAMID_TARGETS, [radiance.size], lambda: self._pass.pyramid(radiance.size))
        run(
            Stage.PYRAMID,
            [picture.composite, textures, exposure, pyramid],
            lambda: self._pass.fill(radiance, textures, exposure, pyramid),
        )
        run(Stage.BACKDROP, [textures, behind], lambda: self._pass.backdrop(textures, behind, self._target))
        run(
            Stage.PHOTOGRAPH,
            [picture.composite, textures, exposure, behind],
            lambda: self._pass.render(pyramid, made, textures, behind, self._target),
        )
        self._count(self.renderer.stages.timings)
        transparent = behind == "transparent" or made.photo.alpha is not None
        self.picture = replace(picture, image=self._target, transparent=transparent)
        return self.picture

    def exposure(self) -> float:
        """Return what makes the radiance on screen that of the photograph, see `viewer.photograph.edit.Edited`."""
        assert self.shown is not None
        assert self.finished is not None
        (made, scene), lit = self.shown, self.finished.lit
        exposure = scene.display.key / KEY
        if scene.environment.probe is made.light and scene.environment.intensity > 0.0:
            return exposure
        # Seen are just those that face the camera: a height field hides nothing of itself.
        seen = lit.samples.normals[:, 2].clip(0.0)
        area = float((seen * lit.samples.areas).sum())
        mean = float((seen * luminance(lit.flux)).sum()) / max(area, 1e-12)
        return exposure * exposure_match(made.light, made.geometry, scene, mean)

    def wait(self, timeout: float = 60.0) -> None:
        """Wait for what the workers do now; for tests and replays, never for a window."""
        self._work.wait(timeout)
        super().wait(timeout)

    def _newest(self, scene: Scene, detail: Detail) -> tuple[Scene, LitScene, Gather] | None:
        newest = super()._newest(scene, detail)
        if newest is None:
            return None
        drawn, lit, gather = newest
        made = self._work.object_of(lit.model.mesh)
        if made is None:  # the other half of a split view, left behind by several
            return None
        assert self._work.made is not None
        scale = drawn.display.image_size[1] / self._work.made.geometry.framing.size[0]
        size = scaled(made.geometry.framing.size[::-1], scale)
        # Each object has a camera of its own, and that of the newest would show an older one beside its place.
        drawn = replace(drawn, camera=made.geometry.camera, display=replace(drawn.display, image_size=size))
        self.shown = made, drawn
        camera = place_camera(drawn.camera, lit.model.mesh.radius, drawn.display.image_size)
        return drawn, replace(lit, camera=camera), gather


def scaled(size: tuple[int, int], scale: float) -> tuple[int, int]:
    """Return a size times a factor, in whole pixels."""
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
