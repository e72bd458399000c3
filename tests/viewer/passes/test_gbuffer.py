"""The visible surface: what a picture shows of it does not depend on how it is drawn."""

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from milkglass.core.geometry.bodies import has_volumes
from milkglass.core.geometry.mesh import Mesh, flaws
from milkglass.viewer.bench.shapes import SHAPES
from milkglass.viewer.files.builtin import builtin_model
from milkglass.viewer.files.model import joined, read_model
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.gl.context import current, read_rgba
from milkglass.viewer.passes.gbuffer import GBufferPass
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.settings import CameraSettings
from tests.support.model_files import box, save

pytestmark = pytest.mark.gl
SIZE = (96, 96)


def drawn(context: moderngl.Context, mesh: Mesh, camera: CameraSettings) -> np.ndarray:
    """Positions and normals that a camera sees, (H, W, 8)."""
    with current(context):
        gbuffers = GBufferPass(context)
        target = gbuffers.targets(SIZE)
        gbuffers.render(MeshBuffers(context, mesh), model_camera(camera, mesh, SIZE).world_to_clip, target)
        return np.concatenate([read_rgba(target.position), read_rgba(target.normal)], axis=-1)


@pytest.mark.parametrize("angle", [0.0, 130.0])
def test_culled_back_faces_leave_the_picture_of_a_closed_mesh_as_it_is(context, angle):
    mesh = SHAPES["knot"]()
    camera = CameraSettings(azimuth_deg=angle, elevation_deg=25.0)
    both, front = (drawn(context, replace(mesh, outward=known), camera) for known in (False, True))
    differ = (np.abs(both - front) > 1e-3).any(axis=-1)
    assert both[..., 3].sum() > 1000
    assert differ.mean() < 1e-3  # silhouettes, where both sides meet in a pixel


def test_back_faces_are_culled_of_closed_meshes_alone_and_from_outside(context):
    mesh = SHAPES["ball"]()
    around = model_camera(CameraSettings(), mesh, SIZE)
    flat = model_camera(CameraSettings(orthographic=True), mesh, SIZE)
    x, y, z = (-0.95 * around.eye[:3]).tolist()
    inside = model_camera(CameraSettings(target_mm=(x, y, z), zoom=1.0), mesh, SIZE)
    with current(context):
        closed = MeshBuffers(context, replace(mesh, outward=True))
        assert closed.culling(around.world_to_clip) == closed.culling(flat.world_to_clip) == moderngl.CULL_FACE
        assert np.linalg.norm(inside.eye[:3]) < mesh.radius
        assert closed.culling(inside.world_to_clip) == 0
        assert MeshBuffers(context, mesh).culling(around.world_to_clip) == 0


def test_the_inside_of_an_open_shell_is_seen(context, tmp_path):
    whole = box((10.0, 10.0, 10.0))
    lid = np.flatnonzero(whole.face_normals[:, 1] > 0.9)
    whole.update_faces(np.setdiff1d(np.arange(len(whole.faces)), lid))
    mesh = read_model(save(whole, tmp_path / "open.ply"), 10.0, close_holes=False).mesh
    assert not mesh.outward
    seen = drawn(context, mesh, CameraSettings(elevation_deg=60.0))
    inner = (seen[..., 3] > 0.0) & (seen[..., 1] < -4.9)
    assert np.count_nonzero(inner) > 100  # its bottom, from within


def test_files_of_solids_are_known_to_look_outward(tmp_path):
    solid = box((10.0, 20.0, 30.0))
    assert read_model(save(solid, tmp_path / "solid.ply"), 10.0).mesh.outward
    solid.invert()
    assert read_model(save(solid, tmp_path / "turned.ply"), 10.0).solid("it").mesh.outward


def test_a_mesh_with_a_cavity_or_a_solid_inside_out_is_not_outward():
    ball = SHAPES["ball"]()
    small = replace(ball, vertices=0.5 * ball.vertices, normals=-ball.normals, faces=ball.faces[:, ::-1])
    assert has_volumes(ball)
    assert not has_volumes(joined(ball, small))


def test_the_built_in_sculpture_is_outward():
    mesh = builtin_model(100.0)
    assert mesh.outward
    assert flaws(mesh).solid
    assert has_volumes(mesh)


def test_faces_of_a_shuffled_mesh_are_drawn_in_the_order_of_the_whole(context):
    mesh = SHAPES["knot"]()
    shuffled = np.random.default_rng(3).permutation(len(mesh.faces))
    with current(context):
        orders = [
            np.frombuffer(MeshBuffers(context, replace(mesh, faces=faces)).faces.read(), np.int32).reshape(-1, 3)
            for faces in (mesh.faces, mesh.faces[shuffled])
        ]
    middles = [mesh.vertices[order].mean(axis=1) for order in orders]
    assert np.array_equal(np.sort(orders[0], axis=0), np.sort(mesh.faces, axis=0))
    steps = [np.linalg.norm(np.diff(middle, axis=0), axis=1).mean() for middle in middles]
    assert steps[1] < 1.01 * steps[0]
