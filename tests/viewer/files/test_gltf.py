"""viewer.files.gltf: what glTF files have that is refused by name, and what is left out and said."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.viewer.files.model import read_model
from tests.support.model_files import box


def changed(path: Path, **keys: Any) -> Path:
    """A GLB of a box whose JSON has keys changed; those of lists are merged into their first element."""

    def change(tree: dict[str, Any]) -> None:
        for key, value in keys.items():
            if isinstance(value, dict):
                tree.setdefault(key, [{}])
                tree[key] = [*tree[key][:-1], {**tree[key][-1], **value}]
            else:
                tree[key] = value

    return rewritten(path, trimesh.Scene(box()), change)


def rewritten(path: Path, scene: trimesh.Scene, change: Callable[[dict[str, Any]], None]) -> Path:
    """A GLB of a scene whose JSON is changed in place."""
    data = trimesh.exchange.gltf.export_glb(scene)
    (size,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + size])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    path.write_bytes(head + struct.pack("<I4s", len(text), b"JSON") + text + rest)
    return path


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"extensionsRequired": ["VENDOR_geometry"]}, "requires the extension VENDOR_geometry"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "is compressed (KHR_draco_mesh_compression)"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "is compressed (EXT_meshopt_compression)"),
        ({"nodes": {"extensions": {"EXT_mesh_gpu_instancing": {}}}}, "has instances (EXT_mesh_gpu_instancing)"),
        ({"accessors": {"sparse": {"count": 1}}}, "has sparse accessors"),
    ],
)
def test_what_would_change_the_shape_is_refused_by_name(tmp_path: Path, keys: dict[str, Any], named: str) -> None:
    path = changed(tmp_path / "box.glb", **keys)
    with pytest.raises(InputError) as refused:
        read_model(path, 4.0)
    assert str(refused.value).startswith(f"{path} {named}")


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"nodes": {"skin": 0}}, "skin"),
        ({"meshes": {"weights": [1.0]}}, "morph targets"),
        (
            {
                "materials": [
                    {
                        "normalTexture": {"index": 0, "texCoord": 1},
                        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                    }
                ]
            },
            "lies otherwise",
        ),
    ],
)
def test_what_else_is_left_out_is_said(tmp_path: Path, keys: dict[str, Any], named: str) -> None:
    (said,) = read_model(changed(tmp_path / "box.glb", **keys), 4.0).warnings
    assert named in said


def test_what_is_read_or_harmless_is_not_remarked_on(tmp_path: Path) -> None:
    required = ["KHR_mesh_quantization", "KHR_materials_ior"]
    assert read_model(changed(tmp_path / "box.glb", extensionsRequired=required), 4.0).warnings == ()


def test_a_tree_of_other_things_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"box\.glb"):
        read_model(changed(tmp_path / "box.glb", nodes=[3]), 4.0)


@pytest.mark.parametrize("missing", ["", "x"])
def test_a_missing_file_is_said_to_be(tmp_path: Path, missing: str) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_model(tmp_path / f"none{missing}.glb", 4.0)
