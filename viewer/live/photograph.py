"""The object of a photograph drawn while its material, light and depth change, and put into the photograph."""

from dataclasses import dataclass, replace

import moderngl

from milkglass.core.display import luminance
from milkglass.core.stages import Stage
from milkglass.viewer.live.developer import ToneMap
from milkglass.viewer.live.job import Finished
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.photograph.edit import PHOTOGRAPH_KEY, exposure_match
from milkglass.viewer.photograph.gpu_composite import PhotoPass
from milkglass.viewer.photograph.object import PhotographObject
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import Picture, PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class DevelopedObject:
    """An object in a photograph, and the exposure that it was put there with, see `viewer.photograph.edit.Edited`."""

    object: PhotographObject
    exposure: float


class PhotographDeveloper:
    """Puts the object of a photograph into the photograph; scenes are those of `PhotoWork.placed`.

    Parameters
    ----------
    work : PhotoWork
    photo_pass : PhotoPass
        Whose pictures are drawn into a target that only this developer has.

    Attributes
    ----------
    developed : DevelopedObject, optional
        What the last picture shows: an object of a moment ago while the newest is on its way.
    """

    def __init__(self, work: PhotoWork, photo_pass: PhotoPass) -> None:
        self.developed: DevelopedObject | None = None
        self._work, self._pass = work, photo_pass
        self._target: moderngl.Framebuffer = photo_pass.target()
        self._parts = ToneMap()

    def placed(self, scene: Scene, lit: LitScene) -> Scene | None:
        """Return the scene with the camera of the object that is lit: another object's would show it out of place."""
        shown, newest = self._work.object_of(lit.model.mesh), self._work.object
        if shown is None or newest is None:  # the other half of a split view, left behind by several
            return None
        scale = scene.display.image_size[1] / newest.geometry.framing.size[0]
        size = scaled(shown.geometry.framing.size[::-1], scale)
        return replace(scene, camera=shown.geometry.camera, display=replace(scene.display, image_size=size))

    def develop(
        self, renderer: Renderer, scene: Scene, lit: LitScene, finished: Finished, request: PictureRequest
    ) -> Picture:
        """Draw the photograph, or the parts that the object's radiance is made of alone."""
        if request.keeps_parts:
            return self._parts.develop(renderer, scene, lit, finished, replace(request, path_step=0))
        shown, behind, run = self._work.object_of(lit.model.mesh), scene.photo.behind, renderer.stages.run
        assert shown is not None
        bare = replace(request, exposure_for=None, develop=False, path_step=0)
        picture = renderer.shade(scene, lit, finished.gather, bare)
        exposure, radiance = exposure_of(shown, scene, finished.lit), picture.composite.textures["radiance"]
        textures = run(Stage.PHOTO_TEXTURES, [shown], lambda: self._pass.upload(shown))
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
            lambda: self._pass.render(pyramid, shown, textures, behind, self._target),
        )
        self.developed = DevelopedObject(shown, exposure)
        transparent = behind == "transparent" or shown.photo.alpha is not None
        return replace(picture, image=self._target, transparent=transparent)


def exposure_of(shown: PhotographObject, scene: Scene, lit: LitScene) -> float:
    """Return what makes the radiance of an object in a scene's light that of its photograph.

    See `viewer.photograph.edit.Edited`; `lit` is the light that the object's volume is of.
    """
    exposure = scene.display.exposed_key / PHOTOGRAPH_KEY
    if scene.environment.probe is shown.light and scene.environment.intensity > 0.0:
        return exposure
    # What is seen is what faces the camera: a height field hides nothing of itself.
    seen = lit.samples.normals[:, 2].clip(0.0)
    area = float((seen * lit.samples.areas).sum())
    mean = float((seen * luminance(lit.flux)).sum()) / max(area, 1e-12)
    return exposure * exposure_match(shown.light, shown.geometry, scene, mean)


def scaled(size: tuple[int, int], scale: float) -> tuple[int, int]:
    """Return a size times a factor, in whole pixels, at least 1."""
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
