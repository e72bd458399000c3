"""The boundary integral equation's surface on the grid: all that a mesh alone decides.

phi / 2 + K phi + S phi / (2 A) = phi_0 on the surface, where S phi = int G phi dA and K phi = int D dG/dn phi dA. Both
are one deposit: a patch's area with the weights W, and its vector area with their slopes. What the grid is too coarse
for is local. For S that is `core.transport.diffusion.green.local_green`; for K it is found from what a constant must
give, K 1 = -1/2 where nothing is absorbed: k0 = -1/2 - K_L 1. It holds curvature, thin sheets and the noise of the
grid.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.grid.layers import LayerGrid, smooth_matrix, smooth_slope_matrix
from milkglass.core.material.medium import NO_ABSORPTION, Medium
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
    """Patches on a grid.

    Attributes
    ----------
    grid : LayerGrid
    patches : Patches, n of them
    weights : (nodes, n) sparse float32
        W.
    slopes : (27 n,) float32
        Of the entries of `weights`, along each patch's mean normal, 1/mm.
    constant : (n_layers, height, width) float32
        K_L 1 at the nodes, which pixels gather.
    double_layer_diagonal : (n,) float64
        k0, what the diagonal of K gets for what the nodes miss of it.
    thickness : (n,) float64
        Way through the object along the normal, mm; 0 where there is none.
    sheet : Sheet
    sheet_reach : float
        Thickness of the thickest sheets, mm.
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

    @functools.cached_property
    def curvature(self) -> Curvature:
        """Of the patches."""
        return curvature(self.patches)

    @functools.cached_property
    def edges(self) -> Edges:
        """Between the patches."""
        plain = self.curvature.evenness > CONSTANTS.edges.plain_evenness
        return Edges(self.patches, self.thickness, plain & ~self.is_sheet)

    @functools.cached_property
    def mean_chord(self) -> float:
        """4 V / A, mm."""
        patches = self.patches
        middle = patches.points.mean(axis=0)
        volume = float(np.einsum("ij,ij->", patches.points - middle, patches.vector_areas)) / 3.0
        return max(4.0 * volume / float(patches.areas.sum()), np.finfo(np.float64).tiny)

    @functools.cached_property
    def is_sheet(self) -> Bools:
        """Patches that have another side, (n,)."""
        each = np.zeros(len(self.patches), np.bool_)
        each[self.sheet.patches] = True
        return each

    def means(self, values: Array) -> Float32:
        """Means of the patches near each node, by area, of (n, k): (k, n_layers, height, width); 0 where none is."""
        areas = self.patches.areas
        total = self.weights @ areas.astype(np.float32)
        sums = self.weights @ (areas[:, None] * values).astype(np.float32)
        mean = sums / np.maximum(total, np.finfo(np.float32).tiny)[:, None]
        return np.ascontiguousarray(mean.T).reshape(-1, *self.grid.shape)

    def bending(self, medium: Medium) -> Array:
        """`Medium.bending` of the patches, (n,); curvature counts as far as light goes before it scatters."""
        far = medium.mean_free_path
        curvature, edges, _ = self.curvature.at(CONSTANTS.curvature.width * far)
        smooth = curvature - edges
        # On sheets, and where light flies through without meeting anything, there is no face to speak of.
        counts = float(np.clip(CONSTANTS.curvature.edgeless_chord - far / self.mean_chord, 0.0, 1.0))
        if counts == 0.0:
            return medium.bending(smooth)
        sharp = np.where(self.is_sheet, 0.0, np.maximum(edges, self.edges.curvature(far)))
        return medium.bending(smooth, counts * sharp)

    def double_layer(self, extrapolation_factor: float, diffusion: float, bending: npt.ArrayLike = 1.0) -> csc_array:
        """Deposit of 2 A M dA: W / (2 A) + b D n . grad W, (nodes, n) sparse float32; b is 1 or (n,)."""
        each = np.broadcast_to(np.asarray(bending, np.float32) * np.float32(diffusion), len(self.patches))
        slopes = self.slopes.reshape(len(self.patches), -1) * each[:, None]
        data = self.weights.data * np.float32(0.5 / extrapolation_factor) + slopes.ravel()
        return csc_array((data, self.weights.indices, self.weights.indptr), shape=self.weights.shape)


@dataclass(frozen=True, eq=False)
class Sheet:
    """The m patches whose other side is nearer than the nodes can tell.

    Attributes
    ----------
    patches, others : (m,) int
        A patch, and the one across.
    thickness : (m,) float64
        mm.
    share : (m,) float64
        How parallel the two sides are, from 0 to 1.
    """

    patches: npt.NDArray[np.intp]
    others: npt.NDArray[np.intp]
    thickness: Array
    share: Array


