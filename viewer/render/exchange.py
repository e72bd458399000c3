"""Light between parts of the object: rays found once a mesh, then transport, mirrors and what crosses thin parts."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.crossing import Crossings
from milkglass.core.light.exchange import Exchange, Hits
from milkglass.core.light.ground import GroundExchange
from milkglass.core.light.indices import Indices
from milkglass.core.light.mirror import ROUNDS, Mirror
from milkglass.core.light.probe import Probe, lookup
from milkglass.core.material.fresnel import row_of, transmittance
from milkglass.core.material.medium import Medium
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import EnteringLight, Matter, Unscattered
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import CrossingsOf, FewCrossingsOf, HitsOf, RefinedOf
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.passes.detail_uniforms import SampledSurface
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.render.occlusion import OcclusionStages
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL
from milkglass.viewer.scene.settings import EnvironmentSettings, TransportSettings

SUB_LIGHTS = 16  # of a lamp with a size, from which mirrored rays come
MOST_RAYS = 1 << 15  # of a lamp
LEAST_ENTERING = 1e-3  # of the most that a lamp has enter, below which a point is at the rim of its light
COSINES = 2048  # of a table of Fresnel's factors
COARSE_ROWS = 32  # of a probe that mirrored rays meet


class ExchangeStages:
    """Makes the exchange of light between parts of a surface, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, transport: Stages, assets: Assets, occlusions: OcclusionStages) -> None:
        self._run, self._assets, self._occlusions = stages.run, assets, occlusions
        self._late = transport.run  # what is computed where light is scattered, perhaps in another thread

    def of(
        self,
        settings: TransportSettings,
        mesh: Mesh,
        surface: SampledSurface,
        leaving: Float32 | None,
        matter: Sequence[Matter],
        indices: Indices | None,
        ground: GroundExchange | None,
        say: Callable[[str], None],
    ) -> Exchange | None:
        """Return the exchange of a mesh, None where it is not wanted, not baked, or there is next to none.

        `leaving` are factors of colours on exitance, (samples, 3); `indices` are of refraction, where these are not all
        alike; `ground` is the plane below, where there is one.
        """
        if not settings.exchanges or not (self._assets.bakes or self._assets.has(HitsOf(mesh))):
            return None

        def report(share: float) -> None:
            say(f"casting rays between parts: {100.0 * share:.0f} %")

        hits = self._run(Stage.EXCHANGE_RAYS, [mesh], lambda: self._assets.get(HitsOf(mesh, report)))
        if hits is None:
            if ground is None:
                return None
            exchange = self.without_hits(mesh, surface, leaving, indices)
        else:
            fine = self._assets.get(RefinedOf(mesh))
            exchange = self._run(
                Stage.EXCHANGE,
                [hits, fine, surface.weights, leaving, indices],
                lambda: Exchange(fine, hits, surface.weights, leaving, indices=indices),
            )
        media = [of_kind.media for of_kind in matter]
        crossings = self._crossings(mesh, media, say) if settings.facts.solves else None
        if crossings is None and ground is None:
            return exchange
        key = exchange, crossings, ground, *media
        lengths = of_channels(matter) if len(matter) > 1 else None
        return self._run(
            Stage.EXCHANGE_THROUGH,
            key,
            lambda: replace(exchange, crossings=crossings, ground=ground, extinctions=lengths),
        )

    def without_hits(
        self, mesh: Mesh, surface: SampledSurface, leaving: Float32 | None, indices: Indices | None = None
    ) -> Exchange:
        """Return an exchange of a mesh that does not see itself: what light of other sources has for its vertices."""
        fine = self._assets.get(RefinedOf(mesh))
        none = Hits.none(len(fine.mesh.vertices))
        return self._run(
            Stage.NO_EXCHANGE,
            [fine, surface.weights, leaving, indices],
            lambda: Exchange(fine, none, surface.weights, leaving, indices=indices),
        )

    def _crossings(self, mesh: Mesh, media: Sequence[Sequence[Medium]], say: Callable[[str], None]) -> Crossings | None:
        """Return paths through matter, None where too little light has any, or they are not there yet."""
        test, bakes = FewCrossingsOf(mesh), self._assets.bakes
        if not (bakes or self._assets.has(test)):
            return None
        source = CrossingsOf.of(mesh, media, self._run(Stage.FEW_CROSSINGS, [test], lambda: self._assets.get(test)))
        if source is None or not (bakes or self._assets.has(source)):
            return None

        def report(share: float) -> None:
            say(f"casting rays through thin parts: {100.0 * share:.0f} %")

        asked = replace(source, progress=report)
        return self._run(Stage.CROSSING_RAYS, [source], lambda: self._assets.get(asked))

    def uploaded(self, exchange: Exchange, buffers: MeshBuffers) -> RefinedSurface:
        """Return the exchange's refined mesh on the GPU; `buffers` are those of the mesh itself."""
        return self._occlusions.refined(exchange.refined, buffers)

    def unscattered(
        self,
        exchange: Exchange,
        surface: SampledSurface,
        flux: Float32,
        lamps: Sequence[tuple[Light, Float32]],
        around: tuple[Probe, EnvironmentSettings] | None,
        matter: Sequence[Matter],
        of_sample: Ints | None,
        from_ground: Float32 | None = None,
    ) -> Unscattered | None:
        """Return the light that has met the surface but not scattered, to be computed with transport; None for none.

        The surface has mirrored it onto itself, or it has crossed thin parts; or the ground returns it.

        Parameters
        ----------
        exchange : Exchange
        surface : SampledSurface
            Of m samples.
        flux : (m, 3)
            E dA of all light that enters these first.
        lamps : of lights and their irradiance on the samples, (m, 3)
        around : probe and its environment, optional
            Light from all around, without what shines as lamps.
        matter : of kinds of bodies
        of_sample : (m,) int, optional
            Kind of matter below each sample, where there are several.
        from_ground : (n, 3), optional
            What the ground returns.
        """
        if not lamps and around is None and from_ground is None:
            return None
        key: list[object] = [
            exchange,
            surface,
            flux,
            *lamps,
            from_ground,
            *(of_kind.eta for of_kind in matter),
            of_sample,
        ]
        if around is not None:
            key += [around[0], around[1].rotation_deg, around[1].intensity]
        if exchange.crossings is not None:
            key += of_channels(matter)

        def compute() -> tuple[Float32, EnteringLight]:
            entering = [(light, surface.unweighted(irradiance)) for light, irradiance in lamps]
            arriving = self._irradiance(exchange, entering, surface.samples, around, matter, of_sample, from_ground)
            again = self._flux(exchange, arriving, surface.samples)
            return arriving, self._late(Stage.UNSCATTERED_LIGHT, [again], lambda: EnteringLight(again, returned=True))

        return self._run(Stage.UNSCATTERED, key, lambda: Unscattered(surface.samples, flux, compute))

    def _irradiance(
        self,
        exchange: Exchange,
        lamps: Sequence[tuple[Light, Float32]],
        samples: SurfaceSamples,
        around: tuple[Probe, EnvironmentSettings] | None,
        matter: Sequence[Matter],
        of_sample: Ints | None,
        from_ground: Float32 | None,
    ) -> Float32:
        """Return the irradiance of such light at the vertices, (n, 3), of lamps and what of them enters the samples."""
        if from_ground is not None and not lamps and around is None:
            return from_ground
        parts, from_lamps = list[Float32]() if from_ground is None else [from_ground], list[Float32]()
        crossings, of_surface = exchange.crossings, exchange.indices or matter[0].eta
        extinctions = of_channels(matter)
        mirror = self._late(Stage.MIRROR, [exchange.refined], lambda: Mirror(exchange.refined.mesh))
        for i, ((light, entering), (kind, eta)) in enumerate(
            itertools.product(lamps, enumerate(of_kind.eta for of_kind in matter)), start=1
        ):
            rays = self._late(
                Stage.LAMP_RAYS.of(i),
                [mirror, samples, light, entering, eta, of_sample, kind],
                lambda light=light, eta=eta, of_these=_of_kind(entering, of_sample, kind): lamp_rays(  # type: ignore[misc]
                    light, of_these, samples, eta
                ),
            )
            from_lamps.append(
                self._late(
                    Stage.MIRRORED_LAMP.of(i),
                    [mirror, *rays, eta],
                    lambda rays=rays, eta=eta: mirror.irradiance(mirror.mirrored(*rays, eta=eta)),  # type: ignore[misc]
                )
            )
            if crossings is None:
                continue
            received = self._late(
                Stage.CROSSING_LAMP.of(i),
                [mirror, *rays, crossings.reach],
                lambda rays=rays, eta=eta: mirror.crossing(*rays, eta=eta, reach=crossings.reach, through=of_surface),  # type: ignore[misc]
            )
            from_lamps.append(
                self._late(
                    Stage.CROSSED_LAMP.of(i),
                    [received, *extinctions],
                    lambda received=received: mirror.irradiance(received, extinctions),  # type: ignore[misc]
                )
            )
        if from_lamps:
            parts.append(
                self._late(
                    Stage.FROM_LAMPS,
                    [mirror, *from_lamps],
                    lambda: mirror.averaged(np.sum(from_lamps, axis=0, dtype=np.float32), ROUNDS),
                )
            )
        if around is not None:
            probe, environment = around
            to_probe, texels = world_to_probe(environment.rotation_deg), coarse(probe.latlong)

            def radiance(directions: Array) -> Array:
                return environment.intensity * np.asarray(lookup(texels, directions @ to_probe), np.float64)

            light_around = [probe, environment.rotation_deg, environment.intensity]
            key = [mirror, exchange.hits, *light_around, of_surface]
            parts.append(
                self._late(Stage.MIRRORED, key, lambda: mirror.averaged(exchange.hits.mirrored(of_surface, radiance)))
            )
            if crossings is not None:
                key = [mirror, crossings, *light_around, *extinctions]
                parts.append(
                    self._late(Stage.CROSSED, key, lambda: mirror.averaged(crossings.irradiance(radiance, extinctions)))
                )
        return self._late(Stage.UNSCATTERED_SUM, parts, lambda: np.asarray(np.sum(parts, axis=0), np.float32))

    def _flux(self, exchange: Exchange, unscattered: Float32, samples: SurfaceSamples) -> Float32:
        """Return the flux that enters the surface samples, (n, 3), for irradiance at the exchange's vertices."""
        at_samples = self._late(
            Stage.EXCHANGE_SAMPLES, [exchange.refined, samples], lambda: exchange.at_samples(samples)
        )

        def interpolated() -> Float32:
            entering = exchange.tinted(at_samples @ unscattered)
            return np.asarray(entering * samples.areas[:, None], np.float32)

        return self._late(Stage.UNSCATTERED_FLUX, [*exchange.surface, samples, unscattered], interpolated)


