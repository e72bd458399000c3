"""What an output folder knows of its sweep: a file for each picture that is made, and indices of all of them.

A picture's row is written last, whole or not at all: what has none is made again. Any process of any machine may write
rows of its own pictures; indices are gathered from all rows.
"""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from milkglass.core.errors import InputError
from milkglass.viewer.files.record import VERSION
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.given_file import given_bytes, reason_of
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.whole_file import replacement
from milkglass.viewer.sweep.studio import Shot
from milkglass.viewer.sweep.sweep import Row, Sweep

FOLDER = ".sweep"  # of rows, inside the output folder
IDENTITY = "sweep.json"
SUFFIX = ".row.json"


def begin(sweep: Sweep, folder: Path) -> None:
    """Make an output folder a sweep's.

    Raises
    ------
    InputError
        If it is another sweep's, or cannot be written.
    """
    rows, identity = folder / FOLDER, {"sweep": sweep.title, "keys": list(sweep.keys)}
    try:
        rows.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: no pictures can be written there ({reason_of(error)})") from error
    found = _read(rows / IDENTITY)
    if found and found != identity:
        of_other = f"{found.get('sweep')}, over {', '.join(found.get('keys', []))}"
        raise InputError(f"{folder} holds pictures of another sweep ({of_other}); choose another --output")
    if not found:
        _write(rows / IDENTITY, identity)


def write_row(
    folder: Path,
    row: Row,
    content: str,
    files: Sequence[str],
    shot: Shot,
    more: Mapping[str, Any],
    note: str = "",
) -> None:
    """Write what is known of a picture whose files are there; `more` are further columns of the index."""
    frame = shot.frame
    _write(
        _row_path(folder, row.index),
        {
            "index": row.index,
            "values": row.values,
            "files": list(files),
            "hash": content,
            "note": " ".join(filter(None, (*frame.warnings, *frame.remarks, note))),
            "predicted_error": frame.quality.predicted_error,
            "version": VERSION,
            "more": dict(more),
            "view": _view(shot),
            "lights": [_light(light) for light in shot.scene.effective_lights()],
        },
    )


def is_finished(folder: Path, index: int, content: str) -> bool:
    """Tell whether a picture is there as it is to be: its row, and all its files."""
    known = _read(_row_path(folder, index))
    if known.get("hash") != content:
        return False
    return all((folder / file).is_file() for file in known.get("files", [""]))


def gather(sweep: Sweep, folder: Path) -> list[dict[str, Any]]:
    """Write the indices of all pictures that are there, and return their rows.

    `index.csv` and `index.json` have a column for each key that varies, as the sweep gives it; `transforms.json` has
    cameras and lights. Rows of pictures that the sweep has no longer are left out.
    """
    paths = sorted((folder / FOLDER).glob(f"*{SUFFIX}"))
    rows = [row for path in paths if (row := _read(path)) and row["index"] < sweep.count]
    more = sorted({key for row in rows for key in row["more"]})
    columns = ["index", "file", *sweep.keys, "hash", "note", "predicted_error", *more, "version"]
    table = [
        row["values"] | row["more"] | {key: row.get(key) for key in columns if key in row} | {"file": row["files"][0]}
        for row in rows
    ]
    lines = io.StringIO()
    writer = csv.DictWriter(lines, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in line.items()} for line in table)
    _write(folder / "index.csv", lines.getvalue())
    _write(folder / "index.json", [line | {"files": row["files"]} for line, row in zip(table, rows, strict=True)])
    if rows:
        _write(folder / "transforms.json", _transforms(rows))
    return rows


def _transforms(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return cameras as NeRF has them: from camera to world, x right, y up, looking along -z; lengths in mm."""
    frames = [{"file_path": row["files"][0], **row["view"], "lights": row["lights"]} for row in rows]
    first = frames[0]
    shared = {key for key in ("camera_angle_x", "w", "h") if all(frame.get(key) == first.get(key) for frame in frames)}
    return {key: first[key] for key in sorted(shared & first.keys())} | {"unit": "mm", "frames": frames}


def _view(shot: Shot) -> dict[str, Any]:
    """Return a camera's matrix to the world, and its focal lengths in pixels, or the width that it shows in mm."""
    width, height = shot.scene.display.image_size
    to_world = np.linalg.inv(shot.camera.view).T  # column vectors
    across, along = float(shot.camera.projection[0, 0]), float(shot.camera.projection[1, 1])
    view: dict[str, Any] = {"w": width, "h": height, "cx": 0.5 * width, "cy": 0.5 * height}
    if shot.scene.camera.orthographic:
        view |= {"orthographic": True, "width_mm": 2.0 / across, "height_mm": 2.0 / along}
    else:
        view |= {
            "fl_x": 0.5 * width * across,
            "fl_y": 0.5 * height * along,
            "camera_angle_x": 2.0 * math.atan(1.0 / across),
        }
    return view | {"transform_matrix": to_world.tolist()}


def _light(light: Light) -> dict[str, Any]:
    return {"kind": light.KIND} | {key: getattr(light, key) for key in settings_of(light)}


def _cell(value: Any) -> Any:
    """Return a value as one cell of a table: lists and tables as JSON."""
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value) if isinstance(value, list | dict) else value


def _row_path(folder: Path, index: int) -> Path:
    return folder / FOLDER / f"{index:07d}{SUFFIX}"


def _read(path: Path) -> dict[str, Any]:
    """Return what a file of the ledger holds; nothing where it is missing or damaged."""
    try:
        found = json.loads(given_bytes(path, "the row"))
    except (InputError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _write(path: Path, content: Any) -> None:
    text = content if isinstance(content, str) else json.dumps(content, indent=1)
    try:
        with replacement(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} could not be written ({reason_of(error)})") from error
