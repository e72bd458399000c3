"""The plane that the object stands on: the light on it, what it sees of the object, and what it gives back."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import moderngl
import numpy as np
from scipy.ndimage import zoom

from milkglass.core.arrays import Array, Float32, Int32, Ints
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.blur import blurred
from milkglass.core.light.exchange import nearest_emitters
from milkglass.core.light.ground import (
    RAYS,
    SIDE,
    GroundExchange,
    GroundMirror,
    GroundPlane,
    GroundRays,
    Horizon,
    upward_directions,
)
from milkglass.core.light.indices import Eta
from milkglass.core.light.probe import Probe, irradiance_direct, lookup
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import GroundRaysOf, RefinedOf
from milkglass.viewer.gl.context import clamped_texture
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.ground import LAMPS_SIDE, GroundLight, GroundPass, LampMaps
from milkglass.viewer.passes.light_source import LightSource
from milkglass.viewer.render.exchange import coarse
from milkglass.viewer.render.exitance import SurfaceExitance
from milkglass.viewer.render.lit_scene import LitScene, Model
from milkglass.viewer.render.paths import Paths
from milkglass.viewer.render.sources import Surround, shines
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, POINT
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings

if TYPE_CHECKING:  # compiled loops take half a second to import
    from milkglass.core.paths import Floor

EMITTERS = 4096  # points of the object's surface whose exitance the plane sees
CELL_DEG = float(np.degrees(np.sqrt(2.0 * np.pi / RAYS)) / 2.0)  # half the angle that a ray stands for
SUB_LIGHTS = 64  # of a lamp with a size, on the plane in the open
RING = 8  # places around the end of the map, whose light in the open is that of all beyond


@dataclass(frozen=True, eq=False)
class Standing:
    """A plane below an object, and light around both with the plane in its way; compared by identity.

    Attributes
    ----------
    plane : GroundPlane
    gap : float
        Between it and the object, mm.
    albedo : 3 floats
    lamps, strong : tuples of Light
        Of the scene, and of its environment, above the plane.
    environment : EnvironmentSettings
        With the plane in the open below its horizon, without what shines as lamps.
    radiance : (3,) float64
        Of the plane in the open.
    sky : Probe, turn and factor, optional
        The environment alone.
    """

    plane: GroundPlane
    gap: float
    albedo: tuple[float, float, float]
    lamps: tuple[Light, ...]
    strong: tuple[Light, ...]
    environment: EnvironmentSettings
    radiance: Array
    sky: tuple[Probe, float, float] | None

    def lit(self, scene: Scene) -> Scene:
        """Return a scene without a ground, but lit as with it, if it were in the open everywhere."""
        return replace(scene.floating(), lights=(*self.lamps, *self.strong), environment=self.environment)


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
    """A plane below an object, and the light on it but for the object's exitance; compared by identity.

    Attributes
    ----------
    standing : Standing
    open_irradiance : (3,) float64
        Of light from all around in the open.
    around : (n, 3) float32
        Of the same at the map's places, with the object in the way, which mirrors some of it.
    sharp : tuple of LightSource
        Lamps without a size.
    lamps : LampMaps of the others, and of these
    exchange : GroundExchange, optional
        None while no rays are cast.
    mirror : GroundMirror, optional
        Likewise, and for a draft.
    emitters : Emitters, optional
        With the rays, where the plane is drawn.
    """

    standing: Standing
    open_irradiance: Array
    around: Float32
    sharp: tuple[LightSource, ...]
    lamps: tuple[LampMaps, LampMaps]
    exchange: GroundExchange | None
    mirror: GroundMirror | None
    emitters: Emitters | None = None


class GroundStages:
    """Makes grounds in one OpenGL context, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, assets: Assets, surround: Surround, ground: GroundPass) -> None:
        self._run, self._spread, self._assets = stages.run, stages.spread, assets
        self._surround, self._ground = surround, ground

    def standing(self, scene: Scene, model: Model, environment: EnvironmentSettings) -> Standing | None:
        """Return the plane below a scene's model, and its lamps and environment with the plane in their way; or None.

        The `environment` is perhaps one with its strong sources left in it.
        """
        run, settings, mesh = self._run, scene.ground, model.mesh
        if not settings.on:
            return None
        gap = settings.gap_mm + model.lift
        plane = run(Stage.GROUND_PLANE, [mesh, gap], lambda: GroundPlane.below(mesh, gap))
        rest, factor = None, 1.0
        if shines(environment):
            rest, factor = self._surround.rest(environment), environment.intensity
        horizon = run(Stage.HORIZON, [rest], lambda: Horizon.of(rest))
        lamps, strong = _above(plane, scene.effective_lights()), _above(plane, self._surround.lamps(environment))

        def make() -> Standing:
            irradiance = factor * horizon.irradiance + sum(far_irradiance(plane, light) for light in (*lamps, *strong))
            radiance = np.array(settings.albedo) / np.pi * irradiance
            turned = replace(
                environment, path=None, builtin=None, probe=horizon.over(radiance / factor), extract=False,
                intensity=factor,
            )  # fmt: skip
            sky = None if rest is None else (rest, environment.rotation_deg, factor)
            return Standing(plane, gap, settings.albedo, lamps, strong, turned, radiance, sky)

        return run(Stage.STANDING, [plane, horizon, environment, settings.albedo, lamps, strong], make)

    def exchange(self, standing: Standing | None, mesh: Mesh, say: Callable[[str], None]) -> GroundExchange | None:
        """Return a plane as part of the exchange of light between the object's parts; None while no rays are cast."""
        if standing is None:
            return None

        def report(share: float) -> None:
            say(f"casting rays between the object and the ground: {100.0 * share:.0f} %")

        source = GroundRaysOf(mesh, standing.gap, report)
        if not (self._assets.bakes or self._assets.has(source)):
            return None
        key = self._run(Stage.GROUND_RAYS, [mesh, standing.gap], lambda: self._assets.get(source)), standing.albedo
        return self._run(Stage.GROUND_EXCHANGE, key, lambda: GroundExchange(*key))

    def lit(
        self,
        standing: Standing | None,
        exchange: GroundExchange | None,
        sources: Sequence[LightSource],
        eta: Eta,
        landed: Float32 | None,
        *,
        draft: bool,
    ) -> tuple[Ground | None, Float32 | None]:
        """Return a plane with the light of sources on it, and what is known of the irradiance that it returns.

        That is what enters at the vertices of the refined mesh, (n, 3), over what the plane in the open returns; None
        while no rays are there, and for a `draft`. `landed` is the irradiance at the places of light that has crossed
        the object, where any does.

        Raises
        ------
        Unfinished
            The stages have an allowance, and the lamps take more.
        """
        if standing is None:
            return None, None
        run, plane, environment = self._run, standing.plane, standing.environment
        lamps = [source for source in sources if source.kind in (DIRECTIONAL, POINT)]
        soft, sharp = (tuple(source for source in lamps if source.is_soft is is_soft) for is_soft in (True, False))
        maps = self._spread(Stage.GROUND_LAMPS, [plane, *soft], lambda: self._ground.lamp_maps(plane, soft))
        seen = exchange.rays if exchange is not None and environment.occluded else None
        open_irradiance, around = run(
            Stage.GROUND_SKY, [standing.sky, seen, plane], lambda: _sky(standing.sky, seen, SIDE**2)
        )
        if landed is not None:
            alone = around
            around = run(Stage.GROUND_UNDER, [alone, landed], lambda: alone + landed)
        returned = mirror = None
        both = (
            maps,
            self._spread(Stage.GROUND_SHARP_LAMPS, [plane, *sharp], lambda: self._ground.lamp_maps(plane, sharp)),
        )
        if exchange is not None and not draft:
            mirror = run(Stage.GROUND_MIRROR, [exchange, eta], lambda: GroundMirror(exchange, eta))
            sky = around
            around, returned = run(
                Stage.GROUND_RETURNED,
                [exchange, mirror, standing, sky, *both, eta],
                lambda: _returned(exchange, mirror, standing, sky, both, eta),
            )
        parts = standing, open_irradiance, around, sharp, both, exchange, mirror
        key = standing, open_irradiance, around, *sharp, *both, exchange, mirror
        return run(Stage.GROUND, key, lambda: Ground(*parts)), returned

    def drawn(self, ground: Ground, lit: LitScene) -> Ground:
        """Return a plane as it is drawn, with what of the object's surface lights it."""
        if ground.exchange is None:
            return ground
        rays = ground.exchange.rays
        emitters = self._run(Stage.GROUND_EMITTERS, [rays, lit.samples], lambda: self._emitters(lit, rays))
        return self._run(Stage.GROUND_DRAWN, [ground, emitters], lambda: replace(ground, emitters=emitters))

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
        return Emitters(few, _emitters_of_faces(fine, rays.faces, few.points, few.normals, spacing))


