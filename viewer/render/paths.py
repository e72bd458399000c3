"""Trees of rays of sight in a picture: which parts of them it needs, and what they are traced in."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.arrays import Bools
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.light.probe import Probe
from milkglass.core.material.library import CHANNELS
from milkglass.core.material.medium import DeltaEddington
from milkglass.core.paths.resolution import RESOLVED, resolved_share, scaled, scattered_share
from milkglass.core.stages import Stage, Stages, numbered
from milkglass.core.transport.base import Matter
from milkglass.core.transport.quality import percent
from milkglass.viewer.render.lit_scene import LitScene, kinds_of
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
    is_drafted : bool
        Whether a draft of what rays find comes near to it.
    at_rest : bool
        Whether pictures do without while something moves.
    """

    tree: "Tree | None"
    meets_itself: bool
    why: tuple[str, ...]
    is_drafted: bool = False
    at_rest: bool = False

    @property
    def while_moving(self) -> "Paths":
        """The rays that are followed while something moves."""
        return replace(self, tree=None) if self.at_rest else self


@dataclass(frozen=True)
class PathParts:
    """Which rays of sight a picture needs, and why.

    Attributes
    ----------
    mirrors : bool
        Whether the surface is smooth, and mirrors an environment, the ground or itself, by rays.
    clear : bool
        Whether light crosses the object unscattered.
    why : tuple of str
        A sentence on each, for those who ask what a picture costs.
    """

    mirrors: bool
    clear: bool
    why: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, lit: LitScene, thin: Sequence[float]) -> "PathParts":
        """Return the parts that a scene needs, whose bodies of each kind are so thick in their thin parts, mm."""
        gloss, around = scene.gloss, shines(scene.environment)
        of_kinds = extinctions(lit)
        left = [
            [float(np.exp(-extinction * mm)) for extinction in of_kind]
            for of_kind, mm in zip(of_kinds, thin, strict=True)
        ]
        least = LEAST_CROSSING if around else LEAST_OF_LAMPS
        clear = np.max(left) >= least or lit.beams is not None or bool(lit.clear)
        glows = lit.beams is not None or not all(matter.scatters for matter in lit.matter)
        by_way = clear and (glows or lit.ground is not None)
        mirrors = gloss.is_smooth and bool(around or by_way or _meets_itself(lit))
        smooth = f"shininess {gloss.shininess:g}, smooth from {SMOOTH_SHININESS:g} on"
        if not scene.transport.shown_paths.mirror:
            mirror = "mirror: not shown"
        elif mirrors:
            mirrored = "an environment" if around else "the object and the ground" if lit.ground else "the object"
            mirror = f"mirror: rays, of {mirrored} ({smooth})"
        elif not around:
            mirror = "mirror: highlights of lamps alone, without an environment"
        else:
            mirror = f"mirror: highlights ({smooth}, strength {gloss.strength:g}, model {gloss.model})"
        sentences = list[str]()
        for matter, of_kind, mm in zip(lit.matter, left, thin, strict=True):
            through = "rays" if max(of_kind) >= least else "none"
            unscattered = (
                f"unscattered: {through} ({_channels(of_kind)} is left behind thin parts of {mm:.3g} mm; "
                f"followed from {100.0 * least:g} % on)"
            )
            named = f"{matter.name or 'the material'}, " if len(lit.matter) > 1 else ""
            sentences += [f"{named}{sentence}" for sentence in (unscattered, *_scattering(lit, matter))]
        return cls(mirrors, bool(clear), (mirror, *sentences, *_clear(lit)))


