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
    """Light that leaves n patches after one scattering, having entered by another face.

    Attributes
    ----------
    exitance : (n,) float64
        M of that light.
    kept : (n,) float64
        Share of the light that enters a patch and does not leave so but diffuses, in (0, 1].
    """

    exitance: Array
    kept: Array


def crossing(edges: Edges, medium: Medium, channel: int, entries: Sequence[Entry]) -> Crossing | None:
    """Return the light of all lights that crosses edges in one channel; None where there is none."""
    resolved = edges.resolved(medium.mean_free_path)
    if resolved == 0.0 or not entries:
        return None
    weighted_pairs = edges.pairs(medium.mean_free_path)
    if not weighted_pairs:
        return None
    areas = edges.patches.areas
    flux, directions = _flux_and_directions(len(areas), entries, medium, channel)
    exitance, lost = np.zeros(len(areas)), np.zeros(len(areas))
    for weight, pairs in weighted_pairs:
        gain, loss = _crossed(edges, pairs, medium, flux, directions)
        exitance += resolved * weight * np.bincount(pairs.patch, gain, len(areas))
        lost += resolved * weight * np.bincount(pairs.patch, loss, len(areas))
    lost = np.minimum(lost, CONSTANTS.edges.largest_loss)
    removed, added = float(np.sum(lost * flux)), float(np.sum(areas * exitance))
    if min(removed, added) <= 0.0:
        return None
    # Both are the same light, but where faces are not half planes: the lesser of the two is moved.
    return Crossing(medium.albedo * min(removed / added, 1.0) * exitance, 1.0 - min(added / removed, 1.0) * lost)


def _crossed(edges: Edges, pairs: Pairs, medium: Medium, flux: Array, directions: Array) -> tuple[Array, Array]:
    """Return exitance that patches have from other faces, for an albedo of 1, and shares lost there, (k,) each."""
    face, partner, cosine = edges.patches.face_normals[pairs.patch], pairs.normals, pairs.cosine
    irradiance = pairs.means @ ((pairs.pieces @ flux) / pairs.areas)
    of_pieces = (pairs.pieces @ directions) / pairs.areas[:, None]
    rays = unit(pairs.means @ of_pieces), unit(directions[pairs.patch])
    # Slopes v: components of the rays over the edge, within the plane of the face that they entered by.
    sine = np.sqrt(1.0 - cosine**2)
    in_face, in_other = (np.einsum("kij,ij->ki", np.stack(rays), normals) for normals in (face, partner))
    tables, distance = wedge(medium.eta), pairs.distance / medium.mean_free_path
    gain = look_up(tables.exitance, cosine, (in_face[0] - cosine * in_other[0]) / sine, distance)
    loss = look_up(tables.lost, cosine, (in_other[1] - cosine * in_face[1]) / sine, distance)
    return pairs.share * irradiance * gain, pairs.share * loss


def _flux_and_directions(n: int, entries: Sequence[Entry], medium: Medium, channel: int) -> tuple[Array, Array]:
    """Return the flux of all lights that scatters, (n,), and its sum times the rays' unit directions, (n, 3)."""
    flux, directions = np.zeros(n), np.zeros((n, 3))
    for entry in entries:
        scattering = entry.flux[:, channel] * -np.expm1(-entry.chords_in(medium))
        flux[entry.patches] += scattering
        directions[entry.patches] += scattering[:, None] * entry.rays
    return flux, directions
