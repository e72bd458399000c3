"""Stub while it is being made."""
from core.mesh import Array, Ints


def sculpture() -> tuple[Array, Ints, Array]:
    """Vertices, faces, normals."""
    raise NotImplementedError
