"""Indices of refraction of a surface that is around one kind of matter, or around several."""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Ints
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.refine import Refined


@dataclass(frozen=True, eq=False)
class Indices:
    """Relative indices of refraction, >= 1, of a surface around several kinds of matter; compared by identity.

    Attributes
    ----------
    etas : tuple of float
        Of each kind.
    of_vertex, of_face : (n,), (faces,) int
        Kind of matter below each vertex and each face.
    """

    etas: tuple[float, ...]
    of_vertex: Ints
    of_face: Ints

    @classmethod
    def of(cls, etas: tuple[float, ...], mesh: Mesh, fine: Refined) -> "Indices":
        """Return the indices of a mesh around several kinds of matter, refined."""
        of_vertex = np.zeros(len(mesh.vertices), np.int64)
        assert mesh.kinds is not None
        of_vertex[mesh.faces] = mesh.kinds[:, None]
        of_vertex = of_vertex[fine.sources]
        return cls(etas, of_vertex, of_vertex[fine.mesh.faces[:, 0]])


Eta = float | Indices  # of a surface, all of it alike or not
