"""The surface of the boundary integral equation, discretised: all that follows from the mesh and the grid alone.

    phi / 2 + K phi + S phi / (2 A) = phi_0    on the surface,

with the single layer S phi = int G phi dA and the double layer K phi = int D dG/dn phi dA, collocated at the patches.
Both layers are one particle-mesh assignment: areas with the B-spline weights W, vector areas with their slopes. What
the grid is too coarse for is local, on the diagonal. For S it is `core.transport.diffusion.green.local_green`; for K
it follows from the row sum of a closed surface without absorption, K 1 = -1/2: k0 = -1/2 - K_L 1, which holds
curvature, thin slabs ("sheets") and the error of the grid.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh, face_cross, face_normals
from milkglass.core.grid.layers import LayerGrid, tsc_gradient_matrix, tsc_matrix
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.threads import Recent, computed_once
from milkglass.core.transport.diffusion.collisions import Exits, FirstCollisions, InnerPaths
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.core.transport.diffusion.edges.curvature import Curvature, curvature
from milkglass.core.transport.diffusion.edges.pairs import Edges
from milkglass.core.transport.diffusion.edges.ramps import rising
from milkglass.core.transport.diffusion.patches import Patches

Bools = npt.NDArray[np.bool_]

ROW_SUM_POINTS = 24  # at which the row sum is measured
ROW_SUM_TOLERANCE = 0.02  # off -1/2: a closed surface has it to the last digits, one with a hole is far from it
RAY_OFFSET = 1e-3  # cells that a ray starts below the surface


@dataclass(frozen=True, eq=False)
class Boundary:
    """Discretised single and double layer of a surface: n patches and their assignment to the nodes of a grid.

    Attributes
    ----------
    grid : LayerGrid
    patches : Patches
        The n panels on which phi is constant.
    weights : (nodes, n) sparse float32
        W, quadratic B-splines of the patches' centres.
    slopes : (27 n,) float32
        Derivatives of the entries of `weights` along each patch's mean normal, 1/mm.
    constant : (n_layers, height, width) float32
        K_L 1 at the nodes, which pixels gather.
    double_layer_diagonal : (n,) float64
        k0, the local part of K.
    thickness : (n,) float64
        Length of the chord inwards along the normal, mm; 0 where there is none.
    sheet : Sheet
        Pairs of patches on the two sides of thin slabs.
    sheet_reach : float
        Thickness up to which a slab is thin, mm.
    paths : InnerPaths
        Of light from all around through matter.
    collisions : FirstCollisions
        What of it collides before it leaves.
    lengths : callable, optional
        Returns b of a medium, (n,), in place of this module's (`core.transport.diffusion.even`).
    origin : Boundary, optional
        The same surface with other paths or lengths, which knows its curvature and edges.
    """

    grid: LayerGrid
    patches: Patches
    weights: csc_array
    slopes: Float32
    constant: Float32
    double_layer_diagonal: Array
    thickness: Array
    sheet: "Sheet"
    sheet_reach: float
    paths: InnerPaths
    collisions: FirstCollisions
    lengths: Callable[[Medium], Array] | None = None
    origin: "Boundary | None" = None

    @computed_once
    def curvature(self) -> Curvature:
        """Mean curvature of the patches, and the part of it that edges make."""
        return curvature(self.patches) if self.origin is None else self.origin.curvature

    @computed_once
    def edges(self) -> Edges:
        """Edges between faces of the surface, for any mean free path."""
        if self.origin is not None:
            return self.origin.edges
        plain = self.curvature.evenness > CONSTANTS.edges.plain_evenness
        return Edges(self.patches, self.thickness, plain & ~self.is_sheet)

    @computed_once
    def mean_chord(self) -> float:
        """Mean chord of the object, 4 V / A (Cauchy), mm."""
        patches = self.patches
        middle = patches.points.mean(axis=0)
        volume = float(np.einsum("ij,ij->", patches.points - middle, patches.vector_areas)) / 3.0
        return max(4.0 * volume / float(patches.areas.sum()), np.finfo(np.float64).tiny)

    @computed_once
    def is_sheet(self) -> Bools:
        """Mask of the patches that are of a thin slab, (n,)."""
        mask = np.zeros(len(self.patches), np.bool_)
        mask[self.sheet.patches] = True
        return mask

    def means(self, values: Array) -> Float32:
        """Return means of (n, k) values over the patches near each node, by area: (k, n_layers, height, width).

        0 where no patch is near.
        """
        areas = self.patches.areas
        total = self.weights @ areas.astype(np.float32)
        sums = self.weights @ (areas[:, None] * values).astype(np.float32)
        mean = sums / np.maximum(total, np.finfo(np.float32).tiny)[:, None]
        return np.ascontiguousarray(mean.T).reshape(-1, *self.grid.shape)

    def bending(self, medium: Medium) -> Array:
        """Return b of the patches, (n,): the extrapolation length over that of a flat and thick object.

        `Medium.bending`, of curvature smoothed over half a mean free path, as far as matter is thick; larger where it
        is so thin that light crosses it, and as even light tells.
        """
        if self.lengths is not None:
            return self.lengths(medium)
        bending, collisions = self._bending(medium), self.collisions.of(medium)
        return bending if collisions is None else collisions.bent(bending, self.patches.areas)

    def concentration(self, medium: Medium) -> Array | None:
        """Return fluence over that which lets out as much in thick matter, (n,); None where all of it is thick."""
        collisions = self.collisions.of(medium)
        return None if collisions is None else collisions.concentration(self.patches.areas)

    def _bending(self, medium: Medium) -> Array:
        mfp = medium.mean_free_path
        curvature, edges, _ = self.curvature.at(CONSTANTS.curvature.width * mfp)
        smooth = curvature - edges
        # Thin slabs have no edges, nor has an object that most light crosses without scattering.
        counts = float(np.clip(CONSTANTS.curvature.edgeless_chord - mfp / self.mean_chord, 0.0, 1.0))
        if counts == 0.0:
            return medium.bending(smooth)
        sharp = np.where(self.is_sheet, 0.0, np.maximum(edges, self.edges.curvature(mfp)))
        return medium.bending(smooth, counts * sharp)

    def going_by(self, paths: InnerPaths | None) -> "Boundary":
        """Return the same patches, which go by paths from other patches of the same samples; all collides without.

        So no paths are followed but those of the other patches.
        """
        kept = Recent[float, Exits](1)

        def exits(eta: float) -> Exits | None:
            if paths is None:
                return None
            return kept.of(eta, lambda: paths.exits(eta).at(paths.patches.of_sample[self.patches.nearest]))

        return replace(self, collisions=FirstCollisions(self.patches.areas, self.thickness, exits), origin=self)

    def bent(self, lengths: Callable[[Medium], Array]) -> "Boundary":
        """Return the same patches with other extrapolation lengths, b of a medium, (n,)."""
        return replace(self, lengths=lengths, origin=self)

    def layer_assignment(
        self, extrapolation_factor: float, diffusion: float, bending: npt.ArrayLike = 1.0
    ) -> csc_array:
        """Return the assignment of both layers, W / (2 A) + b D n . grad W: (nodes, n) sparse float32.

        It takes 2 A M dA of the patches; `diffusion` is D in mm, `bending` b, a number or (n,).
        """
        factors = np.broadcast_to(np.asarray(bending, np.float32) * np.float32(diffusion), len(self.patches))
        slopes = self.slopes.reshape(len(self.patches), -1) * factors[:, None]
        data = self.weights.data * np.float32(0.5 / extrapolation_factor) + slopes.ravel()
        return csc_array((data, self.weights.indices, self.weights.indptr), shape=self.weights.shape)


@dataclass(frozen=True, eq=False)
class Sheet:
    """The m patches of thin slabs, whose two sides are nearer to each other than the nodes can tell.

    Attributes
    ----------
    patches, opposite : (m,) int
        Indices of a patch and of the one across the slab.
    thickness : (m,) float64
        mm.
    share : (m,) float64
        Share to which the two are sides of a slab, from 0 to 1.
    """

    patches: npt.NDArray[np.intp]
    opposite: npt.NDArray[np.intp]
    thickness: Array
    share: Array


def find_sheet(patches: Patches, thickness: Array, reach: float) -> Sheet:
    """Return the pairs of patches across thin slabs, no thicker than `reach`; lengths in mm."""
    thin = np.flatnonzero((thickness > 0.0) & (thickness < reach))
    if len(thin) == 0:
        return Sheet(thin, thin, np.empty(0), np.empty(0))
    across = patches.on_surface[thin] - thickness[thin, None] * patches.face_normals[thin]
    # Nearest in place and in normal: on the thinnest slabs a neighbour on the same side would be nearer.
    search_points = np.hstack([patches.on_surface, reach * patches.face_normals])
    opposite = cKDTree(search_points).query(np.hstack([across, -reach * patches.face_normals[thin]]))[1]
    facing = -np.einsum("ij,ij->i", patches.face_normals[thin], patches.face_normals[opposite])
    limits = CONSTANTS.sheets
    share = rising(facing, limits.least_parallel, limits.parallel)
    share *= np.clip(2.0 - 2.0 * thickness[thin] / reach, 0.0, 1.0)
    used = share > 0.0
    return Sheet(thin[used], opposite[used], thickness[thin[used]], share[used])


def place(grid: LayerGrid, patches: Patches) -> tuple[csc_array, Float32]:
    """Return W of patches, (nodes, n), and the slopes of its entries along their mean normals, (27 n,)."""
    coordinates = grid.coordinates(patches.points)
    mean_normals = patches.vector_areas / np.maximum(patches.areas, np.finfo(np.float64).tiny)[:, None]
    weights = tsc_matrix(grid, coordinates)
    return weights, tsc_gradient_matrix(grid, coordinates, mean_normals, weights).data


class Depths:
    """Chords of a `mesh`, by rays."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self._rays = mesh, mesh.rays
        self._normals = face_normals(mesh.vertices, mesh.faces)

    def along(self, patches: Patches, chosen: npt.NDArray[np.intp], directions: Array, cell: float) -> Array:
        """Return the chords from m patches along unit directions (m, 3): (m,) mm, 0 where a ray leaves at once.

        `cell`, mm, sets how far below the surface rays start.
        """
        return self.ends(patches, chosen, directions, cell)[0]

    def ends(
        self, patches: Patches, chosen: npt.NDArray[np.intp], directions: Array, cell: float
    ) -> tuple[Array, Array]:
        """Return the chords of `along`, and the unit outward normals where they end, (m, 3)."""
        normals = patches.face_normals[chosen]
        face, t = self._rays.first(patches.on_surface[chosen] - RAY_OFFSET * cell * normals, directions)
        inward = np.einsum("ij,ij->i", directions, normals) < 0.0
        return np.where((face >= 0) & inward, t, 0.0), self._normals[face]

    def onwards(self, points: Array, normals: Array, directions: Array, cell: float) -> Array:
        """Return the chords from m points of the surface, (m, 3), along unit directions: (m,) mm, 0 for none."""
        face, t = self._rays.first(points - RAY_OFFSET * cell * normals, directions)
        return np.where(face >= 0, t, 0.0)


