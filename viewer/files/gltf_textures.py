"""What glTF says of where its textures lie and of older materials, in the words that trimesh reads.

trimesh reads the first set of texture coordinates, no transform of them, and turns pictures of the archived
specular-glossiness workflow into others, of which the colours alone are wanted.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from milkglass.core.arrays import Array
from milkglass.viewer.files.gltf import JSON_CHUNK, drawn_textures, listed, read_tree, table

TRANSFORMED = "_TEXTURE_TRANSFORM_"  # a vertex attribute's name: the number of the transform follows
TRANSFORM = "KHR_texture_transform"
GLOSSY = "KHR_materials_pbrSpecularGlossiness"
FLIP = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])  # v from the top to v from below


def plain_gltf(path: Path) -> tuple[bytes | None, dict[str, Array]]:
    """Return a file whose textures lie on the first coordinates, and transforms of these by a vertex attribute's name.

    Returns
    -------
    bytes, optional
        None where the file itself will do.
    dict of str to (3, 3) float64
        v = M (u, v, 1), of coordinates that have their origin at the lower left.
    """
    tree, transforms, changes = read_tree(path), dict[str, Array](), False
    lies = [_lie(material) for material in listed(tree, "materials")]
    for primitive in (primitive for mesh in listed(tree, "meshes") for primitive in listed(mesh, "primitives")):
        number, attributes = primitive.get("material"), table(primitive, "attributes")
        if not isinstance(number, int) or not 0 <= number < len(lies):
            continue
        chosen, transform = lies[number]
        if chosen and f"TEXCOORD_{chosen}" in attributes:
            attributes["TEXCOORD_0"], changes = attributes[f"TEXCOORD_{chosen}"], True
        if transform is not None and "POSITION" in attributes:
            name = f"{TRANSFORMED}{number}"
            # Any accessor will do: what tells is the name.
            attributes[name], transforms[name], changes = attributes["POSITION"], transform, True
    for material in listed(tree, "materials"):
        glossy = table(material, "extensions").pop(GLOSSY, None)
        if isinstance(glossy, dict):
            base = {"baseColorFactor": "diffuseFactor", "baseColorTexture": "diffuseTexture"}
            material["pbrMetallicRoughness"] = {key: glossy[old] for key, old in base.items() if old in glossy}
            changes = True
    return (_with_tree(path.read_bytes(), tree) if changes else None), transforms


def _lie(material: Any) -> tuple[int, Array | None]:
    """Return the set of coordinates of a material's textures, and the transform of these, if any."""
    for texture in drawn_textures(material):
        placed = table(table(texture, "extensions"), TRANSFORM)
        chosen = placed.get("texCoord", texture.get("texCoord"))
        return (chosen if isinstance(chosen, int) else 0), (_matrix(placed) if placed else None)
    return 0, None


def _matrix(placed: dict[str, Any]) -> Array | None:
    """Return T R S of KHR_texture_transform for coordinates from the lower left, (3, 3); None where it is nonsense."""
    try:
        (x, y), (width, height) = placed.get("offset", (0.0, 0.0)), placed.get("scale", (1.0, 1.0))
        angle = float(placed.get("rotation", 0.0))
        c, s = np.cos(angle), np.sin(angle)
        matrix = np.array([[c * width, s * height, x], [-s * width, c * height, y], [0.0, 0.0, 1.0]], np.float64)
    except (TypeError, ValueError):
        return None
    return FLIP @ matrix @ FLIP if np.isfinite(matrix).all() else None


def _with_tree(data: bytes, tree: dict[str, Any]) -> bytes:
    """Return the bytes of a file with another JSON."""
    text = json.dumps(tree).encode()
    if data[:4] != b"glTF":
        return text
    (size,) = struct.unpack_from("<I", data, 12)
    text += b" " * (-len(text) % 4)
    rest = data[JSON_CHUNK + size :]
    head = struct.pack("<4sII", b"glTF", 2, JSON_CHUNK + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest
