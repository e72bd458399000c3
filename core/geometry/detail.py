"""Surface detail: the colours and normal maps that a model's file gives its faces beyond their shape.

Stored beside the mesh, by the corners of its faces: where texture coordinates jump, the mesh stays one surface. Colours
c are linear RGB, (1, 1, 1) where the material is as it is. Scattering blurs a colour that light passes on its way in,
not one on its way out; E is multiplied by c^before and M by c^after, before + after = 1 (d'Eon and Luebke 2007).
Relief turns the normals that enter the Fresnel and cosine factors; transport below the surface knows the shape alone.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Int32
from milkglass.core.geometry.mesh import Mesh, face_cross, group_keys
from milkglass.core.geometry.normals import unit
from milkglass.core.geometry.refine import barycentric
from milkglass.core.geometry.texture import Texture
from milkglass.core.threads import computed_once

FACE_REACH = 1e-4  # of the bounding sphere's radius: how far from a point its face is searched
MIN_NORMAL_HEIGHT = 1e-3  # smallest component of a normal across its surface


@dataclass(frozen=True, eq=False)
class TextureSet:
    """Textures of one material of a model's file: a factor on colours (linear RGB), a colour map and a normal map."""

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    colour: Texture | None = None
    normal: Texture | None = None


@dataclass(frozen=True, eq=False)
class FacePieces:
    """Pieces of a surface, each on one face.

    Attributes
    ----------
    faces : (n,) int
    weights : (n, 3) float64
        Barycentric coordinates of the centre of each piece in its face.
    areas : (n,) float
        mm^2.
    """

    faces: npt.NDArray[np.integer]
    weights: Array
    areas: npt.NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class DetailVertices:
    """Vertices with their attributes for drawing, split where an attribute of `MeshDetail` jumps.

    Attributes
    ----------
    positions, normals, colours : (k, 3) float32
    coordinates : (k, 2) float32
        Texture coordinates.
    tangents : (k, 4) float32
        Unit direction of growing u, 0 where there is none; then 1, or -1 where the texture is mirrored.
    faces : (m, 3) int32
    """

    positions: Float32
    normals: Float32
    coordinates: Float32
    colours: Float32
    tangents: Float32
    faces: Int32


