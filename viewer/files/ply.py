"""PLY files of every kind as the one kind that their reader takes whole: binary, triangles alone, lines that end in LF.

The reader cuts polygons as fans, takes lists of one length alone in binary files, knows no triangle strips, and no
lines that end in CR.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Ints
from milkglass.core.geometry.polygons import triangulated

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
TYPES = _TYPES | {"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"}
TYPES |= {"uint32": "u4", "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"}
NAMES = {numpy: name for name, numpy in reversed(TYPES.items()) if name in ("double", *_TYPES)}
CORNERS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"


@dataclass
class _Element:
    """A table of the file: scalar properties by their numpy type, lists by those of their count and their items."""

    name: str
    length: int
    properties: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def lists(self) -> list[str]:
        return [name for name, types in self.properties.items() if len(types) == 2]


@dataclass
class _Table:
    """What an element holds: scalars (length,) and lists, each as counts (length,) and items, by property."""

    scalars: dict[str, npt.NDArray[np.generic]]
    lists: dict[str, tuple[Ints, Array]]


def plain_ply(data: bytes) -> bytes:
    """Return the content of a PLY file whose faces are triangles, as it is if they are and its lines end in LF.

    Scalar properties stay, and coordinates of textures by corner; elements that are no vertices or faces go.

    Raises
    ------
    ValueError
        It is damaged, or not PLY.
    """
    ending = b"\r\n" if data[3:5] == b"\r\n" else data[3:4]
    head, mark, body = data.partition(b"end_header" + ending)
    if not mark or ending not in (b"\n", b"\r", b"\r\n"):
        raise ValueError("its head does not end")
    order, elements, comments = _parsed(head.decode("utf-8", "replace").replace("\r", "\n").splitlines())
    if ending != b"\r" and _is_plain(order, elements, body):
        return data
    words = None if order else np.array(body.split()).astype(np.float64)
    tables, at = {}, 0
    for element in elements:
        tables[element.name], at = _binary(element, body, at) if words is None else _ascii(element, words, at)
    return _written(tables, comments)


def _parsed(lines: list[str]) -> tuple[str, list[_Element], list[str]]:
    """Return the byte order, empty for text, the elements and the comments that name a texture."""
    order, elements, comments = "", [], []
    for words in filter(None, (line.split() for line in lines)):
        if words[0] == "format":
            order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1], "")
        elif words[0] == "element":
            elements.append(_Element(words[1], int(words[2])))
            if elements[-1].length < 0:
                raise ValueError(f"its head promises {words[2]} of {words[1]}")
        elif words[0] == "property" and elements:
            elements[-1].properties[words[-1]] = tuple(order + TYPES[word] for word in words[1:-1] if word != "list")
        elif words[0] == "comment" and "texturefile" in (words[1].lower() if len(words) > 1 else ""):
            comments.append(" ".join(words))
    return order, elements, comments


def _is_plain(order: str, elements: list[_Element], body: bytes) -> bool:
    """Tell whether all lists are the corners of triangles."""
    lists = [(element, name) for element in elements for name in element.lists]
    if any(element.name != "face" or name not in CORNERS for element, name in lists):
        return False
    if order:
        promised = sum(e.length * sum(_size(types) for types in e.properties.values()) for e in elements)
        return promised == len(body)
    lines = [line for line in body.splitlines() if line.strip()]
    start = 0
    for element in elements:
        rows, start = lines[start : start + element.length], start + element.length
        if element.lists and (
            next(iter(element.properties)) not in element.lists or any(row.split(None, 1)[0] != b"3" for row in rows)
        ):
            return False
    return True


def _size(types: tuple[str, ...]) -> int:
    """Return the bytes of a scalar, or of a list of three."""
    sizes = [np.dtype(name).itemsize for name in types]
    return sizes[0] if len(sizes) == 1 else sizes[0] + 3 * sizes[1]


def _binary(element: _Element, body: bytes, at: int) -> tuple[_Table, int]:
    """Return what an element holds that starts at a byte, and the byte after it."""
    if element.length == 0:
        return _Table({}, {}), at
    kinds, end = [], at
    for name, (first, *items) in element.properties.items():
        count = int(np.frombuffer(body, first, 1, end)[0]) if items else 0
        kinds += [(name, first, ()), *((f"{name} items", kind, (count,)) for kind in items)]
        end += np.dtype(first).itemsize + sum(count * np.dtype(kind).itemsize for kind in items)
    row = np.dtype(kinds)
    if at + element.length * row.itemsize <= len(body):
        table = np.frombuffer(body, row, element.length, at)
        if all((table[name] == table[name][0]).all() for name in element.lists):  # as long as those of the first row
            scalars = {name: table[name] for name in element.properties if name not in element.lists}
            lists = {name: (table[name].astype(np.int64), table[f"{name} items"].ravel()) for name in element.lists}
            return _Table(scalars, lists), at + table.nbytes
    rows: dict[str, list[npt.NDArray[np.generic]]] = {name: [] for name in element.properties}
    for _ in range(element.length):
        for name, (first, *items) in element.properties.items():
            value = np.frombuffer(body, first, 1, at)
            at += value.nbytes
            if items:
                value = np.frombuffer(body, items[0], int(value[0]), at)
                at += value.nbytes
            rows[name].append(value)
    return _table(element, rows), at


def _ascii(element: _Element, words: Array, at: int) -> tuple[_Table, int]:
    """Return what an element holds that starts at a word of the text, and the word after it."""
    if not element.lists:
        count = len(element.properties)
        table = words[at : at + element.length * count].reshape(element.length, count)
        scalars = {name: table[:, i].astype(types[0]) for i, (name, types) in enumerate(element.properties.items())}
        return _Table(scalars, {}), at + table.size
    rows: dict[str, list[npt.NDArray[np.generic]]] = {name: [] for name in element.properties}
    for _ in range(element.length):
        for name, types in element.properties.items():
            start, count = (at, 1) if len(types) == 1 else (at + 1, int(words[at]))
            rows[name].append(words[start : start + count].astype(types[-1]))
            if len(rows[name][-1]) != count:
                raise ValueError("its text ends too early")
            at = start + count
    return _table(element, rows), at


def _table(element: _Element, rows: dict[str, list[npt.NDArray[np.generic]]]) -> _Table:
    scalars, lists = {}, {}
    for name, types in element.properties.items():
        values = np.concatenate([np.empty(0, types[-1]), *rows[name]])
        if len(types) == 1:
            scalars[name] = values
        else:
            lists[name] = np.array([len(row) for row in rows[name]], np.int64), values
    return _Table(scalars, lists)


def _written(tables: dict[str, _Table], comments: list[str]) -> bytes:
    """Return a binary file of the vertices, and of the triangles of faces or strips."""
    vertex, face, strips = (tables.get(name, _Table({}, {})) for name in ("vertex", "face", STRIPS))
    if not all(axis in vertex.scalars for axis in "xyz"):
        raise ValueError("it has no vertices")
    points = np.column_stack([vertex.scalars[axis] for axis in "xyz"]).astype(np.float64)
    columns: dict[str, npt.NDArray[np.generic]] = {}
    triangles = np.empty((0, 3), np.int64)
    corners = next((face.lists[name] for name in (*CORNERS, *face.lists) if name in face.lists), None)
    if corners is not None:
        chosen, polygon = triangulated(points, corners[0], corners[1].astype(np.int64))
        triangles = corners[1].astype(np.int64)[chosen]
        columns = {name: values[polygon] for name, values in face.scalars.items()}
        counts, places = face.lists.get("texcoord", (np.empty(0), np.empty(0)))
        if len(counts) and (counts == 2 * corners[0]).all():
            columns["texcoord"] = places.reshape(-1, 2)[chosen].reshape(-1, 6)
    elif strips.lists:
        triangles = _of_strips(next(iter(strips.lists.values()))[1].astype(np.int64))
    columns = {"vertex_indices": triangles.astype("<i4"), **columns}
    head = ["ply", "format binary_little_endian 1.0", *comments, *_head("vertex", len(points), vertex.scalars)]
    head += [*_head("face", len(triangles), columns), "end_header", ""]
    return "\n".join(head).encode() + _rows(vertex.scalars) + _rows(columns)


def _head(name: str, length: int, columns: dict[str, npt.NDArray[np.generic]]) -> list[str]:
    kinds = {key: NAMES.get(values.dtype.str[1:], "double") for key, values in columns.items()}
    lines = [f"property {'list uchar ' * (columns[key].ndim == 2)}{kind} {key}" for key, kind in kinds.items()]
    return [f"element {name} {length}", *lines]


def _rows(columns: dict[str, npt.NDArray[np.generic]]) -> bytes:
    """Return columns as packed rows, little endian, a list with its count before it."""
    fields: list[tuple[str, npt.DTypeLike, tuple[int, ...]]] = []
    values: list[npt.NDArray[np.generic]] = []
    for key, column in columns.items():
        kind = column.dtype.newbyteorder("<") if column.dtype.str[1:] in NAMES else np.dtype("<f8")
        if column.ndim == 2:
            fields.append((f"{key} count", "u1", ()))
            values.append(np.full(len(column), column.shape[1], np.uint8))
        fields.append((key, kind, column.shape[1:]))
        values.append(column)
    table = np.empty(len(values[0]), np.dtype(fields))
    for (key, *_), column in zip(fields, values, strict=True):
        table[key] = column
    return table.tobytes()


def _of_strips(strip: Ints) -> Ints:
    """Return the triangles (k, 3) of strips of corners, -1 between them; every other one of a strip is turned."""
    at = np.arange(len(strip))
    starts = np.maximum.accumulate(np.where(np.concatenate([[True], strip[:-1] < 0]), at, 0))[: len(strip)]
    triples = np.column_stack([strip[:-2], strip[1:-1], strip[2:]])
    turned = ((at - starts)[: len(triples)] % 2).astype(bool)
    triples[turned] = triples[turned][:, [1, 0, 2]]
    return np.asarray(triples[(triples >= 0).all(axis=1)])
