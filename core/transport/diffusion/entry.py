"""Sources of diffusion: light refracted into the object, light by light, and its first scattering along the rays.

Q lies where light first scatters, exp(-z) along the refracted ray, not on the surface; along the normal instead of the
ray the exitance of a sphere would be off by 6 to 14 %.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array, csr_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import tsc_matrix
from milkglass.core.material.fresnel import reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering, mean_cosine, refract
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.green import SMALLEST_ATTENUATION, LocalParts
from milkglass.core.transport.diffusion.half_space import gain

LEAST_REFLECTED = 0.05  # F_r above which reflection inside is followed; it is less near normal incidence
LEAST_RETURNED = 1e-3  # share of a ray's light above which reflection inside is followed


@dataclass(frozen=True, eq=False)
class Entry:
    """One light inside the object, on the m patches that it reaches.

    Attributes
    ----------
    patches : (m,) int
        Indices of the patches.
    rays : (m, 3) float64
        Unit directions inside.
    stretch : float
        Factor on depths along the rays: the mean cosine of diffuse light, whose ray is the normal; else 1.
    cosines : (m,) float64
        Between the rays and the normals inwards, times `stretch`.
    chords : (m,) float64
        Along the rays to the surface, mm.
    flux : (m, 3) float64
        E dA of R, G and B, F_t included.
    second : Second
        The rays that are reflected inside.
    """

    patches: npt.NDArray[np.intp]
    rays: Array
    stretch: float
    cosines: Array
    chords: Array
    flux: Array
    second: "Second"

    @property
    def diffuse(self) -> bool:
        """Whether the light comes from all around."""
        return self.stretch != 1.0

    def chords_in(self, medium: Medium) -> Array:
        """Return the chords in mean free paths, (m,), along the light's true direction."""
        return self.chords / (self.stretch * medium.mean_free_path)

    def gain(self, medium: Medium) -> Array:
        """Return the factor on the light by what diffusion lacks of it, (m,)."""
        return gain(medium, self.cosines, self.chords_in(medium))


@dataclass(frozen=True, eq=False)
class Second:
    """The k rays of an entry that are reflected where they meet the surface again, with light that never scattered.

    Attributes
    ----------
    rays : (k,) int
        Indices of the entry's rays.
    starts, directions : (k, 3) float64
        Points of reflection, mm, and unit reflected directions.
    chords : (k,) float64
        Along the reflected ray to the surface, mm.
    reflected : (k,) float64
        F_r.
    """

    rays: npt.NDArray[np.intp]
    starts: Array
    directions: Array
    chords: Array
    reflected: Array


def enter(light: EnteringLight, boundary: Boundary, depths: Depths, eta: float, around: Entry | None = None) -> Entry:
    """Return a light refracted into the patches that it reaches.

    `eta` is the relative index, >= 1; `around` any light from all around, whose rays another such light has too.
    """
    patches = boundary.patches
    flux = (patches.sums @ light.flux).astype(np.float64)
    if around is not None and light.direction is None and light.position is None:
        return replace(around, flux=flux[around.patches])
    lit = np.flatnonzero(flux.any(axis=1))
    normals, stretch = patches.normals[lit], 1.0
    if light.direction is not None:
        rays = refract(np.broadcast_to(light.direction, normals.shape), normals, eta)
    elif light.position is not None:
        path = patches.points[lit] - np.asarray(light.position)
        rays = refract(path / np.maximum(np.linalg.norm(path, axis=1, keepdims=True), 1e-12), normals, eta)
    else:
        rays, stretch = -normals, mean_cosine(eta)
    cosines = -stretch * np.einsum("ij,ij->i", rays, normals)
    cell = boundary.grid.texel
    chords, outward = depths.ends(patches, lit, rays, cell)
    met = np.einsum("ij,ij->i", rays, outward)
    reflected = reflectance(1.0 / eta, stretch * met)
    mirrored = np.flatnonzero((chords > 0.0) & (met > 0.0) & (reflected > LEAST_REFLECTED))
    starts = patches.on_surface[lit[mirrored]] + chords[mirrored, None] * rays[mirrored]
    onwards = rays[mirrored] - 2.0 * met[mirrored, None] * outward[mirrored]
    second_chords = depths.onwards(starts, outward[mirrored], onwards, cell)
    second = Second(mirrored, starts, onwards, second_chords, reflected[mirrored])
    return Entry(lit, rays, stretch, cosines, chords, flux[lit], second)


