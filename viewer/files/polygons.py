"""Model files whose faces are polygons, which their reader cuts as fans: OFF is read, concave faces of OBJ are cut."""

import re
from pathlib import Path

import numpy as np

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.polygons import triangulated

_FACE = re.compile(rb"^[ \t]*f((?:[ \t]+[^\s#]+){4,})[ \t]*(?:#[^\n]*)?$", re.MULTILINE)
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", re.MULTILINE)
_REST = re.compile(rb"/\S*")  # of a corner: its texture and normal
_HEAD = re.compile(rb"\s*(?:ST)?C?N?OFF", re.IGNORECASE)


def read_off(path: Path) -> tuple[Array, Ints]:
    """Return the vertices (n, 3) and triangles (m, 3) of an OFF file, its polygons cut; colours are left out.

    Raises
    ------
    ValueError
        It is cut short, of another kind or damaged.
    """
    text = re.sub(rb"#[^\r\n]*", b"", path.read_bytes())
    head = _HEAD.match(text)
    lines = [line for line in text[head.end() if head else 0 :].splitlines() if line.strip()]
    counts = [int(word) for word in lines[0].split()[:2]] if lines else []
    if len(counts) < 2 or min(counts) < 0:
        raise ValueError("its head does not say how many vertices and faces it has")
    n, m = counts
    if len(lines) - 1 < n + m:
        raise ValueError(
            f"cut short: its head promises {n + m:,} lines of vertices and faces, but {len(lines) - 1:,} follow"
        )
    vertices = np.array([line.split()[:3] for line in lines[1 : n + 1]], np.float64).reshape(n, 3)
    rows = [line.split() for line in lines[n + 1 : n + m + 1]]
    faces = [row[1 : int(row[0]) + 1] for row in rows]
    if any(len(face) != int(row[0]) for face, row in zip(faces, rows, strict=True)):
        raise ValueError("a face has fewer corners than it says")
    corners = np.array([int(word) for face in faces for word in face], np.int64)
    triangles, _ = triangulated(vertices, np.array([len(face) for face in faces], np.int64), corners)
    return vertices, corners[triangles]


def cut_obj(text: bytes) -> bytes:
    """Return the text of an OBJ file with its concave faces as triangles.

    Each corner keeps what it refers to. Convex faces stay, which their reader cuts as fans.
    """
    text = text.replace(b"\r\n", b"\n").replace(b"\\\n", b" ")
    polygons = list(_FACE.finditer(text))
    if not polygons:
        return text
    counts = np.array([len(match[1].split()) for match in polygons], np.int64)
    named = np.fromstring(_REST.sub(b"", b" ".join(match[1] for match in polygons)), np.int64, sep=" ")
    found = list(_VERTEX.finditer(text))
    vertices = np.fromstring(b" ".join(match[1] for match in found), np.float64, sep=" ").reshape(-1, 3)
    before = np.searchsorted([match.start() for match in found], [match.start() for match in polygons])
    corners = np.where(named < 0, np.repeat(before, counts) + named, named - 1)  # below 0: from the last one so far
    triangles, polygon = triangulated(vertices, counts, corners)
    starts = np.cumsum(counts) - counts
    pieces, end = [], 0
    first, last = (np.searchsorted(polygon, np.arange(len(counts)), side) for side in ("left", "right"))
    for i in np.unique(polygon[triangles[:, 0] != starts[polygon]]):
        words, rows = polygons[i][1].split(), triangles[first[i] : last[i]] - starts[i]
        cut = [b"f " + b" ".join(words[k] for k in row) for row in rows.tolist()]
        pieces += [text[end : polygons[i].start()], b"\n".join(cut)]
        end = polygons[i].end()
    return b"".join([*pieces, text[end:]])
