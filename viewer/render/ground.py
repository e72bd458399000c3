"""The plane that the object stands on: what it sees of the object, and the light on it."""

from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.blur import blurred
from milkglass.core.light.ground import (
    RAYS,
    SIDE,
    GroundPlane,
    GroundRays,
    emitters_of_faces,
    upward_directions,
)
from milkglass.core.light.probe import Probe, irradiance_direct, lookup
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import GroundRaysOf, RefinedOf
from milkglass.viewer.gl.context import clamped_texture
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.ground import GroundLight, GroundPass
from milkglass.viewer.render.exitance import SurfaceExitance
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.sources import shines
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, POINT
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

EMITTERS = 4096  # points of the object's surface whose exitance the plane sees
CELL_DEG = float(np.degrees(np.sqrt(2.0 * np.pi / RAYS)) / 2.0)  # half the angle that a ray stands for


@dataclass(frozen=True, eq=False)
class Emitters:
    """Points of the object's surface whose exitance lights the plane.

    Attributes
    ----------
    samples : SurfaceSamples
    of_face : (faces of the refined mesh,) int
        The one nearest to each face.
    """

    samples: SurfaceSamples
    of_face: Ints


@dataclass(frozen=True, eq=False)
class Ground:
    """A plane below an object, before the object's exitance is known; compared by identity.

    Attributes
    ----------
    plane : GroundPlane
    open_irradiance : (3,) float64
        Of light from all around in the open.
    sky : (n, 3) float32
        Of the same at the map's places, with the object in the way.
    rays : GroundRays, optional
        None while they are not cast.
    emitters : Emitters, optional
        With the rays.
    """

    plane: GroundPlane
    open_irradiance: Array
    sky: Float32
    rays: GroundRays | None
    emitters: Emitters | None


class GroundStages:
    """Makes grounds, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, assets: Assets) -> None:
        self._run, self._assets = stages.run, assets

    def of(
        self,
        scene: Scene,
        lit: LitScene,
        rest: Callable[[EnvironmentSettings], Probe],
        say: Callable[[str], None] = lambda _: None,
    ) -> Ground:
        """Return the plane of a scene; `rest` gives the probe without what shines as lamps."""
        mesh, gap, environment = lit.model.mesh, scene.ground.gap_mm + lit.model.lift, scene.environment
        plane, rays, emitters = GroundPlane.below(mesh, gap), None, None

        def report(share: float) -> None:
            say(f"casting rays from the ground: {100.0 * share:.0f} %")

        source = GroundRaysOf(mesh, gap, report)
        if self._assets.bakes or self._assets.has(source):
            rays = self._run(Stage.GROUND_RAYS, [mesh, gap], lambda: self._assets.get(source))
            emitters = self._run(Stage.GROUND_EMITTERS, [rays, lit.samples], lambda: self._emitters(lit, rays))
        around = (rest(environment), environment.rotation_deg, environment.intensity) if shines(environment) else None
        seen = rays if environment.occluded else None
        open_irradiance, sky = self._run(Stage.GROUND_SKY, [around, seen, plane], lambda: _sky(around, seen, SIDE**2))
        parts = plane, open_irradiance, sky, rays, emitters
        return self._run(Stage.GROUND, parts, lambda: Ground(*parts))

    def _emitters(self, lit: LitScene, rays: GroundRays) -> Emitters:
        """Choose points of the surface by area."""
        mesh, samples = lit.model.mesh, lit.samples
        shares = samples.areas.astype(np.float64)
        count = min(EMITTERS, int(np.count_nonzero(shares)))
        chosen = np.random.default_rng(0).choice(len(samples), count, replace=False, p=shares / shares.sum())
        chosen = chosen[_along_curve(samples.points[chosen], mesh.radius)]
        few = SurfaceSamples(
            samples.points[chosen], samples.normals[chosen], samples.areas[chosen], samples.faces[chosen]
        )
        spacing = float(np.sqrt(mesh.area / max(count, 1)))
        fine = self._assets.get(RefinedOf(mesh)).mesh
        return Emitters(few, emitters_of_faces(fine, rays.faces, few.points, few.normals, spacing))


def _along_curve(points: Float32, radius: float) -> Ints:
    """Return an order of points in which neighbours are near each other, (n,): Morton's, in a cube of 2 radii."""
    cells = np.clip((points / radius + 1.0) * 16.0, 0.0, 31.0).astype(np.int64)
    bits = [(cells[:, axis] >> bit & 1) << 3 * bit + axis for bit in range(5) for axis in range(3)]
    return np.argsort(np.sum(bits, axis=0), kind="stable")


def _sky(around: tuple[Probe, float, float] | None, rays: GroundRays | None, n: int) -> tuple[Array, Float32]:
    """Return the irradiance of an environment on a plane in the open (3,), and at n places of its map (n, 3)."""
    if around is None:
        return np.zeros(3), np.zeros((n, 3), np.float32)
    probe, rotation_deg, intensity = around
    open_irradiance = intensity * irradiance_direct(probe.latlong, [[0.0, 1.0, 0.0]], 1.0)[0]
    if rays is None:
        return open_irradiance, np.tile(open_irradiance.astype(np.float32), (n, 1))
    towards = upward_directions().astype(np.float64) @ world_to_probe(rotation_deg)
    shares = rays.visible_share(lookup(blurred(probe.latlong, CELL_DEG), towards))
    return open_irradiance, (shares * open_irradiance).astype(np.float32)


class GroundLighting:
    """Lights grounds in one OpenGL context, with what leaves the object."""

    def __init__(
        self,
        context: moderngl.Context,
        stages: Stages,
        ground: GroundPass,
        exitance: SurfaceExitance,
    ) -> None:
        self._context, self._run, self._spread = context, stages.run, stages.spread
        self._ground, self._exitance = ground, exitance

    def light(self, ground: Ground, lit: LitScene, gather: Gather) -> GroundLight:
        """Return the light on a plane.

        Raises
        ------
        Unfinished
            The stages have an allowance, and the lamps take more.
        """
        volume = gather.volume, gather.fluence, gather.tables, gather.eta, gather.exit_normalisation, gather.reentry
        at_places = self._run(
            Stage.GROUND_GLOW,
            [ground, lit.model, lit.detail, *lit.sources, *volume],
            lambda: self._at_places(ground, lit, gather),
        )
        lamps = [source for source in lit.sources if source.kind in (DIRECTIONAL, POINT)]
        soft, sharp = (tuple(source for source in lamps if source.is_soft is is_soft) for is_soft in (True, False))
        maps = self._spread(
            Stage.GROUND_LAMPS, [ground.plane, *soft], lambda: self._ground.lamp_maps(ground.plane, soft)
        )

        def make() -> GroundLight:
            around = clamped_texture(self._context, at_places.reshape(SIDE, SIDE, 3))
            red, green, blue = ground.open_irradiance.tolist()
            return GroundLight(ground.plane, sharp, maps, around, (red, green, blue))

        return self._run(Stage.GROUND_AROUND, [at_places, maps, *sharp], make)

    def _at_places(self, ground: Ground, lit: LitScene, gather: Gather) -> Float32:
        """Return the irradiance from all around, and of what leaves the object, at the places of the map: (n, 3)."""
        if ground.rays is None or ground.emitters is None:
            return ground.sky
        emitters = ground.emitters
        matrix = ground.rays.glow(gather.eta, gather.exit_normalisation, emitters.of_face, len(emitters.samples))
        return np.asarray(ground.sky + matrix @ self._exitance.at(emitters.samples, lit, gather), np.float32)
