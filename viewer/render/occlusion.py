"""Environment light that the object itself keeps from its surface: baked once a mesh, then a share for every vertex.

Shares multiply the unoccluded irradiance: interpolated over the faces for pixels (the G-buffer's third texture), and
for the surface samples on the CPU. Highlights have shares of their own, see `viewer.passes.highlights`.
"""

from collections.abc import Callable

import moderngl

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined, interpolated
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.harmonics import rotated
from milkglass.core.light.probe import Probe
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import VisibilityOf
from milkglass.viewer.assets.visibility import needs_visibility
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.passes.occlusion import Occlusion
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.scene.settings import EnvironmentSettings


class OcclusionStages:
    """Makes occlusions in one OpenGL context, each step only when what it depends on has changed."""

    def __init__(self, context: moderngl.Context, stages: Stages, assets: Assets) -> None:
        self._context, self._run, self._assets = context, stages.run, assets

    def is_available(self, environment: EnvironmentSettings, mesh: Mesh) -> bool:
        """Whether occlusion of an environment by a mesh is needed, and is baked or may be baked now."""
        return needs_visibility(environment) and (self._assets.bakes or self._assets.has(VisibilityOf(mesh)))

    def of(
        self,
        environment: EnvironmentSettings,
        rest: Callable[[EnvironmentSettings], Probe],
        mesh: Mesh,
        buffers: MeshBuffers,
        say: Callable[[str], None],
    ) -> Occlusion | None:
        """Return the occlusion of an environment by a mesh, or None where it is not needed or not baked.

        `rest` gives the probe without what shines as lamps, which have shadow maps.
        """
        if not self.is_available(environment, mesh):
            return None

        def report(share: float) -> None:
            say(f"casting rays for the environment's shadows: {100.0 * share:.0f} %")

        baked = self._run(Stage.VISIBILITY, [mesh], lambda: self._assets.get(VisibilityOf(mesh, report)))
        surface = self.refined(baked.refined, buffers)
        probe, rotation_deg = rest(environment), environment.rotation_deg

        def share() -> Occlusion:
            shares = baked.visibility.shares(rotated(probe.sh, rotation_deg))
            # A buffer of its own each time: the last one is drawn from until the light inside has followed.
            return Occlusion(baked, shares, surface, self._context.buffer(shares))

        return self._run(Stage.OCCLUSION, [baked, surface, probe, rotation_deg], share)

    def refined(self, fine: Refined, buffers: MeshBuffers) -> RefinedSurface:
        """Return a refined mesh uploaded; `buffers` of the mesh serve where nothing was refined."""
        few = len(fine.levels) == 1
        return self._run(
            Stage.REFINED_MESH,
            [fine, buffers],
            lambda: RefinedSurface(fine, buffers if few else MeshBuffers(self._context, fine.mesh)),
        )

    def occluded(self, irradiance: Float32, occlusion: Occlusion | None, samples: SurfaceSamples) -> Float32:
        """Return E at the surface samples, (n, 3): that without occlusion times the visible share."""
        if occlusion is None:
            return irradiance
        fine = occlusion.baked.refined
        corners, weights = self._run(
            Stage.OCCLUDED_SAMPLES, [occlusion.baked, samples], lambda: fine.locate(samples.points, samples.faces)
        )
        return irradiance * interpolated(corners, weights, occlusion.shares)
