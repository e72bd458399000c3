"""Trees of rays from the eye: what the surface mirrors, what is seen through the object, and what glows inside it.

The first meeting with the surface is known, from the picture's G-buffer. From there on rays part and are cast again
(`core.paths.events`), and the radiance of a pixel is the sum over all branches of

    what leaves the object:            w L_surround(d)
    every chord inside:                w (1 / eta^2) int S(x) e^(-s_t' s) ds
    ... in the channels that have no S:   w (1 - e^(-s_t' l)) M / (e pi T)

with w the branch's weight, S the radiance that a mm scatters (`core.paths.glow`), M the exitance of the surface where
the path was refracted into the object last, T its mean transmittance, and e the share of light from all around that
collides below it before it leaves. A sheet that is thin along a ray sends out as little as it lets through, and in all
directions together M; where nothing comes through it is F_t M / (pi T). In even light, without absorption, M = e pi T,
and all branches add up to 1. An object is seen in its own mirror and through its clear parts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Float32, Int32, Ints
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.events import (
    EVENTS,
    LEAST_BEFORE_LAMPS,
    LEAST_WEIGHT,
    MOST_EVENTS,
    Chords,
    Event,
    Meetings,
    Rays,
    follow,
    joined,
    meet,
    none,
    part,
)
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.peaks import Peaks
from milkglass.core.paths.surface import Faces, Surface
from milkglass.core.paths.surroundings import Surroundings
from milkglass.core.threads import pool_map

BATCH = 16384  # rays of sight at a time: a tenth of a second
SHARES = 8  # batches of fewer rays, so that all threads have some
LEAST_BATCH = 1024


class PathsSuperseded(Exception):  # noqa: N818  (not an error)
    """Raised where paths are not wanted any longer."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Where k rays of sight meet the object first.

    Attributes
    ----------
    points, normals : (k, 3) float32
        mm; unit, outward, of the smooth surface.
    directions : (k, 3) float32
        Unit, from the eye.
    bodies : (k,) int32
        As of `core.paths.surface.Faces`.
    """

    points: Float32
    normals: Float32
    directions: Float32
    bodies: Int32

    def part(self, chosen: slice | Ints) -> "Sight":
        """Return a part of the rays."""
        return Sight(self.points[chosen], self.normals[chosen], self.directions[chosen], self.bodies[chosen])


class Seen(NamedTuple):
    """Radiance of k rays of sight, (k, 3) float32 each.

    Attributes
    ----------
    mirror : (k, 3)
        All that the first mirror shows, but for lamps that are drawn as highlights.
    unscattered : (k, 3)
        Surroundings by way of the inside.
    scattered : (k, 3)
        By way of the inside, its glow, and what matter lets out where the path enters it again.
    collided : (k, 3)
        No radiance, but the share of the ray's weight that is refracted where it meets the object first and collides
        before it leaves.
    """

    mirror: Float32
    unscattered: Float32
    scattered: Float32
    collided: Float32


class Inside(NamedTuple):
    """What rays show that the surface has refracted where they met it first.

    Attributes
    ----------
    unscattered : bool
        Whether they show the surroundings.
    glows : tuple of Glow
        What they gather.
    leaving : bool
        Whether they show the surface's exitance.
    """

    unscattered: bool
    glows: tuple[Glow, ...]
    leaving: bool

    @property
    def is_dark(self) -> bool:
        """Whether they show nothing."""
        return not (self.unscattered or self.leaving or self.glows)


class Surfaces(NamedTuple):
    """Where k rays enter matter from outside it.

    Attributes
    ----------
    sources : (k,) int32
        2 n of what ray of sight n has mirrored first, 2 n + 1 of what it has refracted.
    faces : (k,) int32
    places : (k, 2) float32
        Weights of the face's second and third corner.
    weights : (k, 3) float32
        Of each channel, what of the ray enters and collides before it leaves.
    """

    sources: Int32
    faces: Int32
    places: Float32
    weights: Float32

    @classmethod
    def none(cls) -> "Surfaces":
        """Return no meetings."""
        number = np.zeros(0, np.int32)
        return cls(number, number, np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32))


class Found(NamedTuple):
    """What rays of sight found, but for the surface's exitance where they met it.

    Attributes
    ----------
    seen : Seen
    met : Surfaces
        Where they met it.
    """

    seen: Seen
    met: Surfaces


Leaving = Callable[[Ints], Float32]


@dataclass(frozen=True, eq=False)
class Tree:
    """What trees of rays are traced in; compared by identity.

    Attributes
    ----------
    surface : Surface
    extinction : (b, 3) float32
        s_t' of each body, absorption of each clear part, 1/mm.
    surroundings : Surroundings
    glows : tuple of Glow
        Of each kind of matter that has any.
    leaving : callable, optional
        Gives M / (e pi T) at vertices of the surface, (m, 3) float32, for their numbers, (m,): those that rays meet; at
        those of a clear part what matter has that it touches. It is called in the thread that `lit` is called in.
    mirrors, clear : bool
        Whether rays go on that are mirrored first, and those inside; else the latter are absorbed.
    events : int
        From how many meetings with the surface on a path has one branch.
    inside : Inside, optional
        What refracted rays show, where that is not all; mirrored ones show all.
    peaks : Peaks, optional
        Forward peaks that `extinction` leaves out.
    """

    surface: Surface
    extinction: Float32
    surroundings: Surroundings
    glows: tuple[Glow, ...] = ()
    leaving: Leaving | None = None
    mirrors: bool = True
    clear: bool = True
    events: int = EVENTS
    inside: Inside | None = None
    peaks: Peaks | None = None

    def sight(self, origins: Float32, directions: Float32) -> tuple[Int32, Sight]:
        """Return which of k rays from the eye, (k, 3) each, meet the object, and where they meet it first."""
        k = len(origins)
        rays = Rays.beginning(origins, directions, np.ones((k, 3), np.float32), np.arange(k, dtype=np.int32))
        _, met, _ = meet(self.surface, rays, self.extinction)
        outside = np.flatnonzero(met.beyond >= 0)
        return met.sources[outside], Sight(met.points, met.normals, met.directions, met.beyond).part(outside)

    def trace(self, sight: Sight) -> Seen:
        """Return the radiance of rays of sight."""
        return self.lit(self.find(sight))

    def find(self, sight: Sight, go_on: Callable[[], bool] = lambda: True, highlights: float = np.inf) -> Found:
        """Follow rays of sight, in the threads of the pool, as `lit` wants them.

        Lamps up to a radius of `highlights` are left out of the first mirror, see `Surroundings.add`; by default all.

        Raises
        ------
        PathsSuperseded
            If `go_on`, which is asked before every batch and after every event of it, says no.
        """
        k = len(sight.points)
        size = min(max(-(-k // SHARES), LEAST_BATCH), BATCH)
        seen = Seen(*(np.empty((k, 3), np.float32) for _ in Seen._fields))

        def trace(start: int) -> list[Surfaces]:
            if not go_on():  # of a batch that has waited for a thread
                raise PathsSuperseded
            batch, met = slice(start, start + size), list[Surfaces]()
            for values, of_batch in zip(
                seen, self._trace(sight.part(batch), start, met, go_on, highlights), strict=True
            ):
                values[batch] = of_batch
            return met

        parts = [Surfaces.none(), *(part for met in pool_map(trace, range(0, k, size)) for part in met)]
        return Found(seen, Surfaces(*(np.concatenate(column) for column in zip(*parts, strict=True))))

    def lit(self, found: Found) -> Seen:
        """Return the radiance of rays of sight that have been followed, which takes the place of what was found."""
        seen, met = found
        if self.leaving is None or len(met.sources) == 0:
            return seen
        corners = self.surface.faces.corners[met.faces]
        used = np.zeros(len(self.surface.faces.vertices), bool)
        used[corners] = True
        leaving, number = self.leaving(np.flatnonzero(used)), np.cumsum(used, dtype=np.int32) - np.int32(1)
        _add_between(met, number[corners], leaving, seen.mirror, seen.scattered)
        return seen

    def _trace(
        self, sight: Sight, start: int, met: list[Surfaces], go_on: Callable[[], bool], highlights: float
    ) -> Seen:
        """Return what rays see, numbered from `start`, but for matter that they enter again: that `met` has then."""
        surface, faces = self.surface, self.surface.faces
        inside = self.inside or Inside(unscattered=True, glows=self.glows, leaving=True)
        refracts = self.clear and not inside.is_dark
        first = _first(sight, faces, surface.scattering)
        mirrored, refracted, _ = part(surface, first, 1, self.events)
        rays = _numbered(mirrored if self.mirrors else none(mirrored), refracted if refracts else none(refracted))
        unscattered, scattered = np.zeros((2, 2 * len(first.points), 3), np.float32)
        collided, entered = np.zeros((len(first.points), 3), np.float32), [Surfaces.none()]
        crossed = list[Chords]()
        # A dropped mirror gives its weight to what the surface lets out: too much, where lamps leave the rest dark.
        least = LEAST_BEFORE_LAMPS if self.surroundings.has_lamps else LEAST_WEIGHT
        events = follow(
            surface, rays, self.extinction, 1, self.events, clear=self.clear, least=least, most=MOST_EVENTS,
            peaks=self.peaks,
        )  # fmt: skip
        for number, event in enumerate(events):
            if not go_on():
                raise PathsSuperseded
            self.surroundings.add(event.escaped, unscattered, int(number == 0), highlights)
            for glows, chords in self._gathered(event.chords):
                for glow in glows:
                    glow.add(chords, self.extinction, faces.etas[: surface.scattering], scattered)
            crossed.append(event.chords)
            if self.leaving is not None:
                entered.append(_entering(event, surface.scattering, start, collides=not self.clear))
        again = Surfaces(*(np.concatenate(column) for column in zip(*entered, strict=True)))
        for chords in crossed:
            _add_collided(chords, self.extinction, surface.scattering, collided, again.weights)
        used = again.weights.any(axis=1) & (inside.leaving | (again.sources % 2 == 0))
        met.append(Surfaces(*(column[used] for column in again)))
        if not inside.unscattered:
            unscattered[1::2] = 0.0
        return Seen(unscattered[0::2] + scattered[0::2], unscattered[1::2], scattered[1::2], collided)

    def _gathered(self, chords: Chords) -> list[tuple[tuple[Glow, ...], Chords]]:
        """Return which glows the chords of mirrored and of refracted rays gather, all together where they are alike."""
        if self.inside is None or self.inside.glows is self.glows:
            return [(self.glows, chords)]
        mirrored = chords.sources % 2 == 0
        of_mirrored, of_refracted = (Chords(*(of[chosen] for of in chords)) for chosen in (mirrored, ~mirrored))
        return [(self.glows, of_mirrored), (self.inside.glows, of_refracted)]


def _first(sight: Sight, faces: Faces, scattering: int) -> Meetings:
    """Return the first meetings of rays of sight, which come through air, numbered from 0."""
    points, directions = np.array(sight.points, np.float32), np.array(sight.directions, np.float32)
    k = len(points)
    # At outlines a smooth normal may face away. Turned round it would have rays start inside the object; mirrored
    # across the ray it keeps its cosine, by which pixels have what the surface lets out.
    away = np.maximum(np.einsum("ij,ij->i", sight.normals, directions), 0.0)
    normals = sight.normals - 2.0 * away[:, None] * directions
    return Meetings(
        points=points,
        directions=directions,
        normals=normals,
        planes=normals,
        weights=np.ones((k, 3), np.float32),
        etas=faces.etas[sight.bodies],
        beyond=np.array(sight.bodies, np.int32),
        faces=np.full(k, -1, np.int32),
        places=np.zeros((k, 2), np.float32),
        within=np.zeros(k, np.int32),
        entered=np.left_shift(1, faces.media[sight.bodies], dtype=np.int32),
        bodies=np.where(sight.bodies < scattering, sight.bodies, 0).astype(np.int32),
        sources=np.arange(k, dtype=np.int32),
        parents=np.full(k, -1, np.int32),
        entries=np.full(k, -1, np.int32),
        straight=np.ones(k, np.float32),
        lobes=np.zeros((k, 3), np.float32),
        curvatures=np.zeros(k, np.float32),
    )


def _numbered(mirrored: Rays, refracted: Rays) -> Rays:
    """Return both branches with sources 2 n of mirrored and 2 n + 1 of refracted rays, n those before."""
    sources = np.concatenate([2 * mirrored.sources, 2 * refracted.sources + 1])
    both = joined(mirrored, refracted)
    return both._replace(sources=sources, entries=np.full(len(sources), -1, np.int32))


def _entering(event: Event, scattering: int, start: int, *, collides: bool) -> Surfaces:
    """Return the meetings of an event, of sources 2 n and 2 n + 1 of ray `start` + n.

    Weights are what enters bodies that scatter, where all of that `collides` at once; else they are yet 0.
    """
    met = event.meetings
    enters = (met.beyond >= 0) & (met.beyond < scattering) & collides
    refracted = np.where(enters, np.float32(1.0) - event.mirrored, np.float32(0.0))
    return Surfaces(met.sources + np.int32(2 * start), met.faces, met.places, met.weights * refracted[:, None])


@compiled
def _add_collided(chords: Chords, extinction: Float32, scattering: int, first: Float32, entering: Float32) -> None:
    """Add what collides on chords in bodies that scatter to where it entered: where seen first, or at a meeting."""
    for i in range(len(chords.lengths)):
        body, ray, entry = chords.bodies[i], chords.sources[i], chords.entries[i]
        if body >= scattering or entry >= len(entering):
            continue
        for channel in range(3):
            lost = -np.expm1(-extinction[body, channel] * chords.lengths[i]) * chords.weights[i, channel]
            if entry >= 0:
                entering[entry, channel] += lost
            elif ray % 2 == 1:
                first[ray // 2, channel] += lost


@compiled
def _add_between(met: Surfaces, corners: Int32, leaving: Float32, mirror: Float32, scattered: Float32) -> None:
    for i in range(len(corners)):
        ray, (a, b, c), (u, v) = met.sources[i] // 2, corners[i], met.places[i]
        for channel in range(3):
            value = (1 - u - v) * leaving[a, channel] + u * leaving[b, channel] + v * leaving[c, channel]
            if met.sources[i] % 2 == 0:
                mirror[ray, channel] += met.weights[i, channel] * value
            else:
                scattered[ray, channel] += met.weights[i, channel] * value
