"""Second half of the pipeline, from the layer volume to the picture: G-buffer, composite, tone map."""

from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32
from milkglass.core.light.blur import blurred
from milkglass.core.light.probe import Probe
from milkglass.core.stages import Stage, Stages, Steps, alike
from milkglass.viewer.gl.constants import MOST_LAMPS
from milkglass.viewer.gl.context import bind_cleared, checked, free_dropped, latlong_texture, over_object, read_rgba
from milkglass.viewer.passes.composite import OUTPUTS, Composite, CompositePass
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import ClearBuffers, GBuffer, GBufferPass, LitVertices
from milkglass.viewer.passes.ground import GroundPass, GroundTargets
from milkglass.viewer.passes.highlights import HighlightsPass
from milkglass.viewer.passes.irradiance import Highlights, PixelIrradiancePass
from milkglass.viewer.passes.light_source import lamps_of
from milkglass.viewer.passes.lit_vertices import LitVerticesPass
from milkglass.viewer.passes.reentry import Reentry, ReentryPass, ReentryTargets
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.passes.tonemap import Background, TonemapPass
from milkglass.viewer.render import remarks
from milkglass.viewer.render.bodies import bodies_warnings
from milkglass.viewer.render.detail import DrawnDetail
from milkglass.viewer.render.exitance import SurfaceExitance, matter_key
from milkglass.viewer.render.ground import Ground, GroundLighting
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.paths import Paths
from milkglass.viewer.render.picture import Picture, PictureRequest
from milkglass.viewer.render.tracing import Followed, Tracing
from milkglass.viewer.render.vertices import obstacle, refined_surface
from milkglass.viewer.scene.camera import jittered
from milkglass.viewer.scene.lights.sub_lights import PARTS
from milkglass.viewer.scene.scene import Scene

LARGE_SUB_LIGHTS = 16  # of a light of which a picture may show some first
TARGETS = Stage.GBUFFER_TARGETS, Stage.LIGHT_TARGETS, Stage.REENTRY_TARGETS, Stage.PATH_TARGETS  # of each sample
EXPOSURE_STEP = 4  # pixels, between those that a picture is exposed for while something moves


class Sample(NamedTuple):
    """A sample of every pixel.

    Attributes
    ----------
    number : int
    sharing : int
        Among how many samples a light's sub-lights are shared.
    followed : Followed, optional
        Its rays of sight, and those of the other samples.
    exits : bool
        Whether the surface's exitance is shown.
    """

    number: int
    sharing: int
    followed: Followed | None
    exits: bool


