"""The finished frame: arrays of the picture and of what it is made of, and files of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.stages import Timings
from milkglass.core.transport.quality import Quality
from milkglass.viewer.files.formats import PictureContents, write_picture
from milkglass.viewer.files.images import channel_bands, png_bytes
from milkglass.viewer.files.record import Record
from milkglass.viewer.gl.context import current, free_dropped, read_rgba
from milkglass.viewer.passes.composite import OUTPUTS, Composite
from milkglass.viewer.render.planes import write_depth, write_mask
from milkglass.viewer.scene.camera import Camera, Offset, pixel_offsets
from milkglass.viewer.scene.light_paths import LightPaths
from milkglass.viewer.scene.scene import Scene

SCATTERED = ("once", "often")  # parts of light that are shown alone, and add up to the output `subsurface`


@dataclass(frozen=True)
class PictureRequest:
    """What a picture of a lit scene shows, and how well.

    Attributes
    ----------
    offsets : from `viewer.scene.camera.pixel_offsets`
        Where the samples of a pixel lie.
    show : str
        What the image is made of, one of `viewer.passes.composite.OUTPUTS` or of `SCATTERED`.
    parts : bool
        Whether all that radiance is made of is kept on the GPU; it always is where the image shows some of it.
    exposure_for : float, optional
        Log-average of radiance to expose for, in place of the scene's and of the picture's own.
    quick : bool
        Whether a single sample of a pixel may see as little of large lights as each of four would.
    develop : bool
        Whether radiance gets exposure and tone map; a photograph has its own.
    path_step : int
        Side of the squares of pixels of which as many rays of sight are followed, where a scene needs any; 0 for none.
    drafts_sight : bool
        Whether a draft of what rays of sight would find is drawn in place of following them.
    ground : bool
        Whether the plane that the object stands on is drawn, where a scene has one.
    at_vertices : bool
        Whether light that is known at the vertices may be drawn in place of that of each pixel, where it serves.
    """

    offsets: tuple[Offset, ...] = pixel_offsets(1)
    show: str = "radiance"
    parts: bool = False
    exposure_for: float | None = None
    quick: bool = False
    develop: bool = True
    path_step: int = 1
    drafts_sight: bool = False
    ground: bool = True
    at_vertices: bool = False

    @property
    def keeps_parts(self) -> bool:
        """Whether all of `viewer.passes.composite.OUTPUTS` are drawn, not radiance alone."""
        return self.parts or self.show != OUTPUTS[0]

    @property
    def may_be_at_vertices(self) -> bool:
        """Whether light at the vertices is wanted, and enough: for radiance alone, that is developed."""
        return self.at_vertices and self.develop and not self.keeps_parts

    @property
    def output(self) -> str:
        """The one of `viewer.passes.composite.OUTPUTS` that the image is made of."""
        return "subsurface" if self.show in SCATTERED else self.show

    def light_paths(self, scene: Scene) -> LightPaths:
        """Return the parts of light that a picture of a scene shows."""
        shown = scene.transport.shown_paths
        return shown.alone(self.show) if self.show in SCATTERED else shown

    @property
    def shows_ground(self) -> bool:
        """Whether the plane that the object stands on is drawn where a scene has one: in pictures of radiance."""
        return self.ground and self.develop and self.show == OUTPUTS[0]


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture on the GPU, tone-mapped, with the textures that it is composed of."""

    composite: Composite
    image: moderngl.Framebuffer
    camera: Camera
    transparent: bool
    warnings: tuple[str, ...]
    quality: Quality
    log_average: float  # brightness that the picture itself asks to be exposed for
    remarks: tuple[str, ...] = ()
    ground: moderngl.Texture | None = None  # as without the object, times its share
    parts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Still:
    """A tone-mapped picture alone, as an array; attributes as of `Frame`."""

    image: npt.NDArray[np.uint8]
    timings: Timings
    warnings: tuple[str, ...]
    quality: Quality
    remarks: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    log_average: float = 0.0
    record: Record | None = None

    def save(self, path: str | Path) -> None:
        """Write a format of the tone-mapped picture, ``.png``, whole or not at all; otherwise as `Frame.save`."""
        write_picture(path, PictureContents(self.image.shape[:2], lambda: [self.image], texts=_texts(self.record)))

    def _repr_png_(self) -> bytes:
        return png_bytes(self.image)


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame as arrays, top row first; 0 where the object is not, nor in the first two the ground.

    Attributes
    ----------
    radiance : (H, W, 3) float32
        Linear RGB towards the eye, multiplied by coverage.
    alpha : (H, W) float32
        Coverage of the pixel by the object and the ground, [0, 1].
    image : (H, W, 3) uint8, or (H, W, 4) where the background is transparent
        Tone-mapped sRGB; alpha is not multiplied in.
    position, normal : (H, W, 3) float32
        World space (mm; unit), means over the covered part of the pixel.
    irradiance, exitance : (H, W, 3) float32
        E that enters and M that leaves, means over the covered part of the pixel.
    subsurface, specular : (H, W, 3) float32
        F_t M / `core.transport.quality.Quality.exit_normalisation`, or what rays find inside; and the highlights.
    unscattered : (H, W, 3) float32
        What is seen through the object. With the two before it sums to the object's `radiance`.
    timings : dict
        Stage -> ms, of the stages that ran.
    warnings : tuple of str
        What the model's flaws do to the picture, and what its transport misses.
    quality : Quality
        Method and resolution of transport, with the error to expect.
    remarks : tuple of str
        What transport resolves less finely than the material asks for.
    parts : tuple of str
        Which rays of sight were followed, and why.
    log_average : float
        Of the object's radiance, by its brightest channel: as `display.average` it keeps this exposure for a series.
    mask : (H, W) float32
        Coverage of the pixel by the object alone, [0, 1].
    depth : (H, W) float32
        Distance of `position` along the camera's axis from the eye's plane, mm; with a parallel projection too.
    record : Record, optional
        What files of it say of its making.
    """

    radiance: Float32
    alpha: Float32
    image: npt.NDArray[np.uint8]
    position: Float32
    normal: Float32
    irradiance: Float32
    exitance: Float32
    subsurface: Float32
    specular: Float32
    unscattered: Float32
    mask: Float32
    depth: Float32
    timings: Timings
    warnings: tuple[str, ...]
    quality: Quality
    remarks: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    log_average: float = 0.0
    record: Record | None = None

    @property
    def scattered(self) -> Float32:
        """Return what has scattered inside, once and more often: `subsurface`, with the name that says what it is."""
        return self.subsurface

    def channels(self) -> dict[str, Float32]:
        """Return the channels of an EXR file, (H, W) float32 each, by name."""
        planes = {name: self.radiance[..., i] for i, name in enumerate("RGB")}
        planes["A"] = self.alpha
        for layer, names in (("position", "XYZ"), ("normal", "XYZ")):
            planes |= {f"{layer}.{name}": getattr(self, layer)[..., i] for i, name in enumerate(names)}
        planes["depth.Z"] = self.depth
        for layer in ("irradiance", "exitance", "subsurface", "specular", "unscattered", "scattered"):
            planes |= {f"{layer}.{name}": getattr(self, layer)[..., i] for i, name in enumerate("RGB")}
        return planes

    def save(self, path: str | Path) -> None:
        """Write ``.png`` (tone-mapped), ``.exr`` (linear, all channels) or another of `PICTURE_FORMATS`, whole or not.

        Raises
        ------
        InputError
            For another suffix or a place that cannot be written.
        """
        texts = _texts(self.record)
        write_picture(path, PictureContents(self.image.shape[:2], lambda: [self.image], self._layers, texts=texts))

    def _repr_png_(self) -> bytes:
        return png_bytes(self.image)

    def save_mask(self, path: str | Path) -> None:
        """Write `mask` as a PNG of 8 bits; errors as `save`."""
        write_mask(path, self.mask)

    def save_depth(self, path: str | Path) -> tuple[float, float]:
        """Write `depth` as ``.exr`` or ``.png``, see `viewer.render.planes.write_depth`; errors as `save`."""
        return write_depth(path, self.depth, self.mask)

    def _layers(self) -> tuple[Sequence[str], Iterable[Float32]]:
        channels = self.channels()
        return tuple(channels), channel_bands(channels)


def _texts(record: Record | None) -> dict[str, str]:
    return {} if record is None else record.texts()


def read_still(picture: Picture, timings: Timings, *, record: Record | None = None) -> Still:
    """Read the tone-mapped picture alone back from the GPU."""
    return Still(
        read_image(picture),
        timings,
        picture.warnings,
        picture.quality,
        picture.remarks,
        picture.parts,
        picture.log_average,
        record,
    )


def read_frame(picture: Picture, timings: Timings, *, last: bool = False, record: Record | None = None) -> Frame:
    """Read a picture back from the GPU; if nobody needs it there any longer, part by part in its place."""
    with current(picture.image.ctx) as context:
        free_dropped(context)
        alpha = np.ascontiguousarray(read_rgba(picture.composite.textures["radiance"])[..., 3])
        planes = {}
        if last:
            picture.composite.framebuffer.release()
        for name, texture in picture.composite.textures.items():
            planes[name] = np.ascontiguousarray(read_rgba(texture)[..., :3])
            if last:
                texture.release()
    # Sums over the samples that hit the object become their means; most pixels are hit by all or none.
    edge = (alpha > 0.0) & (alpha < 1.0)
    for name in ("position", "normal", "irradiance", "exitance"):
        planes[name][edge] /= alpha[edge, None]
    hit = alpha > 0.0
    normals = planes["normal"][hit]
    planes["normal"][hit] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    mask = np.minimum(alpha, 1.0)  # eight times 1/8 may round above 1
    depth = np.where(hit, -(planes["position"] @ picture.camera.view[:3, 2] + picture.camera.view[3, 2]), 0.0)
    if picture.ground is not None:
        ground = np.maximum(1.0 - alpha, 0.0)[..., None] * read_rgba(picture.ground)
        planes["radiance"] += ground[..., :3]
        alpha += ground[..., 3]
    return Frame(
        **planes,
        alpha=np.minimum(alpha, 1.0),
        mask=mask,
        depth=depth.astype(np.float32),
        image=read_image(picture),
        timings=timings,
        warnings=picture.warnings,
        quality=picture.quality,
        remarks=picture.remarks,
        parts=picture.parts,
        log_average=picture.log_average,
        record=record,
    )


def read_image(picture: Picture) -> npt.NDArray[np.uint8]:
    """Read the tone-mapped image back: (H, W, 3 or 4) uint8, top row first."""
    width, height = picture.image.size
    components = 4 if picture.transparent else 3
    with current(picture.image.ctx):
        data = picture.image.read(components=components, alignment=1)
    return np.ascontiguousarray(np.frombuffer(data, np.uint8).reshape(height, width, components)[::-1])
