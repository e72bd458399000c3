"""Model files: reading them, judging them and turning them into a `Mesh` in world space.

trimesh parses; everything after that is ours, because its own cleaning is slow on a million triangles and
drops what a file says about hard edges.
"""

import difflib
import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from core.errors import InputError
from core.mesh import (
    Array,
    Flaws,
    Ints,
    Mesh,
    check_size,
    compact,
    find_flaws,
    group_keys,
    has_no_area,
    place_in_world,
    position_groups,
    repeats_vertex,
    up_rotation,
)
from core.normals import crease_normals, unit, vertex_normals
from core.sculpture import sculpture

# trimesh reads these too, given what `pip install` adds.
EXTRA_PACKAGES = {
    "3dxml": "lxml networkx pillow",
    "3mf": "lxml networkx",
    "dae": "pycollada pillow",
    "step": "cascadio",
    "stp": "cascadio",
    "xaml": "lxml",
    "zae": "pycollada pillow",
}

# Normals of one position that agree to 2^-9 are one vertex.
NORMAL_BITS = 10


def load_model(path: str | Path, size_mm: float, up: str = "y") -> tuple[Mesh, str | None]:
    """Read a model file and place it in world space.

    Parts of a scene are joined, each with its transform. Normals of the file are kept, hard edges included,
    and computed where the file has none. Vertices that agree are merged, degenerate faces dropped, a closed
    mesh that is inside out is turned outwards.

    Parameters
    ----------
    path : str or Path
    size_mm : float
        Longest side of the bounding box in world space, finite and > 0.
    up : str
        The file's up axis: x, y, z, -x, -y or -z.

    Returns
    -------
    mesh : Mesh
    warning : str or None
        One sentence on what the file's flaws do to the picture.

    Raises
    ------
    InputError
        No file, not a model, no faces, vertices that are not finite numbers, nothing but degenerate faces.
    """
    path = Path(path)
    check_size(size_mm)
    up_rotation(up)
    vertices, normals, faces = _join(_read(path))
    if len(faces) == 0:
        raise InputError(f"{path} has no faces (points or lines only); export it as a triangle mesh.")
    _check_vertices(path, vertices, faces)
    corners = vertices[faces]
    apart = ~(corners == corners[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    used, kept = compact(faces[apart], len(vertices))
    if len(kept) == 0:
        raise InputError(_all_degenerate(path))
    placed = place_in_world(vertices[used], size_mm, up)
    return _condition(path, placed, normals[used] @ up_rotation(up).T, kept)


def builtin_model(size_mm: float, up: str = "y") -> Mesh:
    """Place the built-in sculpture in world space; parameters as in `load_model`."""
    vertices, faces, normals = sculpture()
    return Mesh.of(place_in_world(vertices, size_mm, up), normals @ up_rotation(up).T, faces)


def supported_suffixes() -> tuple[str, ...]:
    """Suffixes, with their dot, that can be read with the packages installed."""
    # Points have no surface to render; stl_ascii is a name for export only.
    formats = trimesh.exchange.load.mesh_formats() - {"xyz", "stl_ascii"}
    return tuple(sorted(f".{name}" for name in formats))


def _read(path: Path) -> trimesh.Scene:
    """Parse the file, silently; any failure becomes one sentence."""
    if os.path.isdir(path):
        raise InputError(f"{path} is a directory; name a model file in it.")
    if not os.path.isfile(path):
        raise InputError(f"{path} does not exist; check the name and the directory.")
    suffix = path.suffix.lower()
    if suffix not in supported_suffixes():
        raise InputError(_unsupported(path, suffix))
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty; export the model again.")
        with _quiet():
            # Materials and texture seams are of no use here: textures would cost time, seams our normals.
            return trimesh.load_scene(path, file_type=suffix[1:], process=False, skip_materials=True, fix_texture=False)
    except InputError:
        raise
    except Exception as error:
        reason = str(getattr(error, "strerror", None) or error)
        reason = " ".join(reason.split())[:120].rstrip(".") or type(error).__name__
        raise InputError(
            f"{path} could not be read as a {suffix} model ({reason}); check the file or export it again."
        ) from error


def _unsupported(path: Path, suffix: str) -> str:
    supported = supported_suffixes()
    if suffix[1:] in EXTRA_PACKAGES:
        return f"{path} needs an extra package to be read: pip install {EXTRA_PACKAGES[suffix[1:]]}."
    near = difflib.get_close_matches(suffix, supported, n=1, cutoff=0.5)
    hint = f" (did you mean {near[0]}?)" if near else ""
    named = f"the suffix {suffix}" if suffix else "no suffix"
    return f"{path} has {named}{hint}; models are read from {', '.join(supported)}."


@contextmanager
def _quiet() -> Iterator[None]:
    """Hold back what trimesh and its packages log and warn about: the user gets one sentence of ours."""
    logger = logging.getLogger("trimesh")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(before)


def _join(scene: trimesh.Scene) -> tuple[Array, Array, Ints]:
    """Vertices, normals (NaN where the file gives none) and faces of all parts, transforms applied."""
    vertices, normals, faces = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
    offset = 0
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh):
            continue
        linear = np.asarray(matrix, np.float64)[:3, :3]
        v = np.asarray(part.vertices, np.float64)
        f = np.asarray(part.faces, np.int64)
        with np.errstate(all="ignore"):
            vertices.append(v @ linear.T + np.asarray(matrix, np.float64)[:3, 3])
            normals.append(_given_normals(part, linear))
        # A mirror turns faces inside out (glTF 2.0, 3.7.4).
        faces.append((f[:, ::-1] if np.linalg.det(linear) < 0.0 else f) + offset)
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces)


