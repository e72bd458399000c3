"""Files whose faces are polygons, strips or written in other ways: the same solid, whatever the way."""

import io
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.viewer.files.model import FileModel, load_model, read_model
from milkglass.viewer.files.ply import plain_ply
from milkglass.viewer.files.polygons import cut_obj

# An arrowhead: a fan from any corner but its first and third leaves it, as one of its caps is written.
ARROW = [(4.0, 3.0), (8.0, 0.0), (4.0, 9.0), (0.0, 0.0)]
VERTICES = [(x, y, z) for z in (0.0, 2.0) for x, y in ARROW]
FACES = [[3, 2, 1, 0], [4, 5, 6, 7], *([i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4))]
# The same with a corner in the middle of an edge: its caps are of five corners.
VERTICES_5 = [(x, y, z) for z in (0.0, 2.0) for x, y in [*ARROW, (2.0, 1.5)]]
FACES_5 = [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9], *([i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5))]
SOLIDS = {"quads": (VERTICES, FACES), "mixed": (VERTICES_5, FACES_5)}
AREA = 24.0
EDGES = 2 * (5.0 + np.hypot(4.0, 9.0))
TYPES = "property float x\nproperty float y\nproperty float z\n"


def head(form: str, vertices, faces: str, end: str = "\n", types: str = TYPES) -> bytes:
    lines = f"ply\nformat {form} 1.0\ncomment of a test\nelement vertex {len(vertices)}\n{types}{faces}end_header\n"
    return lines.replace("\n", end).encode()


def face_element(faces, kinds: str = "uchar int") -> str:
    return f"element face {len(faces)}\nproperty list {kinds} vertex_indices\n"


def as_text(rows) -> str:
    return "".join(" ".join(f"{value:g}" for value in row) + "\n" for row in rows)


def listed(faces):
    return [[len(face), *face] for face in faces]


def packed(vertices, order: str = "<") -> bytes:
    return b"".join(struct.pack(f"{order}3f", *vertex) for vertex in vertices)


def obj(vertices, faces) -> bytes:
    rows = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in vertices)
    return (rows + "".join("f " + " ".join(str(i + 1) for i in face) + "\n" for face in faces)).encode()


def off(vertices, faces) -> bytes:
    return f"OFF\n{len(vertices)} {len(faces)} 0\n{as_text(vertices)}{as_text(listed(faces))}".encode()


def ascii_ply(vertices, faces, end: str = "\n") -> bytes:
    body = (as_text(vertices) + as_text(listed(faces))).replace("\n", end).encode()
    return head("ascii", vertices, face_element(faces), end) + body


def binary_ply(vertices, faces, end: str = "\n", order: str = "<", kinds: str = "uchar int") -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    letters = ("B", "i") if kinds == "uchar int" else ("I", "I")
    rows = b"".join(struct.pack(f"{order}{letters[0]}{len(f)}{letters[1]}", len(f), *f) for f in faces)
    return head(form, vertices, face_element(faces, kinds), end) + packed(vertices, order) + rows


def strips(vertices, faces) -> bytes:
    """Each quad as a strip whose triangles are those of its ears."""
    flat = [i for a, b, c, d in faces for i in (b, c, a, d, -1)]  # a, the corner that turns back, is in both
    element = "element tristrips 1\nproperty list int int vertex_indices\n"
    rows = struct.pack(f"<{1 + len(flat)}i", len(flat), *flat)
    return head("binary_little_endian", vertices, element) + packed(vertices) + rows


def turned(faces):
    """Quads from another corner: that of the cap's hollow is first or third, as the strips need."""
    return [[*face[3:], *face[:3]] if i == 0 else face for i, face in enumerate(faces)]


WAYS = {
    "cr.ply": lambda v, f: ascii_ply(v, f, "\r"),
    "crlf.ply": lambda v, f: ascii_ply(v, f, "\r\n"),
    "ascii.ply": ascii_ply,
    "binary.ply": binary_ply,
    "binary cr.ply": lambda v, f: binary_ply(v, f, "\r"),
    "big.ply": lambda v, f: binary_ply(v, f, order=">"),
    "uint.ply": lambda v, f: binary_ply(v, f, kinds="uint uint"),
    "a.obj": obj,
    "a.off": off,
}


