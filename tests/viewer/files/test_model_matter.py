"""viewer.files.model: what bounds the matter of a file's parts, and what is said of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import flaws
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.files.model import FileModel, load_model, read_model
from milkglass.viewer.scene.settings import ModelSettings
from tests.support.model_files import save, write_obj
from tests.support.solids import ball, block


def solid(path: Path, size_mm: float, nested: str = "hollow") -> FileModel:
    return read_model(path, size_mm).solid(path.name, nested)


def scene_of(*parts: trimesh.Trimesh) -> trimesh.Scene:
    return trimesh.Scene([part.copy() for part in parts])


@pytest.mark.parametrize("suffix", ["glb", "obj", "stl"])
def test_parts_that_run_into_each_other_are_joined_and_it_is_said(tmp_path: Path, suffix: str) -> None:
    path = save(scene_of(block((40, 10, 10)), block((10, 40, 10))), tmp_path / f"plus.{suffix}")
    mesh, said = load_model(path, 40.0)
    assert said == f"{path}: 2 closed parts of it run into each other and were joined."
    assert mesh.volume == pytest.approx(7000.0, rel=1e-5)
    assert flaws(mesh).solid
    assert mesh.outward


def test_a_part_twice_in_a_file_counts_once(tmp_path: Path) -> None:
    path = save(scene_of(block((4, 2, 2)), block((4, 2, 2))), tmp_path / "twice.glb")
    mesh, said = load_model(path, 4.0)
    assert said == f"{path}: 12 of its faces lie on others of it and were left out."
    assert mesh.volume == pytest.approx(16.0)
    assert len(mesh.faces) == 12


def test_nested_parts_are_what_the_scene_says(tmp_path: Path) -> None:
    path = save(scene_of(block((4, 4, 4)), block((2, 2, 2))), tmp_path / "nested.glb")
    settings = ModelSettings(path=path, size_mm=4.0)
    for nested, volume in (("hollow", 56.0), ("solid", 64.0)):
        mesh, (said,) = Assets().mesh(replace(settings, nested=nested))
        assert mesh.volume == pytest.approx(volume)
        assert f"model.nested = {'solid' if nested == 'hollow' else nested}" in said


def test_materials_of_their_own_may_lie_within_each_other(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for name, side in (("glass", 4.0), ("liquid", 3.0)):
        scene.add_geometry(block((side, side, side)), geom_name=name, node_name=name)
    settings = ModelSettings(path=save(scene, tmp_path / "cup.glb"), size_mm=4.0)
    for parts in ((("glass",), ()), ((), ("glass",))):
        model = Assets().model(replace(settings, parts=parts))
        assert model.warnings == ()
        assert sum(mesh.volume for mesh in (model.mesh, *model.clear)) == pytest.approx(64.0 + 27.0)


def test_colours_stay_where_they_are_on_faces_that_are_cut(tmp_path: Path) -> None:
    """A colour that is linear in space, on two balls that run into each other."""
    parts = [ball(1.0), ball(1.0, (0.7, 0.2, 0.1))]
    for part in parts:
        shade = np.clip((part.vertices[:, 0] + 1.0) / 2.7, 0.0, 1.0)
        part.visual.vertex_colors = np.column_stack([shade, shade, shade, np.ones_like(shade)])
    model = solid(save(scene_of(*parts), tmp_path / "two.glb"), 2.7)
    assert model.look is not None
    assert len(model.look.rows) == len(model.mesh.faces)
    low = model.mesh.bounds[0, 0]
    expected = (model.mesh.vertices[model.mesh.faces][..., 0] - low) / 2.7
    np.testing.assert_allclose(model.look.colours[model.look.rows][..., 0], expected, atol=0.01)
    assert {names for names, _ in model.parts} == {names for names, _ in read_model(tmp_path / "two.glb", 2.7).parts}


def test_holes_are_closed_unless_they_are_to_be_left(tmp_path: Path) -> None:
    whole = ball(1.0, subdivisions=3)
    rest = trimesh.Trimesh(whole.vertices, whole.faces[(whole.faces != 5).all(axis=1)], process=False)
    path = save(rest, tmp_path / "open.ply")
    mesh, said = load_model(path, 20.0)
    assert said == f"{path}: 1 hole was closed (model.close_holes = false leaves them)."
    assert flaws(mesh).solid
    mesh, (said,) = Assets().mesh(ModelSettings(path=path, size_mm=20.0, close_holes=False))
    assert len(mesh.faces) == len(rest.faces)
    assert "is not closed (5 open edges)" in said


def test_a_hole_beside_given_normals_has_a_lid_of_its_own_normals(tmp_path: Path) -> None:
    """An open box with texture coordinates and normals."""
    box = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvt 0 0\nvt 1 1\n"
    normals = "vn 0 0 -1\nvn 0 -1 0\nvn 1 0 0\nvn 0 1 0\nvn -1 0 0\n"
    sides = [(1, 4, 3, 2), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8)]
    faces = "".join("f " + " ".join(f"{v}/1/{n + 1}" for v in side) + "\n" for n, side in enumerate(sides))
    mesh, said = load_model(write_obj(tmp_path / "open.obj", box + normals + faces), 1.0)
    assert said is not None
    assert "1 hole was closed" in said
    assert mesh.volume == pytest.approx(1.0)
    top = (mesh.vertices[mesh.faces][..., 2] > 0.499).all(axis=1)
    np.testing.assert_allclose(mesh.normals[mesh.faces[top]], np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3)), atol=1e-6)