def put_on_grid(
    patches: Patches, grid: LayerGrid, depths: Depths, reach: float, convolve: Callable[[Float32], Float32]
) -> Boundary:
    """Return the discretised surface of patches, the local part of K included.

    Parameters
    ----------
    patches, grid, depths
    reach : float
        Thickness up to which a slab is thin, mm.
    convolve : callable
        Convolution with G_L without absorption: (n_layers, height, width) float32 in and out.
    """
    thickness = depths.along(patches, np.arange(len(patches)), -patches.face_normals, grid.texel)
    sheet = find_sheet(patches, thickness, reach)
    weights, slopes = place(grid, patches)
    unset = np.empty(0, np.float32), np.empty(0)
    paths = InnerPaths(depths.mesh, patches)
    collisions = FirstCollisions(patches.areas, thickness, paths.exits)
    unplaced = Boundary(grid, patches, weights, slopes, *unset, thickness, sheet, reach, paths, collisions)
    deposited = unplaced.layer_assignment(np.inf, NO_ABSORPTION.diffusion) @ patches.areas.astype(np.float32)
    constant = convolve(deposited.reshape(grid.shape))
    diagonal = -0.5 - (weights.T @ constant.ravel()).astype(np.float64)
    return replace(unplaced, constant=constant, double_layer_diagonal=diagonal)


