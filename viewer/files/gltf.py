"""What a glTF file asks of its reader that trimesh does without: refused by name where the shape would be another."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from milkglass.core.errors import InputError

SUFFIXES = (".glb", ".gltf")
JSON_CHUNK = 20  # bytes before the JSON of a binary file
# Required extensions that are read, or that leave the shape alone.
READ = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", "KHR_lights_punctual")
HARMLESS = ("KHR_materials_", "KHR_xmp")
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")


def check_gltf(path: Path) -> tuple[str, ...]:
    """Return clauses on what a glTF file has that is left out of the picture.

    Raises
    ------
    InputError
        If what it has that cannot be read changes its shape: required extensions, instancing, sparse accessors.
    """
    tree = read_tree(path)
    required = [name for name in listed(tree, "extensionsRequired") if isinstance(name, str)]
    for name in required:
        if name in COMPRESSED:
            raise InputError(f"{path} is compressed ({name}), which is not read; export it without compression")
        if name not in READ and not name.startswith(HARMLESS):
            raise InputError(f"{path} requires the extension {name}, which is not read; export it without")
    nodes = listed(tree, "nodes")
    if any("EXT_mesh_gpu_instancing" in node.get("extensions", {}) for node in nodes):
        raise InputError(f"{path} has instances (EXT_mesh_gpu_instancing), which are not read; export them as meshes")
    if any("sparse" in accessor for accessor in listed(tree, "accessors")):
        raise InputError(f"{path} has sparse accessors, which are not read; export it without")
    return tuple(_left_out(tree, nodes))


def _left_out(tree: dict[str, Any], nodes: list[Any]) -> Iterator[str]:
    if any("skin" in node for node in nodes):
        yield "it has a skin, whose joints and pose are left out, so that parts of it may lie elsewhere"
    if any(any(listed(holder, "weights")) for holder in (*nodes, *listed(tree, "meshes"))):
        yield "its morph targets are left out"
    for material in listed(tree, "materials"):
        lies = [(texture.get("texCoord", 0), table(texture, "extensions")) for texture in drawn_textures(material)]
        if any(lie != lies[0] for lie in lies):
            yield "a normal map of it lies otherwise than its colours, and is drawn as these lie"
            return


def drawn_textures(material: Any) -> Iterator[dict[str, Any]]:
    """Yield the references to textures that are drawn, colours first."""
    glossy = table(table(material, "extensions"), "KHR_materials_pbrSpecularGlossiness").get("diffuseTexture")
    base = glossy or table(material, "pbrMetallicRoughness").get("baseColorTexture")
    yield from (texture for texture in (base, table(material, "normalTexture") or None) if isinstance(texture, dict))


def table(holder: Any, key: str) -> dict[str, Any]:
    """Return the table that a key holds; an empty one where it holds none."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, dict) else {}


def listed(holder: Any, key: str) -> list[Any]:
    """Return the list that a key holds; an empty one where it holds none."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, list) else []


def read_tree(path: Path) -> dict[str, Any]:
    """Return the JSON of a file; nothing of one that is damaged, which its reader will say."""
    try:
        with path.open("rb") as file:
            head = file.read(JSON_CHUNK)
            size = struct.unpack("<I", head[12:16])[0] if head[:4] == b"glTF" else -1
            tree = json.loads(file.read(size) if size >= 0 else head + file.read())
    except (OSError, ValueError, RecursionError, struct.error):
        return {}
    return tree if isinstance(tree, dict) else {}