@dataclass(frozen=True, eq=False)
class Scattering:
    """First scattering of a light in a medium, as linear functions of the flux that enters each of n patches.

    Attributes
    ----------
    deposited : (nodes, k) sparse float32
        Q at the nodes, of the flux of `patches`.
    patches : (k,) int
        Patch of each column.
    local : (n, n) sparse float64
        a' E sum w rho(depth) at every patch, for what the nodes are too coarse for.
    """

    deposited: csc_array
    patches: npt.NDArray[np.intp]
    local: csr_array

    def at_nodes(self, flux: Array) -> Float32:
        """Return Q at the nodes, (nodes,), for the flux of the patches, (n,); its integral is what is not absorbed."""
        return np.asarray(self.deposited @ flux[self.patches].astype(np.float32))

    def at_patches(self, flux: Array) -> Array:
        """Return the local part at the patches, (n,), for their flux, (n,)."""
        return np.asarray(self.local @ flux)


class _FirstScattering:
    """Where the light of an entry scatters first in a medium, once reflected inside too, for a window of width s, mm.

    Attributes
    ----------
    points : (k, 3) float64
        mm.
    shares : (k,) float64
        Of the light of a patch that scatters at each and is not absorbed.
    owners : (k,) int
        That patch.
    rows, sides : (j,) int
        Patches with a local part, and those by whose light; what was reflected inside has one too small to count.
    local : (j,) float64
        That part for a unit of flux.
    """

    def __init__(self, entry: Entry, boundary: Boundary, medium: Medium, s: float) -> None:
        n, patches, sheet = len(boundary.patches), entry.patches, boundary.sheet
        depths, shares = first_scattering(entry.chords_in(medium))
        second, (rays, second_depths, second_shares) = entry.second, second_scattering(entry, medium)
        collisions = boundary.collisions.of(medium) if entry.diffuse else None
        if collisions is not None:  # of which the mean ray tells only where
            of_rays = second.rays[rays]
            followed = shares.sum(axis=1) + np.bincount(of_rays, second_shares.sum(axis=1), minlength=len(patches))
            counted = (collisions.share[patches] / np.maximum(followed, np.finfo(np.float64).tiny))[:, None]
            shares, second_shares = counted * shares, counted[of_rays] * second_shares
        depths, shares = medium.mean_free_path * depths, medium.albedo * shares
        lengths = entry.stretch * np.concatenate([depths.T.ravel(), medium.mean_free_path * second_depths.T.ravel()])
        twice, again = np.tile(np.arange(len(patches)), 2), np.tile(rays, 2)
        starts = np.concatenate([boundary.patches.points[patches[twice]], second.starts[again]])
        self.points = starts + lengths[:, None] * np.concatenate([entry.rays[twice], second.directions[again]])
        self.shares = np.concatenate([shares.T.ravel(), medium.albedo * second_shares.T.ravel()])
        self.owners = patches[np.concatenate([twice, second.rays[again]])]
        index = np.full(n, -1)  # of each patch in the entry
        index[patches] = np.arange(len(patches))
        lit = np.flatnonzero(index[sheet.opposite] >= 0)  # thin slabs that light enters on the other side
        across, parts = index[sheet.opposite[lit]], LocalParts.of(medium, s)
        density = shares / np.maximum(boundary.patches.areas[patches], np.finfo(np.float64).tiny)[:, None]
        below = depths * entry.cosines[:, None]
        left = np.abs(sheet.thickness[lit, None] - below[across])
        near_density = np.sum(density * parts.green(below), axis=1)
        coupling = sheet.share[lit] * np.sum(density[across] * parts.green(left), axis=1)
        self.rows = np.concatenate([patches, sheet.patches[lit]])
        self.sides = np.concatenate([patches, sheet.opposite[lit]])
        self.local = np.concatenate([near_density, coupling])


def scattering(entry: Entry, boundary: Boundary, medium: Medium, s: float) -> Scattering:
    """Return the first scattering of a light, for a window of width s, mm."""
    first, n = _FirstScattering(entry, boundary, medium, s), len(boundary.patches)
    deposited = _weights(boundary, first.points)
    deposited.data *= np.repeat(first.shares.astype(np.float32), np.diff(deposited.indptr))
    return Scattering(deposited, first.owners, csr_array((first.local, (first.rows, first.sides)), shape=(n, n)))


