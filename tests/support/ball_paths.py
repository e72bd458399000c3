"""Paths from the eye through a ball that scatters forward: independent of `core.reference` and `core.paths`."""

import numpy as np

from milkglass.core.arrays import Array

SURVIVAL, FAINT = 0.3, 0.1


def seen_halves(sigma_s: float, sigma_a: float, g: float, eta: float, paths: int) -> Array:
    """Return the mean radiance of a ball of radius 1 lit by half of all directions, seen from these or not.

    `sigma_s` is unreduced, by Henyey and Greenstein's phase function. Light goes the way of sight reversed: a path
    along -z that leaves sees the half that it leaves towards, by what is left of its weight.
    """
    rng = np.random.default_rng(7)
    radius = np.sqrt((np.arange(paths) + rng.random(paths)) / paths)
    p = np.stack([radius, np.zeros(paths), np.sqrt(1.0 - radius**2)], axis=1)
    d, w = np.tile([0.0, 0.0, -1.0], (paths, 1)), np.ones(paths)
    seen, extinction, inside = np.zeros(2), sigma_s + sigma_a, False
    while len(w):
        scatters = np.zeros(len(w), bool)
        if inside:
            along = _dot(p, d)
            reach = -along + np.sqrt(np.maximum(0.0, along**2 + 1.0 - _dot(p, p)))
            flight = rng.exponential(1.0 / extinction, len(w))
            scatters = flight < reach
            p = p + np.minimum(flight, reach)[:, None] * d
        normals = (-p if inside else p) / np.linalg.norm(p, axis=1, keepdims=True)
        beyond = 1.0 / eta if inside else eta
        cosine = np.clip(-_dot(d, normals), 1e-9, 1.0)
        after = np.sqrt(np.maximum(0.0, 1.0 - (1.0 - cosine**2) / beyond**2))
        across = (cosine - beyond * after) / (cosine + beyond * after)
        upright = (beyond * cosine - after) / (beyond * cosine + after)
        mirrored = rng.random(len(w)) < np.where(after > 0.0, 0.5 * (across**2 + upright**2), 1.0)
        back = d + 2.0 * cosine[:, None] * normals
        through = (d + cosine[:, None] * normals) / beyond - after[:, None] * normals
        met = np.where(mirrored[:, None], back, through)
        d = np.where(scatters[:, None], _turned(d, g, rng), met)
        w = np.where(scatters, w * sigma_s / extinction, w)
        leaves = ~scatters & ~mirrored if inside else mirrored
        seen += [np.sum(w[leaves & (d[:, 2] >= 0.0)]), np.sum(w[leaves & (d[:, 2] < 0.0)])]
        faint = w < FAINT
        stays = ~leaves & (~faint | (rng.random(len(w)) < SURVIVAL))
        w = np.where(faint, w / SURVIVAL, w)
        p, d, w, inside = p[stays], d[stays], w[stays], True
    return seen / paths


def _turned(d: Array, g: float, rng: np.random.Generator) -> Array:
    """Return directions after scattering."""
    n = len(d)
    ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * rng.random(n))
    cosine = (1.0 + g * g - ratio**2) / (2.0 * g)
    turn, sine = 2.0 * np.pi * rng.random(n), np.sqrt(np.maximum(0.0, 1.0 - cosine**2))
    first = np.cross(d, np.where((np.abs(d[:, 0]) < 0.6)[:, None], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    aside = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(d, first)
    return np.asarray(cosine[:, None] * d + sine[:, None] * aside)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))
