"""viewer.files.model: what files become; test_model_refusals.py has the files that are refused."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import flaws
from milkglass.viewer.files.builtin import builtin_model
from milkglass.viewer.files.model import load_model
from tests.support.counting import calls, peak_bytes
from tests.support.model_files import box, save, write_obj


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb", "gltf", "off"])
def test_a_box_of_every_format_is_the_same_solid(tmp_path: Path, suffix: str) -> None:
    if suffix == "gltf":
        for name, blob in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box())).items():
            (tmp_path / name).write_bytes(blob)
        path = tmp_path / "model.gltf"
    else:
        path = save(box(), tmp_path / f"box.{suffix}")
    mesh, warning = load_model(path, 100.0, "y")
    assert warning is None
    assert flaws(mesh).solid
    assert len(mesh.faces) == 12
    assert len(mesh.vertices) == 24
    assert mesh.volume == pytest.approx(25.0 * 50.0 * 100.0, rel=1e-6)
    np.testing.assert_allclose(mesh.bounds, [[-12.5, -25, -50], [12.5, 25, 50]], rtol=1e-6)
    np.testing.assert_allclose(np.abs(mesh.normals).max(axis=1), 1.0, atol=1e-6)


def test_ascii_and_upper_case_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.STL").write_text(trimesh.exchange.stl.export_stl_ascii(box()))
    (tmp_path / "a.Ply").write_bytes(trimesh.exchange.ply.export_ply(box(), encoding="ascii"))
    for name in ("a.STL", "a.Ply"):
        mesh, warning = load_model(str(tmp_path / name), 4.0)
        assert warning is None
        assert mesh.volume == pytest.approx(8.0, rel=1e-6)


def test_quads_become_triangles(tmp_path: Path) -> None:
    path = write_obj(tmp_path / "square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    mesh, warning = load_model(path, 20.0)
    assert mesh.area == pytest.approx(400.0)
    assert mesh.bounds[:, 2].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1], (4, 1)), atol=1e-7)
    assert warning is not None
    assert "is not closed (4 open edges)" in warning


@pytest.mark.parametrize("sign", ["", "-"])
@pytest.mark.parametrize(("axis", "extents"), [("x", (2, 1, 4)), ("y", (1, 2, 4)), ("z", (1, 4, 2))])
def test_the_up_axis_turns_positions_and_normals(
    tmp_path: Path, sign: str, axis: str, extents: tuple[int, ...]
) -> None:
    mesh, _ = load_model(save(box(), tmp_path / "box.ply"), 4.0, sign + axis)
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), extents, rtol=1e-6)
    assert flaws(mesh).solid
    # Each corner of a box lies on the side that its normal names.
    half = np.ptp(mesh.bounds, axis=0) / 2.0
    np.testing.assert_allclose(np.einsum("ij,ij->i", mesh.vertices / half, mesh.normals), np.ones(24), rtol=1e-6)


def test_z_up_turns_about_x(tmp_path: Path) -> None:
    cone = trimesh.creation.cone(radius=1.0, height=4.0)
    cone.apply_translation([0, 0, 5])
    mesh, _ = load_model(save(cone, tmp_path / "cone.ply"), 4.0, "z")
    tip = mesh.vertices[mesh.vertices[:, 1] > 1.999]
    np.testing.assert_allclose(tip, np.tile([0, 2, 0], (len(tip), 1)), atol=1e-6)


def test_a_model_far_from_the_origin_keeps_its_shape(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    far = ball.copy()
    far.apply_translation([1e6, -1e6, 1e6])
    mesh, warning = load_model(save(far, tmp_path / "far.obj", digits=10), 2.0)
    assert warning is None
    radius = np.linalg.norm(mesh.vertices, axis=1)
    np.testing.assert_allclose(radius, 1.0, atol=1e-6)


def test_scene_parts_are_joined_with_their_transforms(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.5, [0, 1, 0])
    enlarge = np.diag([2.0, 2.0, 2.0, 1.0])
    enlarge[1, 3] = 3.0
    scene.add_geometry(box((1, 1, 1)), geom_name="a", transform=turn)
    scene.add_geometry(box((1, 1, 1)), geom_name="b", transform=enlarge)
    mesh, warning = load_model(save(scene, tmp_path / "two.glb"), 4.5)
    assert warning is None
    assert len(mesh.faces) == 24
    assert mesh.volume == pytest.approx(1.0 + 8.0, rel=1e-6)
    assert np.ptp(mesh.bounds[:, 1]) == pytest.approx(4.5, rel=1e-6)


@pytest.mark.parametrize("with_normals", [True, False])
def test_a_mirrored_part_stays_outward(tmp_path: Path, with_normals: bool) -> None:
    plain = trimesh.creation.icosphere(subdivisions=3)
    ball = trimesh.Trimesh(plain.vertices, plain.faces, vertex_normals=plain.vertices, process=False)
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 2.0, 1.0, 1.0])
    scene.add_geometry(ball, transform=mirror)
    mesh, warning = load_model(save(scene, tmp_path / "m.glb", include_normals=with_normals), 4.0)
    assert warning is None
    assert mesh.volume > 0.0
    # The gradient of an ellipsoid with half axes 1, 2, 1.
    expected = mesh.vertices / np.array([1.0, 4.0, 1.0])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", expected, mesh.normals)
    assert cosine.min() > (1.0 - 1e-6 if with_normals else 0.99)


def test_the_normals_of_a_file_are_kept_with_their_hard_edges(tmp_path: Path) -> None:
    # A shallow roof, 20 degrees: smooth by its angle, hard by its own normals.
    text = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 2 -.364 0\nv 2 -.364 1\n"
    text += "vn 0 1 0\nvn .3420 .9397 0\n"
    faces = "f 1//1 3//1 2//1\nf 1//1 4//1 3//1\nf 2//2 3//2 5//2\nf 5//2 3//2 6//2\n"
    hard, _ = load_model(write_obj(tmp_path / "hard.obj", text + faces), 2.0)
    assert len(hard.vertices) == 8
    assert len(np.unique(hard.normals.round(4), axis=0)) == 2
    plain = faces.replace("//1", "").replace("//2", "")
    smooth, _ = load_model(write_obj(tmp_path / "smooth.obj", text + plain), 2.0)
    assert len(smooth.vertices) == 6


def test_given_normals_follow_scaling_and_are_made_unit(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    long = trimesh.Trimesh(ball.vertices, ball.faces, vertex_normals=7.0 * ball.vertices, process=False)
    mesh, warning = load_model(save(long, tmp_path / "b.ply", vertex_normal=True), 2.0)
    assert warning is None
    assert len(mesh.vertices) == len(ball.vertices)
    np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(("share", "bad"), [(0.1, 0.0), (0.1, np.nan), (1.0, 0.0), (1.0, np.inf), (0.1, -1.0)])
def test_unusable_normals_are_computed(tmp_path: Path, share: float, bad: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    normals = ball.vertices.copy()
    some = np.random.default_rng(5).random(len(normals)) < share
    normals[some] = -normals[some] if bad == -1.0 else bad
    mesh, warning = load_model(save_with_normals(tmp_path / "b.ply", ball, normals), 2.0)
    assert warning is None
    assert np.einsum("ij,ij->i", mesh.normals, mesh.vertices).min() > 0.999


def save_with_normals(path: Path, mesh: trimesh.Trimesh, normals: np.ndarray) -> Path:
    properties = "".join(f"property float {c}\n" for c in ("x", "y", "z", "nx", "ny", "nz"))
    rows = [" ".join(map(repr, map(float, r))) for r in np.hstack([mesh.vertices, normals])]
    rows += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    header = f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\n{properties}"
    header += f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(header + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("normal_sign", [0, 1, -1])
def test_an_inside_out_solid_is_turned_outwards_and_says_so(tmp_path: Path, normal_sign: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.faces = ball.faces[:, ::-1].copy()
    path = tmp_path / "ball.ply"
    if normal_sign:
        save_with_normals(path, ball, normal_sign * ball.vertices)
    else:
        save(ball, path)
    mesh, warning = load_model(path, 2.0)
    assert warning == f"{path}: its faces looked inwards and were turned outwards."
    assert flaws(mesh).solid
    assert np.einsum("ij,ij->i", mesh.normals, mesh.vertices).min() > 0.999


def test_normals_put_an_inconsistent_winding_right(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    faces = ball.faces.copy()
    faces[::3] = faces[::3, ::-1]
    mixed = trimesh.Trimesh(ball.vertices, faces, process=False)
    mesh, warning = load_model(save_with_normals(tmp_path / "n.ply", mixed, ball.vertices), 2.0)
    assert warning is None
    assert flaws(mesh).solid
    mesh, warning = load_model(save(mixed, tmp_path / "plain.ply"), 2.0)
    assert warning is not None
    assert f"{len(faces[::3])} of its faces looked the wrong way and were turned" in warning
    assert flaws(mesh).solid


def test_a_non_manifold_mesh_is_read_with_a_warning(tmp_path: Path) -> None:
    fan = "v 0 0 0\nv 0 1 0\nv 1 0 0\nv -1 0 .5\nv 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n"
    mesh, warning = load_model(write_obj(tmp_path / "fan.obj", fan), 10.0)
    assert len(mesh.faces) == 3
    assert warning is not None
    assert "1 edges join more than two faces" in warning
    assert warning.count(".") - str(tmp_path / "fan.obj").count(".") == 1
    assert "\n" not in warning


def test_degenerate_faces_and_stray_vertices_do_not_count(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 99 99 99\nv 50 50 50\nv .5 0 0\n"
    text += "f 1 2 3\nf 1 3 4\nf 5 5 5\nf 6 6 1\nf 1 7 2\n"
    mesh, _ = load_model(write_obj(tmp_path / "stray.obj", text), 10.0)
    assert mesh.area == pytest.approx(100.0)
    assert len(mesh.vertices) == 4


def test_seams_that_collinear_faces_fill_are_closed(tmp_path: Path) -> None:
    solid = box((1, 1, 1))
    a, b, c = solid.faces[0]
    middle = len(solid.vertices)
    split = [[a, middle, c], [middle, b, c], [a, b, middle]]
    faces = np.concatenate([split, solid.faces[1:]])
    vertices = np.concatenate([solid.vertices, [0.5 * (solid.vertices[a] + solid.vertices[b])]])
    mesh, warning = load_model(save(trimesh.Trimesh(vertices, faces, process=False), tmp_path / "t.off"), 1.0)
    assert warning is None
    assert len(mesh.faces) == 13
    assert mesh.volume == pytest.approx(1.0)


def test_other_peoples_noise_is_held_back(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "bad.obj"
    path.write_text("mtllib missing.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gone\nf 1 2 3\n")
    with caplog.at_level(logging.DEBUG):
        load_model(path, 1.0)
    assert not caplog.records
    assert not logging.getLogger("trimesh").level


@pytest.mark.slow
def test_measured_models(data_dir: Path) -> None:
    expected = {
        "dragon_100k.ply": (100_000, None),
        "bunny_closed.ply": (69_664, None),
        "bunny.ply": (69_664, "5 holes were closed"),
        "buddha_100k.ply": (100_000, "50 edges join more than two faces"),
    }
    for name, (n_faces, problem) in expected.items():
        mesh, warning = load_model(data_dir / "meshes" / name, 100.0)
        assert len(mesh.faces) == n_faces
        assert mesh.volume > 0.0
        assert (problem in warning) if problem and warning else warning is None
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("suffix", ["ply", "stl"])
def test_what_loading_costs_grows_as_the_faces_do(tmp_path: Path, suffix: str) -> None:
    """No loop over them, and no array of pairs of them."""
    count, held = [], []
    for subdivisions in (3, 5):
        ball = trimesh.creation.icosphere(subdivisions)
        path = save(ball, tmp_path / f"ball.{suffix}")
        mesh, warning = load_model(path, 100.0)
        assert warning is None
        assert len(mesh.vertices) == len(ball.vertices)
        count.append(calls(lambda path=path: load_model(path, 100.0)))
        held.append(peak_bytes(lambda path=path: load_model(path, 100.0)) / len(ball.faces))
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 50.0**3, rel=0.01)
    assert count[1] < 1.1 * count[0]
    assert held[1] < 1.1 * held[0]


@pytest.mark.slow
@pytest.mark.parametrize("up", ["y", "z"])
def test_the_builtin_model_is_placed_like_a_file(up: str) -> None:
    mesh = builtin_model(80.0, up)
    assert np.ptp(mesh.bounds, axis=0).max() == pytest.approx(80.0, rel=1e-6)
    assert flaws(mesh).solid
