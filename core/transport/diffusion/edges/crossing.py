"""Light near edges that scatters once and leaves by another face than it came in by.

Diffusion takes what has just entered for isotropic, and spreads all that leaves over z_b, a few mean free paths. On a
smooth surface that evens out. Beside an edge it does not: light that scatters once below one face crosses the other
within half a mean free path, and diffusion has that strip 10 % too dark and what is around it too bright. So this light
is taken out of what diffuses, and added where it leaves, as in a wedge of two faces
(`core.transport.diffusion.edges.wedge`). The tables of the wedge are exact; which patches are beside which edge, and
how far, is decided by thresholds chosen by hand (`core.transport.diffusion.edges.pairs`). It matters where the mean
free path is not small against the object, so where patches are smaller than it; larger ones could not show that strip.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.normals import unit
from milkglass.core.material.medium import Medium
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.edges.pairs import Edges, Pairs
from milkglass.core.transport.diffusion.edges.wedge import look_up, wedge
from milkglass.core.transport.diffusion.entry import Entry


@dataclass(frozen=True, eq=False)
class Crossing:
    """What n patches let out of light from other faces, and what of their own is so lost.

    Attributes
    ----------
    exitance : (n,) float64
        M of light that has scattered once.
    kept : (n,) float64
        Share of their own light that diffuses, in (0, 1].
    """

    exitance: Array
    kept: Array


def crossing(edges: Edges, medium: Medium, channel: int, entries: Sequence[Entry]) -> Crossing | None:
    """Follow one channel of all lights over the edges; None where nothing crosses one."""
    far = medium.mean_free_path
    counts = edges.shown(far)
    if counts == 0.0 or not entries:
        return None
    pairs = edges.pairs(far)
    if not pairs:
        return None
    areas = edges.patches.areas
    flux, way = _together(len(areas), entries, medium, channel)
    exitance, lost = np.zeros(len(areas)), np.zeros(len(areas))
    for part, each in pairs:
        seen, gone = _crossed(edges, each, medium, flux, way)
        exitance += counts * part * np.bincount(each.patch, seen, len(areas))
        lost += counts * part * np.bincount(each.patch, gone, len(areas))
    lost = np.minimum(lost, CONSTANTS.edges.largest_loss)
    taken, given = float(np.sum(lost * flux)), float(np.sum(areas * exitance))
    if min(taken, given) <= 0.0:
        return None
    # Both are the same light, but for faces that are no half planes.
    return Crossing(medium.albedo * min(taken / given, 1.0) * exitance, 1.0 - min(given / taken, 1.0) * lost)


def _crossed(edges: Edges, pairs: Pairs, medium: Medium, flux: Array, way: Array) -> tuple[Array, Array]:
    """Exitance that patches have from the faces of pairs, for an albedo of 1, and their own share lost there, (k,)."""
    own, other, cosine = edges.patches.face_normals[pairs.patch], pairs.normals, pairs.cosine
    irradiance = pairs.means @ ((pairs.pieces @ flux) / pairs.areas)
    rays = unit(pairs.means @ ((pairs.pieces @ way) / pairs.areas[:, None])), unit(way[pairs.patch])
    # Components of rays over the edge, away from their own face's normal towards the other's.
    sine = np.sqrt(1.0 - cosine**2)
    in_own, in_other = (np.einsum("kij,ij->ki", np.stack(rays), normals) for normals in (own, other))
    tables, distance = wedge(medium.eta), pairs.distance / medium.mean_free_path
    seen = look_up(tables.exitance, cosine, (in_own[0] - cosine * in_other[0]) / sine, distance)
    gone = look_up(tables.lost, cosine, (in_other[1] - cosine * in_own[1]) / sine, distance)
    return pairs.share * irradiance * seen, pairs.share * gone


def _together(n: int, entries: Sequence[Entry], medium: Medium, channel: int) -> tuple[Array, Array]:
    """Flux of all lights in one channel that meets anything, (n,), and sums of it times the rays, (n, 3)."""
    flux, way = np.zeros(n), np.zeros((n, 3))
    for entry in entries:
        own = entry.flux[:, channel] * -np.expm1(-entry.chords_in(medium))
        flux[entry.patches] += own
        way[entry.patches] += own[:, None] * entry.rays
    return flux, way
