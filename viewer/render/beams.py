"""Beams of a scene's lights through the object, where its matter is clear enough for nodes to resolve free paths."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from milkglass.core.geometry.bodies import Bodies
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.light.probe import Probe
from milkglass.core.material.medium import Medium
from milkglass.core.paths.resolution import needs_beams
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.render.lit_scene import Model
from milkglass.viewer.render.paths import surface_of
from milkglass.viewer.render.sources import Surround, shines
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL
from milkglass.viewer.scene.settings import EnvironmentSettings

if TYPE_CHECKING:  # compiled loops take half a second to import, and most pictures of marble do without
    from milkglass.core.paths.beams import Beams
    from milkglass.core.paths.emission import Ball
    from milkglass.core.paths.surface import ClearPart, Surface

# Of all lights together. Under Uffizi 30,000 leave mottles where free paths are a few cells, 120,000 next to none.
BEAMS, DRAFT_BEAMS = 120_000, 30_000
SUB_LIGHTS = 16  # of a lamp with a size


class BeamStages:
    """Casts the beams of lights, light by light, each only when it or the surface has changed; no material does."""

    def __init__(self, stages: Stages, surround: Surround) -> None:
        self._run, self._surround = stages.run, surround

    def of(
        self, lamps: Sequence[Light], environment: EnvironmentSettings, model: Model, clear: "tuple[ClearPart, ...]",
        bodies: Bodies | None, media: Sequence[Medium], grid: LayerGrid, *, draft: bool,
    ) -> "Beams | None":  # fmt: skip
        """Return the beams of lamps and an environment, None where no channel needs them; fewer as a `draft`.

        `bodies` are those that scatter alone, `clear` parts of the model that do not.
        """
        if not any(needs_beams(medium, grid) for medium in media):
            return None
        from milkglass.core.paths.beams import joined
        from milkglass.core.paths.emission import Ball

        run, eta, mesh, whole = self._run, media[0].eta, model.mesh, model.whole
        surface = run(Stage.PATH_SURFACE, [mesh, bodies, eta, clear], lambda: surface_of(mesh, bodies, eta, clear))
        around = run(Stage.BALL, [whole], lambda: Ball.around(whole))
        # Half for lamps, half for what comes from all around, where there are both.
        share = (DRAFT_BEAMS if draft else BEAMS) // max(bool(lamps) + shines(environment), 1)
        count = share // max(len(lamps), 1)
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


def lamp_beams(light: Light, surface: "Surface", around: "Ball", count: int) -> "Beams":
    """Return about `count` beams of a lamp, shared out among its sub-lights."""
    from milkglass.core.paths.beams import joined, traced
    from milkglass.core.paths.emission import diverging, parallel

    lights = light.sub_lights(1 if light.is_sharp else SUB_LIGHTS)
    n = len(lights)
    share, colour = count // n, np.array(lights.colour) / n
    if lights.kind == DIRECTIONAL:
        emitted = [parallel(towards, colour, around, share) for towards in lights.vectors]
    else:
        emitted = [
            diverging(place, functools.partial(lights.emission, i), colour, around, share)
            for i, place in enumerate(lights.vectors)
        ]
    return joined([traced(surface, part) for part in emitted])


def probe_beams(
    probe: Probe, rotation_deg: float, intensity: float, surface: "Surface", around: "Ball", count: int
) -> "Beams":
    """Return `count` beams of an environment."""
    from milkglass.core.paths.beams import traced
    from milkglass.core.paths.emission import surrounding

    return traced(surface, surrounding(intensity * probe.latlong, world_to_probe(rotation_deg), around, count))
