"""Built-in vessels with what is in them, turned about +y: a tumbler and a bottle of glass, each with a liquid.

The liquid reaches a little into the glass, so that no air is between them; glass, of less volume, is what is there
(`core.paths.surface`). Lengths are mm of the object as it is made; a scene scales it.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh

GLASS, LIQUID = "glass", "liquid"
TURNS = 160  # vertices around
LONGEST = 4.0  # mm, of a straight piece of a profile
ARC = 12  # vertices of a rounded corner of a right angle
REACH = 0.4  # of the liquid into the glass, mm
Corner = tuple[float, float, float]  # radius and height of a profile's corner, and how far it is rounded, mm


def tumbler() -> dict[str, Mesh]:
    """Return a tumbler, 95 high, its wall 2.5 and its base 9 thick, with 66 of liquid, by the names of its parts."""
    glass = (
        (0.0, 0.0, 0.0), (33.0, 0.0, 2.5), (38.5, 95.0, 1.2), (36.0, 95.0, 1.2), (31.0, 9.0, 9.0), (0.0, 9.0, 0.0),
    )  # fmt: skip
    wall = _at(glass[3], glass[4])
    return {GLASS: lathe(_rounded(glass)), LIQUID: lathe(_rounded(_poured(wall, glass[4], 75.0, 9.0)))}


def bottle() -> dict[str, Mesh]:
    """Return a bottle with a long neck, 240 high, its wall 3 thick, filled up to the shoulder, by its parts' names."""
    outside = (
        (0.0, 2.0, 0.0), (14.0, 2.0, 8.0), (22.0, 0.0, 4.0), (31.0, 0.0, 5.0), (31.0, 145.0, 45.0), (13.5, 178.0, 45.0),
        (12.5, 226.0, 1.0), (14.5, 228.0, 1.0), (14.5, 240.0, 2.5),
    )  # fmt: skip
    inside = (
        (9.5, 240.0, 2.0), (9.8, 178.0, 48.0), (28.0, 144.0, 42.0), (28.0, 6.0, 7.0), (12.0, 7.0, 12.0), (0.0, 7.0, 0.0)
    )  # fmt: skip
    liquid = (
        (0.0, 7.0 - REACH, 0.0), (12.0, 7.0 - REACH, 12.0), (28.0 + REACH, 6.0 - REACH, 7.0),
        (28.0 + REACH, 144.0, 42.0), (9.8 + REACH, 178.0, 48.0), (9.7 + REACH, 201.2, 0.0), (8.6, 200.2, 3.0),
        (6.0, 200.0, 3.0), (0.0, 200.0, 0.0),
    )  # fmt: skip
    return {GLASS: lathe(_rounded((*outside, *inside))), LIQUID: lathe(_rounded(liquid))}


VESSELS: Mapping[str, Callable[[], dict[str, Mesh]]] = {"tumbler": tumbler, "bottle": bottle}


def lathe(profile: Array) -> Mesh:
    """Return the closed surface of a profile turned about +y.

    Parameters
    ----------
    profile : (n, 2)
        Radius and height, from the axis to the axis, the inside to the left; smooth, but for the axis.
    """
    along = np.diff(profile, axis=0)
    sides = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    outward = np.concatenate([sides[:1], sides[:-1] + sides[1:], sides[-1:]])
    outward[[0, -1]] *= (0.0, 1.0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    angles = 2.0 * np.pi * np.arange(TURNS) / TURNS
    ring = np.column_stack([np.sin(angles), np.cos(angles)])

    def turned(values: Array) -> Array:
        """Return radial and axial parts, (n, 2), around the axis: its two ends, then ring by ring."""
        radial = values[1:-1, None, :1] * ring
        axial = np.broadcast_to(values[1:-1, None, 1], radial.shape[:2])
        around = np.stack([radial[..., 0], axial, radial[..., 1]], axis=-1).reshape(-1, 3)
        ends = np.array([[0.0, values[0, 1], 0.0], [0.0, values[-1, 1], 0.0]])
        return np.concatenate([ends, around])

    rings = 2 + np.arange(len(profile) - 2)[:, None] * TURNS + np.arange(TURNS)
    following = np.roll(rings, -1, axis=1)
    low, high = (rings[:-1], following[:-1]), (rings[1:], following[1:])
    quads = [np.stack([low[0], low[1], high[1]], axis=-1), np.stack([low[0], high[1], high[0]], axis=-1)]
    first = np.stack([np.zeros(TURNS, int), following[0], rings[0]], axis=-1)
    last = np.stack([np.ones(TURNS, int), rings[-1], following[-1]], axis=-1)
    faces = np.concatenate([first, *(quad.reshape(-1, 3) for quad in quads), last])
    return Mesh.of(turned(profile), turned(outward), faces)


def _poured(wall: Callable[[float], float], foot: Corner, level: float, rounding: float) -> tuple[Corner, ...]:
    """Return the profile of a liquid in a vessel up to a level, with the meniscus that creeps up its wall."""
    bottom = foot[1] - REACH
    return (
        (0.0, bottom, 0.0), (wall(bottom) + REACH, bottom, rounding), (wall(level + 1.6) + REACH, level + 1.6, 0.0),
        (wall(level) - 1.0, level + 0.35, 2.0), (wall(level) - 4.5, level, 6.0), (0.0, level, 0.0),
    )  # fmt: skip


def _at(upper: Corner, lower: Corner) -> Callable[[float], float]:
    """Return the radius of a straight wall over height."""
    return lambda height: float(np.interp(height, [lower[1], upper[1]], [lower[0], upper[0]]))


def _rounded(corners: Sequence[Corner]) -> Array:
    """Return the profile of corners with roundings, as points no further apart than `LONGEST`, (n, 2)."""
    places, found = np.array([corner[:2] for corner in corners]), [np.array([corners[0][:2]])]
    for i in range(1, len(corners) - 1):
        found.append(_arc(places[i - 1], places[i], places[i + 1], corners[i][2]))
    points = np.concatenate([*found, places[-1:]])
    pieces = []
    for start, end in pairwise(points):
        count = max(int(np.ceil(np.linalg.norm(end - start) / LONGEST)), 1)
        pieces.append(start + np.arange(count)[:, None] / count * (end - start))
    return np.concatenate([*pieces, points[-1:]])


def _arc(before: Array, corner: Array, after: Array, rounding: float) -> Array:
    """Return the points of a corner rounded by an arc, of that radius or what its sides have room for."""
    back, on = before - corner, after - corner
    lengths = np.linalg.norm([back, on], axis=1)
    back, on = back / lengths[0], on / lengths[1]
    turn = np.pi - np.arccos(np.clip(back @ on, -1.0, 1.0))
    if rounding <= 0.0 or turn < 1e-6:
        return corner[None]
    reach = min(rounding * float(np.tan(0.5 * turn)), 0.49 * float(lengths.min()))
    radius = reach / np.tan(0.5 * turn)
    middle = (back + on) / np.linalg.norm(back + on)
    centre = corner + np.hypot(radius, reach) * middle
    start, end = corner + reach * back - centre, corner + reach * on - centre
    count = max(int(np.ceil(ARC * turn / (0.5 * np.pi))), 2)
    along = np.linspace(0.0, 1.0, count + 1)[:, None]
    return np.asarray(centre + (np.sin((1.0 - along) * turn) * start + np.sin(along * turn) * end) / np.sin(turn))
