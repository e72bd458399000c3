"""Trees of rays of sight in a picture: which parts of them it needs, and what they are traced in."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.probe import Probe
from milkglass.core.material.library import CHANNELS
from milkglass.core.material.medium import Medium
from milkglass.core.paths.resolution import RESOLVED, resolved_share, scaled, scattered_share, scatters
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.methods import Method
from milkglass.core.transport.quality import percent
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.sources import Surround, shines
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import SMOOTH_SHININESS, EnvironmentSettings

if TYPE_CHECKING:  # compiled loops take half a second to import, and most pictures of marble do without
    from milkglass.core.paths import ClearPart, Surface, Surroundings, Tree

# Share of light that crosses thin parts, below which none is followed: of an environment; and of lamps alone, of which
# specks are seen through the object (petals of jade let through 0.13: on 0.2 % of the pixels, 0.9 % of the light).
LEAST_CROSSING, LEAST_OF_LAMPS = 0.002, 0.2
THIN_QUANTILE = 0.05  # of the surface's thickness
THICKNESS_RAYS = 2000
START = 1e-4  # radii of the bounding sphere below the surface at which these start


@dataclass(frozen=True, eq=False)
class Paths:
    """Rays of sight of a scene, but for the exitance of its surface; compared by identity.

    Attributes
    ----------
    tree : Tree, optional
        Where the scene needs any rays.
    meets_itself : bool
        Whether rays that leave the object meet it again, or come to it through clear parts.
    why : tuple of str
        As of `PathParts`.
    """

    tree: "Tree | None"
    meets_itself: bool
    why: tuple[str, ...]


@dataclass(frozen=True)
class PathParts:
    """Which rays of sight a picture needs, and why.

    Attributes
    ----------
    mirrors : bool
        Whether the surface is smooth, and mirrors an environment by rays.
    clear : bool
        Whether light crosses the object unscattered.
    why : tuple of str
        A sentence on each, for those who ask what a picture costs.
    """

    mirrors: bool
    clear: bool
    why: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, lit: LitScene, thin: float) -> "PathParts":
        """Return the parts that a scene needs, whose object is so thick in its thin parts, mm."""
        gloss, around = scene.gloss, shines(scene.environment)
        left = [float(np.exp(-extinction * thin)) for extinction in extinctions(lit)]
        least = LEAST_CROSSING if around else LEAST_OF_LAMPS
        clear = max(left) >= least or lit.beams is not None or bool(lit.clear)
        mirrors = gloss.is_smooth and (around or (clear and lit.ground is not None))
        smooth = f"shininess {gloss.shininess:g}, smooth from {SMOOTH_SHININESS:g} on"
        if not scene.transport.shown_paths.mirror:
            mirror = "mirror: not shown"
        elif mirrors:
            mirror = f"mirror: rays, of {'an environment' if around else 'the ground'} ({smooth})"
        elif not around:
            mirror = "mirror: highlights of lamps alone, without an environment"
        else:
            mirror = f"mirror: highlights ({smooth}, strength {gloss.strength:g}, model {gloss.model})"
        through = "rays" if max(left) >= least else "none"
        unscattered = (
            f"unscattered: {through} ({_channels(left)} is left behind thin parts of {thin:.3g} mm; "
            f"followed from {100.0 * least:g} % on)"
        )
        return cls(mirrors, clear, (mirror, unscattered, *_scattering(lit), *_clear(lit)))


class PathStages:
    """Makes what rays of sight are traced in, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, surround: Surround) -> None:
        self._run, self._surround = stages.run, surround

    def of(self, scene: Scene, lit: LitScene, say: Callable[[str], None]) -> Paths | None:
        """Return the rays of sight of a lit scene; None where its transport follows none."""
        if not lit.quality.facts.follows_sight:
            return None
        mesh, samples = lit.model.mesh, lit.samples
        parts = PathParts.of(scene, lit, self._run(Stage.THICKNESS, [mesh], lambda: thin_part(mesh, samples)))
        if not (parts.mirrors or parts.clear):
            return Paths(None, meets_itself=False, why=parts.why)
        say("preparing rays through the object")
        from milkglass.core.paths import Tree, most_events

        bodies = None if lit.body_marks is None else lit.bodies
        surface = self._run(
            Stage.PATH_SURFACE,
            [mesh, bodies, lit.eta, lit.clear],
            lambda: surface_of(mesh, bodies, lit.eta, lit.clear),
        )
        around, mirrors, clear = self._surroundings(scene, lit), parts.mirrors, parts.clear

        def make() -> Tree:
            of_bodies = np.array(surface.absorption)
            of_bodies[: surface.scattering] = extinctions(lit)
            return Tree(surface, of_bodies, around, mirrors=mirrors, clear=clear, events=most_events(surface))

        tree = self._run(Stage.PATHS, [surface, around, *extinctions(lit), mirrors, clear], make)
        return Paths(tree, meets_itself=lit.exchange is not None or bool(lit.clear), why=parts.why)

    def _surroundings(self, scene: Scene, lit: LitScene) -> "Surroundings":
        environment, lamps = scene.environment, scene.effective_lights()
        probe = rest = None
        if lit.ground is not None:
            lamps = lit.ground.standing.lamps
            if not shines(environment):  # below its horizon the plane in the open
                environment = lit.ground.standing.environment
        if shines(environment):
            probe, rest = self._surround.probe(environment), self._surround.rest(environment)
        turned = replace(environment, path=None, builtin=None, probe=None)  # the probe itself stands for these
        return self._run(
            Stage.SURROUNDINGS, [probe, rest, turned, lamps], lambda: _surroundings(environment, probe, rest, lamps)
        )


