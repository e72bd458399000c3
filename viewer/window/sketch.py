"""What a window shows of its model before there is light, and before all of the program is imported."""

from typing import TYPE_CHECKING

import moderngl

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.sculpture import SPACING
from milkglass.viewer.files.builtin import builtin_model
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import leave_framebuffer
from milkglass.viewer.passes.sketch import SketchPass
from milkglass.viewer.passes.tonemap import backdrop
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import BUILTINS

if TYPE_CHECKING:
    from milkglass.viewer.files.model import FileModel

LARGEST_FILE = 2**23  # bytes: a larger model is read by a worker, which tells how far it is and can be left
COARSENESS = 1.5  # of the sculpture's cells, on which it stands there in a third of the time


class Sketch:
    """A scene's model in clay.

    Attributes
    ----------
    model : FileModel or None
        What was read of the scene's file for it; None where it is of no file.
    """

    def __init__(self, context: moderngl.Context, mesh: Mesh, model: "FileModel | None" = None) -> None:
        self.model = model
        self._context, self._mesh = context, mesh
        self._buffers, self._pass = MeshBuffers(context, mesh), SketchPass(context)
        self._picture: moderngl.Framebuffer | None = None
        self._drawn: object = None  # what the picture was drawn for

    @classmethod
    def of(cls, context: moderngl.Context, scene: Scene) -> "Sketch | None":
        """Return the sketch of a scene's model; None where that would take long, or where its file cannot be used."""
        settings = scene.model
        if settings.builtin_name == BUILTINS[0] and not isinstance(settings.size_mm, str):
            return cls(context, builtin_model(settings.size_mm, settings.up or "y", COARSENESS * SPACING))
        if settings.mesh is not None or settings.path is None:
            return None
        from milkglass.viewer.files.model import read_model

        try:
            if settings.path.stat().st_size > LARGEST_FILE:
                return None
            model = read_model(settings.path, settings.size_mm, settings.up, close_holes=settings.close_holes)
        except (OSError, InputError):
            return None  # who reads it again says so
        return cls(context, model.mesh, model)

    def draw(self, scene: Scene, target: moderngl.Framebuffer, size: tuple[int, int]) -> None:
        """Draw the model as the scene's camera sees it into the lower left of a framebuffer that has a depth buffer.

        `size` is the width and height of the picture there, in pixels.
        """
        whole, target.viewport = target.viewport, (0, 0, *size)
        colour = backdrop(scene.display.background)
        target.clear(*colour, 1.0, depth=1.0, viewport=target.viewport)
        self._pass.render(self._buffers, model_camera(scene.camera, self._mesh, size), target)
        target.viewport = whole
        leave_framebuffer(self._context)

    def picture(self, scene: Scene) -> moderngl.Framebuffer:
        """Return the model at the scene's image size, drawn anew if the camera moved, in one framebuffer a size."""
        size = scene.display.image_size
        if self._picture is None or self._picture.size != size:
            colour = self._context.texture(size, 4)
            self._picture = self._context.framebuffer([colour], self._context.depth_renderbuffer(size))
            self._drawn = None
        asked = scene.camera, scene.display.background
        if asked != self._drawn:
            self.draw(scene, self._picture, size)
            self._drawn = asked
        return self._picture