class Shading:
    """Draws lit scenes in one OpenGL context."""

    def __init__(self, context: moderngl.Context, stages: Stages, ground: GroundPass, worker: Executor) -> None:
        self._context = context
        self._stages, self._run = stages, stages.run
        self._gbuffer = GBufferPass(context)
        self._irradiance = PixelIrradiancePass(context)
        self._lobes = HighlightsPass(context)
        self._composite = CompositePass(context)
        self._tonemap = TonemapPass(context)
        self._detail = DrawnDetail(context, stages)
        self._reentry = ReentryPass(context)
        self._no_probe = latlong_texture(context, np.zeros((1, 1, 3), np.float32))
        self._ground = ground
        self._lit = LitVerticesPass(context)
        self._exitance = exitance = SurfaceExitance(context, self._irradiance, self._composite, self._no_probe)
        self._ground_lighting = GroundLighting(context, stages, exitance)
        self._tracing = Tracing(context, stages, self._composite, exitance, worker)
        self._seen: GBuffer | None = None
        self._lit_by: tuple[object, ...] = ()  # what the lamps' light in the last picture depends on

    def shade(
        self,
        scene: Scene,
        lit: LitScene,
        gather: Gather,
        request: PictureRequest,
        behind: Probe | None = None,
        ground: Ground | None = None,
        paths: Paths | None = None,
        *,
        last: bool = False,
    ) -> Picture:
        """Draw a scene through its camera and return the picture on the GPU.

        Parameters
        ----------
        scene, lit
        gather : Gather
            The layer volume to read, which may be an older one: exitance does not depend on the camera.
        request : PictureRequest
            Where nothing is to be developed, the image is the composite's own framebuffer.
        behind : Probe, optional
            Where an environment is to be seen behind the object.
        ground : Ground, optional
            Where the object stands on one.
        paths : Paths, optional
            Rays of sight, where the scene needs any and they are wanted.
        last : bool
            Whether what the pixels are drawn from goes before they are developed.

        Raises
        ------
        Unfinished
            The stages have an allowance, and the pixels take more.
        """
        display, show = scene.display, request.output
        if paths is not None and ground is not None:
            paths = self._ground_lighting.below(paths, ground, lit, gather)
        at_vertices = request.may_be_at_vertices and self.serves_at_vertices(scene, lit, gather, paths)
        self._lit_by = _lamps_key(lit, gather)
        if at_vertices:
            composite = self._between_vertices(scene, lit, gather)
        else:
            composite = self._pixels(scene, lit, gather, request, paths)
        if last:
            self._seen = None
            for targets in TARGETS:
                self._stages.forget(targets)
            free_dropped(self._context)
        if not request.develop:
            return self._picture(scene, lit, gather, composite, composite.framebuffer, 0.0)
        why = () if paths is None else paths.why
        texture = composite.textures[show]
        step = EXPOSURE_STEP if at_vertices else 1
        average = self._run(Stage.EXPOSURE, [composite, show], lambda: self._tonemap.log_average(texture, step))
        fixed = display.average if show == OUTPUTS[0] else None  # radiance is what it is the average of
        exposed = request.exposure_for or fixed or average
        background = replace(self._background(scene, behind), beside_depth=at_vertices or len(request.offsets) == 1)
        drawn = None
        if ground is not None and request.shows_ground:
            drawn = self._ground_pixels(scene, lit, gather, ground)
        plane = None if drawn is None else drawn.radiance
        depth = self._depth(display.image_size)
        image = self._run(Stage.IMAGE, [display.image_size, depth], lambda: self._image(display.image_size, depth))
        self._run(
            Stage.TONE_MAP,
            [composite, show, exposed, display, scene.environment, background.probe, scene.camera, image, drawn],
            lambda: self._tonemap.render(
                texture,
                exposed,
                display,
                background,
                lit.camera,
                image,
                directions=show == "normal",
                ground=plane,
            ),
        )
        return replace(self._picture(scene, lit, gather, composite, image, average), ground=plane, parts=why)

    def _picture(
        self,
        scene: Scene,
        lit: LitScene,
        gather: Gather,
        composite: Composite,
        image: moderngl.Framebuffer,
        average: float,
    ) -> Picture:
        flaws = (*lit.model.warnings, *lit.troubles, *bodies_warnings(lit.bodies), *lit.quality.warnings)
        said = (
            (*flaws, *remarks.warnings(scene, lit)),
            (*remarks.remarks(scene, lit, gather), *remarks.sizes(scene, lit)),
        )
        transparent = scene.display.background == "transparent"
        return Picture(composite, image, lit.camera, transparent, said[0], lit.quality, average, said[1])

    def pick(self, pixel: tuple[int, int]) -> tuple[float, float, float] | None:
        """Return the world position (mm) that the last picture shows at a pixel (column, row from the top), or None."""
        if self._seen is None:
            return None
        texture, (x, y) = self._seen.position, pixel
        if not (0 <= x < texture.width and 0 <= y < texture.height):
            return None
        box = (x, texture.height - 1 - y, 1, 1)
        values = np.frombuffer(self._seen.framebuffer.read(viewport=box, components=4, dtype="f4"), np.float32)
        return (float(values[0]), float(values[1]), float(values[2])) if values[3] > 0.0 else None

    def advance(
        self,
        scene: Scene,
        lit: LitScene,
        gather: Gather,
        request: PictureRequest,
        ground: Ground | None = None,
        paths: Paths | None = None,
    ) -> None:
        """Draw part of the samples that `shade` needs, so that no frame waits for all.

        Raises
        ------
        Unfinished
            As long as some are missing.
        """
        if paths is not None and ground is not None:
            paths = self._ground_lighting.below(paths, ground, lit, gather)
        self._pixels(scene, lit, gather, request, paths)
        if ground is not None and request.shows_ground:
            self._ground_pixels(scene, lit, gather, ground)
        moving = None if paths is None else paths.while_moving
        if request.may_be_at_vertices and self.serves_at_vertices(scene, lit, gather, moving):
            self._lit_vertices(lit, gather)

    def surface(self, scene: Scene, lit: LitScene, gather: Gather) -> tuple[Float32, Float32, Float32]:
        """Return the surface at the middle of every pixel, read back from the GPU, top row first.

        Returns
        -------
        alpha : (H, W) float32
            1 where the object is.
        position, exitance : (H, W, 3) float32
            World space, mm; M, without what colours do to light that leaves.
        """
        lit = lit.without_tint()
        textures = self._pixels(scene, lit, gather, PictureRequest(parts=True)).textures
        radiance, position, exitance = (read_rgba(textures[name]) for name in ("radiance", "position", "exitance"))
        return radiance[..., 3], position[..., :3], exitance[..., :3]

    def _pixels(
        self, scene: Scene, lit: LitScene, gather: Gather, request: PictureRequest, paths: Paths | None = None
    ) -> Composite:
        """Shade every pixel once a sample."""
        offsets = request.offsets
        targets, key = self._pixel_work(scene, lit, gather, request)
        shown = request.light_paths(scene)
        tree = self._tracing.tree(paths, lit, gather, shown)
        sharing = _sharing(lit) if request.quick and len(offsets) == 1 else len(offsets)

        def shade() -> Steps[Composite]:
            followed = None if tree is None else Followed(tree, len(offsets), request.path_step)
            for i in range(len(offsets)):
                if i > 0:
                    yield None
                yield from self._sample(scene, lit, gather, request, Sample(i, sharing, followed, shown.often), targets)
            return replace(targets)  # the same textures, but a new object: what follows knows that they changed

        step = 0 if tree is None or request.drafts_sight else request.path_step
        return self._stages.spread(Stage.COMPOSITE, (*key, sharing, tree, shown, step), shade)

    def pixels_alone(self, scene: Scene, lit: LitScene, gather: Gather, paths: Paths | None) -> str:
        """Return why a picture is not drawn from light at the vertices while the camera moves; empty where it is."""
        if paths is not None and paths.tree is not None:
            return "rays of sight are followed through it"
        return obstacle(lit, gather, scene.display.image_size)

    def serves_at_vertices(self, scene: Scene, lit: LitScene, gather: Gather, paths: Paths | None) -> bool:
        """Whether a picture that may be is drawn from light at the vertices.

        Not where lamps have changed since the last picture: lighting them for one takes longer than a smaller picture.
        """
        return alike(self._lit_by, _lamps_key(lit, gather)) and not self.pixels_alone(scene, lit, gather, paths)

    def _between_vertices(self, scene: Scene, lit: LitScene, gather: Gather) -> Composite:
        """Draw radiance from light that is known at the vertices, which no move of the camera changes."""
        run, size, camera = self._run, scene.display.image_size, lit.camera
        surface, light = refined_surface(lit, gather), self._lit_vertices(lit, gather)
        targets, _ = self._pixel_work(scene, lit, gather, PictureRequest())
        lobes, marks = self._occluded_lobes(scene, lit), self._marks(lit, surface)
        depth = self._depth(size)
        gbuffer = self._seen = run(
            Stage.GBUFFER_TARGETS,
            [size, True, lobes is not None, depth],
            lambda: self._gbuffer.targets(size, occluded=True, lobes=lobes is not None, depth=depth),
        )
        clip = camera.world_to_clip
        drawn = run(
            Stage.GBUFFER,
            [light, gbuffer, clip.tobytes(), marks, lobes],
            lambda: self._gbuffer.render_lit(light, clip, gbuffer, marks, lobes),
        )

        def shade() -> Composite:
            self._lit.render(gbuffer, lit.sources, gather, self._highlights(scene, lit), camera, targets)
            return replace(targets)

        return run(Stage.COMPOSITE, [targets, light, scene.gloss, lit.lobes, drawn, clip.tobytes(), lobes], shade)

    def _lit_vertices(self, lit: LitScene, gather: Gather) -> LitVertices:
        """Light the vertices, which no move of the camera does again, and no other matter by its lamps."""
        surface = refined_surface(lit, gather)
        lamps = self._stages.spread(
            Stage.LAMPS_AT_VERTICES,
            (*_lamps_key(lit, gather), *matter_key(gather)),
            lambda: self._exitance.lamps_at(surface, lit, gather, _sharing(lit)),
        )

        def light() -> Steps[LitVertices]:
            exitance, shares = yield from self._exitance.of_refined(surface, lit, gather, lamps)
            buffers = lit.model.buffers if surface is None else surface.buffers
            first, last = np.split(shares, [MOST_LAMPS // 2], axis=1)
            values = (np.ascontiguousarray(part, np.float32) for part in (exitance, first, last))
            return LitVertices(buffers, *(self._context.buffer(part) for part in values))

        return self._stages.spread(Stage.LIT_VERTICES, (lamps, *lit.sources, *gather.key), light)

    def _marks(self, lit: LitScene, surface: RefinedSurface | None) -> moderngl.Buffer | None:
        """Return the body of each vertex of what is drawn, where there are several."""
        if lit.body_marks is None or surface is None:
            return None if lit.body_marks is None else lit.body_marks.buffer
        of_vertex = lit.body_marks.of_vertex
        return self._run(Stage.REFINED_MARKS, [of_vertex, surface], lambda: surface.bodies(self._context, of_vertex))

    def _ground_pixels(self, scene: Scene, lit: LitScene, gather: Gather, ground: Ground) -> GroundTargets:
        """Draw the ground at every pixel."""
        size, settings = scene.display.image_size, scene.ground
        targets = self._run(Stage.GROUND_TARGETS, [size], lambda: self._ground.targets(size))
        light = self._ground_lighting.light(ground, lit, gather)

        def draw() -> GroundTargets:
            self._ground.render(light, settings, lit.camera, targets)
            return replace(targets)  # a new object, as of the composite

        return self._run(Stage.GROUND_PIXELS, [targets, light, settings, scene.camera, size], draw)

    def _pixel_work(
        self, scene: Scene, lit: LitScene, gather: Gather, request: PictureRequest
    ) -> tuple[Composite, tuple[object, ...]]:
        """Return the targets of the pixels, and everything that these depend on."""
        size, parts = scene.display.image_size, request.keeps_parts
        depth = self._depth(size)
        key = [size, parts, depth]
        targets = self._run(
            Stage.COMPOSITE_TARGETS, key, lambda: self._composite.targets(size, parts=parts, depth=depth)
        )
        light = lit.model, lit.detail, *lit.sources
        return targets, (targets, request.offsets, scene.gloss, scene.camera, size, *light, *gather.key)

    def _sample(
        self,
        scene: Scene,
        lit: LitScene,
        gather: Gather,
        request: PictureRequest,
        sample: Sample,
        targets: Composite,
    ) -> Steps[None]:
        """Add one sample of every pixel; the first one clears what was there."""
        run, size, camera, offsets = self._run, scene.display.image_size, lit.camera, request.offsets
        followed = sample.followed
        mirrors = followed is not None and followed.tree.mirrors
        occlusion, behind = lit.occlusion, self._behind(lit, gather)
        lobes = None if mirrors else self._occluded_lobes(scene, lit)
        is_occluded, has_lobes = occlusion is not None, lobes is not None
        depth = self._depth(size)
        gbuffer = self._seen = run(
            Stage.GBUFFER_TARGETS,
            [size, is_occluded, has_lobes, depth],
            lambda: self._gbuffer.targets(size, occluded=is_occluded, lobes=has_lobes, depth=depth),
        )
        light = run(Stage.LIGHT_TARGETS, [size, depth], lambda: self._irradiance.targets(size, depth))
        clip = jittered(camera, offsets[sample.number], size)
        surface = refined_surface(lit, gather)
        buffers, marks = lit.model.buffers if surface is None else surface.buffers, self._marks(lit, surface)
        clear = None if followed is None else self._clear(lit)
        run(
            Stage.GBUFFER,
            [buffers, gbuffer, clip.tobytes(), marks, occlusion, behind, lobes, clear],
            lambda: self._gbuffer.render(buffers, clip, gbuffer, marks, occlusion, behind, lobes, clear),
        )
        detail, again, sources = self._detail.draw(lit.detail, clip, size), None, lit.sources
        if gather.reentry is not None:
            again = self._drawn_again(gather, gather.reentry, clip, size)
            sources = *sources, gather.reentry.source
        gbuffer = replace(gbuffer, detail=detail, reentry=again)
        if sample.number == 0:
            bind_cleared(targets.framebuffer)
        by_rays = followed is not None and followed.shows_discs and not request.drafts_sight
        highlights = self._highlights(scene, lit)
        if mirrors:
            highlights = Highlights(scene.gloss, self._no_probe, by_rays=True, discs_by_rays=by_rays)
        yield from self._irradiance.steps(
            gbuffer, sources, gather, highlights, camera, light, sample.number, sample.sharing
        )
        left = tuple(kind.left_to_surface if followed is not None else (1.0,) * 3 for kind in gather.kinds)
        traced = self._composite.not_traced(left if sample.exits else ((0.0,) * 3,) * len(left))
        if followed is not None and request.drafts_sight:
            drafted = self._tracing.draft(followed.tree, lit, gbuffer, depth, clip)
            traced = replace(drafted, left=traced.left)
        elif followed is not None:
            found = yield from self._tracing.steps(followed, gbuffer, camera, offsets[sample.number])
            traced = traced if found is None else replace(found, left=traced.left)
        weight = 1.0 / len(offsets)
        self._composite.render(gbuffer, light, gather, highlights, camera, weight, targets, traced)

    def _clear(self, lit: LitScene) -> ClearBuffers | None:
        """Return the clear parts of the object on the GPU, where there are any."""
        model, buffers = lit.model, lit.model.clear_buffers
        if not lit.clear or buffers is None:
            return None
        numbers = [np.full(len(part.vertices), lit.scattering + i, np.float32) for i, part in enumerate(model.clear)]
        marks = self._run(
            Stage.CLEAR_MARKS, [model, lit.scattering], lambda: self._context.buffer(np.concatenate(numbers))
        )
        return self._run(Stage.CLEAR_BUFFERS, [marks], lambda: ClearBuffers(buffers, marks))

    def _drawn_again(
        self, gather: Gather, reentry: Reentry, clip: npt.NDArray[np.float64], size: tuple[int, int]
    ) -> ReentryTargets:
        """Draw light that enters the object again at every pixel."""
        thin = gather.is_thin
        targets = self._run(Stage.REENTRY_TARGETS, [size, thin], lambda: self._reentry.targets(size, thin=thin))
        values = self._run(Stage.REENTRY_BUFFERS, [reentry, thin], lambda: self._reentry.upload(reentry, thin=thin))
        self._run(
            Stage.REENTRY_PIXELS,
            [values, clip.tobytes(), targets],
            lambda: self._reentry.render(reentry.surface, values, clip, targets),
        )
        return targets

    def _highlights(self, scene: Scene, lit: LitScene) -> Highlights:
        """Return the highlights of this shininess, with the environment that they mirror where one is seen."""
        lobes, gloss = lit.lobes, scene.gloss
        if lobes is None or gloss.strength == 0.0:
            return Highlights(gloss, self._no_probe)
        mirrored = self._run(
            Stage.ENVIRONMENT_HIGHLIGHTS,
            [lobes, gloss.shininess],
            lambda: latlong_texture(self._context, lobes.filtered(gloss.shininess)),
        )
        return Highlights(gloss, mirrored)

    def _occluded_lobes(self, scene: Scene, lit: LitScene) -> moderngl.Buffer | None:
        """Return the visible share of an environment's highlights at each vertex, where something may be in the way."""
        occlusion, gloss = lit.occlusion, scene.gloss
        if occlusion is None or gloss.strength == 0.0:
            return None
        baked = occlusion.baked
        blocked = self._run(Stage.BLOCKED_HIGHLIGHTS, [baked], lambda: self._lobes.upload(baked.visibility))
        return self._run(
            Stage.OCCLUDED_HIGHLIGHTS,
            [occlusion.baked, occlusion.surface, blocked, gloss.shininess, lit.camera.eye.tobytes()],
            lambda: self._lobes.run(occlusion, blocked, gloss.shininess, lit.camera),
        )

    def _behind(self, lit: LitScene, gather: Gather) -> moderngl.Buffer | None:
        """Return the visible share of an environment from the other side of thin parts, at each vertex."""
        if (occlusion := lit.occlusion) is None or not gather.is_thin:
            return None
        return self._run(Stage.OCCLUSION_BEHIND, [occlusion], lambda: occlusion.behind(self._context))

    def _background(self, scene: Scene, probe: Probe | None) -> Background:
        if probe is None:
            return Background(self._no_probe, 0.0, 0.0)
        environment, blur = scene.environment, scene.display.background_blur_deg
        texture = self._run(
            Stage.BACKGROUND, [probe, blur], lambda: latlong_texture(self._context, blurred(probe.latlong, blur))
        )
        return Background(texture, environment.rotation_deg, environment.intensity)

    def _image(self, size: tuple[int, int], depth: moderngl.Renderbuffer) -> moderngl.Framebuffer:
        purpose = f"a picture of {size[0]} x {size[1]} pixels"
        texture = checked(self._context, lambda: self._context.texture(size, 4), purpose)
        return over_object(self._context, [texture], depth)

    def _depth(self, size: tuple[int, int]) -> moderngl.Renderbuffer:
        """Return the depth buffer that all that is drawn over the object shares."""
        return self._run(Stage.DEPTH, [size], lambda: self._gbuffer.depth(size))


def _sharing(lit: LitScene) -> int:
    """Return among how many samples of a pixel sub-lights are shared in a picture of one of them, to be quick."""
    large = max((source.sub_lights for source in lit.sources), default=1) >= LARGE_SUB_LIGHTS
    return PARTS if large else 1


def _lamps_key(lit: LitScene, gather: Gather) -> tuple[object, ...]:
    """Return all that lamps' light at the vertices depends on, but for the matter's little."""
    return refined_surface(lit, gather), lit.model, lit.body_marks, *lamps_of(lit.sources)
