"""Beams of light through an object, as its surface mirrors and refracts them.

They depend on the surface, the lights and the index of refraction alone. Matter attenuates them afterwards, along paths
that are the same for all its coefficients and that no ray is cast for again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from milkglass.core.arrays import Bools, Float32, Int32
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.events import EVENTS, Event, Rays, follow, most_events
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
    lengths : (k,) float32
        mm.
    before : (k, n) float32
        Way up to its start in each kind of matter that scatters, mm.
    power : (k, 3) float32
        R, G and B at the start, without attenuation there.
    bodies : (k,) int32
        That they cross.
    surface : Surface, optional
        By which they were refracted and mirrored, where that is known.
    lights : (k,) int32, optional
        Of which of several lights each is, ascending.
    unattenuated : (k, 3) float32, optional
        The power without what matter of other kinds has taken, where that is taken off.
    """

    starts: Float32
    ends: Float32
    lengths: Float32
    before: Float32
    power: Float32
    bodies: Int32
    surface: Surface | None = None
    lights: Int32 | None = None
    unattenuated: Float32 | None = None

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def emitted(self) -> Float32:
        """Return the power at the start without any attenuation, (k, 3)."""
        return self.power if self.unattenuated is None else self.unattenuated

    def of_body(self, body: int) -> "Beams":
        """Return the chords that cross one body."""
        return self.chosen(self.bodies == body)

    def chosen(self, chosen: Bools) -> "Beams":
        """Return some of the chords."""
        placed = self.starts[chosen], self.ends[chosen], self.lengths[chosen], self.before[chosen]
        lights = None if self.lights is None else self.lights[chosen]
        emitted = None if self.unattenuated is None else self.unattenuated[chosen]
        return Beams(*placed, self.power[chosen], self.bodies[chosen], self.surface, lights, emitted)

    def by_light(self, most: int) -> "list[Beams]":
        """Return the chords of each light, `most` in all: from the last of them on lights are taken together."""
        if self.lights is None or len(self) == 0:
            return [self]
        lights = np.minimum(self.lights, most - 1)
        return [self.chosen(lights == light) for light in np.unique(lights)]

    def in_matter(self, kind: int, extinctions: Float32) -> "Beams":
        """Return the chords as one kind of matter has them: ways through the others have taken their share.

        `extinctions` are those of each kind for R, G and B, (n, 3) 1/mm.
        """
        if len(extinctions) == 1:
            return self
        elsewhere = np.arange(len(extinctions)) != kind
        power = self.power * np.exp(-(self.before[:, elsewhere] @ extinctions[elsewhere]))
        return replace(self, before=self.before[:, [kind]], power=power, unattenuated=self.emitted)


def traced(surface: Surface, light: Emitted) -> Beams:
    """Return the chords of light through bodies that scatter, what these absorb and scatter left out."""
    courses = followed(surface, light.origins, light.directions, events=most_events(surface))
    power = light.power[courses.sources] * courses.weights
    placed = courses.starts, courses.ends, courses.lengths, courses.before
    beams = Beams(*placed, power, courses.bodies, surface)
    return beams.chosen(beams.bodies < surface.scattering) if surface.is_nested else beams


@dataclass(frozen=True, eq=False)
class Courses:
    """Chords of rays through clear bodies, k of them, ray by event.

    Attributes
    ----------
    starts, ends, lengths, before
        As of `Beams`.
    weights : (k, n) float32
        What is left of the ray by what it has met: of R, G and B where clear parts absorb, else of all light.
    bodies, sources, events : (k,) int32
        Body that each chord crosses, its ray, and the number of the event at its end, ascending.
    """

    starts: Float32
    ends: Float32
    lengths: Float32
    before: Float32
    weights: Float32
    bodies: Int32
    sources: Int32
    events: Int32

    def chosen(self, chosen: Bools) -> "Courses":
        """Return some of the chords."""
        return Courses(*(getattr(self, item.name)[chosen] for item in fields(self)))


def followed(
    surface: Surface,
    origins: Float32,
    directions: Float32,
    met: int = 0,
    events: int = EVENTS,
    *,
    inside: bool = False,
    enters: bool = True,
) -> Courses:
    """Return the chords of rays, (n, 3) each, that have `met` the surface so often before, in the order of events.

    Paths end after so many `events`, and where they leave unless one `enters` again. They begin in air or, if `inside`,
    in the first body.
    """
    parts = []
    tracked = tracked_rays(surface, origins, directions, met, events, inside=inside, enters=enters)
    for number, (event, before, _) in enumerate(tracked, start=met + 1):
        chords = event.chords
        placed = chords.starts, chords.ends, chords.lengths, before
        numbers = np.full(len(before), number, np.int32)
        parts.append((*placed, chords.weights, chords.bodies, chords.sources, numbers))
    return Courses(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def tracked_rays(
    surface: Surface,
    origins: Float32,
    directions: Float32,
    met: int = 0,
    events: int = EVENTS,
    *,
    inside: bool = False,
    enters: bool = True,
) -> Iterator[tuple[Event, Float32, Float32]]:
    """Yield the events of rays that matter which scatters leaves as they are, and how far they have come in it.

    Parameters are those of `followed`. The ways in each of the m kinds of matter that scatter, mm, are up to the starts
    of the event's chords, (k, m), and up to the ends of all chords so far.
    """
    n, absorption = len(origins), surface.absorption if surface.absorption.any() else surface.absorption[:, :1]
    weights = np.ones((n, absorption.shape[1]), np.float32)
    rays = Rays.beginning(origins, directions, weights, np.arange(n, dtype=np.int32))
    if inside:
        rays.within[:] = 1 << surface.faces.media[0]
    travelled, none = np.empty((0, surface.kinds), np.float32), np.full(len(absorption) - surface.scattering, -1)
    kinds = np.concatenate([surface.matter, none]).astype(np.int32)
    for event in follow(surface, rays, np.ascontiguousarray(absorption), met, events, enters=enters):
        chords = event.chords
        before, travelled = _ways_travelled(chords.parents, chords.lengths, kinds[chords.bodies], travelled)
        yield event, before, travelled


@compiled
def _ways_travelled(parents: Int32, lengths: Float32, kinds: Int32, so_far: Float32) -> tuple[Float32, Float32]:
    """Return the ways up to the starts of chords, and to the ends of all; a parent comes before its children."""
    n, m = so_far.shape
    before, travelled = np.zeros((len(lengths), m), np.float32), np.empty((n + len(lengths), m), np.float32)
    travelled[:n] = so_far
    for i in range(len(lengths)):
        if parents[i] >= 0:
            before[i] = travelled[parents[i]]
        travelled[n + i] = before[i]
        if kinds[i] >= 0:
            travelled[n + i, kinds[i]] += lengths[i]
    return before, travelled


def joined(parts: Sequence[Beams]) -> Beams:
    """Return the chords of several lights as one."""
    starts, ends, lengths, before, power = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("starts", "ends", "lengths", "before", "power")
    )
    bodies = np.concatenate([part.bodies for part in parts])
    lights = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    return Beams(starts, ends, lengths, before, power, bodies, parts[0].surface, lights)
