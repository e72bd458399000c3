"""Sources of diffusion: light refracted into the object, light by light, and its first scattering along the rays.

Q lies where light first scatters, exp(-z) along the refracted ray, not on the surface; along the normal instead of the
ray the exitance of a sphere would be off by 6 to 14 %.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array, csr_array, hstack

from milkglass.core.arrays import Array, Float32
from milkglass.core.grid.layers import tsc_matrix
from milkglass.core.material.fresnel import reflectance
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering, mean_cosine, refract
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.green import local_green
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


def scattering(entry: Entry, boundary: Boundary, medium: Medium, s: float) -> Scattering:
    """Return the first scattering of a light, once reflected inside too, whose local part is too small to count."""
    n, patches, sheet = len(boundary.patches), entry.patches, boundary.sheet
    depths, shares = first_scattering(entry.chords_in(medium))
    depths, shares = medium.mean_free_path * depths, medium.albedo * shares
    start = boundary.patches.points[patches]
    density = shares / np.maximum(boundary.patches.areas[patches], np.finfo(np.float64).tiny)[:, None]
    second, (rays, second_depths, second_shares) = entry.second, second_scattering(entry, medium)
    lengths = entry.stretch * medium.mean_free_path * second_depths
    index = np.full(n, -1)  # of each patch in the entry
    index[patches] = np.arange(len(patches))
    lit = np.flatnonzero(index[sheet.opposite] >= 0)  # thin slabs that light enters on the other side
    across = index[sheet.opposite[lit]]
    columns, diagonal, coupling = [], np.zeros(len(patches)), np.zeros(len(lit))
    for node in range(2):
        points = start + entry.stretch * depths[:, node, None] * entry.rays
        reflected = second.starts[rays] + lengths[:, node, None] * second.directions[rays]
        columns.append(_assigned(boundary, points, shares[:, node]))
        columns.append(_assigned(boundary, reflected, medium.albedo * second_shares[:, node]))
        below = depths[:, node] * entry.cosines
        diagonal += density[:, node] * local_green(medium, s, below)
        left = np.abs(sheet.thickness[lit] - below[across])
        coupling += sheet.share[lit] * density[across, node] * local_green(medium, s, left)
    rows = np.concatenate([patches, sheet.patches[lit]])
    sides = np.concatenate([patches, sheet.opposite[lit]])
    local = csr_array((np.concatenate([diagonal, coupling]), (rows, sides)), shape=(n, n))
    owners = np.tile(np.append(patches, patches[second.rays[rays]]), 2)
    return Scattering(csc_array(hstack(columns, format="csc")), owners, local)


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
    flux, of_light = np.zeros(len(boundary.patches)), of_light or scattering(entry, boundary, medium, s)
    counted = retained[entry.patches] * entry.gain(medium)
    flux[entry.patches] = counted * entry.flux[:, channel]
    return of_light.at_nodes(flux), of_light.at_patches(flux)


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


def _assigned(boundary: Boundary, points: Array, strength: Array) -> csc_array:
    """Return the particle-mesh assignment of points (k, 3), mm, times their strength (k,): (nodes, k)."""
    weights = tsc_matrix(boundary.grid, boundary.grid.coordinates(points))
    data = weights.data * np.repeat(strength.astype(np.float32), np.diff(weights.indptr))
    return csc_array((data, weights.indices, weights.indptr), shape=weights.shape)
