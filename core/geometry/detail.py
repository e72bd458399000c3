"""Colours and small relief of a surface: what a model's file says of its faces beyond their shape.

Kept beside the mesh, by the corners of its faces: where texture coordinates jump, the mesh stays one surface. Colours
c are linear RGB, (1, 1, 1) where the material is as it is. Scattering blurs a colour that light passes on its way in,
not one on its way out; E is multiplied by c^before and M by c^after, before + after = 1 (d'Eon and Luebke 2007).
Relief turns the normals that light meets; what lies below knows the shape alone.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh, face_cross, group_keys
from milkglass.core.geometry.normals import unit
from milkglass.core.geometry.rays import RayMesh
from milkglass.core.geometry.refine import barycentric
from milkglass.core.geometry.texture import Texture
from milkglass.core.threads import computed_once

Int32 = npt.NDArray[np.int32]

FACE_REACH = 1e-4  # of the bounding sphere's radius: how far from a point the face is looked for that it lies on
STEEPEST = 1e-3  # least height of a normal above its surface


@dataclass(frozen=True, eq=False)
class Skin:
    """One material of a model's file: a factor on colours (linear RGB), and textures, if it has them."""

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    colour: Texture | None = None
    normal: Texture | None = None


@dataclass(frozen=True, eq=False)
class Places:
    """Pieces of a surface: face (n,), barycentric weights (n, 3) of the middle, area (n,) in mm^2."""

    faces: npt.NDArray[np.integer]
    weights: Array
    areas: npt.NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Vertices:
    """Vertices with all that is known of them, (k, ...) float32: as `Detail` has it, split where that jumps.

    `tangents` is the direction of growing u and, last, 1, or -1 where the texture is mirrored; 0 where there is none.
    """

    positions: Float32
    normals: Float32
    coordinates: Float32
    colours: Float32
    tangents: Float32
    faces: Int32


@dataclass(frozen=True, eq=False)
class Detail:
    """Colours and relief of a mesh; compared by identity, so that it can be a cache key.

    Attributes
    ----------
    mesh : Mesh
    rows : (m, 3) int32
        The row of the next two tables that each corner of the faces has.
    coordinates : (k, 2) float32
        Texture coordinates.
    colours : (k, 3) float32
        Linear RGB.
    skin : (m,) int32
        Of each face.
    skins : tuple of Skin
    """

    mesh: Mesh
    rows: Int32
    coordinates: Float32
    colours: Float32
    skin: Int32
    skins: tuple[Skin, ...]

    @property
    def has_colours(self) -> bool:
        """Whether any colour differs from 1."""
        plain = all(skin.colour is None and skin.factor == (1.0, 1.0, 1.0) for skin in self.skins)
        return not plain or bool((self.colours != 1.0).any())

    @property
    def has_normals(self) -> bool:
        """Whether any material of the surface has a normal map."""
        return any(skin.normal is not None for skin in self.skins)

    @computed_once
    def vertices(self) -> Vertices:
        """Vertices of their own, with tangents, for drawing."""
        return _vertices(self)

    def places(self, points: npt.ArrayLike, faces: npt.NDArray[np.integer], areas: npt.NDArray[np.floating]) -> Places:
        """Pieces about points (n, 3) that lie on faces (n,) of the mesh, of areas (n,), mm^2."""
        weights = barycentric(self.mesh.vertices, self.mesh.faces[faces], np.asarray(points, np.float64))
        weights = np.maximum(weights, 0.0)
        return Places(faces, weights / weights.sum(axis=1, keepdims=True), areas)

    def at(self, points: Array, face_normals: Array, areas: npt.NDArray[np.floating]) -> Places:
        """Pieces about points (n, 3) of the surface, by the normals (n, 3) of the faces that they lie on."""
        reach = FACE_REACH * self.mesh.radius
        face, distance = self._rays.first(points + reach * face_normals, -face_normals)
        opposite_face, further = self._rays.first(points - reach * face_normals, face_normals)
        nearer = np.where(opposite_face >= 0, np.abs(further - reach), np.inf) < np.where(
            face >= 0, np.abs(distance - reach), np.inf
        )
        return self.places(points, np.maximum(np.where(nearer, opposite_face, face), 0), areas)

    def colour(self, places: Places, power: float = 1.0) -> Float32:
        """Mean of the colour to a power in each piece, (n, 3)."""
        corners = self.rows[places.faces]
        found = np.einsum("ni,nic->nc", places.weights, self.colours[corners]) ** power
        for skin, rows in self._by_skin(places):
            found[rows] *= np.asarray(skin.factor) ** power
            if skin.colour is not None:
                found[rows] *= self._mean(skin.colour, places, rows, power)
        return np.asarray(np.maximum(found, 0.0), np.float32)

    def relief(self, places: Places, normals: npt.NDArray[np.floating], strength: float) -> tuple[Float32, Float32]:
        """Unit normals (n, 3) turned by the relief, and factors (n,) on irradiance there.

        The factor is the length of the mean of the normals in a piece: a mean of cosines is that of the mean normal.
        `strength` scales slopes; the factor follows as for small ones, whose 1 - length grows as their square.
        """
        turned, factors = np.array(normals, np.float64), np.ones(len(normals))
        tangents = np.einsum("ni,nic->nc", places.weights, self.vertices.tangents[self.vertices.faces[places.faces]])
        for skin, rows in self._by_skin(places):
            if skin.normal is None or len(rows) == 0:
                continue
            mean = self._mean(skin.normal, places, rows).astype(np.float64)
            normal = turned[rows]
            along = tangents[rows, :3]
            along = unit(along - np.einsum("ij,ij->i", along, normal)[:, None] * normal)
            across = np.cross(normal, along) * np.where(tangents[rows, 3:] < 0.0, -1.0, 1.0)
            # Without a tangent both are 0, and the normal stays.
            slope = strength * (mean[:, :1] * along + mean[:, 1:2] * across)
            has_tangent = np.any(along != 0.0, axis=1)
            turned[rows] = unit(slope + np.maximum(mean[:, 2:], STEEPEST) * normal)
            shortened = 1.0 - np.minimum(np.linalg.norm(mean, axis=1), 1.0)
            factors[rows[has_tangent]] = np.maximum(1.0 - strength**2 * shortened[has_tangent], 0.0)
        return turned.astype(np.float32), factors.astype(np.float32)

    @computed_once
    def _rays(self) -> RayMesh:
        return RayMesh(self.mesh.vertices, self.mesh.faces)

    @computed_once
    def _density(self) -> Array:
        """Area of the unit square of texture coordinates on an area of each face, (m,), 1/mm^2."""
        _, double = _sides(self.coordinates, self.rows)
        area = np.linalg.norm(face_cross(self.mesh.vertices, self.mesh.faces), axis=1)
        density: Array = np.abs(double) / np.maximum(area, np.finfo(np.float64).tiny)
        return density

    def _by_skin(self, places: Places) -> list[tuple[Skin, npt.NDArray[np.intp]]]:
        """Every skin, and which of the places have it."""
        of_place = self.skin[places.faces]
        return [(skin, np.flatnonzero(of_place == i)) for i, skin in enumerate(self.skins)]

    def _mean(self, texture: Texture, places: Places, rows: npt.NDArray[np.intp], power: float = 1.0) -> Float32:
        faces = places.faces[rows]
        coordinates = np.einsum("ni,nic->nc", places.weights[rows], self.coordinates[self.rows[faces]])
        return texture.mean(coordinates, places.areas[rows] * self._density[faces], power)


