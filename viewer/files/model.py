"""Model files: reading them, judging them and turning them into a `Mesh` in world space.

trimesh parses; everything after that is ours, because its own cleaning is slow on a million triangles and
drops what a file says about hard edges.
"""

import difflib
import io
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from milkglass.core.arrays import Array, Bools, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import components, has_volumes
from milkglass.core.geometry.mesh import Mesh, check_size, compact, flaws, place_in_world, up_rotation
from milkglass.core.geometry.normals import unit
from milkglass.core.geometry.solids import COUNTS, Solids, solids
from milkglass.core.geometry.vessels import VESSELS
from milkglass.core.threads import computed_once
from milkglass.viewer.files.conventions import FILE, conventions
from milkglass.viewer.files.decoding import cause_of, textures_only
from milkglass.viewer.files.gltf import SUFFIXES, check_gltf
from milkglass.viewer.files.gltf_medium import FileMedium, medium_of
from milkglass.viewer.files.gltf_textures import plain_gltf
from milkglass.viewer.files.model_condition import all_degenerate, condition
from milkglass.viewer.files.model_look import Look, LookParts, texture_troubles
from milkglass.viewer.files.ply import plain_ply
from milkglass.viewer.files.polygons import cut_obj, read_off
from milkglass.viewer.files.references import References, candidates
from milkglass.viewer.scene.given_file import reading

LONGEST_HEAD = 1 << 16  # bytes in which an OBJ file names its materials
MOST_NAMED = 20  # parts in a sentence
CUT = {".obj": cut_obj, ".ply": plain_ply}  # what has the polygons of a file as triangles
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


