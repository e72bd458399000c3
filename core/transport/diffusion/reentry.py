"""Light that leaves the object and enters it again, as part of the boundary integral equation.

Patches of exitance M light every other part (`core.light.exchange`), E = T M at the vertices of a refined mesh, which
diffuses as light from all around does. The equation is linear in E, so that

    A u - b(P T M) = b(E_0),    u = 2 A M, P from vertices to patches,

has one Krylov space, and a product is one convolution as without: sources of the light that enters again are taken off
the layers' before it.
"""

import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array, csr_array, hstack

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.layers import tsc_matrix
from milkglass.core.light.exchange import Exchange, Pattern
from milkglass.core.material.medium import Medium
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Boundary, Depths
from milkglass.core.transport.diffusion.entry import Entry, enter, first_sources, second_scattering
from milkglass.core.transport.diffusion.green import local_green
from milkglass.core.transport.diffusion.patches import Patches

KEPT_MEDIA = 6  # two materials
# What leaves and meets the surface again, as a share of what has entered, below which a channel does without: it
# changes a picture by at most 0.3 %.
NEGLIGIBLE_SHARE = 0.005


class ExchangeGeometry:
    """What the exchange of light between the n patches of a surface on a grid owes to their places alone.

    Parameters
    ----------
    exchange : Exchange
        Of m vertices.
    boundary : Boundary
    samples : SurfaceSamples
        That the patches were made of.
    """

    def __init__(self, exchange: Exchange, boundary: Boundary, samples: SurfaceSamples) -> None:
        patches = boundary.patches
        self.boundary, self.samples = boundary, samples
        emitters = exchange.emitters(patches.on_surface, patches.face_normals, boundary.grid.texel)
        self.pattern = Pattern(exchange.hits, emitters, len(patches))
        self.leaving: Float32 | None = None
        if exchange.leaving is not None:
            sums = patches.sums @ (samples.areas[:, None] * exchange.leaving)
            self.leaving = (sums / np.maximum(patches.areas, np.finfo(np.float64).tiny)[:, None]).astype(np.float32)
        tints = [None] if exchange.entering is None else list(exchange.entering.T)
        at_samples = exchange.at_samples(samples)
        self.to_patches = [_flux_matrix(patches, samples.areas, at_samples, tint) for tint in tints]


class SurfaceExchange:
    """Exchange of light between the n patches of a surface that lies on a grid.

    Parameters
    ----------
    geometry : ExchangeGeometry
    depths : Depths
    eta : float
        Relative index of refraction, >= 1.
    """

    def __init__(self, geometry: ExchangeGeometry, depths: Depths, eta: float) -> None:
        self.boundary, samples = geometry.boundary, geometry.samples
        self._to_vertices = geometry.pattern.matrix(eta)
        self._leaving, self._to_patches = geometry.leaving, geometry.to_patches
        everywhere = EnteringLight(np.ones((len(samples), 3), np.float32))
        self._entry = enter(everywhere, self.boundary, depths, eta)
        self._lock = threading.Lock()
        self._sources: dict[Medium, DiffuseSources] = {}
        areas = self.boundary.patches.areas
        self.share = float(self.flux(0, np.ones(len(areas))).sum() / areas.sum())

    def irradiance(self, exitance: Array) -> Float32:
        """Return what enters again at the vertices, (m, 3), for exitance of the patches, (n, 3)."""
        leaving = exitance.astype(np.float32)
        return np.asarray(self._to_vertices @ (leaving if self._leaving is None else leaving * self._leaving))

    def flux(self, channel: int, exitance: Array) -> Array:
        """Return the flux that enters the patches again, (n,), for their exitance in one channel, (n,)."""
        leaving = exitance.astype(np.float32)
        if self._leaving is not None:
            leaving *= self._leaving[:, channel]
        to_patches = self._to_patches[channel % len(self._to_patches)]
        return np.asarray(to_patches @ (self._to_vertices @ leaving), np.float64)

    def sources(self, medium: Medium, s: float) -> "DiffuseSources":
        """Return the sources of light from all around in a medium, for a window of width s, mm; kept for the next."""
        with self._lock:
            found = self._sources.pop(medium, None)
        found = found or diffuse_sources(self._entry, self.boundary, medium, s)
        with self._lock:
            self._sources = {**dict(list(self._sources.items())[1 - KEPT_MEDIA :]), medium: found}
        return found

    def is_negligible(self, medium: Medium) -> bool:
        """Whether so little of a channel's light enters again that no picture shows it."""
        return self.share * diffuse_reflectance(medium) < NEGLIGIBLE_SHARE


def _flux_matrix(patches: Patches, areas: Float32, at_samples: csr_array, tint: Float32 | None) -> csr_array:
    """Return the matrix from irradiance at the vertices to the flux into patches, coloured by a tint of the samples."""
    factors = areas if tint is None else areas * tint
    return csr_array(patches.sums @ at_samples.multiply(factors[:, None]).tocsr())