def _sides(coordinates: Float32, rows: Int32) -> tuple[Array, Array]:
    """Two sides of each face in texture coordinates, (m, 2 sides, 2), and their determinant (m,)."""
    corners = coordinates[rows].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return sides, sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]


def _vertices(detail: Detail) -> Vertices:
    mesh, rows = detail.mesh, detail.rows
    sides, double = _sides(detail.coordinates, rows)
    mirrored = double < 0.0
    # Faces share a vertex where they share its row too, and are alike mirrored (Mikkelsen 2008).
    key = (mesh.faces.astype(np.int64) * len(detail.coordinates) + rows) * 2 + mirrored[:, None]
    first, group = group_keys(key.ravel())
    vertex, row = mesh.faces.ravel()[first], rows.ravel()[first]
    faces = group.reshape(-1, 3)
    tangents = np.zeros((len(first), 4), np.float32)
    tangents[:, 3] = np.where(mirrored[first // 3], -1.0, 1.0)
    if detail.has_normals:
        tangents[:, :3] = _tangents(mesh, sides, double, faces, len(first))
    return Vertices(
        mesh.vertices[vertex],
        mesh.normals[vertex],
        detail.coordinates[row],
        detail.colours[row],
        tangents,
        faces.astype(np.int32),
    )


def _tangents(mesh: Mesh, sides: Array, double: Array, faces: npt.NDArray[np.int64], n: int) -> Array:
    """Directions of growing u at n vertices, (n, 3): means over their faces by angle, 0 where no face has one."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = unit((first * sides[:, 1, 1:] - second * sides[:, 0, 1:]) * np.sign(double)[:, None])
    ahead, back = (unit((np.roll(corners, by, axis=1) - corners).reshape(-1, 3)) for by in (-1, 1))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", ahead, back), -1.0, 1.0))
    weighted = angle[:, None] * np.repeat(along, 3, axis=0)
    sums = [np.bincount(faces.ravel(), weighted[:, i], n) for i in range(3)]
    return unit(np.stack(sums, axis=-1))
