"""viewer.files.model: every sentence with which a model file is refused."""

import builtins
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import flaws
from milkglass.viewer.files.model import load_model, read_model, supported_suffixes
from tests.support.model_files import box, save, write_obj


def refusal(path: Path, size_mm: float = 100.0, up: str = "y") -> str:
    with pytest.raises(InputError) as caught:
        load_model(path, size_mm, up)
    sentence = str(caught.value)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


def test_refuses_what_is_not_there(tmp_path: Path) -> None:
    missing = tmp_path / "none.ply"
    assert refusal(missing) == f"{missing} does not exist; check the name and the directory."
    assert refusal(tmp_path) == f"{tmp_path} is a directory; name a model file in it."


def test_refuses_unsupported_suffixes_naming_the_nearest(tmp_path: Path) -> None:
    path = write_obj(tmp_path / "a.pyl", "")
    assert refusal(path).startswith(f"{path} has the suffix .pyl (did you mean .ply?); models are read from ")
    for suffix in (".glb", ".gltf", ".obj", ".off", ".ply", ".stl"):
        assert suffix in refusal(path)
        assert suffix in supported_suffixes()
    assert "has no suffix;" in refusal(write_obj(tmp_path / "plain", "x"))
    assert refusal(write_obj(tmp_path / "points.xyz", "0 0 0\n")).count(".xyz") == 2
    if ".3mf" not in supported_suffixes():
        path = write_obj(tmp_path / "a.3mf", "x")
        assert refusal(path) == f"{path} needs an extra package to be read: pip install lxml networkx."


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb", "gltf", "off"])
@pytest.mark.parametrize("content", [b"", b"this is no model\n", bytes(range(256)) * 4, b"\n\n\n"])
def test_refuses_empty_and_unparsable_files(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"bad.{suffix}"
    path.write_bytes(content)
    sentence = refusal(path)
    assert sentence.startswith(f"{path} ")
    expected = ("could not be read as a", "has no faces") if content else ("is empty",)
    assert any(problem in sentence for problem in expected)


def test_refuses_a_truncated_file(tmp_path: Path) -> None:
    for suffix in ("ply", "stl", "glb"):
        path = save(box(), tmp_path / f"cut.{suffix}")
        path.write_bytes(path.read_bytes()[:-30])
        assert "could not be read as a" in refusal(path)


def test_refuses_an_off_file_of_fewer_faces_than_it_promises(tmp_path: Path) -> None:
    path = save(box(), tmp_path / "box.off")
    whole = path.read_text()
    path.write_text("# a box, \n" + whole.replace("OFF\n8 12", "OFF 8 12"))
    assert len(read_model(path, 100.0).mesh.faces) == 12
    path.write_text("\n".join(whole.splitlines()[:-4]))
    with pytest.raises(InputError, match="cut short: its head promises 20 lines of vertices and faces, but 16 follow"):
        read_model(path, 100.0)


def test_refuses_points(tmp_path: Path) -> None:
    cloud = trimesh.PointCloud(np.random.default_rng(6).random((10, 3)))
    for suffix in ("ply", "glb"):
        path = tmp_path / f"cloud.{suffix}"
        trimesh.Scene(cloud).export(path) if suffix == "glb" else cloud.export(path)
        assert "has no faces (points or lines only)" in refusal(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_refuses_vertices_that_are_not_finite(tmp_path: Path, bad: float) -> None:
    solid = box()
    vertices = solid.vertices.copy()
    vertices[3, 1] = bad
    path = save(trimesh.Trimesh(vertices, solid.faces, process=False), tmp_path / "nan.ply")
    assert "vertices that are not finite numbers (1 of 8, the first is vertex 3)" in refusal(path)
    unused = np.concatenate([solid.vertices, [[bad, bad, bad]]])
    mesh, _ = load_model(save(trimesh.Trimesh(unused, solid.faces, process=False), tmp_path / "ok.ply"), 1.0)
    assert flaws(mesh).solid


def test_refuses_vertices_that_do_not_exist(tmp_path: Path) -> None:
    blob = trimesh.exchange.ply.export_ply(box())
    # The last face of a binary PLY: a count of one byte, three int32.
    for wrong in (8, -1):
        path = tmp_path / "index.ply"
        path.write_bytes(blob[:-4] + struct.pack("<i", wrong))
        assert f"has a face with vertex {wrong} but only 8 vertices" in refusal(path)


def test_refuses_faces_without_area(tmp_path: Path) -> None:
    line = "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\nf 1 1 2\n"
    assert "has no face with an area" in refusal(write_obj(tmp_path / "line.obj", line))
    point = "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n"
    assert "has no face with an area" in refusal(write_obj(tmp_path / "point.obj", point))


@pytest.mark.parametrize("size_mm", [0.0, -5.0, float("nan"), float("inf")])
def test_refuses_sizes_that_are_no_length(tmp_path: Path, size_mm: float) -> None:
    sentence = refusal(save(box(), tmp_path / "box.ply"), size_mm)
    assert sentence == f"model.size_mm must be a finite length above 0 mm, not {size_mm}."


def test_refuses_unknown_up_axes(tmp_path: Path) -> None:
    assert "model.up must be one of x, y, z" in refusal(save(box(), tmp_path / "box.ply"), 1.0, "up")


TRIANGLES = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 0
vt 0 1
usemtl a
f 1/1 3/3 2/2
f 1/1 2/2 4/3
f 2/1 3/2 4/3
f 1/1 4/2 3/3
"""


@pytest.mark.parametrize("place", ["../secret", "{}/secret", "/dev/zero"])
@pytest.mark.parametrize("kind", ["mtl", "texture", "gltf"])
def test_a_model_reads_nothing_outside_its_folder(tmp_path: Path, monkeypatch, kind: str, place: str) -> None:
    """Whatever a file of a stranger names: its reader would learn what is there, or never come to an end."""
    inside = tmp_path / "model"
    inside.mkdir()
    (tmp_path / "secret").write_bytes(b"newmtl a\nKd 1 0 0\n" + bytes(36))
    name, opened = place.format(tmp_path), []
    if kind == "gltf":
        path = inside / "a.gltf"
        write_gltf_of_buffer(path, name)
    else:
        path = write_obj(inside / "a.obj", f"mtllib {name if kind == 'mtl' else 'a.mtl'}\n{TRIANGLES}")
        (inside / "a.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    genuine = builtins.open
    monkeypatch.setattr(
        builtins, "open", lambda file, *rest, **named: opened.append(file) or genuine(file, *rest, **named)
    )
    try:
        said = " ".join(read_model(path, 100.0).warnings)
    except InputError as error:
        said = str(error)
    assert not [file for file in opened if Path(str(file)).name in ("secret", "zero")]
    if kind != "mtl":
        assert "is outside the model's folder" in said


def write_gltf_of_buffer(path: Path, uri: str) -> None:
    primitive = {"attributes": {"POSITION": 0}}
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}
    document = {
        "asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 36}], "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
    }  # fmt: skip
    path.write_text(json.dumps(document))