def of_channels(matter: Sequence[Matter]) -> tuple[tuple[float, ...], ...]:
    """Return sigma_t' of R, G and B, each of all kinds of matter, 1/mm."""
    media = [of_kind.media for of_kind in matter]
    return tuple(tuple(medium.sigma_t_prime for medium in channel) for channel in zip(*media, strict=True))


def _of_kind(entering: Float32, of_sample: Ints | None, kind: int) -> Float32:
    """Return light that enters samples, (m, 3), where these are of one kind of matter, and 0 elsewhere."""
    return entering if of_sample is None else np.where((of_sample == kind)[:, None], entering, np.float32(0.0))


def lamp_rays(
    light: Light, entering: Float32, samples: SurfaceSamples, eta: float
) -> tuple[Array, Array, Array, Array]:
    """Return rays from the surface to a lamp: points, normals, directions towards it, flux that arrives; (k, 3) each.

    `entering` is what of it enters the samples, (m, 3), in its shadows; from each where any does a ray goes to one of
    its sub-lights.
    """
    parts = light.sub_lights(1 if light.is_sharp else SUB_LIGHTS)
    step = 1 + len(samples) // MOST_RAYS  # of few samples each stands for several
    lit = step * np.flatnonzero(entering[::step].any(axis=1))
    points, normals = samples.points[lit].astype(np.float64), samples.normals[lit].astype(np.float64)
    entering, areas = entering[lit], step * samples.areas[lit]
    chosen = np.random.default_rng(0).integers(len(parts), size=len(points))
    entered, towards, arriving = np.zeros(len(points)), np.zeros_like(points), np.zeros(len(points))
    let_in = transmittance(eta, np.linspace(0.0, 1.0, COSINES + 1)) / len(parts)
    for i, vector in enumerate(parts.vectors):
        direction = vector if parts.kind == DIRECTIONAL else vector - points
        direction = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12)
        cosines = np.maximum((normals * direction).sum(axis=1), 0.0)
        on_surface = cosines * parts.emission(i, points)
        entered += on_surface * let_in[row_of(cosines, COSINES)]
        np.copyto(towards, direction, where=(chosen == i)[:, None])
        np.copyto(arriving, on_surface, where=chosen == i)
    scale = arriving / np.maximum(entered, LEAST_ENTERING * entered.max(initial=0.0) + 1e-30)
    return points, normals, towards, entering * (scale * areas)[:, None]


def coarse(latlong: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return a lat-long map with texels averaged to COARSE_ROWS rows at most: a few rays see small sources as noise."""
    step = max(1, latlong.shape[0] // COARSE_ROWS)
    rows, columns = latlong.shape[0] // step, latlong.shape[1] // step
    cut = latlong[: rows * step, : columns * step].reshape(rows, step, columns, step, -1)
    return np.asarray(cut.mean(axis=(1, 3)), latlong.dtype)
