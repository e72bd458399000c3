"""The surface of a transparent object, as rays meet it from outside and from inside."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Float32, Int32
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.geometry.rays import RayMesh

OFFSET = 2e-5  # radii of the bounding sphere from a face at which rays that leave it start


class Faces(NamedTuple):
    """Arrays of a surface for compiled loops: n vertices, m faces, b bodies.

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
    """

    corners: Int32
    vertices: Float32
    normals: Float32
    planes: Float32
    bodies: Int32
    etas: Float32


@dataclass(frozen=True, eq=False)
class Surface:
    """Closed bodies in air, each of one medium inside; compared by identity.

    A ray is inside a body from where it meets the front of a face of it to where it meets the back of one.

    Attributes
    ----------
    faces : Faces
    rays : RayMesh
    offset : float
        Distance from a face at which rays that leave it start, mm.
    """

    faces: Faces
    rays: RayMesh
    offset: float

    @classmethod
    def of(cls, mesh: Mesh, etas: npt.ArrayLike, bodies: Int32 | None = None) -> "Surface":
        """Return the surface of a closed mesh.

        Parameters
        ----------
        mesh : Mesh
            Faces counter-clockwise seen from outside.
        etas : float or (b,) array
            Relative index of refraction of each body, > 0.
        bodies : (m,) int32, optional
            Body of each face, 0 to b - 1; without, all are one.
        """
        of_face = np.zeros(len(mesh.faces), np.int32) if bodies is None else bodies
        planes = face_normals(mesh.vertices, mesh.faces)
        faces = Faces(
            corners=np.array(mesh.faces, np.int32, order="C"),
            vertices=np.array(mesh.vertices, np.float32, order="C"),
            normals=np.array(mesh.normals, np.float32, order="C"),
            planes=np.array(planes, np.float32, order="C"),
            bodies=np.array(of_face, np.int32, order="C"),
            etas=np.array(np.atleast_1d(etas), np.float32, order="C"),
        )
        return cls(faces, RayMesh(mesh.vertices, mesh.faces), OFFSET * mesh.radius)