@dataclass(frozen=True, eq=False)
class FileModel:
    """A model's mesh, sentences on what is wrong with its file, and how its surface looks, if the file says.

    Attributes
    ----------
    mesh, warnings, look
    of_face : (m,) int, optional
        Part of each face of the mesh; without, all are of the first.
    names : tuple of tuple of str
        By which each part is known: of its material, then of its object.
    materials : tuple of str
        Name of the file's material of each part, empty where it has none.
    clear : tuple of Mesh
        Parts that have been taken out of it, see `parted`.
    file_size : str
        The size that it has in its file, in words; empty where there is no file.
    medium : FileMedium, optional
        What the file says that the surface bounds, where it says so.
    """

    mesh: Mesh
    warnings: tuple[str, ...] = ()
    look: Look | None = None
    of_face: Ints | None = None
    names: tuple[tuple[str, ...], ...] = ()
    materials: tuple[str, ...] = ()
    clear: tuple[Mesh, ...] = ()
    file_size: str = ""
    medium: FileMedium | None = None

    @computed_once
    def parts(self) -> tuple[tuple[tuple[str, ...], Bools], ...]:
        """Return the names of each part and its faces, (m,); where the file has but one, its components by number."""
        if self.of_face is not None and len(self.names) > 1:
            return tuple((names, self.of_face == i) for i, names in enumerate(self.names))
        of_face, count = components(self.mesh)
        return tuple(((str(i + 1),), of_face == i) for i in range(count))

    @computed_once
    def whole(self) -> Mesh:
        """Return the mesh with all that has been taken out of it."""
        return joined(self.mesh, *self.clear) if self.clear else self.mesh

    @property
    def lift(self) -> float:
        """Return how far the mesh is above the lowest point of the whole, mm."""
        return float(self.mesh.bounds[0, 1] - self.whole.bounds[0, 1])

    def parted(self, clear: Sequence[str], scattering: Sequence[str], name: str) -> "FileModel":
        """Return the model with its clear parts taken out, which are meshes of their own.

        Those that scatter light are kinds of matter of the mesh, after what is named nowhere, which is 0.

        Parameters
        ----------
        clear, scattering : names of parts
        name : str
            What sentences call the model.

        Raises
        ------
        InputError
            No part has a name, or none is left.
        """
        left, kinds = np.ones(len(self.mesh.faces), bool), np.zeros(len(self.mesh.faces), np.int64)
        parts = []
        for wanted in (*clear, *scattering):
            faces = [of_part for names, of_part in self.parts if wanted in names]
            if not faces and len(self.parts) < 2:
                raise InputError(
                    f"materials.{wanted} names no part of {name}, which is of one part alone; leave it out"
                )
            if not faces:
                known = _listed([names[0] for names, _ in self.parts])
                raise InputError(f"materials.{wanted} names no part of {name}, whose parts are {known}")
            of_part = left & np.any(faces, axis=0)
            if not of_part.any():
                raise InputError(f"materials.{wanted} names faces of {name} that another table has named; keep one")
            left &= ~of_part
            parts.append(of_part)
        if not left.any():
            raise InputError(f"materials names all parts of {name}; leave one to [material], which scatters light")
        for kind, of_part in enumerate(parts[len(clear) :], start=1):
            kinds[of_part] = kind
            left |= of_part
        look = None if self.look is None else self.look.of_faces(left)
        meshes = tuple(submesh(self.mesh, of_part) for of_part in parts[: len(clear)])
        mesh = submesh(self.mesh, left)
        if scattering:
            mesh = replace(mesh, kinds=kinds[left])
        of_face = None if self.of_face is None else self.of_face[left]
        return replace(self, mesh=mesh, look=look, of_face=of_face, clear=meshes)

    def solid(self, name: str, nested: str = "hollow") -> "FileModel":
        """Return the model with the boundaries of its matter alone, see `core.geometry.solids`.

        Parameters
        ----------
        name : str
            What sentences call the model.
        nested : str
            What a closed part within another is that looks the same way: "hollow" or "solid".
        """
        found = [solids(mesh, hollow=nested == "hollow") for mesh in (self.mesh, *self.clear)]
        changed = [bounded for bounded in found if bounded is not None]
        warnings = (*self.warnings, *self._drawn_as_one(name))
        if not changed:
            return replace(self, warnings=warnings)
        mesh, *clear = (
            before if bounded is None else _judged(bounded.mesh)
            for before, bounded in zip((self.mesh, *self.clear), found, strict=True)
        )
        look, of_face, matter = self.look, self.of_face, found[0]
        if matter is not None:
            look = None if look is None else look.cut(matter.face, matter.weights)
            of_face = None if of_face is None else of_face[matter.face]
        said = f"{name}: {'; '.join(_clauses(changed, nested))}."
        return replace(self, mesh=mesh, warnings=(said, *warnings), look=look, of_face=of_face, clear=tuple(clear))

    def _drawn_as_one(self, name: str) -> tuple[str, ...]:
        """Return a sentence where parts of several of the file's materials are of one matter, that of [material]."""
        if self.of_face is None or len(self.materials) < 2:
            return ()
        left = self.of_face if self.mesh.kinds is None else self.of_face[self.mesh.kinds == 0]
        counts = np.bincount(left, minlength=len(self.materials))
        shared = list(dict.fromkeys(material for material, count in zip(self.materials, counts, strict=True) if count))
        named = [material for material in shared if material]
        if len(shared) < 2:
            return ()
        nameless = " and what has none" if "" in shared else ""
        return (
            f"{name}: parts of its materials {_listed(named)}{nameless} are drawn as one matter, that of [material]; "
            f'a table [materials."{named[-1]}"] gives one its own.',
        )


def _listed(names: Sequence[str]) -> str:
    """Return the first of some names as a phrase, each once, and how many more there are."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(dict.fromkeys(names[:MOST_NAMED])) + more


def _judged(mesh: Mesh) -> Mesh:
    """Return a mesh that knows whether only front faces are seen from outside."""
    return replace(mesh, outward=flaws(mesh).solid and has_volumes(mesh))


def _clauses(changed: Sequence[Solids], nested: str) -> Iterator[str]:
    """Return clauses on what was done to the matter of a model."""
    turned, joined, copies, within, count = (sum(getattr(solid, name) for solid in changed) for name in COUNTS)
    if turned == count:
        yield "its faces looked inwards and were turned outwards"
    elif turned:
        yield f"{_parts(turned)} looked inwards and {_were(turned)} turned outwards"
    if joined:
        yield f"{_parts(joined)} run into each other and were joined"
    if copies:
        yield f"{_parts(copies)} {_were(copies)} dropped as {'a copy' if copies == 1 else 'copies'}"
    if within and nested == "hollow":
        yield f"{_parts(within)} within another {_were(within)} taken for hollow (model.nested = solid fills that)"
    elif within:
        yield f"{_parts(within)} within another {_were(within)} dropped, as matter in matter (model.nested = solid)"


def _parts(count: int) -> str:
    return "1 closed part of it" if count == 1 else f"{count} closed parts of it"


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def joined(*meshes: Mesh) -> Mesh:
    """Return meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]).astype(np.int32),
    )


