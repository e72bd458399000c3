"""First half of the pipeline, up to the flux of the surface samples: model, samples, shadows, irradiance, layers."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from milkglass.core.arrays import Float32, Ints
from milkglass.core.geometry.bodies import Bodies, bodies_of_kinds
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.indices import Indices
from milkglass.core.light.probe import Probe
from milkglass.core.stages import Stage, Stages, Steps
from milkglass.core.transport.base import EnteringLight, Matter, Scattered, SeparableTransport, Transport
from milkglass.core.transport.clear import ClearTransport
from milkglass.core.transport.methods import Method
from milkglass.core.transport.quality import Quality, make_transport, sample_spacing
from milkglass.viewer.assets.keeper import Assets, shape_of
from milkglass.viewer.assets.sources import IndicesOf, PartedProbe
from milkglass.viewer.files.model import joined
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import volume_texture
from milkglass.viewer.passes.detail_uniforms import SampledSurface
from milkglass.viewer.passes.gather import Gather, GatherKind, TableTextures
from milkglass.viewer.passes.ground import GroundPass
from milkglass.viewer.passes.irradiance import SampleIrradiancePass
from milkglass.viewer.passes.layers import LayersPass
from milkglass.viewer.passes.light_source import LightSource, reentering
from milkglass.viewer.passes.reentry import Reentry
from milkglass.viewer.render.beams import BeamStages
from milkglass.viewer.render.bodies import Separation, convolvers, separate_by_default
from milkglass.viewer.render.detail import DetailStages
from milkglass.viewer.render.exchange import ExchangeStages
from milkglass.viewer.render.ground import Ground, GroundStages, Standing
from milkglass.viewer.render.lit_scene import LitScene, Model, kinds_of
from milkglass.viewer.render.matter import ONE_MATERIAL, of_kinds, of_one_kind, touching
from milkglass.viewer.render.occlusion import OcclusionStages
from milkglass.viewer.render.paths import Paths, PathStages
from milkglass.viewer.render.sources import LampSources, Surround, casts_shadows, shines
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.keys import version
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings, ModelSettings, TransportSettings

if TYPE_CHECKING:
    from milkglass.core.paths.surface import ClearPart

Progress = Callable[[str], None]
LEAST_LEFT = 0.1  # of light that crosses a part, below which it is as good as opaque
NO_SHADOW = (
    "little light crosses it, yet it is in the way of rays, beams, the matter that it touches and lamps on the ground:"
    " other shadows and the environment's occlusion do not know it"
)
NO_RAYS = "parts with a material of their own are seen by rays, which transport diffusion alone follows; left out"


class Lighting:
    """Lights scenes in one OpenGL context; every stage runs only when what it depends on has changed."""

    def __init__(
        self,
        context: moderngl.Context,
        stages: Stages,
        transport_stages: Stages,
        effort: str,
        assets: Assets,
        ground: GroundPass,
        tolerance: float | None = None,
    ) -> None:
        self._context, self._tolerance = context, tolerance
        self._run, self._spread = stages.run, stages.spread
        self._assets = assets
        self._effort = effort
        self._solvers: dict[Quality, SeparableTransport] = {}  # a drag's and the picture's
        self._lamps = LampSources(context, stages)
        self._irradiance = SampleIrradiancePass(context)
        self._surround = Surround(context, stages, assets, self._lamps)
        self._layers = LayersPass(context)
        self._separation = Separation(context, stages, self._layers)
        self._occlusions = OcclusionStages(context, stages, assets)
        self._exchanges = ExchangeStages(stages, transport_stages, assets, self._occlusions)
        self._details = DetailStages(context, stages, assets)
        self._grounds = GroundStages(stages, assets, self._surround, ground)
        self._beams = BeamStages(stages, self._surround)
        self._paths = PathStages(stages, self._surround)

    def light(self, scene: Scene, say: Progress, draft: bool = False) -> LitScene:
        """Run the first half of the pipeline; `say` is told as each long step begins.

        As a `draft`, lights with a size get by with less, and sources in an environment with its soft shadows.
        Raises `core.stages.Unfinished` where the stages have an allowance and that is not enough.
        """
        run = self._run

        say("loading the model")
        model = run(Stage.MODEL, [shape_of(scene.model), version(scene.model.path)], lambda: self._load(scene.model))
        bodies, separate = None, scene.separate
        if separate:
            bodies = run(Stage.FIND_BODIES, [model], lambda: self._assets.bodies(model.mesh))
        settings = self._assets.possible(scene.transport, model.mesh, separate=separate)
        if scene.model.bodies is None and bodies is not None:
            bodies = separate_by_default(bodies, settings.facts)
        bodies, matter, unlike = self._matter(scene, model, bodies, settings.facts)
        count = 1 if bodies is None else bodies.count
        camera = model_camera(scene.camera, model.whole, scene.display.image_size)
        profiles = scene.material.profiles(self._assets.profile_table)
        if settings.facts.needs_roughness:
            run(Stage.ROUGHNESS, [model], lambda: self._assets.roughness(model.mesh))
        quality = quality_of(scene, model.mesh, self._assets)
        made_for = replace(quality.grid_alone, tolerance=self._tolerance)
        keep = convolvers(made_for, count)
        transport = run(Stage.TRANSPORT, [made_for, keep], lambda: self._transport(made_for, keep))
        grid = transport.grid(model.mesh, camera.rotation)
        if count == 1:
            self._layers.check_limits(grid, layers_follow=quality.layers is None)

        say("sampling the surface")
        spacing = sample_spacing(model.mesh, settings, quality.resolution)
        # What is at hand may serve for several spacings: everything after depends on the samples themselves.
        finer = self._assets.accept_finer
        samples = run(Stage.SAMPLES, [model, spacing, finer], lambda: self._assets.samples(model.mesh, spacing, finer))
        surface, detail, troubles = self._details.surface(scene, samples)
        parts, left_out = self._clear_parts(scene, model, quality)
        troubles += *left_out, *unlike, *self._surround.said(scene.environment)

        scatters: Transport = transport
        body_marks = marks = None
        if bodies is not None and count > 1:
            body_marks = self._separation.marks(model.mesh, bodies)
            scatters = self._separation.of_bodies(model.mesh, bodies, made_for, transport, grid, samples)
            # Light through thin sheets asks which body a shadow map shows.
            marks = body_marks.buffer if quality.facts.knows_sheets else None

        say("casting shadows")
        on_model = model.mesh, model.buffers
        environment = scene.environment
        if draft and self._occlusions.is_available(environment, model.mesh):
            # Its windows and lamps stay in it: a turn is then a product, not a shadow map for each of them.
            environment = replace(environment, extract=False)
        lamps: tuple[Light, ...] = scene.effective_lights()
        strong: tuple[Light, ...] = self._surround.lamps(environment)
        if (standing := self._grounds.standing(scene, model, environment)) is not None:
            lamps, strong, environment = standing.lamps, standing.strong, standing.environment
        occlusion = self._occlusions.of(environment, self._surround.rest, *on_model, say)
        even, lobes = self._surround.even(environment, [of_kind.eta for of_kind in matter], occlusion)
        of_scene = [(light, Stage.LIGHT.of(i)) for i, light in enumerate(lamps, start=1)]
        of_probe = [(light, Stage.PROBE_SOURCE.of(i)) for i, light in enumerate(strong, start=1)]
        shining = self._lamps.sources(of_scene + of_probe, *on_model, marks, draft)
        sources = *shining, *even

        sight, alone = quality.facts.follows_sight and detail is None, bodies if count > 1 else None
        seen_through = standing if sight else None
        landed = self._beams.onto_ground(seen_through, model, parts, alone, matter, grid, draft=draft)
        reflecting = self._grounds.exchange(standing, model.mesh, say)
        indices = self._indices(model.mesh, matter, settings, standing)
        onto_ground = (
            sources if standing is None else self._onto_ground((*lamps, *strong), sources, model, parts, draft)
        )
        ground, from_ground = self._grounds.lit(
            standing, reflecting, onto_ground, indices or matter[0].eta, landed, draft=draft
        )
        leaving = None if detail is None or detail.after == 0.0 else self._details.leaving(detail, samples)
        exchange, clear = None, not any(of_kind.scatters for of_kind in matter)
        if clear:
            scatters = run(Stage.CLEAR_TRANSPORT, [scatters], lambda: ClearTransport(scatters))
        else:
            exchange = self._exchanges.of(settings, model.mesh, surface, leaving, matter, indices, reflecting, say)
        carrier = exchange
        if carrier is None and from_ground is not None and not clear:
            carrier = self._exchanges.without_hits(model.mesh, surface, leaving)
        refined = None if occlusion is None else occlusion.surface
        if carrier is not None:
            refined = self._exchanges.uploaded(carrier, model.buffers)

        say("lighting the surface")
        of_sample = self._of_samples(samples, bodies, matter)
        irradiances = self._irradiances(surface, sources, matter, of_sample)
        flux = run(
            Stage.FLUX,
            [surface, *irradiances],
            lambda: _total(irradiances, len(samples)) * surface.samples.areas[:, None],
        )
        lights = self._entering(surface, sources, irradiances) if quality.facts.takes_each_light else ()
        unscattered, lit_by, around = None, list[tuple[Light, Float32]](), None
        if exchange is not None and not draft:  # a turned lamp casts rays again
            lit_by = list(zip((*lamps, *strong), irradiances, strict=False))
            around = (self._surround.rest(environment), environment) if shines(environment) else None
        if carrier is not None:
            unscattered = self._exchanges.unscattered(
                carrier, surface, flux, lit_by, around, matter, of_sample, from_ground
            )
        coordinates = run(Stage.LAYER_DEPTH, [surface, grid], lambda: self._layers.coordinates(surface.buffers, grid))
        beams = None
        if sight and not clear:
            beams = self._beams.of((*lamps, *strong), environment, model, parts, alone, matter, grid, draft=draft)
        placed = scatters, grid, profiles, coordinates, flux, lights, matter, samples
        looks = lobes, bodies, body_marks, detail, troubles
        return LitScene(
            model, camera, sources, quality, *placed, *looks, exchange, unscattered, refined, beams, parts, ground,
            indices,
        )  # fmt: skip

    def _onto_ground(
        self,
        lamps: tuple[Light, ...],
        sources: tuple[LightSource, ...],
        model: Model,
        clear: "tuple[ClearPart, ...]",
        draft: bool,
    ) -> tuple[LightSource, ...]:
        """Return sources as a ground has them: clear parts are in lamps' way, what comes through lands."""
        if not clear or model.whole_buffers is None:
            return sources
        named = [(light, Stage.LIGHT_ONTO_GROUND.of(i)) for i, light in enumerate(lamps, start=1)]
        past = self._lamps.sources(named, model.whole, model.whole_buffers, None, draft)
        return *past, *sources[len(lamps) :]

    def _matter(
        self, scene: Scene, model: Model, bodies: Bodies | None, method: Method
    ) -> tuple[Bodies | None, tuple[Matter, ...], tuple[str, ...]]:
        """Return the bodies that scatter light alone, what they are of, and sentences on what cannot be shown of it."""
        run, mesh = self._run, model.mesh
        if mesh.kinds is None or not method.follows_sight:
            alone = of_one_kind(scene, mesh, 1 if bodies is None else bodies.count, method)
            named = ", ".join(name for name, _ in scene.scattering_parts)
            return bodies, (alone,), (f"{named}: {ONE_MATERIAL}",) if named else ()
        joined = scene.model.bodies == "joined" or bodies is None
        bodies, ranges = run(Stage.BODIES_OF_KINDS, [model, joined], lambda: bodies_of_kinds(mesh, joined=joined))
        key = [model, scene.material, scene.scattering_parts, bodies, method]
        matter = run(Stage.MATTER, key, lambda: of_kinds(scene, mesh, ranges, method))
        touch = run(Stage.TOUCHING, [model, *matter], lambda: touching(mesh, matter))
        return bodies, matter, touch

    def _of_samples(self, samples: SurfaceSamples, bodies: Bodies | None, matter: tuple[Matter, ...]) -> Ints | None:
        """Return the kind of matter below each sample, (n,), where there are several."""
        if bodies is None or len(matter) == 1:
            return None
        of_face, key = bodies.of_face, [samples, bodies, *(of_kind.bodies for of_kind in matter)]
        return self._run(Stage.OF_KIND, key, lambda: kinds_of(of_face[samples.faces], matter))

    def _indices(
        self,
        mesh: Mesh,
        matter: tuple[Matter, ...],
        settings: TransportSettings,
        standing: Standing | None,
    ) -> Indices | None:
        """Return the indices of refraction of the surface that light is exchanged by, of several kinds of matter."""
        if len(matter) == 1 or not (settings.exchanges or standing is not None):
            return None
        etas = tuple(of_kind.eta for of_kind in matter)
        return self._run(Stage.INDICES, [mesh, *etas], lambda: self._assets.get(IndicesOf(mesh, etas)))

    def _clear_parts(
        self, scene: Scene, model: Model, quality: Quality
    ) -> "tuple[tuple[ClearPart, ...], tuple[str, ...]]":
        """Return the parts that do not scatter light, and a sentence where the transport cannot show them."""
        if not model.clear:
            return (), ()
        if not quality.facts.follows_sight:
            return (), (f"{', '.join(name for name, _ in scene.clear_parts)}: {NO_RAYS}",)
        parts = self._run(Stage.CLEAR_PARTS, [model, scene.clear_parts], lambda: clear_parts(scene, model))
        dark = [part.name for part in parts if _left_of(part) < LEAST_LEFT]
        return parts, (f"{', '.join(dark)}: {NO_SHADOW}",) if dark else ()

    def gather(self, lit: LitScene, scattered: Scattered) -> Gather:
        """Upload what transport has scattered, for pixels to gather."""
        run, context, nodes = self._run, self._context, scattered.volume
        volume = run(Stage.LAYER_VOLUME, [nodes], lambda: self._layers.volume(nodes))
        key = lit.transport, scattered.grid, *lit.transport.material(lit.entering), scattered.boundaries
        tables = run(Stage.PIXEL_TERMS, key, scattered.pixel_tables)
        of_kinds = run(
            Stage.PIXEL_TABLES, [tables], lambda: [TableTextures.upload(context, of_kind) for of_kind in tables.kinds]
        )
        fluence = volume
        if tables.solves:
            fluence = run(Stage.MEAN_FLUENCE, [nodes], lambda: volume_texture(context, scattered.mean_fluence()))
        kinds, matter, resolved = [], lit.matter, scattered.resolved
        for i, of_kind in enumerate(matter):
            on_way_out = of_kind.eta, lit.quality.exit_normalisation(of_kind.eta)
            ends = float(of_kind.bodies.start), float(of_kind.bodies.stop) if i + 1 < len(matter) else np.inf
            kind = GatherKind(of_kinds[min(i, len(of_kinds) - 1)], *on_way_out, ends)
            if resolved is not None:
                left = tuple(1.0 - share for share in resolved.kinds[i].shares)
                kind = replace(kind, left_to_surface=left)
            kinds.append(kind)
        placed = tuple(kinds), scattered.world_to_texture, lit.transport.smooth
        windows, reentry = self._windows(scattered.windows), self._reentry(lit, scattered)
        clear = (lit.scattering, max(part.eta for part in lit.clear)) if lit.clear else ()
        return Gather(volume, fluence, *placed, windows, reentry, resolved, *clear)

    def _reentry(self, lit: LitScene, scattered: Scattered) -> Reentry | None:
        """Return the light that enters again, of an exchange that knows of any."""
        surface = lit.surface
        unscattered = None if scattered.estimates_unscattered else lit.unscattered
        if surface is None or (scattered.reentering is None and unscattered is None):
            return None

        def make() -> Reentry:
            total = lit.entering_again(scattered)
            assert total is not None
            return Reentry(surface, total, reentering(self._lamps.no_probe, self._lamps.no_shadow))

        return self._run(Stage.REENTRY, [surface, scattered.reentering, unscattered], make)

    def _windows(self, windows: Float32 | None) -> moderngl.Texture | None:
        """Upload where the bodies lie in an atlas."""
        if windows is None:
            return None
        return self._run(Stage.BODY_WINDOWS, [windows], lambda: self._layers.windows(windows))

    def ground(self, scene: Scene, lit: LitScene) -> Ground | None:
        """Return the plane that the object stands on, where a scene has one."""
        return self._grounds.drawn(lit.ground, lit) if scene.ground.on and lit.ground is not None else None

    def paths(
        self, scene: Scene, lit: LitScene, say: Progress = lambda _: None, *, moves: bool = False
    ) -> Paths | None:
        """Return the rays of sight of a lit scene, where it needs any; `moves` as of `PathStages.of`."""
        return self._paths.of(scene, lit, say, moves=moves)

    def probe(self, environment: EnvironmentSettings) -> Probe:
        """Read the light probe of an environment that has one."""
        return self._surround.probe(environment)

    def parted(self, environment: EnvironmentSettings) -> PartedProbe | None:
        """Return the sources of its probe that shine as lamps, and the rest; None where no light comes from."""
        return self._surround.parted(environment)

    def start_cold(self) -> None:
        """Have all solvers forget the solutions that the next would start from."""
        for solver in self._solvers.values():
            solver.start_cold()
        self._separation.start_cold()

    def release(self) -> None:
        """Let go of solvers and assets, but for the probes."""
        self._solvers.clear()
        self._separation.release()
        self._assets.keep_probes()

    def _transport(self, made_for: Quality, keep: int) -> SeparableTransport:
        """Make a transport; of one that solves, and keeps a surface and a solution, one of the last two may serve."""
        if not made_for.facts.solves:
            return make_transport(made_for, self._effort, keep)
        solver = self._solvers.pop(made_for, None) or make_transport(made_for, self._effort, keep)
        solver.kernels.keep = keep
        self._solvers = {**dict(list(self._solvers.items())[-1:]), made_for: solver}
        return solver

    def _load(self, settings: ModelSettings) -> Model:
        file = self._assets.model(settings)
        buffers = MeshBuffers(self._context, file.mesh)
        model = Model(file.mesh, buffers, file.warnings, file_size=file.file_size, medium=file.medium)
        if not file.clear:
            return model
        buffers = MeshBuffers(self._context, joined(*file.clear))
        whole = file.whole, MeshBuffers(self._context, file.whole)
        return replace(
            model, clear=file.clear, clear_buffers=buffers, with_clear=whole[0], whole_buffers=whole[1], lift=file.lift
        )

    def _irradiances(
        self,
        surface: SampledSurface,
        sources: tuple[LightSource, ...],
        matter: tuple[Matter, ...],
        of_sample: Ints | None,
    ) -> list[Float32]:
        """Return E of each light at every sample, (n, 3) float32; `of_sample` is the kind of matter below each."""
        etas = tuple(of_kind.eta for of_kind in matter)
        return [
            self._spread(
                Stage.IRRADIANCE.of(i),
                [surface, source, etas, of_sample],
                lambda source=source: self._irradiance_of(surface, source, etas, of_sample),  # type: ignore[misc]
            )
            for i, source in enumerate(sources, start=1)
        ]

    def _irradiance_of(
        self, surface: SampledSurface, source: LightSource, etas: tuple[float, ...], of_sample: Ints | None
    ) -> Steps[Float32]:
        irradiance = yield from self._irradiance.steps(surface.buffers, source, etas[0])
        for eta in set(etas[1:]) - {etas[0]}:
            assert of_sample is not None
            on_these = np.array(etas)[of_sample] == eta
            irradiance[on_these] = (yield from self._irradiance.steps(surface.buffers, source, eta))[on_these]
        entering = surface.weighted(irradiance)
        return self._occlusions.occluded(entering, source.occlusion, surface.samples)

    def _entering(
        self, surface: SampledSurface, sources: tuple[LightSource, ...], irradiances: list[Float32]
    ) -> tuple[EnteringLight, ...]:
        """Return each light's flux at every sample, and where it comes from."""
        areas = surface.samples.areas[:, None]
        return tuple(
            self._run(
                Stage.LIGHT_FLUX.of(i),
                [source, irradiance],
                lambda source=source, irradiance=irradiance: source.entering(irradiance * areas),  # type: ignore[misc]
            )
            for i, (source, irradiance) in enumerate(zip(sources, irradiances, strict=True), start=1)
        )


def _total(irradiances: list[Float32], n: int) -> Float32:
    total = np.zeros((n, 3), np.float32)
    for part in irradiances:
        total += part
    return total


def clear_parts(scene: Scene, model: Model) -> "tuple[ClearPart, ...]":
    """Return the parts of a model that do not scatter light, with their materials."""
    from milkglass.core.paths.surface import ClearPart

    materials = ((name, settings.resolve()) for name, settings in scene.clear_parts)
    return tuple(
        ClearPart(mesh, material.eta, material.sigma_a, name)
        for mesh, (name, material) in zip(model.clear, materials, strict=True)
    )


def _left_of(part: "ClearPart") -> float:
    """Return how much of the light along a mean chord of a part it lets through, of the channel with the most."""
    return float(np.exp(-min(part.absorption) * part.mesh.mean_chord))


def quality_of(scene: Scene, mesh: Mesh, assets: Assets) -> Quality:
    """Choose layers and resolution for a scene whose mesh is loaded."""
    sharp = bool(scene.effective_lights()) or casts_shadows(scene.environment, assets)
    profiles = scene.material.profiles(assets.profile_table)
    return assets.quality(scene.transport, profiles, mesh, sharp_light=sharp, separate=scene.separate)
