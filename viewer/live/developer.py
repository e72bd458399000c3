"""How the radiance of a lit object becomes the picture that a window shows."""

from typing import Protocol

from milkglass.viewer.live.job import Finished
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.picture import Picture, PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene


class Developer(Protocol):
    """Makes pictures of what `viewer.live.live.Live` has lit."""

    def placed(self, scene: Scene, lit: LitScene) -> Scene | None:
        """Return the scene with the camera and the size that an object is drawn with; None where it cannot be drawn.

        `lit` is what is drawn, perhaps of an older object than the scene's.
        """

    def develop(
        self, renderer: Renderer, scene: Scene, lit: LitScene, finished: Finished, request: PictureRequest
    ) -> Picture:
        """Draw a picture of radiance, exposed and tone-mapped or put into a photograph, and return it.

        Parameters
        ----------
        renderer : Renderer
        scene : Scene
            As of `placed`.
        lit : LitScene
            Lights and camera to draw with.
        finished : Finished
            The volume to draw from, and the light that it is of.
        request : PictureRequest

        Raises
        ------
        Unfinished
            The stages have an allowance, and the pixels take more.
        """


class ToneMap:
    """Exposes and tone-maps radiance: the picture of a model."""

    def placed(self, scene: Scene, lit: LitScene) -> Scene:
        """Return the scene as it is: its camera sees every model."""
        return scene

    def develop(
        self, renderer: Renderer, scene: Scene, lit: LitScene, finished: Finished, request: PictureRequest
    ) -> Picture:
        """Draw the picture that a scene's display settings ask for."""
        return renderer.shade(scene, lit, finished.gather, request)
