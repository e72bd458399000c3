"""Light that has scattered once goes on along rays, to where it collides for the second time.

Where matter scatters forward, two moments of what scatters lie about where it goes: by them half as much again as is
true goes on across a beam, collides near the surface, and comes back. Rays are drawn by the whole phase function
instead, and followed as beams are: mirrored and refracted, out of the object and in again.

Rays depend on beams and phase functions alone. How far along its way light scatters, of which coefficients tell, is
drawn by 1 / s beyond some length, which is alike for all free paths: whatever these are, the weights that they give
rays are as good as even, with a variance of a quarter of ln(longest way / that length) where light scatters within the
object. So other coefficients cast no ray, and what they change has no noise of its own.

R, G and B share rays. Each weighs them by its own density over that with which they were drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.normals import about
from milkglass.core.material.medium import DeltaEddington
from milkglass.core.paths.beams import Beams, Courses, followed
from milkglass.core.paths.emission import sequence
from milkglass.core.paths.lobes import density, turned
from milkglass.core.paths.surface import Surface

RAYS = 3 << 15
EVENTS = 16  # that are followed: much of the light is totally reflected, often again and again
NEAR = 1.0 / 32.0  # of the beams' mean chord: nodes resolve no free path that is much shorter


@dataclass(frozen=True, eq=False)
class Onwards:
    """Ways on from n places on beams, whatever scatters there.

    Attributes
    ----------
    chords : (n,) int64
        Chord of the beams that each is on.
    travelled : (n,) float64
        From where the beam began to cross matter of this kind, mm.
    cosines : (n,) float64
        Between the beam and the way on.
    odds : (n,) float64
        Reciprocal of the density with which it was drawn, of all n together: mm, over directions all alike.
    courses : Courses
        Of rays from there.
    surface : Surface
        At which they are mirrored and refracted.
    """

    chords: Ints
    travelled: Array
    cosines: Array
    odds: Array
    courses: Courses
    surface: Surface

    def scattered(self, beams: Beams, flights: Sequence[DeltaEddington], used: Sequence[bool]) -> Beams:
        """Return the beams that other beams make by scattering once.

        Parameters
        ----------
        beams : Beams
            Unscattered light in matter of one kind, of which some scatters.
        flights : of R, G and B
        used : of R, G and B
            Whether its light is asked for.
        """
        extinction = np.array([flight.sigma_t for flight in flights])
        scattering = np.array([flight.sigma_s * of for flight, of in zip(flights, used, strict=True)])
        power = beams.power[self.chords] * scattering * np.exp(-extinction * self.travelled[:, None])
        power *= np.stack([density(self.cosines, flight.g) for flight in flights], axis=1) * self.odds[:, None]
        met = np.exp(-extinction * beams.before) * -np.expm1(-extinction * beams.lengths[:, None])
        albedo = np.array([flight.albedo * of for flight, of in zip(flights, used, strict=True)])
        total = albedo * (beams.power * met).sum(axis=0, dtype=np.float64)
        drawn = power.sum(axis=0)
        power *= np.divide(total, drawn, out=np.zeros(3), where=drawn > 0.0)
        courses = self.courses
        placed = courses.starts, courses.ends, courses.lengths, courses.before
        sent = courses.weights * power.astype(np.float32)[courses.sources]
        return Beams(*placed, sent, courses.bodies, self.surface)


def sent_on(beams: Beams, cosines: Sequence[float], surface: Surface) -> Onwards:
    """Return where beams go on from, and how.

    Parameters
    ----------
    beams : Beams
        Unscattered light in matter of one kind.
    cosines : of R, G and B
        Mean cosine of scattering, [0, 1).
    surface : Surface
        Of matter of that kind, at which what goes on is mirrored and refracted.
    """
    light, (u, v, w, t) = beams.emitted.astype(np.float64), sequence(4, RAYS)
    share = light.sum(axis=1)
    near = NEAR * float(share @ beams.lengths) / float(share.sum())
    start = beams.before[:, 0] + near
    so_far = np.cumsum(share * np.log1p(beams.lengths / start))
    places = (np.arange(RAYS) + 0.5) / RAYS * so_far[-1]
    chords = np.searchsorted(so_far, places).clip(0, len(so_far) - 1)
    length, start = beams.lengths[chords].astype(np.float64), start[chords].astype(np.float64)
    along = start * np.expm1(u * np.log1p(length / start))
    turns = turned(v, _drawn(light[chords], w), cosines)
    towards = np.stack([density(turns, g) for g in cosines], axis=1)
    odds = so_far[-1] / RAYS * (start + along) / (light[chords] * towards).sum(axis=1)
    axes = (beams.ends[chords] - beams.starts[chords]) / length[:, None]
    origins, directions = beams.starts[chords] + along[:, None] * axes, about(axes, turns, 2.0 * np.pi * t)
    courses = followed(surface, origins.astype(np.float32), directions.astype(np.float32), 1, EVENTS, inside=True)
    courses = courses.chosen(courses.bodies < surface.scattering)
    return Onwards(chords, start - near + along, turns, odds, courses, surface)


def _drawn(power: Array, random: Array) -> Ints:
    """Return a channel for each row of power (n, 3), as often as its share, by numbers (n,) uniform in [0, 1)."""
    so_far = np.cumsum(power, axis=1)
    found: Ints = (random[:, None] * so_far[:, -1:] >= so_far).sum(axis=1).clip(0, 2)
    return found
