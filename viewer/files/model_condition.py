"""A model's arrays made sound: what is wrong with them found and put right, normals given or computed, a `Mesh`."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import has_volumes
from milkglass.core.geometry.mesh import (
    Flaws,
    Mesh,
    compact,
    find_flaws,
    group_keys,
    has_no_area,
    position_groups,
    repeats_vertex,
)
from milkglass.core.geometry.normals import crease_normals, vertex_normals

# Normals of one position that agree to 2^-9 are one vertex.
NORMAL_BITS = 10


def all_degenerate(path: Path) -> str:
    """Return the sentence that no face has an area."""
    return f"{path} has no face with an area; export it again, without mesh compression."


def condition(path: Path, vertices: Array, normals: Array, faces: Ints, corners: Ints) -> tuple[Mesh, Ints, str | None]:
    """Make a `Mesh` of placed vertices (n, 3) with the normals (n, 3), NaN for none, and faces (m, 3) of a file.

    Returns
    -------
    mesh : Mesh
    corners : (k, 3)
        The rows of `corners`, (m, 3), of the faces that are left, turned where those were.
    warning : str or None
    """
    first, group = position_groups(vertices)
    # Faces without area still close the seams that they were put into, so they count here.
    found = find_flaws(vertices[first], group[faces])
    if found.inverted:
        faces, corners = faces[:, ::-1], corners[:, ::-1]
    valid = ~repeats_vertex(group[faces]) & ~has_no_area(vertices, faces)
    faces, corners = faces[valid], corners[valid]
    if len(faces) == 0:
        raise InputError(all_degenerate(path))
    has_normals = np.isfinite(normals[faces]).all(axis=(1, 2))
    sound = found.closed and found.non_manifold_edges == 0 and found.inconsistent_edges == 0
    if has_normals.any():
        before = faces[:, 0].copy()
        faces[has_normals], normals = _reconcile(vertices, normals, faces[has_normals], sound=sound)
        corners = np.where((faces[:, 0] != before)[:, None], corners[:, ::-1], corners)
        if not sound:
            left = find_flaws(vertices[first], group[faces])
            found = replace(found, inconsistent_edges=left.inconsistent_edges)
    parts = [_merge_given(group, vertices, normals, faces[has_normals])] if has_normals.any() else []
    if not has_normals.all():
        used, renumbered = compact(group[faces[~has_normals]], len(first))
        parts.append(crease_normals(vertices[first[used]], renumbered))
    offsets = np.cumsum([0] + [len(part[0]) for part in parts])
    mesh = Mesh.of(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] + offset for part, offset in zip(parts, offsets, strict=False)]),
    )
    rows = np.concatenate([corners[has_normals], corners[~has_normals]])
    return replace(mesh, outward=sound and has_volumes(mesh)), rows, _warning(path, found)


def _reconcile(vertices: Array, normals: Array, faces: Ints, *, sound: bool) -> tuple[Ints, Array]:
    """Make the file's normals and the winding of its faces agree; compute those that are zero.

    The winding of a closed, consistent mesh is sure, and normals follow it. Elsewhere the normals are the
    better witness, and faces that all their normals speak against are turned.
    """
    if not sound:
        u, v, w = (vertices[faces[:, k]] for k in range(3))
        along = np.einsum("ij,ikj->ik", np.cross(v - u, w - u), normals[faces])
        faces = np.where((along < 0.0).all(axis=1)[:, None], faces[:, ::-1], faces)
    computed = vertex_normals(vertices, faces)
    cosine = np.einsum("ij,ij->i", normals, computed)
    if sound:
        used, _ = compact(faces, len(vertices))
        if np.count_nonzero(cosine[used] < 0.0) * 2 > len(used):
            normals, cosine = -normals, -cosine
    wrong = cosine <= 0.0 if sound else ~np.any(normals != 0.0, axis=1)
    return faces, np.where(wrong[:, None], computed, normals)


def _merge_given(group: Ints, vertices: Array, normals: Array, faces: Ints) -> tuple[Array, Array, Ints]:
    """Merge vertices that agree in position and normal."""
    used, faces = compact(faces, len(vertices))
    vertices, normals, group = vertices[used], normals[used], group[used]
    cells = np.rint((normals + 1.0) * (2**NORMAL_BITS - 1) / 2.0).astype(np.int64)
    key = group
    for axis in range(3):
        key = key << NORMAL_BITS | cells[:, axis]
    first, merged = group_keys(key)
    return vertices[first], normals[first], merged[faces]


def _warning(path: Path, found: Flaws) -> str | None:
    """One sentence on what the flaws do to the picture."""
    parts = []
    if found.inverted:
        parts.append("its faces looked inwards and were turned outwards")
    if found.boundary_edges:
        parts.append(
            f"it is not closed ({found.boundary_edges} open edges), so no light enters where surface is"
            " missing and the picture is too dark there"
        )
    if found.non_manifold_edges:
        parts.append(f"{found.non_manifold_edges} edges join more than two faces, so the shading may show seams there")
    if found.inconsistent_edges:
        parts.append(
            f"faces disagree about which side is outside across {found.inconsistent_edges} edges, so some"
            " take up no light and look black"
        )
    return f"{path}: {'; '.join(parts)}." if parts else None