class PathStages:
    """Makes what rays of sight are traced in, each step only when what it depends on has changed."""

    def __init__(self, stages: Stages, surround: Surround) -> None:
        self._run, self._surround = stages.run, surround

    def of(self, scene: Scene, lit: LitScene, say: Callable[[str], None], *, moves: bool = False) -> Paths | None:
        """Return the rays of sight of a lit scene, at rest or where it `moves`; None where transport follows none."""
        if not lit.quality.facts.follows_sight:
            return None
        mesh, samples = lit.model.mesh, lit.samples
        kinds = samples.faces if lit.bodies is None else kinds_of(lit.bodies.of_face[samples.faces], lit.matter)
        chosen = [slice(None) if len(lit.matter) == 1 else kinds == i for i in range(len(lit.matter))]
        thin = [
            self._run(
                numbered(Stage.THICKNESS, i),
                [mesh, *lit.matter[1:]],
                lambda of_kind=of_kind: thin_part(mesh, samples, of_kind),  # type: ignore[misc]
            )
            for i, of_kind in enumerate(chosen)
        ]
        parts = PathParts.of(scene, lit, thin)
        if not (parts.mirrors or parts.clear):
            return Paths(None, meets_itself=False, why=parts.why)
        # What lamps alone show of an object in its mirror, without rays is at its rims.
        at_rest = not parts.clear and not shines(scene.environment)
        if moves and at_rest:
            return Paths(None, meets_itself=False, why=parts.why, is_drafted=True, at_rest=True)
        say("preparing rays through the object")
        from milkglass.core.paths import Peaks, Tree, most_events

        bodies = None if lit.body_marks is None else lit.bodies
        surface = surface_for_rays(self._run, mesh, bodies, lit.matter, lit.clear)
        around, mirrors, clear = self._surroundings(scene, lit), parts.mirrors, parts.clear
        of_kinds, flights = extinctions(lit), _flights(lit) if parts.clear else []

        def make() -> Tree:
            of_bodies = np.array(surface.absorption)
            of_bodies[: surface.scattering] = np.array(of_kinds)[surface.matter]
            peaks = Peaks.of([flights[kind] for kind in surface.matter], surface) if flights else None
            events = most_events(surface)
            return Tree(surface, of_bodies, around, mirrors=mirrors, clear=clear, events=events, peaks=peaks)

        tree = self._run(Stage.PATHS, [surface, around, *of_kinds, *flights, mirrors, clear], make)
        # What a surface mirrors of itself, and parts within parts, a few rays show and a draft does not.
        is_drafted = at_rest or (clear and not lit.clear and len(lit.matter) == 1)
        return Paths(tree, _meets_itself(lit), parts.why, is_drafted, at_rest)

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


def _meets_itself(lit: LitScene) -> bool:
    """Return whether rays that leave the object meet it again, or come to it through clear parts."""
    return lit.exchange is not None or bool(lit.clear) or len(lit.matter) > 1


def extinctions(lit: LitScene) -> list[tuple[float, ...]]:
    """Return the extinction of light along rays of sight, of R, G and B in each kind of matter, 1/mm: that of beams."""
    if lit.beams is None:
        return [tuple(medium.sigma_t_prime for medium in of_kind.media) for of_kind in lit.matter]
    return [tuple(flight.sigma_t for flight in of_kind) for of_kind in _flights(lit)]


def _flights(lit: LitScene) -> list[tuple[DeltaEddington, ...]]:
    """Return how light of R, G and B crosses each kind of matter; of none where none that scatters is followed."""
    if lit.beams is None:
        return []
    return [tuple(scaled(medium, lit.grid) for medium in of_kind.followed) for of_kind in lit.matter]


def _scattering(lit: LitScene, matter: Matter) -> tuple[str, str, str]:
    """Return sentences on light that scatters once, and more often, and on that which leaves by the surface."""
    media, chord = matter.media, matter.chord
    if not matter.scatters:
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


def thin_part(mesh: Mesh, samples: SurfaceSamples, of_kind: Bools | slice = slice(None)) -> float:
    """Return how thick a mesh is in its thin parts: a quantile of what rays along the normal tell, by area, mm.

    `of_kind` chooses some of the samples.
    """
    areas = np.zeros(len(samples))
    areas[of_kind] = samples.areas[of_kind]
    chosen = np.random.default_rng(0).choice(len(samples), THICKNESS_RAYS, p=areas / areas.sum())
    inwards = -samples.normals[chosen]
    starts = samples.points[chosen] + START * mesh.radius * inwards
    face, distance = mesh.rays.first(starts, inwards)
    met = face >= 0
    return float(np.quantile(distance[met], THIN_QUANTILE)) if met.any() else 2.0 * mesh.radius


def surface_for_rays(
    run: Callable[..., "Surface"],
    mesh: Mesh,
    bodies: Bodies | None,
    matter: Sequence[Matter],
    clear: "tuple[ClearPart, ...]",
) -> "Surface":
    """Return the surface for rays of a mesh, one body or several that scatter light each alone, and of clear parts."""

    def make() -> "Surface":
        from milkglass.core.paths import Surface

        if bodies is None:
            return Surface.of(mesh, matter[0].eta, clear=clear)
        kinds = kinds_of(np.arange(bodies.count, dtype=np.int32), tuple(matter))
        return Surface.of(mesh, np.array([of_kind.eta for of_kind in matter])[kinds], bodies.of_face, clear, kinds)

    etas, ends = tuple(of_kind.eta for of_kind in matter), tuple(of_kind.bodies for of_kind in matter)
    return run(Stage.PATH_SURFACE, [mesh, bodies, etas, ends, clear], make)


def _surroundings(
    environment: EnvironmentSettings, probe: Probe | None, rest: Probe | None, lights: tuple[Light, ...]
) -> "Surroundings":
    from milkglass.core.paths import Surroundings

    lamps = [light.seen() for light in lights]
    if probe is None or rest is None:
        return Surroundings.of(lamps=lamps)
    turn, intensity = environment.rotation_deg, environment.intensity
    return Surroundings.of(probe.latlong, rest.latlong, turn, intensity, lamps, probe.sh)
