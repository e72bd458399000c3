"""Colours and relief that a model's file comes with, taken from what trimesh parsed.

Only one set of texture coordinates a material, and repeating textures; alpha, and a single colour for the whole model,
which is the material's business, are left out.
"""

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.core.arrays import Array, Bools, Float32, Int32, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.detail import MeshDetail, TextureSet
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.solids import is_new
from milkglass.core.geometry.texture import COLOUR, NORMAL, Texture, linear
from milkglass.core.threads import computed_once
from milkglass.viewer.files.decoding import cause_of
from milkglass.viewer.files.images import PICTURE_SUFFIXES, read_image
from milkglass.viewer.files.references import transform_of

Table = tuple[Float32, Float32]  # texture coordinates (k, 2), linear colours (k, 3)

MAX_TEXELS = 8192  # texels a side; larger textures of a file are averaged to fit
MADE_UP = (2, 2)  # texels of the grey picture, of no file, that trimesh gives to coordinates without a material
LINEAR_SUFFIXES = (".glb", ".gltf")  # whose vertex colours are linear (glTF 2.0, 3.7.2.1), not sRGB
TROUBLES = ("image", "materials", "texture")  # words of what trimesh logs where it does without them


@dataclass(frozen=True, eq=False)
class MaterialLook:
    """One material of a file: a factor, linear RGB, and pictures of Pillow that are not decoded yet."""

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    colour: Any = None
    normal: Any = None


@dataclass(frozen=True, eq=False)
class Look:
    """The colours and relief of a mesh's surface, as its file has them.

    Attributes
    ----------
    rows : (m, 3) int32
        Rows of the tables, of each corner of the mesh's faces.
    coordinates, colours : (k, 2) and (k, 3) float32
    material : (m,) int32
        Of each face.
    materials : tuple of MaterialLook
    mapped : bool
        Whether there are texture coordinates.
    """

    rows: Int32
    coordinates: Float32
    colours: Float32
    material: Int32
    materials: tuple[MaterialLook, ...]
    mapped: bool

    @computed_once
    def has_colours(self) -> bool:
        """Whether the file has colours."""
        plain = all(material.colour is None and material.factor == (1.0, 1.0, 1.0) for material in self.materials)
        return not plain or bool((self.colours != 1.0).any())

    @property
    def has_relief(self) -> bool:
        """Whether the file has a normal map."""
        return any(material.normal is not None for material in self.materials)

    def of_faces(self, chosen: Bools) -> "Look | None":
        """Return the look of some faces, (m,) bool; None where it is plain."""
        tables = self.rows[chosen], self.coordinates, self.colours, self.material[chosen]
        look = Look(*tables, self.materials, self.mapped)
        used = [self.materials[i] for i in np.unique(look.material)]
        plain = len({material.factor for material in used}) == 1 and not self.mapped
        plain = plain and all(material.colour is None and material.normal is None for material in used)
        return None if plain and np.ptp(self.colours[look.rows.ravel()], axis=0).max() == 0.0 else look

    def cut(self, face: Ints, weights: Array) -> "Look":
        """Return the look of pieces of the faces, (k,), whose corners have barycentric weights there, (k, 3, 3)."""
        rows, new = self.rows[face], is_new(weights)
        coordinates, colours = (
            np.einsum("ij,ijk->ik", weights[new], table[rows[np.nonzero(new)[0]]]).astype(np.float32)
            for table in (self.coordinates, self.colours)
        )
        rows = np.take_along_axis(rows, weights.argmax(axis=2), axis=1)
        rows[new] = len(self.coordinates) + np.arange(len(coordinates))
        tables = np.concatenate([self.coordinates, coordinates]), np.concatenate([self.colours, colours.clip(0.0, 1.0)])
        return Look(rows, *tables, self.material[face], self.materials, self.mapped)


