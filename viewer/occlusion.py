"""Environment light that the object itself keeps from its surface: baked once a mesh, then a share for every vertex.

Shares multiply the unoccluded irradiance: interpolated over the faces for pixels (the G-buffer's third texture), and
for the surface samples on the CPU. Highlights have shares of their own, see `viewer.highlights_pass`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from core.environment import Probe
from core.mesh import Mesh
from core.refine import interpolated
from core.samples import SurfaceSamples
from core.spherical_harmonics import rotated
from core.stages import Stages
from viewer.assets import Assets
from viewer.buffers import MeshBuffers
from viewer.settings import EnvironmentSettings
from viewer.visibility import LONGEST_EDGE, BakedVisibility, needs_visibility

Float32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Shares of one environment's light, on both sides.

    Attributes
    ----------
    baked : BakedVisibility
    shares : (n, 3) float32
        Of the vertices of the refined mesh, in [0, 1].
    buffers : MeshBuffers
        Of that mesh.
    values : buffer
        Shares, three floats a vertex.
    """

    baked: BakedVisibility
    shares: Float32
    buffers: MeshBuffers
    values: moderngl.Buffer

    def at(self, points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Shares at points (n, 3) of the surface with normals (n, 3): of the nearest vertices that face that way."""
        weights, nearest = self._neighbours(points, normals)
        return np.asarray(np.einsum("nk,nkc->nc", weights, self.shares[nearest]))

    def _neighbours(
        self, points: npt.NDArray[np.floating], normals: npt.NDArray[np.floating]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
        mesh = self.baked.refined.mesh
        turn = LONGEST_EDGE * mesh.radius  # mm that a turn of the normal by a radian counts
        tree = cKDTree(np.concatenate([mesh.vertices, turn * mesh.normals], axis=1))
        distance, nearest = tree.query(np.concatenate([points, turn * normals], axis=1), k=min(3, len(mesh.vertices)))
        distance, nearest = (np.reshape(values, (len(points), -1)) for values in (distance, nearest))
        weights = 1.0 / (distance**2 + (1e-6 * mesh.radius) ** 2)
        return weights / weights.sum(axis=1, keepdims=True), nearest

    def behind(self, context: moderngl.Context) -> moderngl.Buffer:
        """Shares on the other side, seen against each vertex' normal: three floats each."""
        return context.buffer(interpolated(*self.baked.opposite, self.shares))

    def bodies(self, context: moderngl.Context, of_vertex: npt.NDArray[np.int32]) -> moderngl.Buffer:
        """Body of each vertex of the refined mesh, one float."""
        return context.buffer(of_vertex[self.baked.refined.sources].astype(np.float32))


class OcclusionStages:
    """Makes occlusions in one OpenGL context, each step only when what it depends on has changed."""

    def __init__(self, context: moderngl.Context, stages: Stages, assets: Assets) -> None:
        self._context, self._run, self._assets = context, stages.run, assets

    def known(self, environment: EnvironmentSettings, mesh: Mesh) -> bool:
        """Whether what keeps an environment's light from a mesh is wanted, and there or to be waited for."""
        return needs_visibility(environment) and (self._assets.bakes or self._assets.has_visibility(mesh))

    def of(
        self,
        environment: EnvironmentSettings,
        rest: Callable[[EnvironmentSettings], Probe],
        mesh: Mesh,
        buffers: MeshBuffers,
        say: Callable[[str], None],
    ) -> Occlusion | None:
        """What keeps the environment's light from the surface of a mesh, if that is wanted and known.

        `rest` gives the probe without what shines as lamps, which have shadow maps.
        """
        if not self.known(environment, mesh):
            return None

        def report(share: float) -> None:
            say(f"casting rays for the environment's shadows: {100.0 * share:.0f} %")

        baked = self._run("visibility", [mesh], lambda: self._assets.visibility(mesh, report))
        return self._occlusion(baked, buffers, rest(environment), environment.rotation_deg)

    def occluded(self, irradiance: Float32, occlusion: Occlusion | None, samples: SurfaceSamples) -> Float32:
        """Unoccluded E at the surface samples, (n, 3), times what reaches them."""
        if occlusion is None:
            return irradiance
        fine = occlusion.baked.refined
        corners, weights = self._run(
            "occluded samples", [occlusion.baked, samples], lambda: fine.locate(samples.points, samples.faces)
        )
        return irradiance * interpolated(corners, weights, occlusion.shares)

    def _occlusion(self, baked: BakedVisibility, buffers: MeshBuffers, probe: Probe, rotation_deg: float) -> Occlusion:
        context, run, fine = self._context, self._run, baked.refined
        of_mesh = run(
            "refined mesh",
            [baked, buffers],
            lambda: buffers if len(fine.levels) == 1 else MeshBuffers(context, fine.mesh),
        )

        def share() -> Occlusion:
            shares = baked.visibility.shares(rotated(probe.sh, rotation_deg))
            # A buffer of its own each time: the last one is drawn from until the light inside has followed.
            return Occlusion(baked, shares, of_mesh, context.buffer(shares))

        return run("occlusion", [baked, of_mesh, probe, rotation_deg], share)