def _above(plane: GroundPlane, lights: tuple[Light, ...]) -> tuple[Light, ...]:
    """Return the lights whose middle is above a plane."""
    return tuple(light for light in lights if light.vector[1] > (0.0 if light.DISTANT else plane.height))


def far_irradiance(plane: GroundPlane, light: Light) -> Array:
    """Return the irradiance of a light in the open where the map of a plane ends, (3,)."""
    angles = 2.0 * np.pi * np.arange(RING) / RING
    x, z = np.array(plane.centre)[:, None] + plane.reach * np.stack([np.cos(angles), np.sin(angles)])
    points = np.stack([x, np.full(RING, plane.height), z], axis=1)
    parts = light.sub_lights(1 if light.is_sharp else SUB_LIGHTS)
    total = 0.0
    for i, vector in enumerate(parts.vectors):
        towards = np.broadcast_to(vector, points.shape) if parts.kind == DIRECTIONAL else vector - points
        cosines = np.maximum(towards[:, 1] / np.linalg.norm(towards, axis=1), 0.0)
        total += float(np.mean(cosines * parts.emission(i, points)))
    return np.array(parts.colour) * total / len(parts)


def _emitters_of_faces(mesh: Mesh, faces: Int32, points: Float32, normals: Float32, spacing: float) -> Ints:
    """Return the emitter of each face of a mesh, (faces,), for some `faces` alone (0 of others).

    Other arguments as of `core.light.exchange.nearest_emitters`.
    """
    found, met = np.zeros(len(mesh.faces), np.intp), np.unique(faces[faces >= 0])
    if len(met):
        found[met] = nearest_emitters(Mesh(mesh.vertices, mesh.normals, mesh.faces[met]), points, normals, spacing)
    return found


