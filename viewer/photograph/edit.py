"""Image-based material editing: the object of a photograph in another material, under the light around it.

After Khan et al. 2006, as figure 3 of the paper does: photograph -> height -> surface (`viewer.photograph.geometry`),
background -> light (`core.photograph.surround`), then the renderer's own pipeline, and back into the photograph
(`viewer.photograph.composite`).
"""

from concurrent.futures import Future
from dataclasses import dataclass, replace
from time import perf_counter

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.display import luminance
from milkglass.core.light.probe import Probe, irradiance_table, lookup
from milkglass.core.photograph.light import ShadingFit, fit_surround
from milkglass.core.photograph.surround import MAP_HEIGHT, filled, filled_halves, scene_radiance, surround_map
from milkglass.core.stages import Stage, Timings
from milkglass.core.threads import one_blas_thread, thread_pool
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.gl.context import read_rgba
from milkglass.viewer.photograph.framing import frame_object
from milkglass.viewer.photograph.geometry import Geometry, make_geometry
from milkglass.viewer.render.lighting import Progress
from milkglass.viewer.render.picture import Frame, PictureRequest, read_frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DisplaySettings

SURROUND_SIDE = 256  # pixels along the longer side of the background that the light is computed of
OBJECT_NODES = (
    48  # of diffusion along the object, unless the scene says: what they miss is less than an estimated shape misses
)
PHOTOGRAPH_KEY = DisplaySettings().key  # of a scene whose object keeps the photograph's exposure


@dataclass(frozen=True, eq=False)
class Edited:
    """An object rendered in another material, not yet in its photograph.

    Pixels (h, w) are the rendered ones, see `viewer.photograph.framing.Framing.size`.

    Attributes
    ----------
    photo : Photo
    geometry : Geometry
    radiance : (h, w, 3) float32
        Linear RGB, multiplied by coverage.
    coverage : (h, w) float32
        By the rendered surface, [0, 1].
    frame : Frame, optional
        Everything that was rendered, where it was asked for.
    exposure : float
        Factor that turns the radiance into the photograph's, see `core.photograph.surround.scene_radiance`.
    white : float
        White point of the tone map.
    behind : (h, w, 3) float32
        Linear RGB of the background in [0, 1], filled in where the object was; see `background`.
    timings : Timings
    warnings : tuple of str
    """

    photo: Photo
    geometry: Geometry
    radiance: Float32
    coverage: Float32
    frame: Frame | None
    exposure: float
    white: float
    behind: Float32
    timings: Timings
    warnings: tuple[str, ...]


@one_blas_thread()
def edit(
    photo: Photo,
    scene: Scene,
    context: moderngl.Context,
    *,
    samples: int = 1,
    parts: bool = True,
    progress: Progress = lambda _: None,
) -> Edited:
    """Return the object of a photograph, rendered in a scene's material and light.

    Parameters
    ----------
    photo : Photo
    scene : Scene
        Its model's shape, camera and picture size are replaced by the photograph's; without an environment, the
        photograph's background is one. Its `photo` settings say how depth is estimated or read.
    context : moderngl.Context
    samples : int
        Antialiasing samples of a pixel, >= 1; the mask smooths the outline anyway.
    parts : bool
        Whether to keep what the radiance is made of.
    progress : as of `viewer.render.renderer.render`

    Raises
    ------
    InputError
        Why the object cannot be rendered; one sentence.
    """
    timings: Timings = {}
    clock = perf_counter()

    def lap(stage: Stage) -> None:
        nonlocal clock
        timings[stage], clock = 1e3 * (perf_counter() - clock), perf_counter()

    progress("estimating the depth")
    framing = frame_object(photo, scene.model.length_mm)
    white, depth = scene.display.white, scene.photo
    lights: list[Future[Probe]] = []
    geometry = make_geometry(
        photo,
        framing,
        white,
        strength=depth.depth_strength,
        smoothing=depth.depth_smoothing,
        depth=depth.depth,
        on_shading=lambda shading: lights.append(thread_pool().submit(photo_light, photo, shading, white)),
    )
    lap(Stage.DEPTH_AND_SURFACE)
    behind = thread_pool().submit(background, geometry)
    progress("looking at the surround")
    light = lights[0].result()
    lap(Stage.LIGHT)
    placed = placed_scene(scene, geometry, light)
    renderer = Renderer(context)
    # Light by hand is as bright as the irradiance that it makes says, which is one of the parts.
    is_lit_by_photo = placed.environment.probe is light and placed.environment.intensity > 0.0
    picture = renderer.draw(
        placed,
        PictureRequest(pixel_offsets(samples), parts=parts or not is_lit_by_photo, develop=parts, path_step=0),
        progress=progress,
        last=True,
    )
    timings |= renderer.timings
    rendered = read_rgba(picture.composite.textures["radiance"])
    radiance, covered = np.ascontiguousarray(rendered[..., :3]), np.minimum(rendered[..., 3], 1.0)
    exposure = scene.display.exposed_key / PHOTOGRAPH_KEY
    if not is_lit_by_photo:
        irradiance = read_rgba(picture.composite.textures["irradiance"])[..., :3]
        mean = float(luminance(irradiance).sum()) / max(float(covered.sum()), 1.0)
        exposure *= exposure_match(light, geometry, placed, mean)
    frame = read_frame(picture, renderer.timings, last=True) if parts else None
    lap(Stage.RENDERING)
    kept = exposure, white, behind.result(), timings, picture.warnings
    lap(Stage.BACKGROUND)
    return Edited(photo, geometry, radiance, covered, frame, *kept)