def find_sheet(patches: Patches, thickness: Array, reach: float) -> Sheet:
    """Pair the patches with those across the object, no further than `reach` along their normals; lengths in mm."""
    thin = np.flatnonzero((thickness > 0.0) & (thickness < reach))
    if len(thin) == 0:
        return Sheet(thin, thin, np.empty(0), np.empty(0))
    across = patches.on_surface[thin] - thickness[thin, None] * patches.face_normals[thin]
    # Nearest in place and in normal: on the thinnest sheets a neighbour of one's own side would be nearer.
    known = np.hstack([patches.on_surface, reach * patches.face_normals])
    others = cKDTree(known).query(np.hstack([across, -reach * patches.face_normals[thin]]))[1]
    facing = -np.einsum("ij,ij->i", patches.face_normals[thin], patches.face_normals[others])
    limits = CONSTANTS.sheets
    share = rising(facing, limits.least_parallel, limits.parallel)
    share *= np.clip(2.0 - 2.0 * thickness[thin] / reach, 0.0, 1.0)
    used = share > 0.0
    return Sheet(thin[used], others[used], thickness[thin[used]], share[used])


def place(grid: LayerGrid, patches: Patches) -> tuple[csc_array, Float32]:
    """W of patches, and the slopes of its entries along their mean normals."""
    coordinates = grid.coordinates(patches.points)
    mean_normals = patches.vector_areas / np.maximum(patches.areas, np.finfo(np.float64).tiny)[:, None]
    weights = smooth_matrix(grid, coordinates)
    return weights, smooth_slope_matrix(grid, coordinates, mean_normals, weights).data


class Depths:
    """How far it is to the other side, by rays."""

    def __init__(self, mesh: Mesh) -> None:
        self._rays = RayMesh(mesh.vertices, mesh.faces)
        cross = face_cross(mesh.vertices, mesh.faces)
        self._normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny)

    def along(self, patches: Patches, chosen: npt.NDArray[np.intp], directions: Array, cell: float) -> Array:
        """Way through the object from m patches along unit directions (m, 3): (m,) mm, 0 where a ray leaves at once.

        `cell`, mm, sets how far below the surface rays start.
        """
        return self.ends(patches, chosen, directions, cell)[0]

    def ends(
        self, patches: Patches, chosen: npt.NDArray[np.intp], directions: Array, cell: float
    ) -> tuple[Array, Array]:
        """Return what `along` does, and the unit outward normals where the rays end, (m, 3)."""
        normals = patches.face_normals[chosen]
        face, t = self._rays.first(patches.on_surface[chosen] - RAY_OFFSET * cell * normals, directions)
        inward = np.einsum("ij,ij->i", directions, normals) < 0.0
        return np.where((face >= 0) & inward, t, 0.0), self._normals[face]

    def onwards(self, points: Array, normals: Array, directions: Array, cell: float) -> Array:
        """Way through the object from m points of its surface, (m, 3), along unit directions: (m,) mm, 0 for none."""
        face, t = self._rays.first(points - RAY_OFFSET * cell * normals, directions)
        return np.where(face >= 0, t, 0.0)


def put_on_grid(
    patches: Patches, grid: LayerGrid, depths: Depths, reach: float, convolve: Callable[[Float32], Float32]
) -> Boundary:
    """Put a surface on a grid, and measure what the grid misses of K.

    `reach`, mm, is the thickness of the thickest sheets; `convolve` does so with G_L where nothing is absorbed.
    """
    thickness = depths.along(patches, np.arange(len(patches)), -patches.face_normals, grid.texel)
    sheet = find_sheet(patches, thickness, reach)
    weights, slopes = place(grid, patches)
    unknown = np.empty(0, np.float32), np.empty(0)
    unplaced = Boundary(grid, patches, weights, slopes, *unknown, thickness, sheet, reach)
    deposited = unplaced.double_layer(np.inf, NO_ABSORPTION.diffusion) @ patches.areas.astype(np.float32)
    constant = convolve(deposited.reshape(grid.shape))
    diagonal = -0.5 - (weights.T @ constant.ravel()).astype(np.float64)
    return replace(unplaced, constant=constant, double_layer_diagonal=diagonal)


@functools.lru_cache(maxsize=1)
def depths_of(mesh: Mesh) -> Depths:
    """Return the rays of the last mesh: grids of the same one share them."""
    return Depths(mesh)


def row_sums(mesh: Mesh, n: int = ROW_SUM_POINTS, body: npt.NDArray[np.integer] | None = None) -> Array:
    """K 1 at n places spread over the surface, without absorption: -1/2 each where it is closed and wound outwards.

    Of a place's own body alone where that of each face is given: bodies may then share a plane.

    The solid angle of all faces seen from the middle of one, over -4 pi (van Oosterom and Strackee 1983), float64.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    areas = np.cumsum(np.linalg.norm(face_cross(mesh.vertices, mesh.faces), axis=1))
    chosen = np.searchsorted(areas, (np.arange(n) + 0.5) / n * areas[-1])
    sums = np.empty(n)
    for row, face in enumerate(chosen):
        own = np.arange(len(corners)) if body is None else np.flatnonzero(body == body[face])
        a, b, c = np.moveaxis(corners[own] - corners[face].mean(axis=0), 1, 0)
        la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", side, side)) for side in (a, b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a)))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        angle = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        angle[own == face] = 0.0  # its own plane
        sums[row] = -np.sum(angle) / (4.0 * np.pi)
    return sums


def is_closed(sums: Array) -> bool:
    """Whether row sums are those of a surface that is closed and wound outwards."""
    return bool(np.abs(sums + 0.5).max() <= ROW_SUM_TOLERANCE)