def sources(
    entry: Entry,
    boundary: Boundary,
    medium: Medium,
    channel: int,
    s: float,
    retained: Array,
    of_light: Scattering | None = None,
) -> tuple[Float32, Array]:
    """Return the first scattering of one channel: assigned to the nodes (nodes,), and its local part (n,).

    `retained` is the share of each patch's light that diffuses, (n,); `of_light` the scattering of the entry's light
    in the medium, where it is known: of light from all around, that of any such light. Light counts times what
    diffusion lacks of it (`core.transport.diffusion.half_space`).
    """
    flux = np.zeros(len(boundary.patches))
    flux[entry.patches] = retained[entry.patches] * entry.gain(medium) * entry.flux[:, channel]
    if of_light is not None:
        return of_light.at_nodes(flux), of_light.at_patches(flux)
    first = _FirstScattering(entry, boundary, medium, s)
    at_nodes = _weights(boundary, first.points) @ (first.shares * flux[first.owners]).astype(np.float32)
    at_patches = np.bincount(first.rows, first.local * flux[first.sides], len(flux))
    return np.asarray(at_nodes), np.asarray(at_patches, np.float64)


def shallow_sources(flux: Array, boundary: Boundary, medium: Medium, s: float) -> tuple[Float32, Array]:
    """Return the first scattering of light from all around as `sources` does, to first order in its depth.

    It is W f - n . grad W <z> f at the nodes, in a third of the time. Next to a flat surface that is exact, as its
    local part makes up for the rest; what is farther away gets a tenth too little where free paths are of four cells.

    Parameters
    ----------
    flux : (n,) float64
        E dA of one channel that enters the patches.
    boundary, medium, s
        As of `sources`.
    """
    patches, sheet, parts = boundary.patches, boundary.sheet, LocalParts.of(medium, s)
    deep = mean_cosine(medium.eta) * medium.mean_free_path  # depth of a mean free path
    chords = boundary.thickness / deep
    left = np.exp(-chords)
    counted = medium.albedo * gain(medium, np.full(len(flux), mean_cosine(medium.eta)), chords) * flux
    sigma = max(medium.attenuation, SMALLEST_ATTENUATION / s)
    scattered, depth = counted * (1.0 - left), deep * counted * (1.0 - (1.0 + chords) * left)
    reaching = counted * -np.expm1(-chords * (1.0 + sigma * deep)) / (1.0 + sigma * deep)  # the mean of exp(-sigma z)
    slopes = csc_array((boundary.slopes, boundary.weights.indices, boundary.weights.indptr), boundary.weights.shape)
    at_nodes = boundary.weights @ scattered.astype(np.float32) - slopes @ depth.astype(np.float32)
    per_area = 1.0 / np.maximum(patches.areas, np.finfo(np.float64).tiny)
    local = parts.values[0] * scattered - (scattered - reaching) / (2.0 * medium.diffusion * sigma)
    across = parts.green(sheet.thickness) * (per_area * scattered)[sheet.opposite]
    across -= parts.slope(sheet.thickness) / medium.diffusion * (per_area * depth)[sheet.opposite]
    local *= per_area
    local[sheet.patches] += sheet.share * across
    return np.asarray(at_nodes), local


def first_sources(entry: Entry, medium: Medium, channel: int, retained: Array) -> tuple[Array, Array]:
    """Return depths of first scattering along the rays, mm, and its a' E dA, (m, 2) each; arguments of `sources`."""
    depths, shares = first_scattering(entry.chords_in(medium))
    flux = retained[entry.patches] * entry.flux[:, channel]
    return medium.mean_free_path * depths, medium.albedo * flux[:, None] * shares


def second_scattering(entry: Entry, medium: Medium) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """Return the first scattering of light that was reflected inside.

    Returns
    -------
    rays : (j,) int
        Indices of `entry.second`.
    depths : (j, 2) float64
        In mean free paths along the reflected ray.
    shares : (j, 2) float64
        Of the light that entered; what reaches the end of the second chord is lost.
    """
    second = entry.second
    left = second.reflected * np.exp(-entry.chords_in(medium)[second.rays])
    worth = np.flatnonzero(left > LEAST_RETURNED)
    depths, shares = first_scattering(second.chords[worth] / (entry.stretch * medium.mean_free_path))
    return worth, depths, left[worth, None] * shares


def _weights(boundary: Boundary, points: Array) -> csc_array:
    """Return the particle-mesh assignment of points (k, 3), mm: (nodes, k)."""
    return tsc_matrix(boundary.grid, boundary.grid.coordinates(points))
