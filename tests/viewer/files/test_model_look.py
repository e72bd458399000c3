"""viewer.files.model_look: colours and relief of files, and what is wrong with them."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import EpsImagePlugin

from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.geometry.detail import MeshDetail
from milkglass.core.geometry.mesh import flaws
from milkglass.core.geometry.texture import linear
from milkglass.viewer.files.model import load_model, read_model
from milkglass.viewer.files.model_look import detail_of
from tests.support.skins import FLAT, ball_with_map, picture, write_ball, write_slab


def detail_at(path, texture=None, normal_map=None) -> tuple[MeshDetail | None, tuple[str, ...]]:
    model = read_model(path, 20.0)
    return detail_of(model.look, model.mesh, path.name, texture, normal_map, colours=True, relief=True)


def colours_at(detail: MeshDetail) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the faces, (n, 3) mm, and colours there."""
    mesh = detail.mesh
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    n = len(middles)
    return middles, detail.colour(detail.pieces(middles, np.arange(n), np.zeros(n)))


def columns(*colours) -> np.ndarray:
    """Upright stripes, (64, 64, 3)."""
    return np.repeat(np.uint8(colours)[None], 64, axis=0).repeat(64 // len(colours), axis=1)


@pytest.mark.parametrize("suffix", ["glb", "obj", "gltf"])
def test_a_texture_lies_where_its_coordinates_say(tmp_path, suffix):
    stripes = picture(columns((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)))
    path = tmp_path / f"ball.{suffix}"
    if suffix == "gltf":
        scene = trimesh.load_scene(write_ball(tmp_path / "ball.glb", stripes))
        for name, blob in trimesh.exchange.gltf.export_gltf(scene).items():
            (tmp_path / name).write_bytes(blob)
        path = tmp_path / "model.gltf"
    else:
        write_ball(path, stripes)
    detail, warnings = detail_at(path)
    assert warnings == ()
    middles, colours = colours_at(detail)
    turn = np.mod(np.arctan2(-middles[:, 2], middles[:, 0]) / (2.0 * np.pi), 1.0)
    sure = np.abs(np.mod(4.0 * turn, 1.0) - 0.5) < 0.3
    expected = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])[(4.0 * turn).astype(int)]
    assert sure.sum() > 100
    np.testing.assert_allclose(colours[sure], expected[sure], atol=1e-4)


def test_a_seam_cuts_colours_and_not_the_mesh(tmp_path):
    path = write_ball(tmp_path / "ball.glb", picture((9, 99, 200)))
    mesh, warning = load_model(path, 20.0)
    assert warning is None
    assert flaws(mesh).solid
    assert find_bodies(mesh).count == 1
    detail, _ = detail_at(path)
    assert len(detail.vertices.positions) > len(mesh.vertices)
    assert np.ptp(detail.coordinates[detail.rows], axis=1)[:, 0].max() < 0.1  # no face runs back across the texture


@pytest.mark.parametrize(("suffix", "is_linear"), [("ply", False), ("obj", False), ("glb", True)])
def test_vertex_colours_are_interpolated_and_decoded(tmp_path, suffix, is_linear):
    vertices, faces, _ = ball_with_map()
    bytes_ = np.full((len(vertices), 4), 255, np.uint8)
    bytes_[:, :3] = np.clip(127.5 + 127.5 * vertices, 0, 255)
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=bytes_, process=False)
    mesh.export(tmp_path / f"ball.{suffix}")
    detail, _ = detail_at(tmp_path / f"ball.{suffix}")
    middles, colours = colours_at(detail)
    share = 0.5 + 0.5 * middles / 10.0
    np.testing.assert_allclose(colours, share if is_linear else linear(share), atol=0.02)