def placed_scene(scene: Scene, geometry: Geometry, light: Probe) -> Scene:
    """Return the scene with a photograph's object and camera, and its light where there is no other environment.

    What is bright in the background is behind the object, and need not shine as a lamp: only one in front does.
    """
    rows, columns = geometry.framing.size
    environment = scene.environment
    if not environment.given:
        sharp = environment.extract and geometry.shading.lamp is not None
        environment = replace(environment, probe=light, extract=sharp)
    transport = scene.transport
    if transport.facts.solves and transport.resolution is None and transport.error_target is None:
        transport = replace(transport, resolution=OBJECT_NODES)
    display = replace(scene.display, image_size=(columns, rows), background="black")
    return replace(
        scene.floating(),
        model=replace(scene.model, path=None, builtin=None, mesh=geometry.mesh),
        camera=geometry.camera,
        display=display,
        environment=environment,
        transport=transport,
    )


def photo_light(photo: Photo, shading: ShadingFit, white: float) -> Probe:
    """Return the light probe around the object, in the photograph's radiance, see `core.photograph.light`."""
    h, w = photo.size
    block = max(1, max(h, w) // SURROUND_SIDE)
    region = Region(0, 0, -(-h // block) * block, -(-w // block) * block)
    colour, coverage = photo.reduced(region, block)
    weight, around = clear_of(coverage), None
    if weight.any():
        outline = photo.outline
        centre = (outline.top + 0.5 * outline.height) / h, (outline.left + 0.5 * outline.width) / w
        around = surround_map(filled(scene_radiance(colour, white), weight.astype(np.float32)), centre)
    return Probe.from_pixels(fit_surround(around, shading, (MAP_HEIGHT, 2 * MAP_HEIGHT)))


def background(geometry: Geometry) -> Float32:
    """Return the background (h, w, 3), linear RGB, filled in where the object is.

    A pixel has two read pixels along a side: only what is filled in is seen, and that is smooth.
    """
    step, clear = geometry.framing.step, clear_of(geometry.coverage).astype(np.float32)
    return filled_halves(geometry.framing.cut(geometry.colour, step), geometry.framing.cut(clear, step))


def clear_of(coverage: Float32) -> npt.NDArray[np.bool_]:
    """Return which pixels (h, w) show nothing of the object, nor of its blurred edge of two pixels."""
    near = np.pad(coverage > 0.0, 2)
    near = near[:-4] | near[1:-3] | near[2:-2] | near[3:-1] | near[4:]
    return ~(near[:, :-4] | near[:, 1:-3] | near[:, 2:-2] | near[:, 3:-1] | near[:, 4:])


def exposure_match(light: Probe, geometry: Geometry, scene: Scene, rendered: float) -> float:
    """Return the factor that makes the mean luminance of a picture's irradiance that of the photograph's light."""
    front = geometry.mesh.normals[geometry.mesh.normals[:, 2] > 0.0]
    # Facing the camera as the picture shows them: a tilted face is as many pixels smaller.
    table = irradiance_table(light.sh, scene.material.resolve().eta)
    wanted = float(np.average(luminance(lookup(table, front)), weights=front[:, 2]))
    return wanted / rendered if rendered > 0.0 else 0.0
