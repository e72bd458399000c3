"""The pipeline, top to bottom: a scene becomes a picture.

`Renderer.draw` reads as the diagram of the README. Every stage states what it depends on and runs only when that
changed; a renderer that is kept (the window's, a benchmark's) computes only what a new scene needs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import numpy.typing as npt

from core.dipole import dipoles
from core.environment import Probe, irradiance_table
from core.mesh import Mesh
from core.samples import SurfaceSamples, surface_samples
from core.stages import Stages
from core.transport import LayeredTransport, Transport
from viewer.buffers import MeshBuffers, SampleBuffers
from viewer.camera import jittered, pixel_offsets, place_camera
from viewer.composite_pass import Composite, CompositePass, Gather
from viewer.gbuffer_pass import GBufferPass
from viewer.gl import check_image_size, checked, headless_context, latlong_texture
from viewer.images import read_radiance
from viewer.irradiance_pass import IrradiancePass, LightSource, lamp, surround
from viewer.layers_pass import LayersPass
from viewer.model import builtin_model, load_model
from viewer.picture import Frame, Picture, read_frame
from viewer.scene import Scene
from viewer.settings import Light, ModelSettings
from viewer.shadows_pass import ShadowsPass
from viewer.tonemap_pass import Background, TonemapPass

Float32 = npt.NDArray[np.float32]
Progress = Callable[[str], None]

SAMPLE_EDGE = 1.5  # longest edge of a surface sample's piece, in texels: about two samples a texel


def render(scene: Scene, *, samples: int = 4, seed: int = 0, progress: Progress | None = None) -> Frame:
    """Render a scene without a window.

    Parameters
    ----------
    scene : Scene
    samples : int
        Antialiasing samples of a pixel, >= 1.
    seed : int
        Of their pattern; >= 0.
    progress : callable, optional
        Called with a few words as each long step begins.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        Unusable files or values, GPU limits, no OpenGL driver; one sentence each.
    """
    return Renderer(headless_context()).render(scene, samples=samples, seed=seed, progress=progress)


@dataclass(frozen=True, eq=False)
class Model:
    """A loaded mesh, on both sides."""

    mesh: Mesh
    buffers: MeshBuffers
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Surface:
    """The samples of a mesh, on both sides."""

    samples: SurfaceSamples
    buffers: SampleBuffers


class Renderer:
    """Renders scenes in one OpenGL context and keeps what the next scene can use again.

    Parameters
    ----------
    context : moderngl.Context
    effort : str
        FFTW's planner flag, see `core.convolution.LayerConvolver`.
    """

    def __init__(self, context: moderngl.Context, effort: str = "FFTW_ESTIMATE") -> None:
        self.context = context
        self.stages = Stages(finish=context.finish)
        self._effort = effort
        self._shadows = ShadowsPass(context)
        self._irradiance = IrradiancePass(context)
        self._layers = LayersPass(context)
        self._gbuffer = GBufferPass(context)
        self._composite = CompositePass(context)
        self._tonemap = TonemapPass(context)
        self._no_probe = latlong_texture(context, np.zeros((1, 1, 3), np.float32))

    def render(
        self, scene: Scene, *, samples: int = 4, seed: int = 0, progress: Progress | None = None
    ) -> Frame:
        """Render a scene and read everything back; see `render`."""
        picture = self.draw(scene, samples=samples, seed=seed, parts=True, progress=progress)
        return self.stages.run("read back", [object()], lambda: read_frame(picture, self.stages.timings))

    def draw(
        self,
        scene: Scene,
        *,
        samples: int = 1,
        seed: int = 0,
        parts: bool = False,
        progress: Progress | None = None,
    ) -> Picture:
        """Render a scene and leave the picture on the GPU, with what its radiance is made of if `parts`."""
        run, display, material = self.stages.run, scene.display, scene.material.resolve()
        say = progress or (lambda _: None)
        self.stages.begin()
        check_image_size(self.context, display.image_size)

        say("loading the model")
        model = run("model", [scene.model], lambda: self._load(scene.model))
        camera = place_camera(scene.camera, model.mesh.radius, display.image_size)
        transport: Transport = run(
            "plans",
            [scene.transport],
            lambda: LayeredTransport(scene.transport.layers, scene.transport.resolution, effort=self._effort),
        )
        grid = transport.grid(model.mesh, camera.rotation)
        self._layers.check_limits(grid)

        say("sampling the surface")
        texel = float(np.ptp(model.mesh.bounds, axis=0).max()) / (scene.transport.resolution - 1)
        spacing = SAMPLE_EDGE * texel
        surface = run("samples", [model, spacing], lambda: self._sample(model.mesh, spacing))

        say("casting shadows")
        sources = [*self._lamps(scene, model), *self._surround(scene, material.eta)]

        say("lighting the surface")
        flux = self._flux(surface, sources, material.eta)

        say("scattering light through the layers")
        coordinates = run(
            "layer depth", [surface, grid], lambda: self._layers.coordinates(surface.buffers, grid)
        )
        exitance = transport.exitance(grid, coordinates, flux, dipoles(material), self.stages)
        volume = run("layer volume", [exitance], lambda: self._layers.volume(exitance))

        say("drawing")
        gather = Gather(volume, grid.world_to_texture, material.eta)
        composite = self._pixels(scene, model, sources, gather, pixel_offsets(samples, seed), parts)
        background = self._background(scene)
        image = run("image", [display.image_size], lambda: self._image(display.image_size))
        average = run(
            "exposure", [composite], lambda: self._tonemap.log_average(composite.textures["radiance"])
        )
        self._tonemap.render(composite.textures["radiance"], average, display, background, camera, image)
        return Picture(composite, image, display.background == "transparent", model.warnings)

    def _load(self, settings: ModelSettings) -> Model:
        if settings.path is None:
            mesh, warning = builtin_model(settings.size_mm, settings.up), None
        else:
            mesh, warning = load_model(settings.path, settings.size_mm, settings.up)
        return Model(mesh, MeshBuffers(self.context, mesh), () if warning is None else (warning,))

    def _sample(self, mesh: Mesh, spacing: float) -> Surface:
        samples = surface_samples(mesh, spacing)
        return Surface(samples, SampleBuffers(self.context, samples))

    def _lamps(self, scene: Scene, model: Model) -> list[LightSource]:
        """Directional and point lights, each with its shadow map."""

        def cast(light: Light) -> LightSource:
            shadow = self._shadows.render(model.buffers, model.mesh, light)
            return lamp(light, shadow, self._no_probe)

        return [
            self.stages.run(f"shadow of light {i}", [model, light], lambda light=light: cast(light))  # type: ignore[misc]
            for i, light in enumerate(scene.effective_lights(), start=1)
        ]

    def _surround(self, scene: Scene, eta: float) -> list[LightSource]:
        """Return the environment's light, if there is one."""
        environment = scene.environment
        if environment.path is None:
            return []
        probe = self._probe(scene)
        table = self.stages.run(
            "environment table",
            [probe, eta],
            lambda: latlong_texture(self.context, irradiance_table(probe.sh, eta)),
        )
        source = self.stages.run(
            "environment light",
            [table, environment],
            lambda: surround(table, environment.rotation_deg, environment.intensity, self._shadows.none),
        )
        return [source]

    def _probe(self, scene: Scene) -> Probe:
        path = scene.environment.path
        assert path is not None
        return self.stages.run("probe", [path], lambda: Probe.from_pixels(read_radiance(path)))

    def _flux(self, surface: Surface, sources: list[LightSource], eta: float) -> Float32:
        """Power that enters at each sample, E dA of all lights: (n, 3) float32."""
        each = [
            self.stages.run(
                f"irradiance of light {i}",
                [surface, source, eta],
                lambda source=source: self._irradiance.of_samples(surface.buffers, source, eta),  # type: ignore[misc]
            )
            for i, source in enumerate(sources, start=1)
        ]

        def total() -> Float32:
            irradiance = np.zeros((len(surface.samples), 3), np.float32)
            for part in each:
                irradiance += part
            return irradiance * surface.samples.areas[:, None]

        return self.stages.run("flux", [surface, *each], total)

    def _pixels(
        self,
        scene: Scene,
        model: Model,
        sources: list[LightSource],
        gather: Gather,
        offsets: tuple[tuple[float, float], ...],
        parts: bool,
    ) -> Composite:
        """Shade every pixel once a sample."""
        run, size = self.stages.run, scene.display.image_size
        camera = place_camera(scene.camera, model.mesh.radius, size)
        gbuffer = run("gbuffer targets", [size], lambda: self._gbuffer.targets(size))
        light = run("light targets", [size], lambda: self._irradiance.targets(size))
        targets = run("composite targets", [size, parts], lambda: self._composite.targets(size, parts))

        def shade() -> Composite:
            targets.framebuffer.clear()
            for offset in offsets:
                clip = jittered(camera, offset, size)
                run(
                    "gbuffer",
                    [model, gbuffer, clip.tobytes()],
                    lambda: self._gbuffer.render(model.buffers, clip, gbuffer),  # noqa: B023 (runs at once)
                )
                self._irradiance.of_pixels(gbuffer, sources, gather.eta, scene.specular, camera, light)
                self._composite.render(gbuffer, light, gather, camera, 1.0 / len(offsets), targets)
            return replace(
                targets
            )  # the same textures, but a new object: what follows knows that they changed

        depends_on = [model, scene.camera, size, *sources, gather.volume, gather.eta, scene.specular, offsets]
        return run("composite", [targets, *depends_on], shade)

    def _background(self, scene: Scene) -> Background:
        environment = scene.environment
        if scene.display.background != "environment":  # then the probe itself is never seen
            return Background(self._no_probe, 0.0, 0.0)
        probe = self._probe(scene)
        texture = self.stages.run("background", [probe], lambda: latlong_texture(self.context, probe.latlong))
        return Background(texture, environment.rotation_deg, environment.intensity)

    def _image(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        what = f"a picture of {size[0]} x {size[1]} pixels"
        texture = checked(self.context, lambda: self.context.texture(size, 4), what)
        return self.context.framebuffer([texture])
