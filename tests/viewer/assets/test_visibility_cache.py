"""What rays found stays on disk, by content; a cache that is damaged, full or read-only is no error."""

import os
from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.refine import refined
from milkglass.core.light.bake import bake
from milkglass.viewer.assets import ray_cache, visibility
from milkglass.viewer.assets.visibility import bake_visibility, refine
from tests.support.shapes import ball, cube
from tests.support.solids import ball as part, mesh_of


@pytest.fixture(autouse=True)
def folder(tmp_path, few_rays, monkeypatch):
    monkeypatch.setattr(visibility, "LONGEST_EDGE", 1.0)
    monkeypatch.setattr(ray_cache, "cache_folder", lambda: tmp_path)
    return tmp_path / "visibility"


@pytest.fixture
def casts(monkeypatch):
    """How often rays are cast."""
    counted = []
    monkeypatch.setattr(visibility, "bake", lambda *arguments: counted.append(1) or bake(*arguments))
    return counted


@pytest.mark.slow
def test_rays_are_cast_once_a_shape(casts, folder):
    first, again = bake_visibility(refine(ball(subdivisions=2))), bake_visibility(refine(ball(subdivisions=2)))
    assert len(casts) == 1
    for name in ("unoccluded", "visible"):
        assert np.array_equal(getattr(first.visibility, name), getattr(again.visibility, name))
    bake_visibility(refine(refined(cube(), 5.0).mesh))
    assert len(casts) == 2
    assert len(list(folder.iterdir())) == 2  # and nothing temporary


@pytest.mark.parametrize("part", ["vertices", "normals", "faces"])
def test_what_rays_found_is_of_one_mesh_alone(part):
    """Of meshes with the same vertices rays find different things."""
    mesh, kept = cube(), {"bits": np.ones(3, np.uint8)}
    cache = ray_cache.RayCache("visibility", 0)
    cache.keep(mesh, kept)
    assert np.array_equal(cache.read(cube(), {"bits": np.uint8})["bits"], kept["bits"])
    assert cache.read(replace(mesh, **{part: getattr(mesh, part)[::-1].copy()}), {"bits": np.uint8}) is None


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "other"])
def test_a_damaged_file_is_made_anew(casts, folder, damage):
    bake_visibility(refine(ball(subdivisions=2)))
    (path,) = folder.iterdir()
    content = bytearray(path.read_bytes())
    if damage == "cut":
        content = content[: len(content) // 2]
    elif damage == "flipped":
        content[len(content) // 2] ^= 255
    elif damage == "empty":
        content = bytearray()
    path.write_bytes(content)
    if damage == "other":
        with path.open("wb") as file:
            np.savez(file, bits=np.zeros((3, 7), np.uint8))
    bake_visibility(refine(ball(subdivisions=2)))
    assert len(casts) == 2
    bake_visibility(refine(ball(subdivisions=2)))
    assert len(casts) == 2


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_done_without(casts, folder):
    folder.write_text("a file where the folder would be")
    bake_visibility(refine(ball(subdivisions=2)))
    bake_visibility(refine(ball(subdivisions=2)))
    assert len(casts) == 2
    assert folder.read_text() == "a file where the folder would be"


def test_what_was_not_used_for_longest_goes(folder, monkeypatch):
    meshes = [mesh_of(part(radius, subdivisions=1)) for radius in (1.0, 2.0, 3.0)]
    baked = [(mesh, bake(mesh)) for mesh in meshes]
    for age, (mesh, sight) in zip((300, 200), baked[:2], strict=True):
        visibility.keep_sight(mesh, sight)
        newest = max(folder.iterdir(), key=lambda path: path.stat().st_mtime)
        os.utime(newest, (newest.stat().st_mtime - age,) * 2)
    assert visibility.cached_sight(meshes[0]) is not None  # used: now the second is the oldest
    size = max(path.stat().st_size for path in folder.iterdir())
    monkeypatch.setattr(ray_cache, "MOST_BYTES", int(2.5 * size))
    visibility.keep_sight(*baked[2])
    assert [visibility.cached_sight(mesh) is not None for mesh in meshes] == [True, False, True]