def row_sums(mesh: Mesh, n: int = ROW_SUM_POINTS, body: npt.NDArray[np.integer] | None = None) -> Array:
    """Return K 1 at n points spread over the surface, without absorption: -1/2 where it is closed and wound outwards.

    The solid angle of all faces seen from the middle of one, over -4 pi (van Oosterom and Strackee 1983), float64.
    With `body`, the connected component of each face, of the component of that face alone: others may share its plane.
    """
    vertices, corners = mesh.vertices.astype(np.float64), np.ascontiguousarray(mesh.faces.T)
    cross = face_cross(mesh.vertices, mesh.faces)
    places = vertices[corners]
    heights = np.einsum("ij,ij->i", places[0], cross)
    between = places - np.roll(places, -1, axis=0)
    ab2, bc2, ca2 = np.einsum("kij,kij->ki", between, between)
    areas = np.cumsum(np.linalg.norm(cross, axis=1))
    chosen = np.searchsorted(areas, (np.arange(n) + 0.5) / n * areas[-1])
    sums = np.empty(n)
    for row, face in enumerate(chosen):
        middle = places[:, face].mean(axis=0)
        offset = vertices - middle
        squares = np.einsum("ij,ij->i", offset, offset)
        (a2, b2, c2), (a, b, c) = squares[corners], np.sqrt(squares)[corners]
        products = (a2 + b2 - ab2) * c + (b2 + c2 - bc2) * a + (c2 + a2 - ca2) * b  # twice: by the law of cosines
        angle = 2.0 * np.arctan2(heights - cross @ middle, a * b * c + 0.5 * products)
        angle[face] = 0.0  # seen edge-on
        sums[row] = -np.sum(angle if body is None else angle[body == body[face]]) / (4.0 * np.pi)
    return sums


def is_closed(sums: Array) -> bool:
    """Return whether row sums are those of a surface that is closed and wound outwards."""
    return bool(np.abs(sums + 0.5).max() <= ROW_SUM_TOLERANCE)
