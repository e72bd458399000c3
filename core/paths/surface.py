"""The surface of a transparent object, as rays meet it from outside and from inside."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Int32
from milkglass.core.geometry.mesh import Mesh, face_normals, position_groups
from milkglass.core.geometry.rays import RayMesh

OFFSET = 2e-5  # radii of the bounding sphere from a face at which rays that leave it start
COINCIDENT = 1e-4  # radii by which surfaces of two media may lie apart that are meant to touch
OVERLAP = 4.0  # of that distance by which the first of them is grown into the other
UPWARDS = np.array([0.3713, 0.8917, 0.2589])  # along no axis or symmetry of a mesh
MOST_MEDIA = 31  # a bit of a ray's state is for each


@dataclass(frozen=True, eq=False)
class ClearPart:
    """A part of an object that absorbs and refracts light but does not scatter it, as the glass around a liquid.

    Attributes
    ----------
    mesh : Mesh
        Closed, faces counter-clockwise seen from outside.
    eta : float
        Index of refraction over that of the air, > 0.
    absorption : of R, G and B
        1/mm.
    name : str
        What sentences call it.
    """

    mesh: Mesh
    eta: float
    absorption: tuple[float, float, float]
    name: str = ""


class Faces(NamedTuple):
    """Arrays of a surface for compiled loops: n vertices, m faces, b bodies, the clear parts last.

    Attributes
    ----------
    corners : (m, 3) int32
    vertices : (n, 3) float32
        mm.
    normals : (n, 3) float32
        Of the vertices, unit, outward.
    planes : (m, 3) float32
        Normals of the faces, unit, outward.
    bodies : (m,) int32
        Body of each face.
    etas : (b,) float32
        Index of refraction inside each body over that of the air.
    media : (b,) int32
        Medium of each body, numbered from 0. Where two media overlap, the one with the higher number is there.
    of_media : (k,) int32
        Clear part of each medium; of one that scatters -1 less the first body of it.
    """

    corners: Int32
    vertices: Float32
    normals: Float32
    planes: Float32
    bodies: Int32
    etas: Float32
    media: Int32
    of_media: Int32


@dataclass(frozen=True, eq=False)
class Surface:
    """Closed bodies in air, each of one medium inside; compared by identity.

    A ray is inside a body from where it meets the front of a face of it to where it meets the back of one. Bodies of
    different media may overlap: what is there is the medium with the smaller volume in all, so that a body within the
    matter of another is seen, and a liquid may reach into its glass (nested dielectrics, Schmidt and Budge 2002).
    Surfaces that coincide are made to overlap.

    Attributes
    ----------
    faces : Faces
    rays : RayMesh
    offset : float
        Distance from a face at which rays that leave it start, mm.
    scattering : int
        Number of the bodies that scatter light; bodies from there on are clear parts.
    absorption : (b, 3) float32
        Of clear parts, 1/mm; 0 of the others.
    matter : (scattering,) int32
        What each body that scatters is of, numbered from 0, ascending.
    """

    faces: Faces
    rays: RayMesh
    offset: float
    scattering: int
    absorption: Float32
    matter: Int32

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        etas: npt.ArrayLike,
        bodies: Int32 | None = None,
        clear: Sequence[ClearPart] = (),
        matter: npt.ArrayLike | None = None,
    ) -> "Surface":
        """Return the surface of a closed mesh, and of clear parts beside it.

        Parameters
        ----------
        mesh : Mesh
            Faces counter-clockwise seen from outside.
        etas : float or (b,) array
            Relative index of refraction of each body, > 0.
        bodies : (m,) int32, optional
            Body of each face, 0 to b - 1; without, all are one.
        clear : sequence of ClearPart
            With what scatters at most `MOST_MEDIA`.
        matter : (b,) int, optional
            What each body is of, as `Surface` has it; without, all are of one.
        """
        etas = np.atleast_1d(np.asarray(etas, np.float32))
        scattering, meshes = len(etas), [mesh, *(part.mesh for part in clear)]
        of_face = np.zeros(len(mesh.faces), np.int32) if bodies is None else bodies
        of_body = np.zeros(scattering, np.int32) if matter is None else np.asarray(matter, np.int32)
        kinds, first_bodies = np.unique(of_body, return_index=True)
        starts = np.cumsum([0, *(len(part.vertices) for part in meshes)])
        radius = max(part.radius for part in meshes)
        vertices = np.concatenate(_overlapping(meshes, COINCIDENT * radius))
        corners = np.concatenate([part.faces + start for part, start in zip(meshes, starts, strict=False)])
        of_clear = [np.full(len(part.mesh.faces), scattering + i) for i, part in enumerate(clear)]
        scatter = [mesh]
        if len(kinds) > 1:
            scatter = [Mesh(mesh.vertices, mesh.normals, mesh.faces[of_body[of_face] == kind]) for kind in kinds]
        largest_first = np.argsort([-part.volume for part in (*scatter, *meshes[1:])], kind="stable")
        numbers = np.argsort(largest_first)
        media = np.concatenate([numbers[of_body], numbers[len(kinds) :]])
        bodies_found = np.concatenate([-1 - first_bodies, scattering + np.arange(len(clear))])
        of_media = bodies_found[largest_first]
        faces = Faces(
            corners=np.array(corners, np.int32, order="C"),
            vertices=np.array(vertices, np.float32, order="C"),
            normals=np.array(np.concatenate([part.normals for part in meshes]), np.float32, order="C"),
            planes=np.array(face_normals(vertices, corners), np.float32, order="C"),
            bodies=np.array(np.concatenate([of_face, *of_clear]), np.int32, order="C"),
            etas=np.array([*etas, *(part.eta for part in clear)], np.float32),
            media=np.array(media, np.int32),
            of_media=np.array(of_media, np.int32),
        )
        absorption = np.zeros((len(faces.etas), 3), np.float32)
        absorption[scattering:] = [part.absorption for part in clear] or np.empty((0, 3))
        rays = RayMesh(vertices, corners) if clear else mesh.rays
        return cls(faces, rays, OFFSET * radius, scattering, absorption, of_body)

    def below_clear(self, points: Array, inwards: Array) -> Array:
        """Return points (n, 3), those in a clear part moved along unit vectors `inwards` to below what they meet."""
        ray, face = self.rays.all_hits(points, np.broadcast_to(UPWARDS, points.shape), self.offset)
        in_clear = np.zeros(len(points), bool)
        for body in range(self.scattering, len(self.faces.etas)):
            crossed = np.bincount(ray[self.faces.bodies[face] == body], minlength=len(points))
            in_clear |= crossed % 2 == 1
        met, distance = self.rays.first(points[in_clear], inwards[in_clear])
        moved = points.copy()
        moved[in_clear] += np.where(met >= 0, distance + self.offset, 0.0)[:, None] * inwards[in_clear]
        return moved

    @property
    def is_nested(self) -> bool:
        """Whether there are clear parts, so that a ray may be in several media at once."""
        return self.scattering < len(self.absorption)

    @property
    def kinds(self) -> int:
        """Return of how many kinds of matter the bodies that scatter are."""
        return int(self.matter[-1]) + 1


def _overlapping(meshes: Sequence[Mesh], distance: float) -> list[Float32]:
    """Return the vertices of meshes, of each grown a little into those after it where the surfaces coincide."""
    found = []
    for i, mesh in enumerate(meshes):
        vertices, later = np.array(mesh.vertices), meshes[i + 1 :]
        if later:
            first, group = position_groups(vertices)
            outward = np.zeros((len(first), 3), np.float32)
            np.add.at(outward, group, mesh.normals)
            outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), np.float32(1e-6))
            origins, reach = vertices[first] - np.float32(distance) * outward, np.full(len(first), 2.0 * distance)
            touching = np.zeros(len(first), bool)
            for other in later:
                touching |= other.rays.first(origins, outward, reach)[0] >= 0
            vertices += np.float32(OVERLAP * distance) * (touching[:, None] * outward)[group]
        found.append(vertices)
    return found
