"""Light probes with small bright spots, and random directions."""

import numpy as np

from milkglass.core.light import probe as env

HEIGHT = 256
SPOTS = (((0.3, 0.6, -0.5), 1.5, (30000.0, 25000.0, 18000.0)), ((-0.8, 0.2, 0.3), 8.0, (20.0, 60.0, 90.0)))


def directions(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


def sky(*spots, height=HEIGHT, level=0.5):
    """A constant sky with discs in it, each (direction, diameter in degrees, radiance)."""
    pixels = np.full((height, 2 * height, 3), level, np.float32)
    towards, _ = env.solid_angles(pixels)
    for direction, angle, radiance in spots:
        inside = towards @ unit(*direction) > np.cos(np.radians(0.5 * angle))
        pixels.reshape(-1, 3)[inside] = radiance
    return pixels
