"""A photograph with its object in another material, composed on the GPU: `viewer.photograph.composite` for windows."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.display import srgb
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.gl.context import leave_framebuffer
from milkglass.viewer.gl.program import Program
from milkglass.viewer.photograph.composite import trusted
from milkglass.viewer.photograph.geometry import Geometry
from milkglass.viewer.photograph.object import PhotographObject, shown_block
from milkglass.viewer.scene.settings import BEHIND


@dataclass(frozen=True, eq=False)
class ObjectTextures:
    """Textures of an object that do not change with its material.

    Attributes
    ----------
    trust : how much each rendered pixel counts, see `viewer.photograph.composite.trusted`
    behind : the background, filled in where the object is
    edges : as of `viewer.photograph.object.PhotographObject`
    """

    trust: moderngl.Texture
    behind: moderngl.Texture
    edges: moderngl.Texture


class PhotoPass:
    """Puts what was rendered into a photograph.

    Parameters
    ----------
    context : moderngl.Context
    photo : Photo
        Shown with a pixel for each square of `viewer.photograph.object.shown_block`.

    Attributes
    ----------
    photograph : moderngl.Texture
        sRGB and alpha, row 0 at the top.
    """

    def __init__(self, context: moderngl.Context, photo: Photo) -> None:
        self._context = context
        self._object = Program(context, "fullscreen.vert", "photo_object.frag")
        self._backdrop = Program(context, "fullscreen.vert", "photo_backdrop.frag")
        self._photo = Program(context, "fullscreen.vert", "photo.frag")
        programs = self._object, self._backdrop, self._photo
        self._first, self._unchanged, self._second = (context.vertex_array(program.program, []) for program in programs)
        self._block = shown_block(photo)
        self.photograph = _uploaded(context, shown_pixels(photo))

    def target(self) -> moderngl.Framebuffer:
        """Make a framebuffer for a picture."""
        size = self.photograph.size
        return self._context.framebuffer([self._context.texture(size, 4)], self._context.depth_renderbuffer(size))

    def upload(self, shown: PhotographObject) -> ObjectTextures:
        """Upload what does not change with the material."""
        return ObjectTextures(
            _uploaded(self._context, _trust(shown.geometry)),
            _uploaded(self._context, shown.behind.astype(np.float16)),
            _uploaded(self._context, shown.edges),
        )

    def pyramid(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Make the first level of a pyramid for radiance of (width, height)."""
        texture = self._context.texture(size, 4, dtype="f2")
        texture.repeat_x = texture.repeat_y = False
        return self._context.framebuffer([texture])

    def fill(
        self, radiance: moderngl.Texture, textures: ObjectTextures, exposure: float, pyramid: moderngl.Framebuffer
    ) -> None:
        """Draw all levels of an object's radiance, which is weighted by coverage."""
        self._context.enable_only(moderngl.NOTHING)
        pyramid.use()
        self._object.set({"t_radiance": radiance, "t_trust": textures.trust, "u_exposure": exposure})
        self._first.render(vertices=3)
        leave_framebuffer(self._context)
        texture = _texture(pyramid)
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)

    def backdrop(self, textures: ObjectTextures, behind: str, out: moderngl.Framebuffer) -> None:
        """Draw what stays of the photograph, and mark the rest for `render`; `behind` of `BEHIND`."""
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "1"
        out.depth_mask = True
        out.use()
        self._backdrop.set({"t_photo": self.photograph, "t_edges": textures.edges, "u_behind": BEHIND.index(behind)})
        self._unchanged.render(vertices=3)
        self._context.depth_func = "<"
        out.depth_mask = False

    def render(
        self,
        pyramid: moderngl.Framebuffer,
        shown: PhotographObject,
        textures: ObjectTextures,
        behind: str,
        out: moderngl.Framebuffer,
    ) -> None:
        """Draw an object whose radiance is in all levels over its `backdrop`; `behind` likewise."""
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = ">"
        region = shown.geometry.framing.shown
        out.use()
        self._photo.set(
            {
                "t_photo": self.photograph,
                "t_edges": textures.edges,
                "t_behind": textures.behind,
                "t_object": _texture(pyramid),
                "u_region": tuple(
                    side / self._block for side in (region.left, region.top, region.width, region.height)
                ),
                "u_white": shown.request.white,
                "u_behind": BEHIND.index(behind),
            }
        )
        self._second.render(vertices=3)
        self._context.depth_func = "<"


def _texture(framebuffer: moderngl.Framebuffer) -> moderngl.Texture:
    texture = framebuffer.color_attachments[0]
    assert isinstance(texture, moderngl.Texture)
    return texture


def shown_pixels(photo: Photo) -> npt.NDArray[np.uint8]:
    """Return the photograph as it is shown, (h, w, 4), sRGB and alpha."""
    block = shown_block(photo)
    rows, columns = (-(-side // block) for side in photo.size)
    colour, _ = photo.reduced(Region(0, 0, rows * block, columns * block), block)
    pixels = np.full((rows, columns, 4), 255, np.uint8)
    pixels[..., :3] = np.rint(255.0 * srgb(colour))
    if photo.alpha is not None:
        alpha = photo.alpha[::block, ::block][:rows, :columns]
        pixels[..., 3] = np.rint(alpha * (255.0 / np.iinfo(alpha.dtype).max))
    return pixels


def _trust(geometry: Geometry) -> npt.NDArray[np.float16]:
    return trusted(geometry)[..., None].astype(np.float16)


def _uploaded(context: moderngl.Context, pixels: npt.NDArray[np.generic]) -> moderngl.Texture:
    """Upload (h, w, c) as it lies, the first row at v = 0."""
    height, width, components = pixels.shape
    kind = "f1" if pixels.dtype == np.uint8 else "f2"
    texture = context.texture((width, height), components, np.ascontiguousarray(pixels), alignment=1, dtype=kind)
    texture.repeat_x = texture.repeat_y = False
    return texture
