"""A model's arrays made sound: what is wrong with them found and put right, normals given or computed, a `Mesh`."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import component_of_faces, has_volumes
from milkglass.core.geometry.mesh import (
    Flaws,
    Mesh,
    compact,
    face_cross,
    find_flaws,
    group_keys,
    has_no_area,
    position_groups,
    repeats_vertex,
)
from milkglass.core.geometry.normals import crease_normals, vertex_normals
from milkglass.core.geometry.repair import caps, repeated_faces, turned_about

# Normals of one position that agree to 2^-9 are one vertex.
NORMAL_BITS = 10


def all_degenerate(path: Path) -> str:
    """Return the sentence that no face has an area."""
    return f"{path} has no face with an area; export it again, without mesh compression."


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What a file's arrays have become.

    Attributes
    ----------
    mesh : Mesh
        Its parts may still look inwards, see `core.geometry.solids`.
    corners : (k, 3)
        The rows of the file's corners, of the faces that are left, turned where those were.
    said : tuple of str
        What was put right and what could not be, clauses of a sentence.
    """

    mesh: Mesh
    corners: Ints
    said: tuple[str, ...]


def condition(
    path: Path, vertices: Array, normals: Array, faces: Ints, corners: Ints, *, close_holes: bool = True
) -> Conditioned:
    """Make a `Mesh` of placed vertices (n, 3) with the normals (n, 3), NaN for none, and faces (m, 3) of a file.

    `corners`, (m, 3), are rows of tables that belong to the corners of the faces.
    """
    first, group = position_groups(vertices)
    # Faces without area still close the seams that they were put into, so they count at first.
    lines = repeats_vertex(group[faces])
    faces, corners = faces[~lines], corners[~lines]
    if len(faces) == 0:
        raise InputError(all_degenerate(path))
    positions, said = vertices[first], list[str]()
    found = find_flaws(positions, group[faces])
    if found.non_manifold_edges or found.inconsistent_edges:
        twice = repeated_faces(group[faces], component_of_faces(group[faces], len(first)))
        if twice.any():
            said.append(f"{np.count_nonzero(twice)} of its faces lie on others of it and were left out")
            faces, corners = faces[~twice], corners[~twice]
            found = find_flaws(positions, group[faces])
    if not _is_sound(found):
        # The file's normals are a better witness than the winding of its faces.
        turned = _against_normals(vertices, normals, faces)
        faces, corners = _turned(faces, turned), _turned(corners, turned)
        found = find_flaws(positions, group[faces])
    if found.inconsistent_edges:
        turned = turned_about(group[faces], len(first))
        before, faces, corners = found, _turned(faces, turned), _turned(corners, turned)
        found = find_flaws(positions, group[faces])
        if found.inconsistent_edges < before.inconsistent_edges:
            said.append(f"{np.count_nonzero(turned)} of its faces looked the wrong way and were turned")
    if found.boundary_edges and close_holes:
        lids = caps(positions, group[faces], component_of_faces(group[faces], len(first)))
        if lids.holes:
            row = np.zeros(len(first), corners.dtype)
            row[group[faces]] = corners
            faces = np.concatenate([faces, lids.faces + len(vertices)])
            corners = np.concatenate([corners, row[lids.faces]])
            vertices = np.concatenate([vertices, positions])
            normals = np.concatenate([normals, np.full_like(positions, np.nan)])
            group = np.concatenate([group, np.arange(len(first))])
            found = find_flaws(positions, group[faces])
            holes = "1 hole was" if lids.holes == 1 else f"{lids.holes} holes were"
            said.append(f"{holes} closed (model.close_holes = false leaves them)")
    valid = ~has_no_area(vertices, faces)
    faces, corners = faces[valid], corners[valid]
    if len(faces) == 0:
        raise InputError(all_degenerate(path))
    has_normals, sound = np.isfinite(normals[faces]).all(axis=(1, 2)), _is_sound(found)
    parts = []
    if has_normals.any():
        normals = _reconcile(vertices, normals, faces[has_normals], sound=sound)
        parts.append(_merge_given(group, vertices, normals, faces[has_normals]))
    if not has_normals.all():
        used, renumbered = compact(group[faces[~has_normals]], len(first))
        parts.append(crease_normals(positions[used], renumbered))
    offsets = np.cumsum([0] + [len(part[0]) for part in parts])
    mesh = Mesh.of(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] + offset for part, offset in zip(parts, offsets, strict=False)]),
    )
    rows = np.concatenate([corners[has_normals], corners[~has_normals]])
    return Conditioned(replace(mesh, outward=sound and has_volumes(mesh)), rows, (*said, *_flaws(found)))


def _is_sound(found: Flaws) -> bool:
    """Whether a mesh is closed and consistently wound."""
    return found.closed and found.non_manifold_edges == 0 and found.inconsistent_edges == 0


def _turned(faces: Ints, chosen: Bools) -> Ints:
    """Return faces, or what belongs to their corners, (m, 3), with the chosen ones, (m,), in the opposite order."""
    return np.where(chosen[:, None], faces[:, ::-1], faces)


def _against_normals(vertices: Array, normals: Array, faces: Ints) -> Bools:
    """Return a mask (m,) of the faces that all their normals speak against."""
    along = np.einsum("ij,ikj->ik", face_cross(vertices, faces), normals[faces])
    return np.asarray((along < 0.0).all(axis=1))


def _reconcile(vertices: Array, normals: Array, faces: Ints, *, sound: bool) -> Array:
    """Make the file's normals agree with the winding of faces that have some; compute those that are zero.

    The winding of a closed, consistent mesh is sure, and normals follow it.
    """
    computed = vertex_normals(vertices, faces)
    cosine = np.einsum("ij,ij->i", normals, computed)
    if sound:
        used, _ = compact(faces, len(vertices))
        if np.count_nonzero(cosine[used] < 0.0) * 2 > len(used):
            normals, cosine = -normals, -cosine
    wrong = cosine <= 0.0 if sound else ~np.any(normals != 0.0, axis=1)
    return np.where(wrong[:, None], computed, normals)


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


def _flaws(found: Flaws) -> tuple[str, ...]:
    """Return clauses on what the flaws that are left do to the picture."""
    said = []
    if found.boundary_edges:
        said.append(
            f"it is not closed ({found.boundary_edges} open edges), so no light enters where surface is"
            " missing and the picture is too dark there"
        )
    if found.non_manifold_edges:
        said.append(f"{found.non_manifold_edges} edges join more than two faces, so the shading may show seams there")
    if found.inconsistent_edges:
        said.append(
            f"faces disagree about which side is outside across {found.inconsistent_edges} edges, so some"
            " take up no light and look black"
        )
    return tuple(said)
