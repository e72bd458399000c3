"""The surface of the integral equation: row sums, near part, pairs of a sheet, rays across."""

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.assignment import SHEET_REACH
from milkglass.core.material.medium import NO_ABSORPTION, Medium
from milkglass.core.transport.diffusion.boundary import (
    Boundary,
    Depths,
    find_sheet,
    is_closed,
    put_on_grid,
    row_sums,
)
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.green import local_green
from milkglass.core.transport.diffusion.patches import make_patches
from milkglass.core.transport.diffusion.solver import WINDOW, DiffusionTransport
from tests.support.diffusing import samples_of
from tests.support.shapes import ball as smooth_ball, cube, plate, torus_knot
from tests.support.solids import ball, block, mesh_of, rings, scattered, sheet


def torus():
    return trimesh.creation.torus(8.0, 3.0, major_sections=48, minor_sections=24)


CLOSED = {
    "box": cube(),
    "thin box": mesh_of(block((20.0, 20.0, 0.01))),
    "needle": mesh_of(block((20.0, 0.01, 0.01))),
    "ball": mesh_of(ball(10.0)),
    "torus": mesh_of(torus()),
    "knot": torus_knot(n_along=160, n_around=16),
    "hollow ball": mesh_of(ball(10.0), ball(6.0, inverted=True)),
    "ball in the cavity": mesh_of(ball(10.0), ball(6.0, inverted=True), ball(3.0)),
    "linked rings": mesh_of(*rings()),
    "many": scattered(60),
    "far away": mesh_of(ball(10.0, at=(1e4, -2e4, 5e3))),
    "tiny": mesh_of(ball(1e-3)),
}


@pytest.mark.parametrize("name", CLOSED)
def test_row_sums_of_closed_surfaces(name):
    sums = row_sums(CLOSED[name])
    digits = 5e-3 if name == "far away" else 1e-5  # float32 places
    np.testing.assert_allclose(sums, -0.5, atol=digits)
    assert is_closed(sums)


def opened(mesh: Mesh, faces: int) -> Mesh:
    return Mesh(mesh.vertices, mesh.normals, mesh.faces[faces:])


def turned(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.normals, mesh.faces[:, ::-1])


OPEN = {
    "box without a side": opened(cube(), 2),
    "ball with a hole": opened(smooth_ball(20.0, 3), 60),
    "sheet": mesh_of(sheet(0.0)),
    "inside out": turned(mesh_of(ball(10.0))),
    "one of two balls inverted": mesh_of(ball(5.0), ball(5.0, at=(20.0, 0.0, 0.0), inverted=True)),
    "both outward, nested": mesh_of(ball(10.0), ball(6.0)),
    "overlapping": mesh_of(ball(5.0), ball(5.0, at=(4.0, 0.0, 0.0))),
    "twice": mesh_of(ball(5.0), ball(5.0)),
}


@pytest.mark.parametrize("name", OPEN)
def test_surfaces_that_are_not_closed(name):
    assert not is_closed(row_sums(OPEN[name]))


def test_row_sum_is_the_share_of_the_sphere():
    """From the middle of one of a box's sides the other five fill a half space; without the opposite one, less."""
    box = block((2.0, 2.0, 2.0))
    keep = box.face_normals[:, 2] > -0.5
    mesh = mesh_of(trimesh.Trimesh(box.vertices, box.faces[keep], process=False))
    corners = mesh.vertices[mesh.faces].astype(float)
    areas = np.cumsum(np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1))
    sums = row_sums(mesh, 60)
    for row, face in enumerate(np.searchsorted(areas, (np.arange(60) + 0.5) / 60 * areas[-1])):
        x = corners[face].mean(axis=0)
        # The missing side by a midpoint sum.
        t = (np.arange(400) + 0.5) / 200.0 - 1.0
        across = np.stack([*np.meshgrid(t, t), np.full((400, 400), -1.0)], axis=-1) - x
        missing = np.sum(-across[..., 2] / np.linalg.norm(across, axis=-1) ** 3) * 0.005**2 / (4.0 * np.pi)
        assert sums[row] == pytest.approx(-0.5 + missing, abs=1e-4)


def on_grid(mesh: Mesh, resolution: int = 48):
    transport = DiffusionTransport(resolution=resolution)
    grid = transport.grid(mesh, np.eye(3))
    return transport.boundary(mesh, samples_of(mesh, resolution), grid, Depths(mesh))


@pytest.mark.parametrize("radius", [10.0, 3.0])
def test_near_part_of_a_ball_is_its_curvature(radius):
    """K 1 = -1/2, most of it smooth: what is left is that of the curvature within a window, below s / R."""
    boundary = on_grid(smooth_ball(2.0 * radius))
    s = WINDOW * boundary.grid.texel
    mean = np.average(boundary.double_layer_diagonal, weights=boundary.patches.areas)
    assert np.abs(boundary.double_layer_diagonal).max() < s / radius
    # int D G'(r) r / (2 R) 2 pi r dr of the local part, by parts: -D rho(0) / R.
    expected = -float(local_green(NO_ABSORPTION, s, 0.0)) * NO_ABSORPTION.diffusion / radius
    assert mean == pytest.approx(expected, abs=0.05 * abs(expected))


