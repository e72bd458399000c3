"""core.geometry.sculpture: a solid, thick and thin, the same every time."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import face_cross, find_flaws, half_edges, signed_volume
from milkglass.core.geometry.normals import unit
from milkglass.core.geometry.sculpture import sculpture
from milkglass.viewer.files.builtin import builtin_model

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def made() -> Arrays:
    return sculpture()


def digest(arrays: Arrays) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


@pytest.mark.slow
def test_is_one_closed_outward_solid(made: Arrays) -> None:
    vertices, faces, _ = made
    assert find_flaws(vertices, faces).solid
    assert 60_000 <= len(faces) <= 150_000
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))
    assert trimesh.Trimesh(vertices, faces, process=False).body_count == 1
    # V - E + F = 2 - 2 genus is even, and the lantern's windows are handles.
    euler = len(vertices) - len(half_edges(faces, len(vertices))[1]) + len(faces)
    assert euler % 2 == 0
    assert euler < -40
    assert (np.linalg.norm(face_cross(vertices, faces), axis=1) > 0.0).all()


def test_is_about_one_unit_and_stands_upright(made: Arrays) -> None:
    vertices, faces, _ = made
    extents = np.ptp(vertices, axis=0)
    assert extents.max() == pytest.approx(1.0, abs=0.1)
    assert 0.01 < signed_volume(vertices, faces) / np.prod(extents) < 0.3
    # The foot is flat and under the middle.
    bottom = vertices[vertices[:, 1] < vertices[:, 1].min() + 1e-3]
    np.testing.assert_allclose(bottom.mean(axis=0)[[0, 2]], 0.0, atol=0.01)


def test_normals_are_unit_and_agree_with_the_faces(made: Arrays) -> None:
    vertices, faces, normals = made
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    cosine = np.einsum("ij,ikj->ik", unit(face_cross(vertices, faces)), normals[faces])
    assert np.median(cosine) > 0.99
    assert np.mean(cosine < 0.0) < 1e-3


def test_has_thin_parts_of_one_to_three_percent_and_thick_ones(made: Arrays) -> None:
    vertices, faces, _ = made
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    inwards = -mesh.face_normals
    start = mesh.triangles_center + 1e-4 * inwards
    hits, rays, _ = mesh.ray.intersects_location(start, inwards, multiple_hits=False)
    assert len(rays) > 0.99 * len(faces)
    thickness = np.linalg.norm(hits - start[rays], axis=1) / np.ptp(vertices, axis=0).max()
    area = mesh.area_faces[rays] / mesh.area_faces[rays].sum()
    assert area[thickness < 0.01].sum() < 0.005
    assert area[(thickness >= 0.01) & (thickness < 0.03)].sum() > 0.4
    assert area[thickness > 0.1].sum() > 0.1


@pytest.mark.slow
def test_is_the_same_in_every_process(made: Arrays) -> None:
    script = (
        "import hashlib, numpy as np; from milkglass.core.geometry.sculpture import sculpture;"
        "print(hashlib.sha256(b''.join(np.ascontiguousarray(a).tobytes() for a in sculpture())).hexdigest())"
    )
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert printed.strip() == digest(made)


@pytest.mark.slow
def test_becomes_a_mesh_in_millimetres(made: Arrays) -> None:
    mesh = builtin_model(100.0)
    assert len(mesh.faces) == len(made[1])
    assert np.ptp(mesh.bounds, axis=0).max() == pytest.approx(100.0, rel=1e-6)
    np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0.0, atol=1e-4)
