"""Beams of a scene's lights through the object, where its matter is clear enough for nodes to resolve free paths."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.ground import SIDE
from milkglass.core.light.probe import Probe
from milkglass.core.paths.resolution import needs_beams, scaled, scatters
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import Matter
from milkglass.viewer.render.ground import Standing
from milkglass.viewer.render.lit_scene import Model
from milkglass.viewer.render.paths import surface_for_rays
from milkglass.viewer.render.sources import Surround, shines
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL
from milkglass.viewer.scene.settings import EnvironmentSettings

if TYPE_CHECKING:  # compiled loops take half a second to import, and most pictures of marble do without
    from milkglass.core.paths.beams import Beams, Emitted
    from milkglass.core.paths.emission import Ball
    from milkglass.core.paths.landing import Landings
    from milkglass.core.paths.surface import ClearPart, Surface

# Of all lights together, onto the object's box. Under Uffizi 20,000 leave mottles where free paths are a few cells,
# 80,000 next to none.
BEAMS, DRAFT_BEAMS = 80_000, 20_000
SUB_LIGHTS = 16  # of a lamp with a size


class BeamStages:
    """Casts the beams of lights, light by light, each only when it or the surface has changed; no material does."""

    def __init__(self, stages: Stages, surround: Surround) -> None:
        self._run, self._surround = stages.run, surround

    def of(
        self, lamps: Sequence[Light], environment: EnvironmentSettings, model: Model, clear: "tuple[ClearPart, ...]",
        bodies: Bodies | None, matter: Sequence[Matter], grid: LayerGrid, *, draft: bool,
    ) -> "Beams | None":  # fmt: skip
        """Return the beams of lamps and an environment, None where no channel needs them; fewer as a `draft`.

        `bodies` are those that scatter alone, `clear` parts of the model that do not.
        """
        if not any(needs_beams(medium, grid) for of_kind in matter for medium in of_kind.followed):
            return None
        from milkglass.core.paths.beams import joined

        run = self._run
        surface, around = self._placed(model, clear, bodies, matter)
        share, count = _shares(lamps, environment, DRAFT_BEAMS if draft else BEAMS)
        parts = [
            run(
                Stage.BEAMS_OF_LIGHT.of(i),
                [surface, light, count],
                lambda light=light: lamp_beams(light, surface, around, count),  # type: ignore[misc]
            )
            for i, light in enumerate(lamps, start=1)
        ]
        if shines(environment):
            rest, turn, factor = self._surround.rest(environment), environment.rotation_deg, environment.intensity
            parts.append(
                run(
                    Stage.BEAMS_AROUND,
                    [surface, rest, turn, factor, share],
                    lambda: probe_beams(rest, turn, factor, surface, around, share),
                )
            )
        return run(Stage.BEAMS, parts, lambda: joined(parts)) if parts else None

    def onto_ground(
        self, standing: Standing | None, model: Model, clear: "tuple[ClearPart, ...]", bodies: Bodies | None,
        matter: Sequence[Matter], grid: LayerGrid, *, draft: bool,
    ) -> Float32 | None:  # fmt: skip
        """Return the irradiance at the places of a plane's map of light that has crossed an object, (n, 3).

        Lamps' light that the object has mirrored is among it, and what has come through clear parts alone. None where
        next to nothing crosses; others as of `of`.
        """
        if standing is None:
            return None
        within = any(needs_beams(medium, grid) for of_kind in matter for medium in of_kind.followed)
        if not (within or clear) and all(scatters(of_kind.media, of_kind.chord) for of_kind in matter):
            return None
        from milkglass.core.paths.landing import landed

        run, plane, environment = self._run, standing.plane, standing.environment
        surface, around = self._placed(model, clear, bodies, matter)
        lamps = *standing.lamps, *standing.strong
        share, count = _shares(lamps, environment, DRAFT_BEAMS if draft else BEAMS)
        extinctions = tuple(
            tuple(scaled(medium, grid).sigma_t if within else medium.sigma_t_prime for medium in of_kind.followed)
            for of_kind in matter
        )

        def of_lamp(light: Light) -> "list[Landings]":
            return [landed(surface, part, plane, of_lamp=True) for part in emitted_by(light, around, count)]

        parts = [
            run(
                Stage.LANDINGS_OF_LIGHT.of(i),
                [surface, plane, light, count],
                lambda light=light: of_lamp(light),  # type: ignore[misc]
            )
            for i, light in enumerate(lamps, start=1)
        ]
        if shines(environment):
            probe, turn, factor = self._surround.rest(environment), environment.rotation_deg, environment.intensity
            parts.append(
                run(
                    Stage.LANDINGS_AROUND,
                    [surface, plane, probe, turn, factor, share],
                    lambda: [landed(surface, emitted_around(probe, turn, factor, around, share), plane, of_lamp=False)],
                )
            )
        return run(
            Stage.LANDED,
            [plane, *extinctions, *parts],
            lambda: sum(
                (ends.irradiance(plane, np.array(extinctions, np.float32)) for part in parts for ends in part),
                np.zeros((SIDE**2, 3), np.float32),
            ),
        )

    def _placed(
        self, model: Model, clear: "tuple[ClearPart, ...]", bodies: Bodies | None, matter: Sequence[Matter]
    ) -> "tuple[Surface, Ball]":
        """Return the surface of a model for rays, and the ball around it that light comes from."""
        from milkglass.core.paths.emission import Ball

        surface = surface_for_rays(self._run, model.mesh, bodies, matter, clear)
        whole, run = model.whole, self._run
        return surface, run(Stage.BALL, [whole], lambda: Ball.around(whole))


def _shares(lamps: Sequence[Light], environment: EnvironmentSettings, beams: int) -> tuple[int, int]:
    """Return how many beams an environment and each lamp have: half for lamps, half for it, where there are both."""
    share = beams // max(bool(lamps) + shines(environment), 1)
    return share, share // max(len(lamps), 1)


def lamp_beams(light: Light, surface: "Surface", around: "Ball", count: int) -> "Beams":
    """Return about `count` beams of a lamp."""
    from milkglass.core.paths.beams import joined, traced

    return joined([traced(surface, part) for part in emitted_by(light, around, count)])


def emitted_by(light: Light, around: "Ball", count: int) -> "list[Emitted]":
    """Return about `count` rays of a lamp, shared out among its sub-lights."""
    from milkglass.core.paths.emission import diverging, parallel

    lights = light.sub_lights(1 if light.is_sharp else SUB_LIGHTS)
    n = len(lights)
    share, colour = count // n, np.array(lights.colour) / n
    if lights.kind == DIRECTIONAL:
        return [parallel(towards, colour, around, share) for towards in lights.vectors]
    return [
        diverging(place, functools.partial(lights.emission, i), colour, around, share)
        for i, place in enumerate(lights.vectors)
    ]


def probe_beams(
    probe: Probe, rotation_deg: float, intensity: float, surface: "Surface", around: "Ball", count: int
) -> "Beams":
    """Return about `count` beams of an environment."""
    from milkglass.core.paths.beams import traced

    return traced(surface, emitted_around(probe, rotation_deg, intensity, around, count))


def emitted_around(probe: Probe, rotation_deg: float, intensity: float, around: "Ball", count: int) -> "Emitted":
    """Return about `count` rays of an environment."""
    from milkglass.core.paths.emission import surrounding

    return surrounding(intensity * probe.latlong, world_to_probe(rotation_deg), around, count)