def test_near_part_of_a_flat_side_is_small():
    boundary = on_grid(cube())
    patches = boundary.patches
    flat = np.sort(np.abs(patches.points), axis=1)[:, 1] < 7.0
    assert flat.sum() > 1000
    # What is there is the grid's: it depends on where between two nodes the side lies.
    assert np.abs(boundary.double_layer_diagonal[flat]).max() < 0.05
    # At an edge the other side subtends a quarter of space: K itself is there, not in the nodes alone.
    out = np.sort(np.abs(patches.points), axis=1)[:, 1]
    edge = out > out.max() - 0.1
    assert np.abs(boundary.double_layer_diagonal[edge]).mean() > 0.07


def test_a_constant_gives_a_half_everywhere():
    for mesh in (torus_knot(), plate(thickness=0.4)):
        boundary = on_grid(mesh)
        volume = boundary.constant.ravel().astype(float)
        np.testing.assert_allclose(boundary.weights.T @ volume + boundary.double_layer_diagonal, -0.5, atol=1e-5)


@pytest.mark.parametrize("thickness", [0.1, 0.3, 0.6])
def test_sheet_pairs_both_sides(thickness):
    boundary = on_grid(plate(thickness=thickness))
    patches, found = boundary.patches, boundary.sheet
    middle = np.abs(patches.points[:, :2]).max(axis=1) < 8.0
    faces = np.flatnonzero(middle & (np.abs(patches.normals[:, 2]) > 0.9))
    assert np.isin(faces, found.patches).all()
    np.testing.assert_allclose(found.thickness[np.isin(found.patches, faces)], thickness, rtol=0.01)
    own, other = found.patches, found.opposite
    assert (patches.points[own, 2] * patches.points[other, 2] < 0.0)[np.isin(own, faces)].all()
    inside = np.isin(own, faces)
    off = np.linalg.norm((patches.points[own] - patches.points[other])[:, :2], axis=1)
    assert off[inside].max() < 0.7 * boundary.grid.texel * np.sqrt(2.0)
    assert (found.share > 0.0).all()
    assert (found.share <= 1.0).all()
    reach = SHEET_REACH * 1.1 * boundary.grid.texel
    expected = np.clip(2.0 - 2.0 * thickness / reach, 0.0, 1.0)
    np.testing.assert_allclose(found.share[inside], expected, atol=0.02)


def test_thick_objects_have_no_sheet():
    assert len(on_grid(cube()).sheet.patches) == 0
    assert len(on_grid(plate(thickness=4.0)).sheet.patches) == 0


def test_a_wedge_is_no_sheet():
    """Two sides under 60 degrees face each other too little."""
    corners = np.array([[0.0, -10.0, 0.0], [20.0, -10.0, -11.5], [20.0, -10.0, 11.5]])
    prism = trimesh.Trimesh(np.concatenate([corners, corners + np.array([0.0, 20.0, 0.0])])).convex_hull
    sheet = on_grid(mesh_of(prism)).sheet
    assert sheet.share.size == 0


def test_no_thickness_no_pair():
    mesh = cube()
    patches = make_patches(mesh, samples_of(mesh), 1.0)
    found = find_sheet(patches, np.zeros(len(patches)), 2.0)
    assert len(found.patches) == len(found.opposite) == len(found.thickness) == len(found.share) == 0


def test_depths_are_chords():
    mesh = smooth_ball(20.0)
    patches = make_patches(mesh, samples_of(mesh), 0.5)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(patches), 500, replace=False)
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", directions, patches.face_normals[chosen])
    found = Depths(mesh).along(patches, chosen, directions, 0.4)
    assert (found[cosine > 0.0] == 0.0).all()
    inwards = cosine < -0.05
    np.testing.assert_allclose(found[inwards], -20.0 * cosine[inwards], rtol=0.02, atol=0.1)


def test_depths_end_at_a_cavity():
    mesh = mesh_of(ball(10.0, subdivisions=4), ball(6.0, subdivisions=4, inverted=True))
    patches = make_patches(mesh, samples_of(mesh), 0.5)
    found = Depths(mesh).along(patches, np.arange(len(patches)), -patches.face_normals, 0.4)
    np.testing.assert_allclose(found, 4.0, atol=0.1)


class Mirror(Medium):
    """Matter that neither absorbs nor lets anything out: all that its surface receives goes back in."""

    extrapolation_factor = 1e12


@pytest.mark.parametrize("thickness", [0.3, 4.0])
def test_even_fluence_has_no_source_however_the_two_sides_are_bent(monkeypatch, thickness):
    """(1/2 + K) 1 = 0 for fluence b u = 1, whatever b of a patch, of its neighbours and of the other side."""
    mesh = plate(thickness=thickness)
    grid = DiffusionTransport(resolution=48).grid(mesh, np.eye(3))
    patches = make_patches(mesh, samples_of(mesh), grid.texel)
    boundary = put_on_grid(patches, grid, Depths(mesh), SHEET_REACH * WINDOW * grid.texel, np.copy)
    bending = np.random.default_rng(0).uniform(0.5, 1.5, len(patches))
    monkeypatch.setattr(Boundary, "bending", lambda *_: bending)
    nothing = np.zeros(np.prod(grid.shape), np.float32)
    channel = Channel(boundary, Mirror(1.0, 0.0, 1.0), WINDOW * grid.texel, np.copy, nothing, np.zeros(len(patches)))
    two_A_M = 1.0 / bending
    np.testing.assert_allclose(channel.matvec(two_A_M, channel.volume(two_A_M)), 0.0, atol=1e-5)
