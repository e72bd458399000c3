"""Refraction into an object, and the first scattering along the refracted ray as two point sources.

Light that has entered scatters first at a depth z, in mean free paths, of density exp(-z); a share a' of it goes on.
Two Gauss nodes stand for that density on [0, chord], so that in thin parts no source lies outside, and the weights
leave out exactly the light that crosses without scattering, exp(-chord).
"""

import functools

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel

LONGEST_CHORD = 60.0  # mean free paths: beyond, exp(-z) has ended
TABLE_SIZE = 2048  # of Gauss rules over the chord


def refract(directions: npt.ArrayLike, normals: npt.ArrayLike, eta: float) -> Array:
    """Return unit directions inside, (n, 3), of light along unit `directions` (n, 3) at outward unit normals (n, 3).

    Light from behind a normal, as an interpolated normal may have it, is taken to graze. `eta` is inside over outside.
    """
    d, n = np.asarray(directions, np.float64), np.asarray(normals, np.float64)
    mu = np.maximum(-np.einsum("ij,ij->i", np.broadcast_to(d, n.shape), n), 0.0)
    c = np.sqrt(1.0 - (1.0 - mu * mu) / eta**2)
    w = d / eta + (mu / eta - c)[:, None] * n
    return np.asarray(w / np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-12))


@functools.cache
def mean_cosine(eta: float) -> float:
    """Return the mean cosine to the normal, inside, of diffuse light that has entered: its depth over its length."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    t = 0.5 * (nodes + 1.0)
    mu = t * t  # F_t rises steeply near grazing incidence
    entering = weights * t * mu * fresnel.transmittance(eta, mu)
    return float(np.sum(entering * np.sqrt(1.0 - (1.0 - mu * mu) / eta**2)) / np.sum(entering))


def first_scattering(chord: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the two-point Gauss rule of exp(-z) on [0, chord], chord (n,) >= 0 in mean free paths, inf allowed.

    Returns
    -------
    depths, weights : (n, 2) float64
        Depths in mean free paths; weights sum to 1 - exp(-chord).
    """
    chord = np.clip(np.asarray(chord, np.float64), 0.0, LONGEST_CHORD)
    at, table = _table()
    bounded = chord / (1.0 + chord)
    steps = bounded * ((TABLE_SIZE - 1) / at[-1])
    first_step = np.minimum(steps.astype(np.int64), TABLE_SIZE - 2)
    rest = (steps - first_step)[:, None]
    shares = (1.0 - rest) * table[first_step] + rest * table[first_step + 1]
    depths = shares[..., :2] * bounded[..., None]
    first = shares[..., 2] * -np.expm1(-chord)
    return depths, np.stack([first, -np.expm1(-chord) - first], axis=-1)


@functools.cache
def _table() -> tuple[Array, Array]:
    """Return x = chord / (1 + chord), (n,) for n of TABLE_SIZE; both depths / x and the first node's share, (n, 3)."""
    at = np.linspace(0.0, LONGEST_CHORD / (1.0 + LONGEST_CHORD), TABLE_SIZE)
    chord = np.maximum(at / (1.0 - at), 1e-6)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    # Half of the nodes on [0, chord]'s first mean free paths: the density is steep where the chord is long.
    z = chord[:, None] * (0.5 * (nodes + 1.0)) ** 3
    density = weights * 3.0 * (0.5 * (nodes + 1.0)) ** 2 * np.exp(-z)
    density /= density.sum(axis=1, keepdims=True)
    mean = np.sum(density * z, axis=1)
    off = z - mean[:, None]
    variance, third = (np.sum(density * off**power, axis=1) for power in (2, 3))
    skew = 0.5 * third / variance
    root = np.sqrt(skew * skew + variance)  # nodes: the roots of t^2 - (third / variance) t - variance
    lower, upper = skew - root, skew + root
    bounded = chord / (1.0 + chord)
    return at, np.stack([(mean + lower) / bounded, (mean + upper) / bounded, upper / (upper - lower)], axis=1)
