"""What a pixel needs beside the volume to know its own fluence, with its own light: a few small tables.

A pixel solves the equation of `core.transport.diffusion.channel` for its own point, where the volume O and K_L 1 stand
for everything that the nodes carry:

    (rho(0) / (2 A) - b (K_L 1 + k(T))) phi + (f(T) + (b' - 1) k(T)) phi' = O + front E + across E'

with M = phi / (2 A), A that of a flat surface and b as `Boundary.bending` has it. Dashes are the
other side of a slab of thickness T, where the same holds with the sides changed, so that both are known from the light
on both; elsewhere f and k are 0 and `across` does not matter.

On ridges and thin slabs a point has next to nothing of its own, and errors of O would be all that is left of it. So
the two are solved for what phi is more than the neighbourhood's mean, and of that an eigenvalue l of their matrix
is taken as l^3 / (l^4 + WEAK_EIGENVALUE^4), not as 1 / l: 1 % less where l is 1/2, as on smooth surfaces.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.material.refraction import first_scattering, mean_cosine
from milkglass.core.transport.diffusion.boundary import Boundary
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.green import local_green, local_slope
from milkglass.core.transport.diffusion.half_space import gain
from milkglass.core.transport.pixels import LocalTerm, PixelEquation, PixelTables

OnNodes = Callable[[Callable[[Boundary], Float32], int], Float32]

COSINES, THICKNESSES = 16, 48  # rows and columns of the tables
BLACK_DIAGONAL = 1e9  # of a channel that scatters nothing: its M is then 0
LEAST_BENDING = 2e-3  # of b - 1: an object that has less everywhere is taken as flat
WEAK_EIGENVALUE = CONSTANTS.regularisation.weak_eigenvalue
THINNEST = 2e-3  # of the reach
CHORDS = 8.0  # mean free paths: in thicker parts a ray's first scattering knows no other side


def pixel_tables(boundaries: Sequence[Boundary], media: tuple[Medium, ...], s: float, on_nodes: OnNodes) -> PixelTables:
    """Tabulate for surfaces on nodes of one spacing, three media of the same eta and a window of width s, mm.

    Parameters
    ----------
    boundaries : of one object, or of several bodies
    media : R, G and B
    s : float
    on_nodes : callable
        Puts what a function makes of each boundary, so many channels at its nodes, on the nodes of all.
    """
    reach = max((thin_reach(boundary, media) for boundary in boundaries), default=0.0)
    equation = tables(reach, media, s)
    if is_bent(boundaries, media):
        equation = replace(equation, bending=on_nodes(lambda boundary: bending_at_nodes(boundary, media), 3))
    if has_thin_matter(boundaries, media):
        equation = replace(
            equation, concentration=on_nodes(lambda boundary: concentration_at_nodes(boundary, media), 3)
        )
    if reach > 0.0:
        equation = replace(equation, depths=on_nodes(lambda boundary: depths_at_nodes(boundary, reach), 2))
    return PixelTables(LocalTerm(np.zeros((1, 3)), sheet_reach(boundaries)), equation)


def sheet_reach(boundaries: Sequence[Boundary]) -> float:
    """Return the thickness up to which the light behind a thin slab matters, mm; 0 where there are none."""
    return max((boundary.sheet_reach for boundary in boundaries if len(boundary.sheet.patches)), default=0.0)


def is_bent(boundaries: Sequence[Boundary], media: Sequence[Medium]) -> bool:
    """Whether b is other than 1 by more than `LEAST_BENDING` anywhere."""
    bright = [medium for medium in media if not medium.is_black]
    return any(
        np.abs(boundary.bending(medium) - 1.0).max() > LEAST_BENDING for boundary in boundaries for medium in bright
    )


def has_thin_matter(boundaries: Sequence[Boundary], media: Sequence[Medium]) -> bool:
    """Whether light from all around crosses parts without a collision, in any channel that scatters."""
    bright = [medium for medium in media if not medium.is_black]
    return any(boundary.concentration(medium) is not None for boundary in boundaries for medium in bright)


def thin_reach(boundary: Boundary, media: tuple[Medium, ...]) -> float:
    """Return the thickness up to which parts of an object are thin, mm; 0 where none is."""
    bright = [medium.mean_free_path for medium in media if not medium.is_black]
    reach = max([boundary.sheet_reach, *(CHORDS * path for path in bright)])
    thin = bool(np.any((boundary.thickness > 0.0) & (boundary.thickness < reach)))
    return reach if thin else 0.0


def tables(reach: float, media: tuple[Medium, ...], s: float) -> PixelEquation:
    """Tabulate for thicknesses up to `reach`, mm, without `depths` and `bending`."""
    eta, thin = media[0].eta, reach > 0.0
    critical = float(np.sqrt(max(0.0, 1.0 - 1.0 / eta**2)))
    thickness = np.linspace(0.0, reach, THICKNESSES) if thin else np.array([np.inf])
    cosines = np.maximum(np.linspace(critical, 1.0, COSINES), 1e-3)
    zero = np.zeros((COSINES, len(thickness)))
    entering = [_entering(m, s, cosines, thickness) if not m.is_black else (zero, zero) for m in media]
    front, across = zip(*entering, strict=True)
    coupling = np.zeros((len(thickness), 4))
    if thin:
        for i, medium in enumerate(media):
            if not medium.is_black:
                coupling[:, i] = local_green(medium, s, thickness) / (2.0 * medium.extrapolation_factor)
                coupling[:, i] += local_slope(medium, s, thickness)
        coupling[:, 3] = local_slope(NO_ABSORPTION, s, thickness)
    doubled = np.array([2.0 * medium.extrapolation_factor for medium in media])
    diagonal = [
        BLACK_DIAGONAL if m.is_black else float(local_green(m, s, 0.0)) / (2.0 * m.extrapolation_factor) for m in media
    ]
    return PixelEquation(
        reach=reach,
        least_cosine=critical,
        diffuse_cosine=mean_cosine(eta),
        front=np.stack(front, axis=-1).astype(np.float32),
        across=np.stack(across, axis=-1).astype(np.float32),
        coupling=coupling.astype(np.float32),
        diagonal=np.array(diagonal),
        doubled=doubled,
        depths=None,
        bending=None,
        concentration=None,
    )


def mean_fluence(boundary: Boundary, two_A_M: tuple[Array, ...]) -> Float32:
    """Return the area-weighted mean of 2 A M of the patches near each node, (3, n_layers, height, width); 0 without."""
    return boundary.means(np.stack(two_A_M, axis=-1))


def _entering(medium: Medium, s: float, cosines: Array, thickness: Array) -> tuple[Array, Array]:
    """Return a' sum of w rho over the distances of first scattering to either side, by cosine and thickness.

    It is of light times what diffusion lacks of it, as patches have it.
    """
    cosine, thick = np.broadcast_arrays(cosines[:, None], thickness)
    thick = np.where(thick < thickness[-1], thick, np.inf)  # the last column is any
    chords = (thick / cosine / medium.mean_free_path).ravel()
    depths, weights = first_scattering(chords)
    below = depths * medium.mean_free_path * cosine.ravel()[:, None]
    front = np.sum(weights * local_green(medium, s, below), axis=-1)
    left = np.minimum(np.abs(thick.ravel()[:, None] - below), 1e3 * s)
    across = np.sum(weights * local_green(medium, s, left), axis=-1)
    counted = medium.albedo * gain(medium, cosine.ravel(), chords)
    return (counted * front).reshape(cosine.shape), (counted * across).reshape(cosine.shape)


def depths_at_nodes(boundary: Boundary, reach: float) -> Float32:
    """Return `PixelEquation.depths`: thickness and share of a thin slab, spread over the nodes by area.

    Means are of 1 / T, by which a slab stays thin beside parts that are much thicker.
    """
    areas = boundary.patches.areas
    thickness = np.where(boundary.thickness > 0.0, boundary.thickness, reach)
    share = np.zeros(len(areas))
    share[boundary.sheet.patches] = boundary.sheet.share
    inverse = 1.0 / np.clip(thickness, THINNEST * reach, reach)
    total, *sums = (boundary.weights @ (areas * value).astype(np.float32) for value in (1.0, inverse, share))
    near = total > 0.0
    depths = np.zeros((2, len(total)), np.float32)
    depths[0] = 1.0 / reach
    for target, value in zip(depths, sums, strict=True):
        target[near] = value[near] / total[near]
    return depths.reshape(2, *boundary.grid.shape)


def bending_at_nodes(boundary: Boundary, media: Sequence[Medium]) -> Float32:
    """Return `PixelEquation.bending`: harmonic means of b of the patches near each node, by area."""
    return _harmonic_means(boundary, [None if medium.is_black else boundary.bending(medium) for medium in media])


def concentration_at_nodes(boundary: Boundary, media: Sequence[Medium]) -> Float32:
    """Return `PixelEquation.concentration`: harmonic means of that of the patches near each node, by area."""
    return _harmonic_means(boundary, [None if medium.is_black else boundary.concentration(medium) for medium in media])


def _harmonic_means(boundary: Boundary, values: Sequence[Array | None]) -> Float32:
    """Return harmonic means of values of the patches, (n,) each, near each node, less 1; None stands for 1."""
    ones = np.ones(len(boundary.patches))
    inverse = [ones if value is None else 1.0 / value for value in values]
    # Less 1: nodes without a patch near have 0, which is 1.
    return 1.0 / (1.0 + boundary.means(np.stack(inverse, axis=-1) - 1.0)) - 1.0
