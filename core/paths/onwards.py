"""Light that has scattered once goes on along rays, to where it collides for the second time.

Where matter scatters forward, two moments of what scatters lie about where it goes: by them half as much again as is
true goes on across a beam, collides near the surface, and comes back. Rays are drawn by the whole phase function
instead, and followed as beams are: mirrored and refracted, out of the object and in again.

R, G and B share rays. Beams send as many as they have scatter; where on a chord, and which way, is drawn for one of the
three, and counts for each by its share of the densities with which all three would have drawn it (balance heuristic:
Veach and Guibas 1995). So all rays have one power, however different the channels' free paths.
"""

from collections.abc import Sequence

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.normals import across
from milkglass.core.material.medium import DeltaEddington
from milkglass.core.paths.beams import Beams, followed
from milkglass.core.paths.lobes import density, turned
from milkglass.core.paths.surface import Surface

RAYS = 1 << 16
EVENTS = 16  # that are followed: much of the light is totally reflected, often again and again


def scattered_on(beams: Beams, flights: Sequence[DeltaEddington], used: Sequence[bool], surface: Surface) -> Beams:
    """Return the beams that other beams make by scattering once.

    Parameters
    ----------
    beams : Beams
        Unscattered light in matter of one kind, of which some scatters.
    flights : of R, G and B
    used : of R, G and B
        Whether its light is asked for.
    surface : Surface
        Of matter of that kind, at which they are mirrored and refracted.
    """
    rng, g = np.random.default_rng(0), [flight.g for flight in flights]
    extinction = np.array([flight.sigma_t for flight in flights])
    albedo = np.array([flight.albedo * of for flight, of in zip(flights, used, strict=True)])
    reached = beams.power * np.exp(-extinction * beams.before)
    scattered = albedo * reached * -np.expm1(-extinction * beams.lengths[:, None])
    so_far = np.cumsum(scattered.sum(axis=1))
    places = (np.arange(RAYS) + rng.random(RAYS)) / RAYS * so_far[-1]
    chord = np.searchsorted(so_far, places).clip(0, len(so_far) - 1)
    power, length = scattered[chord], beams.lengths[chord].astype(np.float64)
    channel = _drawn(power, rng)
    collided = -np.expm1(-extinction[channel] * length) * rng.random(RAYS)
    along = np.minimum(-np.log1p(-collided) / extinction[channel], length)
    # Densities along the chord of the channels' power, but for exp(-sigma s) of the least sigma, which all have.
    fall = np.exp(-(extinction - extinction.min()) * along[:, None]) * extinction
    power *= np.divide(fall, -np.expm1(-extinction * length[:, None]), out=np.zeros_like(power), where=power > 0.0)
    cosine = turned(rng.random(RAYS), _drawn(power, rng), g)
    power *= np.stack([density(cosine, of) for of in g], axis=1)
    power *= so_far[-1] / RAYS / power.sum(axis=1, keepdims=True)
    axes = (beams.ends[chord] - beams.starts[chord]) / length[:, None]
    origins, directions = beams.starts[chord] + along[:, None] * axes, _around(axes, cosine, rng)
    courses = followed(surface, origins.astype(np.float32), directions.astype(np.float32), 1, EVENTS, inside=True)
    sent = courses.weights * power.astype(np.float32)[courses.sources]
    placed = courses.starts, courses.ends, courses.lengths, courses.before
    found = Beams(*placed, sent, courses.bodies, surface)
    return found.chosen(courses.bodies < surface.scattering)


def _drawn(power: Array, rng: np.random.Generator) -> Ints:
    """Return a channel for each row of power (n, 3), as often as its share of it, (n,)."""
    so_far = np.cumsum(power, axis=1)
    found: Ints = (rng.random(len(power))[:, None] * so_far[:, -1:] >= so_far).sum(axis=1).clip(0, 2)
    return found


def _around(axes: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Return unit directions at cosines (n,) to unit axes (n, 3), in azimuths all alike."""
    turn, sine = 2.0 * np.pi * rng.random(len(cosine)), np.sqrt(np.maximum(0.0, 1.0 - cosine * cosine))
    first, second = across(axes)
    aside = (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second
    return np.asarray(cosine[:, None] * axes + aside)