def extinctions(lit: LitScene) -> list[float]:
    """Return the extinction of light along rays of sight, of R, G and B, 1/mm: that of beams, where there are any."""
    if lit.beams is None:
        return [medium.sigma_t_prime for medium in lit.media]
    return [scaled(medium, lit.grid).sigma_t for medium in lit.media]


def is_clear(method: Method, media: Sequence[Medium], mesh: Mesh) -> bool:
    """Return whether so little light scatters in an object that rays of sight find all there is to see."""
    return method.follows_sight and not scatters(media, mesh.mean_chord)


def _scattering(lit: LitScene) -> tuple[str, str, str]:
    """Return sentences on light that scatters once, and more often, and on that which leaves by the surface."""
    media, chord = lit.media, lit.model.mesh.mean_chord
    if is_clear(lit.quality.facts, media, lit.model.mesh):
        scattered = _channels(scattered_share(medium, chord) for medium in media)
        from_on = f"followed from {100.0 * RESOLVED.least_scattered:g} % on"
        return f"once: none ({scattered} scatters on {chord:.3g} mm; {from_on})", "often: none", "surface: none"
    once = [resolved_share(medium, lit.grid) if lit.beams is not None else 0.0 for medium in media]
    often = [
        share if medium.albedo >= RESOLVED.least_albedo else 0.0 for share, medium in zip(once, media, strict=True)
    ]
    surface = [0.0 if medium.is_black else 1.0 - share for share, medium in zip(once, media, strict=True)]
    why = f"mean free paths of {RESOLVED.least_path:g} to {RESOLVED.full_path:g} cells of {lit.grid.texel:.3g} mm"
    if lit.detail is not None:
        why = "not below surfaces with colours or relief"
    albedos = ", ".join(f"{medium.albedo:.2g}" for medium in media)
    return (
        f"once: {_used('beams and rays', once)} ({why})",
        f"often: {_used('flights, diffusion and rays', often)} (albedo {albedos}; from {RESOLVED.least_albedo:g} on)",
        f"surface: {_used('diffusion', surface)}",
    )


def _used(means: str, shares: Sequence[float]) -> str:
    return f"{means}, {_channels(shares)}" if any(shares) else "none"


def _channels(shares: Iterable[float]) -> str:
    """Return shares of R, G and B as per cents."""
    return ", ".join(f"{channel} {percent(share)}" for channel, share in zip(CHANNELS, shares, strict=True))


def _clear(lit: LitScene) -> tuple[str, ...]:
    """Return a sentence on the parts that do not scatter light, where there are any."""
    if not lit.clear:
        return ()
    named = (
        f"{part.name} (eta {part.eta:g}, absorption {', '.join(f'{value:g}' for value in part.absorption)} /mm)"
        for part in lit.clear
    )
    return (f"clear parts: {'; '.join(named)}; seen by rays, and beams come through them",)


def thin_part(mesh: Mesh, samples: SurfaceSamples) -> float:
    """Return how thick a mesh is in its thin parts: a quantile of what rays along the normal tell, by area, mm."""
    areas = samples.areas.astype(np.float64)
    chosen = np.random.default_rng(0).choice(len(samples), THICKNESS_RAYS, p=areas / areas.sum())
    inwards = -samples.normals[chosen]
    starts = samples.points[chosen] + START * mesh.radius * inwards
    face, distance = RayMesh(mesh.vertices, mesh.faces).first(starts, inwards)
    met = face >= 0
    return float(np.quantile(distance[met], THIN_QUANTILE)) if met.any() else 2.0 * mesh.radius


def surface_of(mesh: Mesh, bodies: Bodies | None, eta: float, clear: "tuple[ClearPart, ...]" = ()) -> "Surface":
    """Return the surface for rays of a mesh, one body or several that scatter light each alone, and of clear parts."""
    from milkglass.core.paths import Surface

    if bodies is None:
        return Surface.of(mesh, eta, clear=clear)
    return Surface.of(mesh, np.full(bodies.count, eta), bodies.of_face, clear)


def _surroundings(
    environment: EnvironmentSettings, probe: Probe | None, rest: Probe | None, lights: tuple[Light, ...]
) -> "Surroundings":
    from milkglass.core.paths import Surroundings

    lamps = [light.seen() for light in lights]
    if probe is None or rest is None:
        return Surroundings.of(lamps=lamps)
    return Surroundings.of(probe.latlong, rest.latlong, environment.rotation_deg, environment.intensity, lamps)
