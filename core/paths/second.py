"""Light that collides for the next time: its flight inside the object, and what the surface sends back of it.

Power that scatters flies through an unbounded medium, which is right inside (`core.paths.flight`). What arrives at the
surface is gathered along fixed directions from some places of it, of a density mu F_r(mu) as what is reflected there
has, most of it totally. Directions come in pairs, each the mirror image of the other: light that arrives along one
goes back along the other, and on from where that ends, mirrored and refracted as beams are. What leaves is gathered
likewise, along the ways that light from all around would take in.

Where clear parts are around the object, light goes out into them first, by all directions alike, and some of it comes
back, through another place of the surface or mirrored there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Float32, Int32, Ints
from milkglass.core.geometry.normals import about, across
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.fresnel import internal_moment, reflectance, transmittance
from milkglass.core.paths.beams import Beams, Courses, followed
from milkglass.core.paths.deposit import moments
from milkglass.core.paths.events import Chords
from milkglass.core.paths.filled import Filled
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.resolved import Scattered
from milkglass.core.paths.surface import Surface
from milkglass.core.threads import pool_map

AXES = 2, 1, 0  # of volumes, along x, y and z
SIDES = 2  # of a pair of directions
MOST_PLACES = 8000
COSINES = 1024  # of their table
OPAQUE = 100.0  # optical thickness of a mean chord in which light is met once
EVENTS = 16  # that are followed: most of the light that goes back is totally reflected, often again and again
MOST_KEPT = 0.999  # of light from one event to the next


@dataclass(frozen=True, eq=False)
class Returns:
    """Where the surface sends light back into an object, along n directions, the second half mirroring the first.

    Attributes
    ----------
    flux : (n,) float64
        Light that goes on of a unit of radiance that arrives, mm^2 sr.
    arrivals : Chords
        Ways inside along which it arrives, from the surface backwards; of the n rays that go on from there.
    courses : Courses
        Of the n rays.
    is_bare : bool
        Whether no clear parts are around, so that each chord ends where the next one of its path begins.
    """

    flux: Array
    arrivals: Chords
    courses: Courses
    is_bare: bool = True

    def reflected(self) -> float:
        """Return the share of light from all directions alike that comes back, where all directions go on: R1."""
        courses = self.courses
        opaque = OPAQUE / max(float(self.arrivals.lengths.mean()), 1e-30)
        met = np.exp(-opaque * courses.before[:, 0]) * -np.expm1(-opaque * courses.lengths)
        return float(np.sum(self.flux[courses.sources] * courses.weights.mean(axis=1) * met) / np.sum(self.flux))


def returns(
    points: Array, normals: Array, areas: Array, surface: Surface, offset: float, around: Surface | None = None
) -> Returns:
    """Return where a surface sends light back, at most at `MOST_PLACES` of k places.

    Parameters
    ----------
    points, normals : (k, 3) float64
        On faces of the surface, mm; unit, of the faces, outward.
    areas : (k,) float64
        mm^2.
    surface : Surface
    offset : float
        Below the surface at which rays start, mm.
    around : Surface, optional
        The same surface with clear parts around it.
    """
    eta, total = float(surface.faces.etas[0]), float(areas.sum())
    count = min(len(points), MOST_PLACES)
    random = np.random.default_rng(0)
    chosen = _places(areas, count, random)
    cosines = (np.arange(COSINES) + 0.5) / COSINES
    density = np.cumsum(cosines * (reflectance(1.0 / eta, cosines) if around is None else 1.0))
    mu = np.interp(random.random(count), density / max(density[-1], np.finfo(np.float64).tiny), cosines)
    turn = 2.0 * np.pi * random.random(count)
    first, second = across(-normals[chosen])
    sine = np.sqrt(1.0 - mu * mu)
    aside = (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second
    directions = np.concatenate([aside, -aside]) - np.tile(mu[:, None] * normals[chosen], (SIDES, 1))
    places = points[chosen] - offset * normals[chosen]
    if around is not None:
        places = around.below_clear(places, -normals[chosen])
    starts = np.tile(places, (SIDES, 1)).astype(np.float32)
    inwards, number = directions.astype(np.float32), np.arange(SIDES * count)
    if around is None:
        courses = followed(surface, starts, inwards, 1, EVENTS)
        share, onwards = internal_moment(eta, 1), (number + count) % len(number)
    else:
        courses = followed(around, starts, -inwards, 1, EVENTS, inside=True)
        courses = courses.chosen(courses.bodies < around.scattering)
        share, onwards = 1.0, number
    flux = np.full(SIDES * count, np.pi * share * total / (SIDES * count))
    return Returns(flux, _across(surface, starts, inwards, onwards.astype(np.int32)), courses, around is None)


def _places(areas: Array, count: int, random: np.random.Generator) -> Ints:
    """Return `count` of k places of these areas, evenly spread over the surface."""
    along = (np.arange(count) + random.random(count)) / count
    found: Ints = np.searchsorted(np.cumsum(areas) / areas.sum(), along).clip(0, len(areas) - 1)
    return found


def _across(surface: Surface, starts: Float32, directions: Float32, sources: Int32) -> Chords:
    """Return the chords of rays from inside a body to its surface, where they meet that, unattenuated."""
    face, distance = surface.rays.first(starts, directions)
    met = np.flatnonzero(face >= 0)
    lengths = distance[met].astype(np.float32)
    ends, count = starts[met] + lengths[:, None] * directions[met], len(met)
    light, body, no_parent = np.ones((count, 3), np.float32), np.zeros(count, np.int32), np.full(count, -1, np.int32)
    return Chords(starts[met], ends, lengths, light, body, sources[met], no_parent, no_parent)


def exits(points: Array, normals: Array, areas: Array, surface: Surface, offset: float) -> Beams:
    """Return the ways on which light leaves an object: reversed, beams of a radiance of 1 from all around.

    Each ends where it leaves again. Parameters are those of `returns`.
    """
    count, eta, random = min(len(points), MOST_PLACES), float(surface.faces.etas[0]), np.random.default_rng(0)
    chosen = _places(areas, count, random)
    mu, turn = np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    inwards = about(-normals[chosen], np.sqrt(1.0 - (1.0 - mu * mu) / eta**2), turn).astype(np.float32)
    places = (points[chosen] - offset * normals[chosen]).astype(np.float32)
    courses = followed(surface, places, inwards, 1, EVENTS, inside=True, enters=False)
    entering = np.tile(np.pi * areas.sum() / count * transmittance(eta, mu)[:, None], 3).astype(np.float32)
    power = courses.weights * entering[courses.sources]
    return Beams(courses.starts, courses.ends, courses.lengths, courses.before, power, courses.bodies)


def left(
    scattered: Scattered, extinctions: Sequence[float], fill: Filled, out: Beams, grid: LayerGrid, eta: float
) -> Array:
    """Return the power of scattered light that leaves before it collides again, (3,), by its ways `out`."""
    count, thickness = len(out), out.before * np.asarray(extinctions, np.float32)
    number, no_parents = np.arange(count, dtype=np.int32), np.full(count, -1, np.int32)
    most = out.power.max(initial=np.finfo(np.float32).tiny)  # weights of chords are 1 at most
    placed = out.starts, out.ends, out.lengths, out.power / most * np.exp(-thickness)
    found = np.zeros((count, 3), np.float32)
    chords = Chords(*placed, np.zeros_like(out.bodies), number, no_parents, no_parents)
    _glow(scattered, fill, grid).add(chords, np.array([extinctions], np.float32), np.array([eta], np.float32), found)
    return np.asarray(most * found.sum(axis=0, dtype=np.float64))


def _glow(scattered: Scattered, fill: Filled, grid: LayerGrid) -> Glow:
    """Return the radiance a mm of scattered light."""
    scale = np.float32(4.0 * np.pi * grid.texel**3) * fill.weight
    return scattered.glow(grid, lambda _, power: power / scale, directed=scattered.is_directed)


def arriving(
    scattered: Scattered, extinctions: Sequence[float], fill: Filled, back: Returns, grid: LayerGrid
) -> Float32:
    """Return the radiance of scattered light where it arrives at the surface, of the rays that go on, (n, 3)."""
    found = np.zeros((len(back.flux), 3), np.float32)
    glow = _glow(scattered, fill, grid)
    glow.add(back.arrivals, np.array([extinctions], np.float32), np.ones(1, np.float32), found)
    return found


def _without_end(courses: Courses, power: Float32, extinctions: Float32) -> Float32:
    """Return the power of chords with that of the last event for all that would follow.

    In clear matter light may be reflected hundreds of times before it collides. Later events meet less by the ratio of
    the last two.
    """
    last = courses.events == EVENTS
    near = last | (courses.events == EVENTS - 1)
    arrived = power[near] * np.exp(-extinctions * courses.before[near])
    met = arrived * -np.expm1(-extinctions * courses.lengths[near, None])
    of_last = met[last[near]].sum(axis=0, dtype=np.float64)
    ratio = of_last / np.maximum(met.sum(axis=0, dtype=np.float64) - of_last, 1e-30)
    following = np.float32(1.0) / (1.0 - np.minimum(ratio, MOST_KEPT))
    return np.where(last[:, None], power * following.astype(np.float32), power)


def collided_again(
    scattered: Scattered,
    extinctions: Sequence[float],
    fill: Filled,
    back: Returns,
    grid: LayerGrid,
    fly: Callable[[int, Float32], Float32],
    potential: Callable[[int, Float32], Float32],
    directed: Sequence[bool],
) -> Scattered:
    """Return the light that meets matter for the next time, at the nodes; its flux where it is `directed`.

    Parameters
    ----------
    scattered : Scattered
    extinctions : of R, G and B
        1/mm.
    fill : Filled
    back : Returns
    grid : LayerGrid
    fly, potential : callable
        Convolutions of a channel with the kernels of `core.paths.flight`, G_1 and H.
    directed : of R, G and B
    """
    courses, radiance = back.courses, arriving(scattered, extinctions, fill, back, grid)
    sent = (back.flux[:, None] * radiance).astype(np.float32)
    power = courses.weights * sent[courses.sources]
    if back.is_bare:
        power = _without_end(courses, power, np.asarray(extinctions, np.float32))
    beams = Beams(courses.starts, courses.ends, courses.lengths, courses.before, power, courses.bodies)
    returned = moments(beams, extinctions, grid, 4 if any(directed) else 1)

    def met(i: int) -> tuple[Float32 | None, Float32 | None]:
        power, flux = scattered.power[i], scattered.flux[i]
        if power is None:
            return None, None
        arrived = fly(i, power)
        if flux is not None:
            slopes = [np.gradient(part, grid.texel, axis=axis) for part, axis in zip(flux, AXES, strict=True)]
            arrived += potential(i, np.float32(-3.0) * np.sum(slopes, axis=0))
        met = returned[0, i] + fill.share * np.maximum(arrived, np.float32(0.0))
        if not directed[i]:
            return met, None
        drops = np.gradient(potential(i, power), grid.texel)
        return met, returned[1:, i] - fill.share * np.stack([drops[axis] for axis in AXES])

    found = pool_map(met, range(len(scattered.power)))
    return Scattered([power for power, _ in found], [flux for _, flux in found])


def carried_on(flux: Float32, turning: float, fly: Callable[[Float32], Float32], fill: Filled) -> Float32:
    """Return the flux of light that has begun to scatter with a `flux`, and of what of it scatters again and again.

    Of light that goes along w as 3 w . v the flux is v where it comes from, and where it collides next the mean of
    3 w (w . v): taken over all directions that is v again, and so each of its parts flies as power does. Without, what
    scatters forward is next to isotropic from its third collision on. What follows is a geometric series.

    Parameters
    ----------
    flux : (3, n_layers, height, width) float32
        Power times mean direction, along x, y and z.
    turning : float
        What a collision leaves of it, [0, 1/2).
    fly : callable
        Convolution with G_1.
    fill : Filled
    """
    again = np.float32(turning) * fill.share * np.stack([fly(part) for part in flux])
    kept = np.abs(again).sum(dtype=np.float64) / max(np.abs(flux).sum(dtype=np.float64), 1e-30)
    return np.asarray(flux + again / np.float32(1.0 - kept))
