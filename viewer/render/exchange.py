"""Light between parts of the object: rays found once a mesh, then a matrix of transport and light by way of mirrors."""

from collections.abc import Callable

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.exchange import Exchange
from milkglass.core.light.probe import Probe, lookup
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import HitsOf, RefinedOf
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.passes.detail_uniforms import SampledSurface
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.render.occlusion import OcclusionStages
from milkglass.viewer.render.sources import shines
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.settings import EnvironmentSettings, TransportSettings


class ExchangeStages:
    """Makes the exchange of light between parts of a surface, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, assets: Assets, occlusions: OcclusionStages) -> None:
        self._run, self._assets, self._occlusions = stages.run, assets, occlusions

    def of(
        self,
        settings: TransportSettings,
        mesh: Mesh,
        surface: SampledSurface,
        leaving: Float32 | None,
        say: Callable[[str], None],
    ) -> Exchange | None:
        """Return the exchange of a mesh, None where it is not wanted, not baked, or there is next to none.

        `leaving` are factors of colours on exitance, (samples, 3).
        """
        if not settings.exchanges or not (self._assets.bakes or self._assets.has(HitsOf(mesh))):
            return None

        def report(share: float) -> None:
            say(f"casting rays between parts: {100.0 * share:.0f} %")

        hits = self._run(Stage.EXCHANGE_RAYS, [mesh], lambda: self._assets.get(HitsOf(mesh, report)))
        if hits is None:
            return None
        fine = self._assets.get(RefinedOf(mesh))
        return self._run(
            Stage.EXCHANGE,
            [hits, fine, surface.weights, leaving],
            lambda: Exchange(fine, hits, surface.weights, leaving),
        )

    def uploaded(self, exchange: Exchange, buffers: MeshBuffers) -> RefinedSurface:
        """Return the exchange's refined mesh on the GPU; `buffers` are those of the mesh itself."""
        return self._occlusions.refined(exchange.refined, buffers)

    def mirrored(
        self, exchange: Exchange, environment: EnvironmentSettings, probe: Callable[[], Probe], eta: float
    ) -> Float32 | None:
        """Return the irradiance of an environment by way of the surface's mirror, at the vertices; None without one."""
        if not shines(environment):
            return None
        around, to_probe = probe(), world_to_probe(environment.rotation_deg)

        def radiance(directions: Array) -> Array:
            return environment.intensity * np.asarray(lookup(around.latlong, directions @ to_probe), np.float64)

        key = [exchange.hits, around, environment.rotation_deg, environment.intensity, eta]
        return self._run(Stage.MIRRORED, key, lambda: exchange.hits.mirrored(eta, radiance))

    def flux(self, exchange: Exchange, mirrored: Float32, surface: SampledSurface) -> Float32:
        """Return the flux that enters the surface samples, (n, 3), for irradiance at the exchange's vertices."""
        samples = surface.samples

        def interpolated() -> Float32:
            at_samples = exchange.tinted(exchange.at_samples(samples) @ mirrored)
            return np.asarray(at_samples * samples.areas[:, None], np.float32)

        return self._run(Stage.MIRRORED_FLUX, [exchange, samples, mirrored], interpolated)
