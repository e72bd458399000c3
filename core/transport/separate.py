"""Transport in each body alone: equation (1) summed over a body's own surface, so that no light crosses the air.

Wraps a `core.transport.base.Transport`: each body's samples run through it on the body's own layers
(`core.grid.atlas`), with the body's own area, and what a body computed is kept until something that it depends on
changes. The cost grows with the bodies' boxes together, and where a body is in the dark there is none.
"""

from itertools import pairwise

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.atlas import Atlas
from milkglass.core.profiles.base import Profiles
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import Transport

# Areas are rounded up to this many steps each factor of two, so that alike bodies share padding and kernels.
AREAS_A_DOUBLING = 2


class SeparateTransport:
    """Scatters light in each body of an object alone.

    Parameters
    ----------
    transport : Transport
        Keeps convolvers for all bodies, up to three each.
    bodies : Bodies
    samples : SurfaceSamples
        Made from the faces that `bodies` speaks of.
    """

    def __init__(self, transport: Transport, bodies: Bodies, samples: SurfaceSamples) -> None:
        self._transport = transport
        body = bodies.of_face[samples.faces]
        order = np.argsort(body, kind="stable")
        bounds = np.searchsorted(body[order], np.arange(bodies.count + 1))
        self._samples = [order[start:stop] for start, stop in pairwise(bounds)]
        areas = np.maximum(np.bincount(body, samples.areas, bodies.count), np.finfo(np.float64).tiny)
        self._areas = 2.0 ** (np.ceil(AREAS_A_DOUBLING * np.log2(areas)) / AREAS_A_DOUBLING)
        self._stages = [Stages() for _ in self._samples]

    def exitance(
        self, atlas: Atlas, coordinates: Float32, flux: Float32, profiles: Profiles, stages: Stages
    ) -> Float32:
        """O of every body, in the atlas: (3, *atlas.shape) float32.

        Parameters
        ----------
        atlas : from `core.grid.atlas.fit_atlas`
        coordinates : (n, 3) float32
            Of the samples, in the whole object's grid.
        flux : (n, 3) float32
        profiles : R, G and B
        stages : Stages
            Keeps what the bodies have in common; their steps' times are added to its own.
        """
        places = stages.run(Stage.BODY_SAMPLES, (atlas, coordinates), lambda: self._placed(atlas, coordinates))
        fluxes = stages.run(Stage.BODY_FLUX, (flux,), lambda: [flux[own] for own in self._samples])
        key = places, fluxes, tuple(profiles)
        # Outside of the stage, so that the bodies' steps keep their own times.
        parts = [] if stages.has(Stage.BODIES, key) else self._parts(atlas, places, fluxes, profiles, stages)
        return stages.run(Stage.BODIES, key, lambda: atlas.filled(parts))

    def release(self) -> None:
        """Let go of what the bodies have computed."""
        for own in self._stages:
            own.clear()

    def _placed(self, atlas: Atlas, coordinates: Float32) -> list[Float32]:
        """Coordinates of each body's samples in its own crop; whole nodes off, so no bit is lost."""
        return [
            coordinates[own] - np.asarray(first[::-1], np.float32)
            for own, first in zip(self._samples, atlas.first, strict=True)
        ]

    def _parts(
        self, atlas: Atlas, places: list[Float32], fluxes: list[Float32], profiles: Profiles, stages: Stages
    ) -> list[Float32 | None]:
        parts: list[Float32 | None] = []
        for i, (crop, own) in enumerate(zip(atlas.crops, self._stages, strict=True)):
            if not fluxes[i].any():
                parts.append(None)
                continue
            own.begin()
            area = float(self._areas[i])
            parts.append(self._transport.exitance(crop, places[i], fluxes[i], profiles, area, own))
            for name, milliseconds in own.timings.items():
                stages.timings[name] = stages.timings.get(name, 0.0) + milliseconds
        return parts