def test_faces_and_parts_may_have_colours_of_their_own(tmp_path):
    box = trimesh.creation.box()
    box.visual.face_colors = np.tile(np.uint8([[255, 0, 0, 255], [0, 0, 255, 255]]), (6, 1))
    box.export(tmp_path / "faces.ply")
    detail, _ = detail_at(tmp_path / "faces.ply")
    _, colours = colours_at(detail)
    assert {tuple(colour) for colour in colours.round(3).tolist()} == {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}

    scene = trimesh.Scene()
    for i, factor in enumerate(([1.0, 0.5, 0.2, 1.0], [0.0, 1.0, 0.0, 1.0])):
        part = trimesh.creation.icosphere(1)
        part.apply_translation([3.0 * i, 0.0, 0.0])
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=factor)
        part.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(part.vertices), 2)), material=material)
        scene.add_geometry(part)
    scene.export(tmp_path / "parts.glb")
    detail, _ = detail_at(tmp_path / "parts.glb")
    middles, colours = colours_at(detail)
    expected = np.where(middles[:, :1] < 0.0, [[1.0, 0.5, 0.2]], [[0.0, 1.0, 0.0]])
    np.testing.assert_allclose(colours, expected, atol=3e-3)


def test_texture_coordinates_of_the_corners_of_a_ply_file(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 4\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    body = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    for i, corners in enumerate(("0 2 1", "0 1 3", "0 3 2", "1 2 3")):
        body += f"3 {corners} 6 {i} 0 {i} 0.5 {i} 1\n"
    (tmp_path / "corner.ply").write_text(header + body)
    picture((9, 99, 200)).save(tmp_path / "own.png")
    detail, _ = detail_at(tmp_path / "corner.ply", texture=tmp_path / "own.png")
    assert flaws(detail.mesh).solid
    assert sorted(detail.coordinates[detail.rows][:, 0, 0].tolist()) == [0.0, 1.0, 2.0, 3.0]
    assert (np.ptp(detail.coordinates[detail.rows], axis=1) == [0.0, 1.0]).all()


def test_what_is_no_colour_is_left_to_the_material(tmp_path):
    white = trimesh.creation.icosphere(1)
    white.visual.vertex_colors = np.tile(np.uint8([90, 90, 90, 255]), (len(white.vertices), 1))
    white.export(tmp_path / "grey.ply")
    write_ball(tmp_path / "mapped.glb", baseColorFactor=[0.5, 0.2, 0.1, 1.0])
    trimesh.creation.icosphere(1).export(tmp_path / "plain.stl")
    assert read_model(tmp_path / "plain.stl", 1.0).look is None
    for name in ("grey.ply", "mapped.glb", "plain.stl"):
        assert detail_at(tmp_path / name) == (None, ())


def test_relief_turns_normals_along_the_texture(tmp_path):
    detail, _ = detail_at(write_ball(tmp_path / "ball.glb", normal=picture((128 + 60, 128 + 30, 128 + 108))))
    middles = detail.mesh.vertices[detail.mesh.faces].mean(axis=1).astype(np.float64)
    n = len(middles)
    places = detail.pieces(middles, np.arange(n), np.zeros(n))
    normals = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    turned, factors = detail.relief(places, normals, 2.0)
    east = np.cross([0.0, 1.0, 0.0], normals)  # growing u
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    expected = 2.0 * (60 * east + 30 * np.cross(normals, east)) + 108 * normals
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    middle = np.abs(middles[:, 1]) < 8.0
    np.testing.assert_allclose(turned[middle], expected[middle], atol=0.04)  # at the seam half of the faces are missing
    np.testing.assert_allclose(factors, 1.0, atol=1e-5)  # they agree
    np.testing.assert_allclose(detail.relief(places, normals, 0.0)[0], normals, atol=1e-6)


def test_a_mirrored_texture_has_mirrored_tangents(tmp_path):
    detail, _ = detail_at(write_slab(tmp_path / "slab.glb", normal=picture((228, 128, 200))))
    mesh, n = detail.mesh, len(detail.mesh.faces)
    normals = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    turned, _ = detail.relief(detail.pieces(middles, np.arange(n), np.zeros(n)), normals, 1.0)
    flat = np.abs(normals[:, 2]) > 0.5  # up, and below, seen from where the texture is mirrored
    np.testing.assert_allclose(turned[flat, 0], 100 / np.hypot(100, 72), rtol=1e-4)
    np.testing.assert_array_equal(turned[~flat], normals[~flat].astype(np.float32))  # no area on the texture


def test_missing_textures_are_told_and_left_out(tmp_path):
    path = write_ball(tmp_path / "ball.obj", picture((200, 30, 30)))
    for image in tmp_path.glob("*.png"):
        image.unlink()
    model = read_model(path, 20.0)
    (warning,) = model.warnings
    assert "could not be read" in warning
    assert "drawn without" in warning
    assert detail_at(path) == (None, ())


def test_a_damaged_texture_is_told_and_left_out(tmp_path):
    noise = picture(np.random.default_rng(0).integers(0, 255, (64, 64, 3)))
    path = write_ball(tmp_path / "ball.glb", noise)
    blob = bytearray(path.read_bytes())
    start = blob.index(b"IDAT")
    blob[start + 40 : start + 2000] = b"\0" * 1960
    path.write_bytes(blob)
    detail, (warning,) = detail_at(path)
    assert detail is None
    assert warning.startswith("ball.glb: its colour texture could not be read")


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_a_texture_that_is_a_program_does_not_run(tmp_path, monkeypatch, suffix):
    """Pillow hands PostScript to Ghostscript, whatever the file is called."""
    postscript = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n0 0 4 4 rectfill\n%%EOF\n"
    ran = tmp_path / "ran"
    (tmp_path / "bin").mkdir()
    ghostscript = tmp_path / "bin" / "gs"
    ghostscript.write_text(f"#!/bin/sh\ntouch {ran}\nexit 1\n")
    ghostscript.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", None)  # where Pillow remembers that there is no Ghostscript
    path = write_ball(tmp_path / f"ball.{suffix}", picture(np.random.default_rng(0).integers(0, 255, (64, 64, 3))))
    (holder,) = tmp_path.glob("*.png") if suffix == "obj" else [path]
    content = holder.read_bytes()
    start = content.index(b"\x89PNG")
    holder.write_bytes(content[:start] + postscript + content[start + len(postscript) :])
    detail, warnings = detail_at(path)
    assert not ran.exists()
    assert detail is None
    assert any("texture" in warning for warning in (*read_model(path, 20.0).warnings, *warnings))


def test_pictures_that_a_person_named_must_be_right(tmp_path):
    path = write_ball(tmp_path / "ball.glb")
    trimesh.creation.icosphere(1).export(tmp_path / "plain.ply")
    picture(FLAT).save(tmp_path / "flat.png")
    (tmp_path / "bad.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"gone.png does not exist"):
        detail_at(path, texture=tmp_path / "gone.png")
    with pytest.raises(InputError, match=r"bad.png cannot be read"):
        detail_at(path, normal_map=tmp_path / "bad.png")
    with pytest.raises(InputError, match=r"model.texture must end in .png"):
        detail_at(path, texture=tmp_path / "a.exr")
    with pytest.raises(InputError, match=r"model.normal_map needs texture coordinates, which plain.ply does not have"):
        detail_at(tmp_path / "plain.ply", normal_map=tmp_path / "flat.png")
    detail, _ = detail_at(path, normal_map=tmp_path / "flat.png")
    assert detail.has_normals
    assert not detail.has_colours


@pytest.mark.parametrize("library", ["", "mtllib missing.mtl\nusemtl gone\n"])
def test_coordinates_without_a_material_are_the_material_alone(tmp_path: Path, library: str) -> None:
    """trimesh makes up a grey picture for them."""
    path = tmp_path / "unwrapped.obj"
    path.write_text(f"{library}v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    look = read_model(path, 1.0).look
    assert look is not None
    assert look.mapped
    assert not look.has_colours


def test_text_need_not_be_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "latin.obj"
    path.write_bytes("# Größe\nmtllib farben.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl rot\nf 1 2 3\n".encode("latin-1"))
    (tmp_path / "farben.mtl").write_bytes("# Märchenfarben für Möbel\nnewmtl rot\nKd 1 0 0\n".encode("latin-1"))
    model = read_model(path, 1.0)
    assert not any("could not be read" in sentence for sentence in model.warnings)
    assert model.names[0][0] == "rot"
