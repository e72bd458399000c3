"""The phase function of Henyey and Greenstein (1941), as walks draw from it."""

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.normals import across

ISOTROPIC = 1e-3  # mean cosine below which a phase function has no direction


def henyey_greenstein(random: Array, g: Array | float) -> Array:
    """Return cosines between directions before and after scattering, of numbers uniform in [0, 1) and mean cosines."""
    uneven = np.abs(g) > ISOTROPIC
    safe = np.where(uneven, g, 1.0)
    ratio = (1.0 - safe**2) / (1.0 - safe + 2.0 * safe * random)
    return np.where(uneven, np.clip((1.0 + safe**2 - ratio**2) / (2.0 * safe), -1.0, 1.0), 2.0 * random - 1.0)


def phase(cosine: Array, g: Array | float) -> Array:
    """Return the density of a cosine, over that of scattering alike in all directions."""
    return np.asarray((1.0 - np.square(g)) / (1.0 + np.square(g) - 2.0 * g * cosine) ** 1.5)


def turned(directions: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Return unit directions, (n, 3), at cosines (n,) to others, in azimuths all alike."""
    turn, sine = 2.0 * np.pi * rng.random(len(cosine)), np.sqrt(np.maximum(0.0, 1.0 - cosine**2))
    first, second = across(directions)
    found = (
        cosine[:, None] * directions + (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second
    )
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))
