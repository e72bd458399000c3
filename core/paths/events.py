"""Rays that meet the surface of clear or murky matter: mirrored and refracted there, absorbed in between.

At every meeting a ray parts in two, by Fresnel's equations for unpolarised light: F_r of its weight is mirrored and
1 - F_r refracted. A branch whose largest weight falls below `LEAST_WEIGHT` is dropped and its weight given to the other
one, so that no energy is lost; what is mirrored where a path begins is kept whatever its weight. What has met the
surface `EVENTS` times leaves along the refracted branch, or straight on where all is reflected. Rays of sight go on
from there as one branch, drawn with its share as the chance: on average each has its weight, and no more rays are cast.
Inside an outline light is totally reflected again and again, and must go as far round the object as it does; after
`MOST_EVENTS` it ends. Rays that leave are cast again: in a concave object they enter again. To drop a branch is right
where light comes from all around. A lamp in front of an object is seen through it in the branches that inner surfaces
mirror alone, some hundredths of a ray before absorption, and is a hundred times as bright as what the others meet: rays
of sight go on to `LEAST_BEFORE_LAMPS`, the less the more of their light forward peaks have turned.

A ray knows all media that it is in, as the bits of a number. Of several that overlap one is there
(`core.paths.surface`), and a surface where that does not change, or only to one of the same index that scatters no
light either, is passed.

Directions are those of rays, of light or of sight: weights are the same for both. Radiance inside is eta^2 times that
outside; who adds radiance of the inside to a path divides by it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Float32, Int32
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.peaks import Peaks, part_lobe, reflectance, turned
from milkglass.core.paths.surface import Faces, Surface

EVENTS = 12
NESTED_EVENTS = 16  # of media within others: light through a filled glass meets four surfaces at least
MOST_EVENTS = 48  # seen through a smooth blob: ended after 12 1.09 of what paths find, after 24 1.02, from 48 on 1.00
MOST_PASSED = 64  # surfaces between two meetings
LEAST_WEIGHT = 0.015
LEAST_BEFORE_LAMPS = 1e-3  # a mirror at right angles leaves 0.02 of an index of 1.33, 0.04 of 1.5
NEGLIGIBLE_WEIGHT = 1e-4  # of the largest channel: what absorption leaves of both branches, below which both end
SMALLEST_NORMAL = 1e-6  # of interpolated normals: below, opposite ones have cancelled
NONE, ALL = np.float32(0.0), np.float32(1.0)  # of a weight


class Rays(NamedTuple):
    """Rays of n channels of light, k of them.

    Attributes
    ----------
    origins, directions : (k, 3) float32
        mm; unit.
    weights : (k, n) float32
        Of each channel: 1 where the path begins, then what mirrors, refraction and absorption leave of it.
    sources : (k,) int32
        Number of whatever the path began with: a pixel, a beam.
    parents : (k,) int32
        Number of the last chord on its path; -1 for none.
    within : (k,) int32
        Bits of the media that it is in, as far as it has met their surfaces: what it meets next may tell better.
    bodies : (k,) int32
        Body that it entered last, of those that scatter.
    entries : (k,) int32
        Number of the meeting where it was refracted last, see `follow`; -1 for none.
    straight : (k,) float32
        Share of its light that no forward peak has turned.
    lobes : (k, 3) float32
        Of what has been turned, see `core.paths.peaks.turned`.
    leanings : (k, 3) float32
        Its mean direction up to where the ray is met next, unit.
    """

    origins: Float32
    directions: Float32
    weights: Float32
    sources: Int32
    parents: Int32
    within: Int32
    bodies: Int32
    entries: Int32
    straight: Float32
    lobes: Float32
    leanings: Float32

    @classmethod
    def beginning(cls, origins: Float32, directions: Float32, weights: Float32, sources: Int32) -> "Rays":
        """Return rays where their paths begin: in air, or in a body of which they meet the surface next."""
        k = len(origins)
        none, air = np.full(k, -1, np.int32), np.zeros(k, np.int32)
        placed = origins, directions, weights, sources, none, air, np.zeros(k, np.int32), none
        return cls(*placed, np.ones(k, np.float32), np.zeros((k, 3), np.float32), directions)


class Chords(NamedTuple):
    """Straight ways through the inside of a body, k of them.

    Attributes
    ----------
    starts, ends : (k, 3) float32
        mm.
    lengths : (k,) float32
        mm.
    weights : (k, n) float32
        Of each channel at the start, before this chord absorbs.
    bodies, sources, parents, entries : (k,) int32
        Body that it crosses; as of the ray. Chords of one path are numbered from 0 by `follow`, in its order.
    """

    starts: Float32
    ends: Float32
    lengths: Float32
    weights: Float32
    bodies: Int32
    sources: Int32
    parents: Int32
    entries: Int32


class Meetings(NamedTuple):
    """Rays where they meet the surface, k of them.

    Attributes
    ----------
    points, directions : (k, 3) float32
        mm; unit, of the arriving ray.
    normals, planes : (k, 3) float32
        Unit, of the smooth surface and of the face, turned to the side that the ray arrives from.
    weights : (k, n) float32
        As they arrive.
    etas : (k,) float32
        Index of refraction of the side beyond over that of the side that the ray arrives from.
    beyond : (k,) int32
        Body on that side; -1 of air.
    faces : (k,) int32
        Of the surface; -1 where it is not known.
    places : (k, 2) float32
        Weights of the face's second and third corner.
    within, entered : (k,) int32
        Media of the side that it arrives from, and of the side beyond, as of the ray.
    bodies, sources, parents, entries : (k,) int32
        As of the rays that go on.
    straight, lobes : (k,), (k, 3) float32
        As of the arriving rays.
    curvatures : (k,) float32
        Mean curvature of the surface, above 0 where it turns as what goes beyond, 1/mm; 0 without forward peaks.
    """

    points: Float32
    directions: Float32
    normals: Float32
    planes: Float32
    weights: Float32
    etas: Float32
    beyond: Int32
    faces: Int32
    places: Float32
    within: Int32
    entered: Int32
    bodies: Int32
    sources: Int32
    parents: Int32
    entries: Int32
    straight: Float32
    lobes: Float32
    curvatures: Float32


class Event(NamedTuple):
    """What became of rays up to their next meeting with the surface.

    Attributes
    ----------
    chords : Chords
        Those that they crossed.
    meetings : Meetings
        Where they met the surface.
    mirrored : (k,) float32
        Share of the weight that goes on mirrored at each meeting: F_r, or 0 or 1 where a branch was dropped.
    escaped : Rays
        Rays that met nothing any more, or that the last event let go.
    """

    chords: Chords
    meetings: Meetings
    mirrored: Float32
    escaped: Rays


def follow(  # noqa: PLR0913
    surface: Surface,
    rays: Rays,
    extinction: Float32,
    met: int = 0,
    events: int = EVENTS,
    *,
    clear: bool = True,
    enters: bool = True,
    least: float = LEAST_WEIGHT,
    most: int | None = None,
    peaks: Peaks | None = None,
) -> Iterator[Event]:
    """Yield the events of rays until all have escaped; their meetings are numbered from 0, in this order.

    Parameters
    ----------
    surface : Surface
    rays : Rays
    extinction : (b, n) float32
        Of each channel in each body, 1/mm.
    met : int
        How often the rays have met the surface before.
    events : int
        From how many meetings on a path has one branch.
    clear : bool
        Whether rays go on inside; else refracted ones are absorbed at once.
    enters : bool
        Whether rays that leave are cast again, and may enter again.
    least : float
        Weight below which a branch is dropped.
    most : int, optional
        After how many meetings paths end; without, after `events`.
    peaks : Peaks, optional
        By which light of rays is turned on its way; without, none is.
    """
    chord = meeting = 0
    most = events if most is None else most
    for number in range(met + 1, most + 1):
        if len(rays.origins) == 0:
            return
        chords, meetings, escaped = meet(surface, rays, extinction, chord, peaks)
        chord += len(chords.lengths)
        mirrored, refracted, share = part(surface, meetings, number, events, meeting, least, most)
        meeting += len(meetings.points)
        if not clear:
            refracted = none(refracted)
        if number == most:
            escaped, rays = joined(escaped, refracted), mirrored
        else:
            rays = joined(mirrored, refracted)
        if not enters:
            rays = Rays._make(column[rays.within != 0] for column in rays)
        yield Event(chords, meetings, share, escaped)


def meet(
    surface: Surface, rays: Rays, extinction: Float32, chord: int = 0, peaks: Peaks | None = None
) -> tuple[Chords, Meetings, Rays]:
    """Return the chords that rays cross, where they meet the surface next, and those that meet nothing.

    `chord` is the number of the first chord; other arguments as of `follow`.
    """
    chords, met, left = [], [], []
    peaks = Peaks.none() if peaks is None else peaks
    for number in range(MOST_PASSED):
        hits = surface.rays.places(rays.origins, rays.directions)
        crossed, meetings, escaped, rays = _meet(
            rays, hits, surface.faces, extinction, surface.offset, surface.scattering, chord, peaks
        )
        chord += len(crossed.lengths)
        if number == 0 and len(rays.origins) == 0:
            return crossed, meetings, escaped
        chords.append(crossed)
        met.append(meetings)
        left.append(escaped)
        if len(rays.origins) == 0:
            break
    return (
        Chords(*(np.concatenate(column) for column in zip(*chords, strict=True))),
        Meetings(*(np.concatenate(column) for column in zip(*met, strict=True))),
        Rays(*(np.concatenate(column) for column in zip(*left, strict=True))),
    )


def part(
    surface: Surface,
    meetings: Meetings,
    number: int,
    events: int = EVENTS,
    first: int = 0,
    least: float = LEAST_WEIGHT,
    most: int | None = None,
) -> tuple[Rays, Rays, Float32]:
    """Return the mirrored and the refracted rays, and the share that is mirrored, see `Event.mirrored`.

    Parameters
    ----------
    surface : Surface
    meetings : Meetings
    number : int
        Of the event on each path: at 1 the mirrored branch is kept, at `most` all goes on along the refracted one.
    events : int
        From which number on all goes on along one branch, drawn by chance.
    first : int
        Number of the first of the meetings.
    least : float
        Weight below which a branch is dropped.
    most : int, optional
        After how many meetings paths end; without, after `events`.
    """
    return _part(meetings, surface.offset, number, events, events if most is None else most, first, least)


def joined(a: Rays, b: Rays) -> Rays:
    """Return two sets of rays as one."""
    return Rays(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))


def none(rays: Rays) -> Rays:
    """Return no rays, of the channels of others."""
    return Rays._make(column[:0] for column in rays)


def most_events(surface: Surface) -> int:
    """Return after how many meetings with a surface paths end."""
    return NESTED_EVENTS if surface.is_nested else EVENTS


@compiled
def _there(within: int, body: int, surface: Faces) -> int:
    """Return the body that a ray is in which is in some media, and entered a body last; -1 in air."""
    if within == 0:
        return -1
    medium = len(surface.of_media) - 1
    while not within >> medium & 1:
        medium -= 1
    found = int(surface.of_media[medium])
    if found >= 0:
        return found
    return body if surface.media[body] == medium else -1 - found


@compiled
def _meet(
    rays: Rays,
    hits: tuple[Int32, Float32, Float32, Float32],
    surface: Faces,
    extinction: Float32,
    offset: float,
    scattering: int,
    chord: int,
    peaks: Peaks,
) -> tuple[Chords, Meetings, Rays, Rays]:
    hit, distance, second, third = hits
    k, channels = rays.weights.shape
    met = 0
    for i in range(k):
        met += hit[i] >= 0
    points, directions = np.empty((met, 3), np.float32), np.empty((met, 3), np.float32)
    normals, planes = np.empty((met, 3), np.float32), np.empty((met, 3), np.float32)
    weights, etas = np.empty((met, channels), np.float32), np.empty(met, np.float32)
    places, faces, beyond = np.empty((met, 2), np.float32), np.empty(met, np.int32), np.empty(met, np.int32)
    within, entered, bodies = np.empty(met, np.int32), np.empty(met, np.int32), np.empty(met, np.int32)
    sources, parents, entries = np.empty(met, np.int32), np.empty(met, np.int32), np.empty(met, np.int32)
    straight, lobes = np.empty(met, np.float32), np.empty((met, 3), np.float32)
    curvatures = np.zeros(met, np.float32)
    starts, ends = np.empty((met, 3), np.float32), np.empty((met, 3), np.float32)
    lengths, before = np.empty(met, np.float32), np.empty((met, channels), np.float32)
    crossed, chord_sources = np.empty(met, np.int32), np.empty(met, np.int32)
    chord_parents, chord_entries = np.empty(met, np.int32), np.empty(met, np.int32)
    free, passed = np.empty(k - met, np.int64), np.zeros(met, np.bool_)
    j = n = left = went_on = 0
    for i in range(k):
        face = hit[i]
        if face < 0:
            free[left] = i
            left += 1
            continue
        u, v = second[i], third[i]
        a, b, c = surface.corners[face]
        body = surface.bodies[face]
        facing = length = np.float32(0.0)
        for axis in range(3):
            facing += rays.directions[i, axis] * surface.planes[face, axis]
        leaving = facing > 0.0
        # What it meets tells on which side of it the ray has been, whatever of it was met before.
        bit, last = 1 << surface.media[body], rays.bodies[i]
        arriving = rays.within[i] | bit if leaving else rays.within[i] & ~bit
        near_body = _there(arriving, body if leaving and body < scattering else last, surface)
        last = body if body < scattering else last
        far_body = _there(arriving ^ bit, last, surface)
        eta_near = surface.etas[near_body] if near_body >= 0 else np.float32(1.0)
        eta_far = surface.etas[far_body] if far_body >= 0 else np.float32(1.0)
        is_clear = (near_body < 0 or near_body >= scattering) and (far_body < 0 or far_body >= scattering)
        passed[j] = near_body == far_body or (is_clear and eta_near == eta_far)
        went_on += passed[j]
        turn = np.float32(-1.0) if leaving else np.float32(1.0)
        for axis in range(3):
            points[j, axis] = rays.origins[i, axis] + distance[i] * rays.directions[i, axis]
            directions[j, axis] = rays.directions[i, axis]
            planes[j, axis] = turn * surface.planes[face, axis]
            smooth = (
                (1 - u - v) * surface.normals[a, axis] + u * surface.normals[b, axis] + v * surface.normals[c, axis]
            )
            normals[j, axis] = smooth
            length += smooth * smooth
        length = np.sqrt(length)
        facing = np.float32(0.0)
        for axis in range(3):
            normals[j, axis] = normals[j, axis] / length if length > SMALLEST_NORMAL else planes[j, axis]
            facing += normals[j, axis] * directions[j, axis]
        if facing > 0.0:
            for axis in range(3):
                normals[j, axis] = -normals[j, axis]
        for channel in range(channels):
            weights[j, channel] = rays.weights[i, channel]
        parents[j], entries[j] = rays.parents[i], rays.entries[i]
        straight[j], lobes[j] = rays.straight[i], rays.lobes[i]
        if len(peaks.turns) > 0:
            curvatures[j] = -turn * peaks.curvatures[face]
            straight[j] = turned(peaks, near_body, rays.weights[i], distance[i], rays.straight[i], lobes[j])
        if near_body >= 0:
            for axis in range(3):
                starts[n, axis], ends[n, axis] = rays.origins[i, axis], points[j, axis]
            for channel in range(channels):
                before[n, channel] = rays.weights[i, channel]
                weights[j, channel] *= np.exp(-extinction[near_body, channel] * distance[i])
            lengths[n], crossed[n] = distance[i], near_body
            chord_sources[n], chord_parents[n], chord_entries[n] = rays.sources[i], rays.parents[i], rays.entries[i]
            parents[j] = chord + n
            n += 1
        etas[j], beyond[j], faces[j], sources[j] = eta_far / eta_near, far_body, face, rays.sources[i]
        within[j], entered[j], bodies[j] = arriving, arriving ^ bit, last
        places[j, 0], places[j, 1] = u, v
        j += 1
    chords = Chords(
        starts[:n], ends[:n], lengths[:n], before[:n], crossed[:n], chord_sources[:n], chord_parents[:n],
        chord_entries[:n],
    )  # fmt: skip
    escaped = Rays(
        rays.origins[free],
        rays.directions[free],
        rays.weights[free],
        rays.sources[free],
        rays.parents[free],
        rays.within[free],
        rays.bodies[free],
        rays.entries[free],
        rays.straight[free],
        rays.lobes[free],
        rays.leanings[free],
    )
    on = np.flatnonzero(passed)
    through = Rays(
        points[on] - np.float32(offset) * planes[on],
        directions[on],
        weights[on],
        sources[on],
        parents[on],
        entered[on],
        bodies[on],
        entries[on],
        straight[on],
        lobes[on],
        directions[on],
    )
    if went_on > 0:
        at = np.flatnonzero(~passed)
        points, directions, normals, planes, weights = points[at], directions[at], normals[at], planes[at], weights[at]
        etas, beyond, faces, places, within = etas[at], beyond[at], faces[at], places[at], within[at]
        entered, bodies, sources, parents, entries = entered[at], bodies[at], sources[at], parents[at], entries[at]
        straight, lobes, curvatures = straight[at], lobes[at], curvatures[at]
    meetings = Meetings(
        points, directions, normals, planes, weights, etas, beyond, faces, places, within, entered, bodies, sources,
        parents, entries, straight, lobes, curvatures,
    )  # fmt: skip
    return chords, meetings, escaped, through


@compiled
def _part(
    meetings: Meetings, offset: float, number: int, events: int, last: int, first: int, least: float
) -> tuple[Rays, Rays, Float32]:
    k, channels = meetings.weights.shape
    origins, directions = np.empty((2, k, 3), np.float32), np.empty((2, k, 3), np.float32)
    weights = np.empty((2, k, channels), np.float32)
    sources, parents = np.empty((2, k), np.int32), np.empty((2, k), np.int32)
    within, bodies, entries = np.empty((2, k), np.int32), np.empty((2, k), np.int32), np.empty((2, k), np.int32)
    went_on, lobed = np.empty(k, np.float32), np.zeros((2, 4), np.float32)
    straight, lobes = np.ones((2, k), np.float32), np.zeros((2, k, 3), np.float32)
    leanings, leaning = np.empty((2, k, 3), np.float32), np.empty(3, np.float32)
    mirrored, refracted = np.empty(3, np.float32), np.empty(3, np.float32)
    counts = np.zeros(2, np.int64)
    for i in range(k):
        d, normal, plane = meetings.directions[i], meetings.normals[i], meetings.planes[i]
        eta = meetings.etas[i]
        cosine = min(np.float32(1.0), -(d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]))
        sine2 = (np.float32(1.0) - cosine * cosine) / (eta * eta)
        beyond = np.sqrt(max(np.float32(0.0), np.float32(1.0) - sine2))
        share = np.float32(1.0)
        if sine2 < 1.0:
            share = reflectance(cosine, beyond, eta)
        for axis in range(3):
            mirrored[axis] = d[axis] + np.float32(2.0) * cosine * normal[axis]
            refracted[axis] = (d[axis] + cosine * normal[axis]) / eta - beyond * normal[axis]
            if share == 1.0 and sine2 >= 1.0:
                refracted[axis] = d[axis]
        least_of_ray = least
        if meetings.straight[i] < ALL:
            lit, lobe = (meetings.straight[i], share), meetings.lobes[i]
            share = part_lobe(lit, lobe, meetings.curvatures[i], d, normal, eta, refracted, leaning, lobed)
            # By lobes a lamp is no brighter than other surroundings.
            least_of_ray = max(least, min(least / max(meetings.straight[i], LEAST_WEIGHT), LEAST_WEIGHT))
        largest = np.float32(0.0)
        for channel in range(channels):
            largest = max(largest, meetings.weights[i, channel])
        if number < events or number >= last or largest < NEGLIGIBLE_WEIGHT:
            shares = _kept(share, largest, number, last, least_of_ray)
        else:
            shares = (ALL, NONE) if _chance(meetings.points[i]) < share else (NONE, ALL)
        went_on[i] = shares[0]
        for branch in range(2):
            if shares[branch] <= 0.0:
                continue
            out = mirrored if branch == 0 else refracted
            side = np.float32(1.0) if branch == 0 else np.float32(-1.0)
            # A smooth normal may send a ray to the wrong side of the face: it is turned back across the face.
            rising = side * (out[0] * plane[0] + out[1] * plane[1] + out[2] * plane[2])
            turn = np.float32(2.0) * min(rising, np.float32(0.0))
            n = counts[branch]
            size = np.float32(0.0)
            for axis in range(3):
                value = out[axis] - turn * side * plane[axis]
                directions[branch, n, axis] = value
                size += value * value
            size = np.sqrt(size)
            for axis in range(3):
                directions[branch, n, axis] /= size
                origins[branch, n, axis] = meetings.points[i, axis] + side * offset * plane[axis]
            for channel in range(channels):
                weights[branch, n, channel] = shares[branch] * meetings.weights[i, channel]
            sources[branch, n], parents[branch, n] = meetings.sources[i], meetings.parents[i]
            within[branch, n] = meetings.within[i] if branch == 0 else meetings.entered[i]
            bodies[branch, n] = meetings.bodies[i]
            entries[branch, n] = meetings.entries[i] if branch == 0 else first + i
            leanings[branch, n] = directions[branch, n]
            if meetings.straight[i] < ALL:
                straight[branch, n], lobes[branch, n] = lobed[branch, 0], lobed[branch, 1:]
                if branch == 1:
                    leanings[branch, n] = leaning
            counts[branch] = n + 1
    m, r = counts[0], counts[1]
    return (
        Rays(
            origins[0, :m],
            directions[0, :m],
            weights[0, :m],
            sources[0, :m],
            parents[0, :m],
            within[0, :m],
            bodies[0, :m],
            entries[0, :m],
            straight[0, :m],
            lobes[0, :m],
            leanings[0, :m],
        ),
        Rays(
            origins[1, :r],
            directions[1, :r],
            weights[1, :r],
            sources[1, :r],
            parents[1, :r],
            within[1, :r],
            bodies[1, :r],
            entries[1, :r],
            straight[1, :r],
            lobes[1, :r],
            leanings[1, :r],
        ),
        went_on,
    )


@compiled
def _chance(point: Float32) -> float:
    """Return a number of [0, 1) that is evenly spread over points (3,), whatever else is followed beside a ray."""
    turn = 12.9898 * point[0] + 78.233 * point[1] + 37.719 * point[2]
    return float((np.sin(turn) * 43758.5453) % 1.0)


@compiled
def _kept(
    share: np.float32, largest: np.float32, number: int, last: int, least: float
) -> tuple[np.float32, np.float32]:
    """Return the shares of a ray's weight that its mirrored and its refracted branch go on with."""
    if largest < NEGLIGIBLE_WEIGHT:
        return NONE, NONE
    if number == last:
        return NONE, ALL
    if share == ALL:
        return ALL, NONE
    mirrored, refracted = share, ALL - share
    mirror_ends = number > 1 and mirrored * largest < least
    refraction_ends = refracted * largest < least
    if mirror_ends and (mirrored < refracted or not refraction_ends):
        return NONE, ALL
    if refraction_ends:
        return ALL, NONE
    return mirrored, refracted