def diffuse_reflectance(medium: Medium) -> float:
    """Return the share of light that has entered a half space which leaves it, (Jensen et al. 2001, equation 15)."""
    absorbed = np.sqrt(3.0 * (1.0 - medium.albedo))
    return float(
        0.5 * medium.albedo * (1.0 + np.exp(-4.0 / 3.0 * medium.extrapolation_factor * absorbed)) * np.exp(-absorbed)
    )


@dataclass(frozen=True, eq=False)
class DiffuseSources:
    """First scattering of light from all around as linear functions of the flux that enters n patches.

    Attributes
    ----------
    deposited : (nodes, k) sparse float32
        Q at the nodes, of the flux of `patches`.
    patches : (k,) int
        Patch of each column.
    local : (n, n) sparse float64
        Local part of the right-hand side at the patches.
    """

    deposited: csc_array
    patches: npt.NDArray[np.intp]
    local: csr_array

    def at_nodes(self, flux: Array) -> Float32:
        """Return Q at the nodes, (nodes,), for the flux that enters the patches, (n,)."""
        return np.asarray(self.deposited @ flux[self.patches].astype(np.float32))


def diffuse_sources(entry: Entry, boundary: Boundary, medium: Medium, s: float) -> DiffuseSources:
    """Return what `core.transport.diffusion.entry.sources` makes of light from all around, for any flux.

    `entry` is that of light from all around with a flux of 1 in every patch.
    """
    n, retained = len(boundary.patches), np.ones(len(boundary.patches))
    patches = entry.patches
    depths, strength = first_sources(entry, medium, 0, retained)
    start = boundary.patches.points[patches]
    unit = strength / np.maximum(entry.flux[:, :1], np.finfo(np.float64).tiny)
    share = unit / np.maximum(boundary.patches.areas[patches], np.finfo(np.float64).tiny)[:, None]
    second, (rays, second_depths, second_shares) = entry.second, second_scattering(entry, medium)
    lengths = entry.stretch * medium.mean_free_path * second_depths
    columns, owners = [], []
    index = np.full(n, -1)
    index[patches] = np.arange(len(patches))
    sheet = boundary.sheet
    lit = np.flatnonzero(index[sheet.opposite] >= 0)
    across = index[sheet.opposite[lit]]
    diagonal, coupling = np.zeros(len(patches)), np.zeros(len(lit))
    for node in range(2):
        points = start + entry.stretch * depths[:, node, None] * entry.rays
        columns.append(_assigned(boundary, points, unit[:, node]))
        owners.append(patches)
        if len(rays):
            points = second.starts[rays] + lengths[:, node, None] * second.directions[rays]
            columns.append(_assigned(boundary, points, medium.albedo * second_shares[:, node]))
            owners.append(patches[second.rays[rays]])
        below = depths[:, node] * entry.cosines
        diagonal += share[:, node] * local_green(medium, s, below)
        left = np.abs(sheet.thickness[lit] - below[across])
        coupling += sheet.share[lit] * share[across, node] * local_green(medium, s, left)
    rows = np.concatenate([patches, sheet.patches[lit]])
    of = np.concatenate([patches, sheet.opposite[lit]])
    local = csr_array((np.concatenate([diagonal, coupling]), (rows, of)), shape=(n, n))
    return DiffuseSources(csc_array(hstack(columns, format="csc")), np.concatenate(owners), local)


def _assigned(boundary: Boundary, points: Array, strength: Array) -> csc_array:
    """Return the particle-mesh assignment of points (k, 3), mm, times their strength (k,): (nodes, k)."""
    weights = tsc_matrix(boundary.grid, boundary.grid.coordinates(points))
    data = weights.data * np.repeat(strength.astype(np.float32), np.diff(weights.indptr))
    return csc_array((data, weights.indices, weights.indptr), shape=weights.shape)


class Reentry:
    """Light of one channel that leaves the patches and enters them again."""

    def __init__(self, surface: SurfaceExchange, channel: int, medium: Medium, s: float) -> None:
        self._surface, self._channel = surface, channel
        self._per_two_A_M = 1.0 / (2.0 * medium.extrapolation_factor)
        self._sources = surface.sources(medium, s)
        self._last: tuple[Array, Array] | None = None

    def at_nodes(self, two_A_M: Array) -> Float32:
        """Return the first scattering at the nodes, (nodes,), of light that enters again, for 2 A M (n,)."""
        return self._sources.at_nodes(self._flux(two_A_M))

    def at_patches(self, two_A_M: Array) -> Array:
        """Return its local part at the patches, (n,)."""
        return np.asarray(self._sources.local @ self._flux(two_A_M))

    def _flux(self, two_A_M: Array) -> Array:
        """Return the flux that enters again; the last one's is kept, since both of its parts are asked for in turn."""
        last = self._last
        if last is None or last[0] is not two_A_M:
            last = two_A_M, self._surface.flux(self._channel, self._per_two_A_M * two_A_M)
            self._last = last
        return last[1]
