"""viewer.files.gltf_textures: where a glTF file's textures lie, and its archived materials."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.visual import gloss

from milkglass.core.arrays import Array
from milkglass.viewer.files.model import read_model
from tests.support.skins import picture
from tests.viewer.files.test_gltf import rewritten

UV = np.array([[0.1, 0.2], [0.7, 0.2], [0.7, 0.9]])
SECOND = UV[:, ::-1]
TRANSFORM = "KHR_texture_transform"
GLOSSY = "KHR_materials_pbrSpecularGlossiness"


def coordinates(path: Path, texture: dict[str, Any], material: dict[str, Any] | None = None) -> Array:
    """Texture coordinates, from the lower left, of a triangle in a GLB whose texture says more of itself."""
    triangle = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], process=False)
    pbr = trimesh.visual.material.PBRMaterial(baseColorTexture=picture((200, 90, 20)))
    triangle.visual = trimesh.visual.TextureVisuals(UV, material=pbr)
    triangle.vertex_attributes["_second"] = np.stack([SECOND[:, 0], 1.0 - SECOND[:, 1]], axis=1).astype(np.float32)

    def change(tree: dict[str, Any]) -> None:
        attributes = tree["meshes"][0]["primitives"][0]["attributes"]
        attributes["TEXCOORD_1"] = attributes.pop("_second")
        base = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
        base.update(texture)
        if material is not None:
            tree["materials"][0] = material

    model = read_model(rewritten(path, trimesh.Scene(triangle), change), 1.0)
    assert not any("texture" in warning or "colours" in warning for warning in model.warnings)
    assert model.look is not None
    assert model.look.has_colours
    found: Array = model.look.coordinates[model.look.rows[0]].astype(np.float64)
    order = np.argsort(model.mesh.vertices[model.mesh.faces[0]] @ [1.0, 2.0, 0.0])
    return found[order]


def test_the_second_set_of_coordinates_is_read(tmp_path: Path) -> None:
    np.testing.assert_allclose(coordinates(tmp_path / "a.glb", {}), UV, atol=1e-6)
    np.testing.assert_allclose(coordinates(tmp_path / "b.glb", {"texCoord": 1}), SECOND, atol=1e-6)
    overridden = {"texCoord": 0, "extensions": {TRANSFORM: {"texCoord": 1}}}
    np.testing.assert_allclose(coordinates(tmp_path / "c.glb", overridden), SECOND, atol=1e-6)


def test_a_transform_turns_scales_and_moves(tmp_path: Path) -> None:
    """From the extension's text: the lower left quarter, turned by 90 degrees, by offset (0, 1)."""
    quarter = {"offset": [0.0, 1.0], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    found = coordinates(tmp_path / "a.glb", {"extensions": {TRANSFORM: quarter}})
    u, v = UV[:, 0], 1.0 - UV[:, 1]  # from the upper left, where glTF counts
    np.testing.assert_allclose(found, np.stack([0.5 * v, 0.5 * u], axis=1), atol=1e-6)
    assert ((found >= 0.0) & (found <= 0.5)).all()
    shifted = coordinates(tmp_path / "b.glb", {"extensions": {TRANSFORM: {"offset": [0.25, 0.5], "scale": [2, 3]}}})
    np.testing.assert_allclose(shifted[:, 0], 2.0 * u + 0.25, atol=1e-6)
    np.testing.assert_allclose(1.0 - shifted[:, 1], 3.0 * v + 0.5, atol=1e-6)


@pytest.mark.parametrize("nonsense", [{"offset": "x"}, {"scale": [1]}, {"rotation": None}, {"offset": [1e400, 0]}])
def test_a_transform_of_nonsense_is_left_out(tmp_path: Path, nonsense: dict[str, Any]) -> None:
    found = coordinates(tmp_path / "a.glb", {"extensions": {TRANSFORM: nonsense}})
    np.testing.assert_allclose(found, UV, atol=1e-6)


def test_specular_glossiness_gives_its_colours_without_another_picture_s_cost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    converted: list[object] = []
    monkeypatch.setattr(gloss, "specular_to_pbr", lambda **given: converted.append(given) or {})
    glossy = {"diffuseTexture": {"index": 0, "texCoord": 1}, "specularGlossinessTexture": {"index": 0}}
    found = coordinates(tmp_path / "a.glb", {}, {"extensions": {GLOSSY: glossy}})
    np.testing.assert_allclose(found, SECOND, atol=1e-6)
    assert converted == []
