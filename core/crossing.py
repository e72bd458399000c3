"""Light near edges that scatters once and leaves by another face than it came in by.

Diffusion takes what has just entered for isotropic, and spreads all that leaves over z_b, a few mean free paths. On a
smooth surface that evens out. Beside an edge it does not: light that scatters once below one face crosses the other
within half a mean free path, and diffusion has that strip 10 % too dark and what is around it too bright. So this light
is taken out of what diffuses, and added where it leaves:

    M(x) dA = sum over sources S exp(-r) F_t(mu) mu dA / (4 pi r^2),

S = a' E dA' w at a few depths along each refracted ray, r the way from there to x in mean free paths, mu its cosine to
the normal at x. Nothing here is fitted. It is needed where the mean free path is not small against the object, so where
patches are smaller than it; larger ones could not show that strip.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core import fresnel
from core.edges import CELL, Edges, Pieces
from core.entry import Entry
from core.medium import Medium

Array = npt.NDArray[np.float64]

NODES = 3  # depths
FINE, COARSE = 0.5, 1.0  # patches in mean free paths: up to here all of it counts, from here on nothing
MOST = 0.5  # of what a source sends out


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
    counts = float(np.clip((COARSE - edges.spacing / far) / (COARSE - FINE), 0.0, 1.0))
    if counts == 0.0 or not entries:
        return None
    pieces = edges.pieces(far)
    if len(pieces.start) == 0:
        return None
    own, way, chord = _together(len(edges.areas), entries, channel)
    flux, rays, chords = _on_pieces(pieces, own, way, chord)
    depths, weights = np.polynomial.laguerre.laggauss(NODES)
    lit = np.flatnonzero(flux[pieces.start] > 0.0)
    start, end, share = pieces.start[lit], pieces.end[lit], counts * pieces.share[lit]
    arrived, lost = np.zeros(len(pieces.areas)), np.zeros(len(pieces.areas))
    apart, normals, areas = pieces.points[end] - pieces.points[start], pieces.normals[end], pieces.areas[end]
    height = np.einsum("ij,ij->i", apart, normals)  # of the end's plane over the start
    slope = np.einsum("ij,ij->i", rays[start], normals)
    along = np.einsum("ij,ij->i", apart, rays[start])
    apart2 = np.einsum("ij,ij->i", apart, apart)
    critical = np.sqrt(1.0 - 1.0 / medium.eta**2)
    for z, weight in zip(depths * far, weights, strict=True):
        below = height - z * slope
        r2 = np.maximum(apart2 - 2.0 * z * along + z * z, 1e-12)
        inside = (z < chords[start]) & (below < pieces.depth[lit] + far * CELL)
        out = np.flatnonzero(inside & (below > critical * np.sqrt(r2)))
        r, mu = np.sqrt(r2[out]), np.minimum(below[out] / np.sqrt(r2[out]), 1.0)
        seen = mu * areas[out] / (4.0 * np.pi * np.maximum(r2[out], 0.5 * areas[out]))
        crosses = share[out] * seen * np.exp(-r / far) * fresnel.transmittance(1.0 / medium.eta, mu)
        lost += np.bincount(start[out], weight * crosses, len(lost))
        arrived += np.bincount(end[out], flux[start[out]] * weight * crosses, len(lost))
    exitance = pieces.near @ (arrived / pieces.areas)
    gone = pieces.near @ np.minimum(lost, MOST)
    taken, given = float(np.sum(gone * own)), float(np.sum(edges.areas * exitance))
    if given == 0.0:
        return None
    return Crossing(medium.albedo * min(taken / given, 1.0) * exitance, 1.0 - gone)


def _together(n: int, entries: Sequence[Entry], channel: int) -> tuple[Array, Array, Array]:
    """Flux of all lights in one channel, (n,), and sums of it times rays, (n, 3), stretch included, and chords, mm."""
    flux, way, chord = np.zeros(n), np.zeros((n, 3)), np.zeros(n)
    for entry in entries:
        own = entry.flux[:, channel]
        flux[entry.patches] += own
        way[entry.patches] += (entry.stretch * own)[:, None] * entry.rays
        chord[entry.patches] += own * entry.chords
    return flux, way, chord


def _on_pieces(pieces: Pieces, flux: Array, way: Array, chord: Array) -> tuple[Array, Array, Array]:
    """Flux of pieces, (m,), and its mean rays, (m, 3), and chords, (m,)."""
    total = pieces.of @ flux
    over = 1.0 / np.maximum(total, np.finfo(np.float64).tiny)
    return total, (pieces.of @ way) * over[:, None], (pieces.of @ chord) * over
