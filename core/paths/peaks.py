"""Light that forward peaks turn on its way, which delta-Eddington counts as unscattered: rays that carry a lobe.

Turns are many and small: what is seen by them is blurred, and what the surface would reflect totally for ever leaves. A
ray stands for light about it, as in cone tracing (Amanatides 1984). After a way l a share e^(-s_f l) has not been
turned, and all together have the mean cosine e^(-s_f (1 - p) l), with s_f the scattering by the peak and p the peak's
mean cosine: e^(-v) is that of a Gaussian of variance v along each axis across, as heat spreads on the sphere, so that v
grows by s_f (1 - p) a mm. Light that has been turned has left the ray, too. With q its distance from it, along each
axis, u its angle and <u u> = v, after a way l

    <q u>' = <q u> + v l + s_f (1 - p) l^2 / 2,    <q q>' = <q q> + 2 <q u> l + v l^2 + s_f (1 - p) l^3 / 3

(Fermi; Eyges 1948). At a surface of mean curvature k it comes in at an angle that differs by u - k q from the ray's:
F_r is a mean over these, and what is refracted leans from the ray to its mean direction, wider or narrower, turned by
k q with the normal. What is mirrored keeps its lobe: a concave mirror that focuses as well would have it grow from one
to the next, beyond what first order tells. R, G and B share rays, which turn by the mean of s_f over what they carry.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.material.medium import DeltaEddington
from milkglass.core.paths.compiled import compiled
from milkglass.core.paths.lobes import peak_cosine
from milkglass.core.paths.surface import Faces, Surface

MOST_VARIANCE = 1.0  # of a lobe: wider ones are as good as even
LEAST_VARIANCE = 1e-6
DEVIATIONS = 3.0  # up to which a lobe's angles count
NODES = 16  # over these
LEAST_SHARE = 1e-6  # of a branch


class Peaks(NamedTuple):
    """Forward peaks of the bodies that scatter, and how their surfaces are curved.

    Attributes
    ----------
    turns : (b, n) float32
        s_f of each of n channels in each of b bodies, 1/mm; no rows where no body has any.
    falls : (b, n) float32
        s_f (1 - p), 1/mm.
    curvatures : (m,) float32
        Mean curvature of each face of the surface, above 0 where it is convex, 1/mm.
    """

    turns: Float32
    falls: Float32
    curvatures: Float32

    @classmethod
    def none(cls) -> "Peaks":
        """Return the peaks of matter that has none."""
        return cls(np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), np.zeros(0, np.float32))

    @classmethod
    def of(cls, flights: Sequence[Sequence[DeltaEddington]], surface: Surface) -> "Peaks":
        """Return the peaks without which light crosses bodies, of R, G and B each."""
        turns = np.array([[flight.peak for flight in of_body] for of_body in flights])
        if not turns.any():
            return cls.none()
        falls = turns * [[1.0 - peak_cosine(flight.g) for flight in of_body] for of_body in flights]
        return cls(turns.astype(np.float32), falls.astype(np.float32), _curvatures(surface.faces))


def _curvatures(faces: Faces) -> Float32:
    """Return half the divergence of the smooth normals on each face."""
    a, b, c = (faces.vertices[column].astype(np.float64) for column in faces.corners.T)
    normal, second, third = (faces.normals[column].astype(np.float64) for column in faces.corners.T)
    across = np.cross(b - a, c - a)
    change = (second - normal) * np.cross(c - a, across) + (third - normal) * np.cross(across, b - a)
    twice = np.maximum(np.einsum("ij,ij->i", across, across), np.finfo(np.float32).tiny)
    return np.asarray(0.5 * change.sum(axis=1) / twice, np.float32)


@compiled
def turned(peaks: Peaks, body: int, weights: Float32, length: float, straight: np.float32, lobe: Float32) -> np.float32:
    """Return the share of a ray that has not been turned after a way through a body or air, and widen its lobe.

    Parameters
    ----------
    peaks : Peaks
    body : int
        -1 of air.
    weights : (n,) float32
        Of each channel where the way starts.
    length : float
        mm.
    straight : float
        Share at the start.
    lobe : (3,) float32
        v, <q u> and <q q> of what has been turned, with lengths in mm.
    """
    total = turns = falls = 0.0
    if 0 <= body < len(peaks.turns):
        for channel in range(len(weights)):
            total += weights[channel]
            turns += weights[channel] * peaks.turns[body, channel]
            falls += weights[channel] * peaks.falls[body, channel]
    before, left, fall = 1.0 - straight, float(straight), 0.0
    if turns > 0.0:
        left, fall = straight * np.exp(-turns / total * length), falls / total
    if left == 1.0:
        return straight
    # Moments of all light grow; what has been turned has them all.
    variance, both, place = lobe
    lobe[0] = (before * variance + fall * length) / (1.0 - left)
    lobe[1] = (before * (both + variance * length) + fall * length**2 / 2.0) / (1.0 - left)
    wider = place + 2.0 * both * length + variance * length**2
    lobe[2] = (before * wider + fall * length**3 / 3.0) / (1.0 - left)
    return np.float32(left)


@compiled
def reflectance(cosine: np.float32, beyond: np.float32, eta: np.float32) -> np.float32:
    """Return F_r of unpolarised light by its cosines before a surface and beyond, and the index beyond over before."""
    across = (cosine - eta * beyond) / max(cosine + eta * beyond, np.float32(1e-20))
    along = (eta * cosine - beyond) / max(eta * cosine + beyond, np.float32(1e-20))
    return np.float32(0.5) * (across * across + along * along)


@compiled
def part_lobe(  # noqa: PLR0913
    lit: tuple[np.float32, np.float32],
    lobe: Float32,
    curvature: float,
    direction: Float32,
    normal: Float32,
    eta: np.float32,
    refracted: Float32,
    leaning: Float32,
    branches: Float32,
) -> np.float32:
    """Return the share of a ray that a surface mirrors.

    Parameters
    ----------
    lit : (float, float)
        Share of its light that has not been turned, and F_r of that.
    lobe : (3,) float32
        As of `turned`.
    curvature : float
        Mean curvature, above 0 where the surface turns as what goes beyond, 1/mm.
    direction, normal : (3,) float32
        Unit, the normal towards where the ray comes from.
    eta : float
        Index of refraction beyond over that before.
    refracted : (3,) float32
        Unit way on of what has not been turned, replaced by that of what has where it is reflected totally.
    leaning : (3,) float32
        Filled with the mean way on of what has been turned, unit.
    branches : (2, 4) float32
        Filled with the share that has not been turned, and the lobe, of what is mirrored and of what is refracted.
    """
    straight, share = lit
    facing = min(max(-float(direction[0] * normal[0] + direction[1] * normal[1] + direction[2] * normal[2]), 0.0), 1.0)
    variance, both, place = lobe
    meeting = max(float(variance - 2.0 * curvature * both + curvature**2 * place), LEAST_VARIANCE)
    counted = min(meeting, MOST_VARIANCE)
    passed, along, down = _through(np.arccos(facing), counted, float(eta))
    on, off = float(straight * (1.0 - share)), float(1.0 - straight) * passed
    mirrored = 1.0 - on - off
    branches[0, 0], branches[0, 1:], branches[1, 1:] = straight * share / max(mirrored, LEAST_SHARE), lobe, lobe
    leaning[:] = refracted
    if on + off < LEAST_SHARE:
        return np.float32(1.0)
    branches[1, 0] = on / (on + off)
    if passed > LEAST_SHARE:
        # Of what is refracted the mean way is as long as its mean cosine: how much wider that is than what came.
        mean = min(float(np.hypot(along, down)) / passed, 1.0)
        gain = float(np.sqrt(-np.log(mean) / counted))
        apart = both - curvature * place
        wider = curvature**2 * place + 2.0 * gain * curvature * apart + gain**2 * meeting
        kept = min(MOST_VARIANCE / max(wider, LEAST_VARIANCE), 1.0)
        branches[1, 1] = max(kept * wider, LEAST_VARIANCE)
        branches[1, 2], branches[1, 3] = kept * (curvature * place + gain * apart), kept * place
    sine, size = max(np.sqrt(1.0 - facing * facing), LEAST_SHARE), max(np.hypot(along, down), 1e-20)
    for axis in range(3):
        if passed > LEAST_SHARE:
            flat = (direction[axis] + facing * normal[axis]) / sine
            leaning[axis] = (along * flat - down * normal[axis]) / size
        if on <= 0.0:
            refracted[axis] = leaning[axis]
    return np.float32(mirrored)


@compiled
def _through(angle: float, variance: float, eta: float) -> tuple[float, float, float]:
    """Return the share of a lobe about an angle of incidence that a surface lets through, and the mean of its way.

    That is along the surface and down through it, each times the share. Angles across the plane of incidence make all
    cosines smaller.
    """
    width, smaller = np.sqrt(variance), np.exp(-0.5 * variance)
    critical = np.sqrt(max(1.0 - eta * eta, 0.0)) / smaller
    last = min(angle + DEVIATIONS * width, np.arccos(min(critical, 1.0)))
    first = max(angle - DEVIATIONS * width, -last)
    passed = along = down = 0.0
    if last <= first:
        return passed, along, down
    for i in range(NODES):
        # Closer to the last angle, where what passes begins like a square root.
        t = (i + 0.5) / NODES
        at = last - (last - first) * t * t
        density = np.exp(-0.5 * ((at - angle) / width) ** 2) / (np.sqrt(2.0 * np.pi) * width)
        cosine = np.cos(at) * smaller
        beyond = np.sqrt(max(1.0 - (1.0 - cosine * cosine) / (eta * eta), 0.0))
        through = density * (1.0 - reflectance(np.float32(cosine), np.float32(beyond), np.float32(eta)))
        through *= 2.0 * t * (last - first) / NODES
        passed += through
        along += through * np.sin(at) * smaller / eta
        down += through * beyond
    return min(passed, 1.0), along, down
