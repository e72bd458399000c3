"""Beams of light through an object, as its surface mirrors and refracts them.

They depend on the surface, the lights and the index of refraction alone. Matter attenuates them afterwards, along paths
that are the same for all its coefficients and that no ray is cast for again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from milkglass.core.arrays import Float32, Int32
from milkglass.core.paths.events import EVENTS, Rays, follow
from milkglass.core.paths.surface import Surface


@dataclass(frozen=True, eq=False)
class Emitted:
    """Light on its way to an object, as k rays.

    Attributes
    ----------
    origins, directions : (k, 3) float32
        mm; unit, the way that light travels.
    power : (k, 3) float32
        R, G and B.
    """

    origins: Float32
    directions: Float32
    power: Float32


@dataclass(frozen=True, eq=False)
class Beams:
    """Chords of light that crosses an object, k of them.

    Attributes
    ----------
    starts, ends : (k, 3) float32
        World space, mm.
    lengths, before : (k,) float32
        Of the chord, and of the way inside up to its start, mm.
    power : (k, 3) float32
        R, G and B at the start, without attenuation.
    bodies : (k,) int32
        That they cross.
    """

    starts: Float32
    ends: Float32
    lengths: Float32
    before: Float32
    power: Float32
    bodies: Int32

    def __len__(self) -> int:
        return len(self.lengths)

    def of_body(self, body: int) -> "Beams":
        """Return the chords that cross one body."""
        chosen = self.bodies == body
        return Beams(*(getattr(self, item.name)[chosen] for item in fields(Beams)))


def traced(surface: Surface, light: Emitted) -> Beams:
    """Return the chords of light through the bodies of a surface, absorption and scattering left out."""
    courses = followed(surface, light.origins, light.directions)
    power = light.power[courses.sources] * courses.weights[:, None]
    return Beams(courses.starts, courses.ends, courses.lengths, courses.before, power, courses.bodies)


@dataclass(frozen=True, eq=False)
class Courses:
    """Chords of rays through clear bodies, k of them, ray by event.

    Attributes
    ----------
    starts, ends, lengths, before
        As of `Beams`.
    weights : (k,) float32
        What is left of the ray by what it has met.
    bodies, sources : (k,) int32
        Body that each chord crosses, and its ray.
    """

    starts: Float32
    ends: Float32
    lengths: Float32
    before: Float32
    weights: Float32
    bodies: Int32
    sources: Int32


def followed(surface: Surface, origins: Float32, directions: Float32, met: int = 0, events: int = EVENTS) -> Courses:
    """Return the chords of rays, (n, 3) each, that have `met` the surface so often before, in the order of events.

    Paths end after so many `events`.
    """
    n = len(origins)
    weights, sources, parents = np.ones((n, 1), np.float32), np.arange(n, dtype=np.int32), np.full(n, -1, np.int32)
    rays, clear = (
        Rays(origins, directions, weights, sources, parents),
        np.zeros((len(surface.faces.etas), 1), np.float32),
    )
    parts = []
    travelled = np.zeros(1, np.float32)  # at the end of each chord so far; 0 at last, for those without a parent
    for event in follow(surface, rays, clear, met, events):
        chords = event.chords
        before = travelled[chords.parents]
        travelled = np.concatenate([travelled[:-1], before + chords.lengths, travelled[-1:]])
        placed = chords.starts, chords.ends, chords.lengths, before
        parts.append((*placed, chords.weights[:, 0], chords.bodies, chords.sources))
    return Courses(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def joined(parts: Sequence[Beams]) -> Beams:
    """Return the chords of several lights as one."""
    return Beams(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(Beams)))