def check(path: Path) -> FileModel:
    model = read_model(path, 9.0)
    assert model.warnings == ()
    assert model.mesh.volume == pytest.approx(2.0 * AREA, rel=1e-5)
    assert model.mesh.area == pytest.approx(2.0 * (AREA + EDGES), rel=1e-5)
    return model


@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize("name", WAYS)
def test_concave_polygons_are_cut_within_themselves(tmp_path, name, solid):
    (tmp_path / name).write_bytes(WAYS[name](*SOLIDS[solid]))
    check(tmp_path / name)


def test_strips_of_triangles_turn_every_other_one(tmp_path):
    (tmp_path / "a.ply").write_bytes(strips(VERTICES, turned(FACES)))
    check(tmp_path / "a.ply")


def test_longer_strips_and_several(tmp_path):
    """A tube of eight quads as one strip, its caps as two fans written as strips of three."""
    ring = [(np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4]
    vertices = [(x, y, z) for z in (0.0, 1.0) for x, y in ring]
    flat = [i for k in range(9) for i in (8 + k % 8, k % 8)] + [-1]
    for a, b in pairwise(range(1, 8)):
        flat += [0, b, a, -1, 8, 8 + a, 8 + b, -1]
    element = "element tristrips 1\nproperty list int int vertex_indices\n"
    rows = struct.pack(f"<{1 + len(flat)}i", len(flat), *flat)
    (tmp_path / "tube.ply").write_bytes(head("binary_little_endian", vertices, element) + packed(vertices) + rows)
    mesh, warning = load_model(tmp_path / "tube.ply", 2.0)
    assert warning is None
    assert mesh.volume == pytest.approx(4.0 * np.sin(np.pi / 4), rel=1e-5)


def test_colours_stay_with_their_faces_and_vertices():
    rgb = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    vertices = [(*vertex, 10 * i, 20, 30) for i, vertex in enumerate(VERTICES_5)]
    faces = [[*row, 5 * i, 6, 7] for i, row in enumerate(listed(FACES_5))]
    data = head("ascii", vertices, face_element(faces) + rgb, types=TYPES + rgb)
    data += (as_text(vertices) + as_text(faces)).encode()
    read = trimesh.load_mesh(io.BytesIO(plain_ply(data)), file_type="ply", process=False, prefer_color="vertex")
    tables = read.metadata["_ply_raw"]
    assert tables["vertex"]["data"]["red"].tolist() == [10 * i for i in range(10)]
    assert tables["face"]["data"]["red"].tolist() == [0, 0, 0, 5, 5, 5, *np.repeat(np.arange(10, 35, 5), 2)]


def test_plain_files_come_back_as_they_are():
    triangles = [[0, 1, 2], [0, 2, 3]]
    for data in (ascii_ply(VERTICES, triangles), binary_ply(VERTICES, triangles)):
        assert plain_ply(data) is data
    assert cut_obj(obj(VERTICES, triangles)) == obj(VERTICES, triangles)


def test_corners_of_obj_keep_what_they_refer_to():
    """Texture and normal of each corner; indices below 0 count from the last vertex before the face."""
    text = obj(VERTICES, []) + b"f -3/2/2 -2/3/2 -1/4/2 -4/1/2\nv 1 1 1\nf 1//1 2//1 \\\n6//1 5//1\n"
    faces = [line.split()[1:] for line in cut_obj(text).decode().splitlines() if line.startswith("f")]
    assert len(faces) == 3
    corners = {"-4/1/2", "-3/2/2", "-2/3/2", "-1/4/2"}
    assert set().union(*faces[:2]) == corners
    assert all({"-4/1/2", "-2/3/2"} <= set(face) <= corners for face in faces[:2])  # from the corner that turns back
    assert faces[2] == ["1//1", "2//1", "6//1", "5//1"]