def submesh(mesh: Mesh, chosen: Bools) -> Mesh:
    """Return some faces of a mesh, (m,) bool, with the vertices that they use."""
    used, faces = compact(mesh.faces[chosen], len(mesh.vertices))
    return Mesh.of(mesh.vertices[used], mesh.normals[used], faces)


def load_model(path: str | Path, size_mm: float | str, up: str | None = None) -> tuple[Mesh, str | None]:
    """Return the mesh of a model file, the boundary of its matter, and one sentence on its flaws or None."""
    model = read_model(path, size_mm, up).solid(str(path))
    return model.mesh, next(iter(model.warnings), None)


def read_model(path: str | Path, size_mm: float | str, up: str | None = None, *, close_holes: bool = True) -> FileModel:
    """Read a model file and place it in world space.

    Parts of a scene are joined, each with its transform. Normals of the file are kept, hard edges included,
    and computed where the file has none. Vertices that agree are merged, degenerate faces and second copies dropped,
    faces that look another way than their neighbours turned, holes closed. `FileModel.solid` does the rest.

    Parameters
    ----------
    path : str or Path
    size_mm : float or "file"
        Longest side of the bounding box in world space, finite and > 0; or that which it has in the file.
    up : str, optional
        The file's up axis: x, y, z, -x, -y or -z; as `viewer.files.conventions` has it if not given.
    close_holes : bool
        Whether simple holes are closed, see `core.geometry.repair.caps`.

    Returns
    -------
    FileModel
        Its first warning, if the mesh has flaws, tells what they do to the picture.

    Raises
    ------
    InputError
        No file, not a model, no faces, vertices that are not finite numbers, nothing but degenerate faces.
    """
    path = Path(path)
    declared = conventions(path)
    up = declared.up if up is None else up
    if not isinstance(size_mm, str):
        check_size(size_mm)
    elif size_mm != FILE:
        raise InputError(f'model.size_mm must be a length or "{FILE}", not {size_mm!r}.')
    up_rotation(up)
    looks = LookParts(path.suffix.lower())
    with texture_troubles() as troubles, textures_only(), reading(path, "the model"):
        left_out = check_gltf(path) if path.suffix.lower() in SUFFIXES else ()
        replaced, transforms = plain_gltf(path) if path.suffix.lower() in SUFFIXES else (None, {})
        looks.transforms = transforms
        scene = _read(path, replaced)
        vertices, normals, faces, rows = _join(scene, looks)
    if len(faces) == 0:
        raise InputError(f"{path} has no faces (points or lines only); export it as a triangle mesh.")
    _check_vertices(path, vertices, faces)
    corners = vertices[faces]
    distinct = ~(corners == corners[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    used, triangles = compact(faces[distinct], len(vertices))
    if len(triangles) == 0:
        raise InputError(all_degenerate(path))
    longest = float(np.ptp(vertices[used], axis=0).max())
    size = declared.size(longest, path) if isinstance(size_mm, str) else size_mm
    placed = place_in_world(vertices[used], size, up)
    names, materials = _part_names(scene)
    turned_up = normals[used] @ up_rotation(up).T
    found = condition(path, placed, turned_up, triangles, rows[distinct], close_holes=close_holes)
    look, of_face = looks.look(found.corners), looks.parts(found.corners)
    said = (*(("; ".join(found.said),) if found.said else ()), *troubles, *left_out)
    warnings = tuple(f"{path}: {clause}." for clause in said)
    said_size, medium = declared.size_text(longest), medium_of(path)
    return FileModel(found.mesh, warnings, look, of_face, names, materials, file_size=said_size, medium=medium)


def builtin_vessel(shape: str, size_mm: float, up: str = "y") -> FileModel:
    """Place a vessel of `core.geometry.vessels` and what is in it in world space."""
    parts = VESSELS[shape]()
    counts = [len(part.faces) for part in parts.values()]
    whole = joined(*parts.values())
    placed, normals = place_in_world(whole.vertices, size_mm, up), whole.normals @ up_rotation(up).T
    of_face = np.repeat(np.arange(len(parts)), counts)
    return FileModel(Mesh.of(placed, normals, whole.faces), of_face=of_face, names=tuple((name,) for name in parts))


def supported_suffixes() -> tuple[str, ...]:
    """Return the suffixes, with their dot, that can be read with the packages installed."""
    # Points have no surface to render; stl_ascii is a name for export only.
    formats = trimesh.exchange.load.mesh_formats() - {"xyz", "stl_ascii"}
    return tuple(sorted(f".{name}" for name in formats))


def _read(path: Path, replaced: bytes | None = None) -> trimesh.Scene:
    """Parse the file, or other bytes in its place, silently; any failure becomes one sentence."""
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
        if suffix == ".stl":
            _check_stl(path)
        if suffix == ".off":
            vertices, faces = read_off(path)
            return trimesh.Scene({path.stem: trimesh.Trimesh(vertices, faces, process=False)})
        with _quiet():
            # Seams of textures would cost our normals; `viewer.files.model_look` has them by corners.
            options: dict[str, Any] = {"split_objects": True} if suffix == ".obj" and not _has_materials(path) else {}
            source: Path | io.BytesIO = path
            if suffix in CUT:
                replaced = CUT[suffix](path.read_bytes())
            if suffix == ".gltf" and replaced is None:
                replaced = path.read_bytes()
            if replaced is not None:
                source = io.BytesIO(replaced)
                options |= {"resolver": References(path)}
            return trimesh.load_scene(source, file_type=suffix[1:], process=False, fix_texture=False, **options)
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} could not be read as a {suffix} model ({cause_of(error)}); check the file or export it again."
        ) from error