def _given_normals(part: trimesh.Trimesh, linear: Array) -> Array:
    """Unit normals of the file, transformed; zero where one is unusable, NaN throughout where most are."""
    # Only trimesh's cache tells normals of the file from those that asking for them would compute.
    if "vertex_normals" not in part._cache:
        return np.full(part.vertices.shape, np.nan)
    # The cofactors are the inverse transpose without its division, which a flattening scale forbids; for a
    # mirror they point inwards.
    cofactors = np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]]) * np.copysign(1.0, np.linalg.det(linear))
    normals = np.asarray(part._cache["vertex_normals"], np.float64) @ cofactors.T
    finite = np.isfinite(normals).all(axis=1, keepdims=True)
    normals = unit(np.where(finite, normals, 0.0))
    if 2 * np.count_nonzero(np.any(normals != 0.0, axis=1)) <= len(normals):
        return np.full_like(normals, np.nan)
    return normals


def _check_vertices(path: Path, vertices: Array, faces: Ints) -> None:
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        wrong = low if low < 0 else high
        raise InputError(f"{path} has a face with vertex {wrong} but only {len(vertices)} vertices; export it again.")
    used, _ = compact(faces, len(vertices))
    bad = used[~np.isfinite(vertices[used]).all(axis=1)]
    if len(bad):
        raise InputError(
            f"{path} has vertices that are not finite numbers ({len(bad)} of {len(used)}, the first is"
            f" vertex {bad[0]}); repair it or export it again."
        )


def _all_degenerate(path: Path) -> str:
    return f"{path} has no face with an area; export it again, without mesh compression."


def _condition(path: Path, vertices: Array, normals: Array, faces: Ints) -> tuple[Mesh, str | None]:
    """Make a `Mesh` of placed vertices and whatever normals (NaN: none) and faces the file has."""
    first, group = position_groups(vertices)
    # Faces without area still close the seams that they were put into, so they count here.
    found = find_flaws(vertices[first], group[faces])
    if found.inverted:
        faces = faces[:, ::-1]
    faces = faces[~repeats_vertex(group[faces]) & ~has_no_area(vertices, faces)]
    if len(faces) == 0:
        raise InputError(_all_degenerate(path))
    given = np.isfinite(normals[faces]).all(axis=(1, 2))
    if given.any():
        sound = found.closed and found.non_manifold_edges == 0 and found.inconsistent_edges == 0
        faces[given], normals = _reconcile(vertices, normals, faces[given], sound)
        if not sound:
            left = find_flaws(vertices[first], group[faces])
            found = replace(found, inconsistent_edges=left.inconsistent_edges)
    parts = [_merge_given(group, vertices, normals, faces[given])] if given.any() else []
    if not given.all():
        used, own = compact(group[faces[~given]], len(first))
        parts.append(crease_normals(vertices[first[used]], own))
    offsets = np.cumsum([0] + [len(part[0]) for part in parts])
    mesh = Mesh.of(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] + offset for part, offset in zip(parts, offsets, strict=False)]),
    )
    return mesh, _warning(path, found)


def _reconcile(vertices: Array, normals: Array, faces: Ints, sound: bool) -> tuple[Ints, Array]:
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