def _returned(
    ground: GroundExchange,
    mirror: GroundMirror,
    standing: Standing,
    sky: Float32,
    maps: tuple[LampMaps, ...],
    eta: Eta,
) -> tuple[Float32, Float32]:
    """Return the irradiance from all around at the places with what the object mirrors, and what the vertices get.

    `sky` is from all around alone, (places, 3); the latter is over that of the plane in the open.
    """
    lamps = np.sum([of_lamps.at_places() for of_lamps in maps], axis=0)
    environment, returning = standing.environment, np.array(standing.albedo, np.float32) / np.float32(np.pi)
    probe = environment.probe
    assert probe is not None
    texels, to_probe = coarse(probe.latlong), world_to_probe(environment.rotation_deg)

    def radiance(directions: Array) -> Array:
        return environment.intensity * np.asarray(lookup(texels, directions @ to_probe), np.float64)

    lit = mirror.lit(sky + lamps + ground.rays.mirrored(eta, radiance))
    difference = returning * lit - standing.radiance.astype(np.float32)
    return lit - lamps, np.asarray(ground.rays.returning.matrix(eta) @ difference)


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
        exitance: SurfaceExitance,
    ) -> None:
        self._context, self._run, self._exitance = context, stages.run, exitance

    def light(self, ground: Ground, lit: LitScene, gather: Gather) -> GroundLight:
        """Return the light on a plane."""
        at_places = self._around(ground, lit, gather)

        def make() -> GroundLight:
            around = clamped_texture(self._context, at_places.reshape(SIDE, SIDE, 3))
            red, green, blue = ground.open_irradiance.tolist()
            return GroundLight(ground.standing.plane, ground.sharp, ground.lamps[0], around, (red, green, blue))

        return self._run(Stage.GROUND_AROUND, [at_places, ground], make)

    def below(self, paths: Paths, ground: Ground, lit: LitScene, gather: Gather) -> Paths:
        """Return rays of sight that see a plane."""
        if (tree := paths.tree) is None:
            return paths
        at_places = self._around(ground, lit, gather)
        floor = self._run(Stage.FLOOR, [at_places, ground], lambda: _floor(ground, at_places))

        def make() -> Paths:
            return replace(paths, tree=replace(tree, surroundings=tree.surroundings.above(floor)))

        return self._run(Stage.PATHS_ON_GROUND, [tree, floor, paths.meets_itself, *paths.why], make)

    def _around(self, ground: Ground, lit: LitScene, gather: Gather) -> Float32:
        """Return the irradiance from all around, and of what leaves the object, at the places of the map: (n, 3)."""
        return self._run(
            Stage.GROUND_GLOW,
            [ground, lit.model, lit.detail, *lit.sources, *gather.key],
            lambda: self._at_places(ground, lit, gather),
        )

    def _at_places(self, ground: Ground, lit: LitScene, gather: Gather) -> Float32:
        if ground.exchange is None or ground.emitters is None:
            return ground.around
        rays, emitters = ground.exchange.rays, ground.emitters
        eta, of_first = lit.indices or lit.eta, gather.kinds[0].exit_normalisation
        matrix = rays.glow(eta, emitters.of_face, len(emitters.samples), of_first)
        glow = matrix @ self._exitance.at(emitters.samples, lit, gather)
        return np.asarray(ground.around + (glow if ground.mirror is None else ground.mirror.lit(glow)), np.float32)


def _floor(ground: Ground, around: Float32) -> "Floor":
    """Return a plane as rays see it, with the irradiance from all around at its places, (n, 3)."""
    from milkglass.core.paths import Floor

    plane = ground.standing.plane
    finer = zoom(
        around.reshape(SIDE, SIDE, 3), (LAMPS_SIDE / SIDE,) * 2 + (1,), order=1, mode="nearest", grid_mode=True
    )
    irradiance = finer + np.sum([lamps.with_object() for lamps in ground.lamps], axis=0)
    radiance = np.array(ground.standing.albedo, np.float32) / np.float32(np.pi) * irradiance
    centre, fade = (np.array(pair, np.float32) for pair in (plane.centre, plane.fade))
    return Floor(np.ascontiguousarray(radiance, np.float32), plane.height, centre, fade, plane.spread, plane.last)