@dataclass(frozen=True, eq=False)
class MeshDetail:
    """Colours and normal maps of a mesh; compared by identity, so that it can be a cache key.

    Attributes
    ----------
    mesh : Mesh
    rows : (m, 3) int32
        Row in `coordinates` and `colours` of each corner of the faces.
    coordinates : (k, 2) float32
        Texture coordinates.
    colours : (k, 3) float32
        Linear RGB.
    texture_set : (m,) int32
        Index of each face's textures in `texture_sets`.
    texture_sets : tuple of TextureSet
    """

    mesh: Mesh
    rows: Int32
    coordinates: Float32
    colours: Float32
    texture_set: Int32
    texture_sets: tuple[TextureSet, ...]

    @property
    def has_colours(self) -> bool:
        """Whether any colour differs from 1."""
        plain = all(
            texture_set.colour is None and texture_set.factor == (1.0, 1.0, 1.0) for texture_set in self.texture_sets
        )
        return not plain or bool((self.colours != 1.0).any())

    @property
    def has_normals(self) -> bool:
        """Whether any material of the surface has a normal map."""
        return any(texture_set.normal is not None for texture_set in self.texture_sets)

    @computed_once
    def vertices(self) -> DetailVertices:
        """Vertices for drawing, with tangents; computed at first use."""
        return _vertices(self)

    def pieces(
        self, points: npt.ArrayLike, faces: npt.NDArray[np.integer], areas: npt.NDArray[np.floating]
    ) -> FacePieces:
        """Return pieces of areas (n,), mm^2, about points (n, 3) that lie on faces (n,) of the mesh."""
        weights = barycentric(self.mesh.vertices, self.mesh.faces[faces], np.asarray(points, np.float64))
        weights = np.maximum(weights, 0.0)
        return FacePieces(faces, weights / weights.sum(axis=1, keepdims=True), areas)

    def pieces_at(self, points: Array, face_normals: Array, areas: npt.NDArray[np.floating]) -> FacePieces:
        """Return pieces about points (n, 3) of the surface; their faces are found along the normals (n, 3) of these."""
        reach = FACE_REACH * self.mesh.radius
        face, distance = self.mesh.rays.first(points + reach * face_normals, -face_normals)
        opposite_face, further = self.mesh.rays.first(points - reach * face_normals, face_normals)
        nearer = np.where(opposite_face >= 0, np.abs(further - reach), np.inf) < np.where(
            face >= 0, np.abs(distance - reach), np.inf
        )
        return self.pieces(points, np.maximum(np.where(nearer, opposite_face, face), 0), areas)

    def colour(self, pieces: FacePieces, power: float = 1.0) -> Float32:
        """Return the mean of colour^power over each piece, (n, 3)."""
        corners = self.rows[pieces.faces]
        found = np.einsum("ni,nic->nc", pieces.weights, self.colours[corners]) ** power
        for texture_set, rows in self._by_texture_set(pieces):
            found[rows] *= np.asarray(texture_set.factor) ** power
            if texture_set.colour is not None:
                found[rows] *= self._mean(texture_set.colour, pieces, rows, power)
        return np.asarray(np.maximum(found, 0.0), np.float32)

    def relief(self, pieces: FacePieces, normals: npt.NDArray[np.floating], strength: float) -> tuple[Float32, Float32]:
        """Return unit normals (n, 3) turned by the normal maps, and factors (n,) on irradiance.

        The factor is the length of the mean of the normals in a piece, since the mean of their cosines is the cosine of
        that mean. `strength` scales slopes; 1 - factor grows with its square, as it does for small slopes.
        """
        turned, factors = np.array(normals, np.float64), np.ones(len(normals))
        tangents = np.einsum("ni,nic->nc", pieces.weights, self.vertices.tangents[self.vertices.faces[pieces.faces]])
        for texture_set, rows in self._by_texture_set(pieces):
            if texture_set.normal is None or len(rows) == 0:
                continue
            mean = self._mean(texture_set.normal, pieces, rows).astype(np.float64)
            normal = turned[rows]
            along = tangents[rows, :3]
            along = unit(along - np.einsum("ij,ij->i", along, normal)[:, None] * normal)
            across = np.cross(normal, along) * np.where(tangents[rows, 3:] < 0.0, -1.0, 1.0)
            # Without a tangent both directions are 0, and the normal stays.
            slope = strength * (mean[:, :1] * along + mean[:, 1:2] * across)
            has_tangent = np.any(along != 0.0, axis=1)
            turned[rows] = unit(slope + np.maximum(mean[:, 2:], MIN_NORMAL_HEIGHT) * normal)
            shortened = 1.0 - np.minimum(np.linalg.norm(mean, axis=1), 1.0)
            factors[rows[has_tangent]] = np.maximum(1.0 - strength**2 * shortened[has_tangent], 0.0)
        return turned.astype(np.float32), factors.astype(np.float32)

    @computed_once
    def _density(self) -> Array:
        """Area in texture coordinates over the area in space of each face, (m,), 1/mm^2."""
        _, double = _sides(self.coordinates, self.rows)
        area = np.linalg.norm(face_cross(self.mesh.vertices, self.mesh.faces), axis=1)
        density: Array = np.abs(double) / np.maximum(area, np.finfo(np.float64).tiny)
        return density

    def _by_texture_set(self, pieces: FacePieces) -> list[tuple[TextureSet, npt.NDArray[np.intp]]]:
        """Return every texture set with the indices of the pieces that have it."""
        of_piece = self.texture_set[pieces.faces]
        return [(texture_set, np.flatnonzero(of_piece == i)) for i, texture_set in enumerate(self.texture_sets)]

    def _mean(self, texture: Texture, pieces: FacePieces, rows: npt.NDArray[np.intp], power: float = 1.0) -> Float32:
        faces = pieces.faces[rows]
        coordinates = np.einsum("ni,nic->nc", pieces.weights[rows], self.coordinates[self.rows[faces]])
        return texture.mean(coordinates, pieces.areas[rows] * self._density[faces], power)


def _sides(coordinates: Float32, rows: Int32) -> tuple[Array, Array]:
    """Return two sides of each face in texture coordinates, (m, 2 sides, 2), and their determinant (m,)."""
    corners = coordinates[rows].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return sides, sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]


def _vertices(detail: MeshDetail) -> DetailVertices:
    mesh, rows = detail.mesh, detail.rows
    sides, double = _sides(detail.coordinates, rows)
    mirrored = double < 0.0
    # Faces share a vertex where they share its row too, and are both mirrored or both not (Mikkelsen 2008).
    key = (mesh.faces.astype(np.int64) * len(detail.coordinates) + rows) * 2 + mirrored[:, None]
    first, group = group_keys(key.ravel())
    vertex, row = mesh.faces.ravel()[first], rows.ravel()[first]
    faces = group.reshape(-1, 3)
    tangents = np.zeros((len(first), 4), np.float32)
    tangents[:, 3] = np.where(mirrored[first // 3], -1.0, 1.0)
    if detail.has_normals:
        tangents[:, :3] = _tangents(mesh, sides, double, faces, len(first))
    return DetailVertices(
        mesh.vertices[vertex],
        mesh.normals[vertex],
        detail.coordinates[row],
        detail.colours[row],
        tangents,
        faces.astype(np.int32),
    )


def _tangents(mesh: Mesh, sides: Array, double: Array, faces: npt.NDArray[np.int64], n: int) -> Array:
    """Return unit directions of growing u at n vertices, (n, 3): angle-weighted means over their faces, or 0."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = unit((first * sides[:, 1, 1:] - second * sides[:, 0, 1:]) * np.sign(double)[:, None])
    ahead, back = (unit((np.roll(corners, by, axis=1) - corners).reshape(-1, 3)) for by in (-1, 1))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", ahead, back), -1.0, 1.0))
    weighted = angle[:, None] * np.repeat(along, 3, axis=0)
    sums = [np.bincount(faces.ravel(), weighted[:, i], n) for i in range(3)]
    return unit(np.stack(sums, axis=-1))