class LookParts:
    """Collects the look of a scene's parts while these are joined."""

    def __init__(self, suffix: str) -> None:
        self._linear = suffix in LINEAR_SUFFIXES
        self._tables: list[Table] = []
        self._materials: list[MaterialLook] = []
        self._starts = [0]
        self._mapped = False
        self.transforms: dict[str, Array] = {}  # of texture coordinates, by the name of a vertex attribute

    def add(self, part: trimesh.Trimesh, faces: Ints) -> Int32:
        """Add a part and return the row of each corner of its faces (m, 3), as the file winds them."""
        (coordinates, colours), rows = self._table(part, faces)
        start = self._starts[-1]
        self._tables.append((coordinates, colours))
        self._starts.append(start + len(coordinates))
        self._materials.append(_material(getattr(part.visual, "material", None)))
        return (rows + start).astype(np.int32)

    def parts(self, rows: Ints) -> Ints:
        """Return the part of each face, numbered as they were added, (m,), for the rows (m, 3) of those kept."""
        return np.asarray(np.searchsorted(self._starts, rows[:, 0], side="right") - 1)

    def look(self, rows: Ints) -> Look | None:
        """Return the look of all parts for the rows (m, 3) of the faces that were kept; None where it is plain."""
        pictures = any(m.colour is not None or m.normal is not None for m in self._materials)
        one_factor = len({material.factor for material in self._materials}) == 1
        if one_factor and not pictures and all(len(colours) == 1 for _, colours in self._tables):
            return None
        coordinates, colours = (np.concatenate([table[i] for table in self._tables]) for i in (0, 1))
        part = self.parts(rows)
        factors = np.array([material.factor for material in self._materials])[part]
        plain = np.ptp(colours[rows.ravel()], axis=0).max() == 0.0 and np.ptp(factors, axis=0).max() == 0.0
        if plain and not pictures and not self._mapped:
            return None
        materials = tuple(self._materials)
        if plain and not pictures:  # a single colour
            materials, colours = tuple(MaterialLook() for _ in materials), np.ones_like(colours)
        return Look(rows.astype(np.int32), coordinates, colours, part.astype(np.int32), materials, self._mapped)

    def _table(self, part: trimesh.Trimesh, faces: Ints) -> tuple[Table, Ints]:
        visual, n = part.visual, len(part.vertices)
        if visual.kind == "face":
            colours = self._colours(visual.face_colors)
            rows = np.repeat(np.arange(len(faces))[:, None], 3, axis=1)
            return (np.zeros((len(colours), 2), np.float32), colours), rows
        uv = getattr(visual, "uv", None)
        vertex_colours = visual.vertex_colors if visual.kind == "vertex" else None
        if visual.kind == "texture":
            vertex_colours = visual.vertex_attributes.get("color")
        raw = _texture_corners(part, len(faces))
        if raw is not None:
            self._mapped = True
            return (raw, np.ones((len(raw), 3), np.float32)), np.arange(3 * len(faces)).reshape(-1, 3)
        mapped = uv is not None and np.asarray(uv).shape == (n, 2)
        if not mapped and (vertex_colours is None or len(vertex_colours) != n):
            return (np.zeros((1, 2), np.float32), np.ones((1, 3), np.float32)), np.zeros_like(faces)
        self._mapped |= mapped
        coordinates = _finite(self._transformed(part, np.asarray(uv))) if mapped else np.zeros((n, 2), np.float32)
        colours = (
            np.ones((n, 3), np.float32)
            if vertex_colours is None or len(vertex_colours) != n
            else self._colours(vertex_colours)
        )
        return (coordinates, colours), faces

    def _transformed(self, part: trimesh.Trimesh, coordinates: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return texture coordinates, (n, 2), as the file transforms them."""
        matrix = next((self.transforms[name] for name in part.vertex_attributes if name in self.transforms), None)
        image = getattr(getattr(part.visual, "material", None), "image", None)
        if matrix is None and image is not None:
            matrix = transform_of(str(getattr(image, "info", {}).get("file_path", "")))
        return coordinates if matrix is None else coordinates @ matrix[:2, :2].T + matrix[:2, 2]

    def _colours(self, values: npt.NDArray[Any]) -> Float32:
        """Linear RGB of 8-bit, 16-bit or float colours, (n, 3 or 4)."""
        scale = float(np.iinfo(values.dtype).max) if values.dtype.kind in "ui" else 1.0
        share = np.clip(np.nan_to_num(np.asarray(values, np.float64)[:, :3] / scale), 0.0, 1.0)
        return (share if self._linear else linear(share)).astype(np.float32)


def detail_of(
    look: Look | None,
    mesh: Mesh,
    name: str,
    texture: Path | None,
    normal_map: Path | None,
    *,
    colours: bool,
    relief: bool,
) -> tuple[MeshDetail | None, tuple[str, ...]]:
    """Return the decoded detail of a look, given pictures in place of the file's, and a sentence on each that failed.

    Raises
    ------
    InputError
        If a given picture cannot be read, or there are no texture coordinates to put it on.
    """
    for key, path in (("texture", texture), ("normal_map", normal_map)):
        if path is not None and (look is None or not look.mapped):
            raise InputError(f"model.{key} needs texture coordinates, which {name} does not have; unwrap it first")
    if look is None:
        return None, ()
    picture = None if texture is None or not colours else Texture(_picture(texture, "texture"))
    bumps = None if normal_map is None or not relief else Texture(_picture(normal_map, "normal_map"), NORMAL)
    troubles: list[str] = []
    decoded: dict[tuple[int, str], Texture | None] = {}  # materials may share a picture

    def decode(image: Any, kind: str) -> Texture | None:
        key = id(image), kind
        if image is not None and key not in decoded:
            decoded[key] = _decoded(image, kind, troubles)
        return None if image is None else decoded[key]

    texture_sets = []
    for material in look.materials:
        tinted = colours and texture is None
        colour = picture if texture is not None else decode(material.colour, COLOUR) if tinted else None
        normal = bumps if normal_map is not None else decode(material.normal, NORMAL) if relief else None
        texture_sets.append(TextureSet(material.factor if tinted else (1.0, 1.0, 1.0), colour, normal))
    tints = look.colours if colours and texture is None else np.ones_like(look.colours)
    detail = MeshDetail(mesh, look.rows, look.coordinates, tints, look.material, tuple(texture_sets))
    warnings = tuple(f"{name}: {trouble}" for trouble in troubles)
    return (detail if detail.has_colours or detail.has_normals else None), warnings


@contextlib.contextmanager
def texture_troubles() -> Iterator[list[str]]:
    """Collect, while a file is read, a sentence on textures that trimesh leaves out; nothing is printed."""
    logger, found = logging.getLogger("trimesh"), list[str]()

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if any(word in record.getMessage() for word in TROUBLES) and not found:
                problem = record.exc_info[1] if record.exc_info else None
                reason = f" ({cause_of(problem)})" if problem is not None else ""
                found.append(f"a texture or material file of it could not be read{reason}, so it is drawn without")

    handler, before = Collector(), (logger.level, logger.propagate)
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    try:
        yield found
    finally:
        logger.removeHandler(handler)
        logger.level, logger.propagate = before


def _material(source: Any) -> MaterialLook:
    """Return a material of trimesh as factor and pictures."""
    parts = getattr(source, "materials", None)  # of several, the first
    source = parts[0] if parts else source
    colour = getattr(source, "baseColorTexture", None) or getattr(source, "image", None)
    if colour is not None and getattr(colour, "format", "") is None and colour.size == MADE_UP:
        colour = None
    factor = getattr(source, "baseColorFactor", None)
    if factor is not None:
        factor = np.asarray(factor, np.float64)[:3] / (255.0 if np.asarray(factor).dtype.kind == "u" else 1.0)
    elif colour is None:  # exporters write any Kd beside a picture
        factor = (getattr(source, "kwargs", None) or {}).get("kd")
    normal = getattr(source, "normalTexture", None)
    if factor is None or np.shape(factor) != (3,):
        return MaterialLook(colour=colour, normal=normal)
    red, green, blue = np.clip(np.asarray(factor, np.float64), 0.0, 1.0).tolist()
    return MaterialLook((red, green, blue), colour, normal)


def _texture_corners(part: trimesh.Trimesh, faces: int) -> Float32 | None:
    """Texture coordinates of the corners, (3 m, 2), where a PLY file has them by faces; trimesh would cut there."""
    raw = part.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    try:
        corners = np.asarray(raw["texcoord"]["f1"] if isinstance(raw, np.ndarray) else raw["texcoord"], np.float64)
    except (KeyError, ValueError, IndexError, TypeError):
        return None
    return _finite(corners.reshape(-1, 2)) if corners.shape == (faces, 6) else None


def _finite(coordinates: npt.ArrayLike) -> Float32:
    return np.nan_to_num(np.asarray(coordinates, np.float64), posinf=0.0, neginf=0.0).astype(np.float32)


def _picture(path: Path, key: str) -> npt.NDArray[np.uint8]:
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise InputError(f"model.{key} must end in {', '.join(PICTURE_SUFFIXES)}, not {path.name}")
    pixels = read_image(path)
    return np.asarray(pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2), np.uint8)


def _decoded(image: Any, kind: str, troubles: list[str]) -> Texture | None:
    try:
        shrink = -(-max(image.size) // MAX_TEXELS)
        return Texture(np.asarray((image.reduce(shrink) if shrink > 1 else image).convert("RGB"), np.uint8), kind)
    except Exception as problem:  # whatever Pillow's decoders raise
        troubles.append(f"its {kind} texture could not be read ({cause_of(problem)}), so it is drawn without")
        return None