def _check_stl(path: Path) -> None:
    """Raise ValueError for a binary STL file of another length than its head says, which trimesh takes for text."""
    with path.open("rb") as file:
        head = file.read(84)
    promised = 84 + 50 * int.from_bytes(head[80:], "little")
    if not head.lstrip().lower().startswith(b"solid") and path.stat().st_size != promised:
        raise ValueError(f"its head promises {promised:,} bytes, but there are {path.stat().st_size:,}")


def _has_materials(path: Path) -> bool:
    """Return whether an OBJ file comes with its materials, by which its parts are then told apart, else by objects."""
    with path.open("rb") as file:
        named = re.search(rb"^\s*mtllib\s+(.+?)\s*$", file.read(LONGEST_HEAD), re.MULTILINE)
    return named is not None and any(os.path.isfile(path.parent / name) for name in candidates(os.fsdecode(named[1])))


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
    """Hold back what trimesh and its packages warn about: the user gets one sentence of ours."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def _join(scene: trimesh.Scene, looks: LookParts) -> tuple[Array, Array, Ints, Ints]:
    """Vertices, normals (NaN where the file gives none), faces and rows of `looks` of all parts, transforms applied."""
    vertices, normals, faces = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
    rows = [np.empty((0, 3), np.int32)]
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
        order = slice(None, None, -1 if np.linalg.det(linear) < 0.0 else 1)
        faces.append(f[:, order] + offset)
        rows.append(looks.add(part, f)[:, order])
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces), np.concatenate(rows)


def _part_names(scene: trimesh.Scene) -> tuple[tuple[tuple[str, ...], ...], tuple[str, ...]]:
    """Return the names of a scene's parts in the order of `_join`: all that each has, and that of its material."""
    found, materials = [], []
    for node in scene.graph.nodes_geometry:
        name = scene.graph[node][1]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh):
            material = getattr(getattr(part.visual, "material", None), "name", None)
            found.append(tuple(dict.fromkeys(str(known) for known in (material, node, name) if known)))
            materials.append(str(material or ""))
    return tuple(found), tuple(materials)


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
