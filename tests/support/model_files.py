"""Files of models made for tests."""

from pathlib import Path

import trimesh


def box(extents: tuple[float, float, float] = (1.0, 2.0, 4.0)) -> trimesh.Trimesh:
    return trimesh.creation.box(extents=extents)


def save(mesh: trimesh.Trimesh | trimesh.Scene, path: Path, **options: object) -> Path:
    mesh.export(path, **options)
    return path


def write_obj(path: Path, text: str) -> Path:
    path.write_text(text)
    return path
