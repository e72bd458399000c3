"""Light between parts: row sums inside a sphere, an arch, and what an object that does not see itself costs."""

import threading

import numpy as np
import pytest

from milkglass.core.geometry.refine import refined
from milkglass.core.light.casting import BakeCancelled
from milkglass.core.light.exchange import LEFT, NEGLIGIBLE, Exchange, cast_hits, nearest_emitters, self_visible_share
from milkglass.core.light.indices import Indices
from milkglass.core.light.mirror import Mirror
from milkglass.core.material.fresnel import hemispherical_transmittance, reflectance
from tests.support.shapes import cube
from tests.support.solids import ball, block, mesh_of


@pytest.fixture(scope="module")
def cavity():
    """The inside of a unit sphere, and the rays in it."""
    mesh = mesh_of(ball(subdivisions=3, inverted=True))
    return mesh, cast_hits(mesh)


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5])
def test_light_in_a_closed_cavity_stays(cavity, eta):
    """Uniform exitance has the irradiance M: what is not let in is mirrored until it is."""
    mesh, hits = cavity
    rows = hits.matrix(eta, np.arange(len(mesh.faces)), len(mesh.faces)).sum(axis=1)
    assert rows.mean() == pytest.approx(1.0, abs=2e-3)
    assert rows.std() < 0.01


def test_even_light_stays_even_where_half_of_the_cavity_has_another_index(cavity):
    """Of radiance 1 all around each place has E = M = pi T, T of its own index."""
    mesh, hits = cavity
    etas = 1.3, 1.8
    right_faces = (mesh.vertices[mesh.faces].mean(axis=1)[:, 0] > 0.0).astype(int)
    indices = Indices(etas, (mesh.vertices[:, 0] > 0.0).astype(int), right_faces)
    transmitting = np.array([hemispherical_transmittance(eta) for eta in etas])
    found = hits.matrix(indices, np.arange(len(mesh.faces)), len(mesh.faces)) @ transmitting[right_faces]
    over = found / transmitting[indices.of_vertex]
    for half in (0, 1):
        assert over[indices.of_vertex == half].mean() == pytest.approx(1.0, abs=2e-3)
    alike = Indices((1.5, 1.5), indices.of_vertex, right_faces)
    for of_two, of_one in zip(hits.factors(alike), hits.factors(1.5), strict=True):
        np.testing.assert_array_equal(of_two, of_one)


def test_a_part_of_the_cavity_lights_all_of_it_alike(cavity):
    """Inside a sphere the view factor from any place to a part is the part's share of the area."""
    mesh, hits = cavity
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    cap = centres[:, 2] > 0.5  # a quarter of the area
    irradiance = hits.matrix(1.0, np.where(cap, 0, -1), 1).toarray()[:, 0]
    assert irradiance.mean() == pytest.approx(0.25, abs=0.01)
    assert np.std(irradiance) < 0.06  # of 64 rays


def test_rays_that_miss_nothing_bring_no_surroundings(cavity):
    assert not cavity[1].mirrored(1.5, lambda directions: np.ones((len(directions), 3))).any()


@pytest.mark.parametrize("mesh", [cube(), mesh_of(ball())], ids=["cube", "ball"])
def test_a_convex_object_has_no_entry(mesh):
    hits = cast_hits(mesh)
    assert hits.matrix(1.5, np.zeros(len(mesh.faces), int), 1).nnz == 0
    assert self_visible_share(mesh) < NEGLIGIBLE


def test_facing_squares_have_their_view_factor():
    """Parallel unit squares at a distance of their side: 0.1998 (Howell, configuration C-11)."""
    pair = mesh_of(block((1.0, 1.0, 0.2), (0.0, 0.0, 0.6)), block((1.0, 1.0, 0.2), (0.0, 0.0, -0.6)))
    fine = refined(pair, 0.06).mesh
    hits = cast_hits(fine)
    centres = fine.vertices[fine.faces].mean(axis=1)
    faces = np.abs(centres[:, 2] - 0.5) < 1e-3
    irradiance = hits.matrix(1.0, np.where(faces, 0, -1), 1).toarray()[:, 0]
    corners, places = fine.faces[np.abs(centres[:, 2] + 0.5) < 1e-3], fine.vertices
    sides = [places[corners[:, i]] - places[corners[:, 0]] for i in (1, 2)]
    areas = 0.5 * np.linalg.norm(np.cross(*sides), axis=1)
    mean = (areas * irradiance[corners].mean(axis=1)).sum() / areas.sum()
    assert mean == pytest.approx(0.1998, abs=0.004)


def test_surroundings_come_by_way_of_the_mirror():
    """A plate beside a wall, both black: a white sky comes by F_r of the wall at its angle of incidence."""
    eta, corner = 1.5, mesh_of(block((2.0, 2.0, 0.1), (0.0, 0.0, -0.05)), block((0.1, 2.0, 2.0), (1.05, 0.0, 1.0)))
    fine = refined(corner, 0.1).mesh
    hits = cast_hits(fine)
    found = hits.mirrored(eta, lambda directions: np.ones((len(directions), 3)))[:, 0]
    vertices, cosines = hits.vertices, hits.cosines.astype(np.float64)
    left = hits.faces[:, 1] == LEFT
    expected = np.zeros(len(found))
    np.add.at(
        expected, vertices[left],
        np.pi / hits.rays * (1.0 - reflectance(eta, cosines[left, 0])) * reflectance(eta, cosines[left, 1]),
    )  # fmt: skip
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
    floor = (fine.vertices[:, 2] > -1e-6) & (fine.vertices[:, 2] < 1e-6) & (fine.vertices[:, 0] > 0.8)
    assert 0.01 < found[floor].mean() < 0.5 * np.pi


def test_cancelled_rays_end(cavity):
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(BakeCancelled):
        cast_hits(cavity[0], cancelled=cancelled)


def test_progress_ends_at_one(cavity):
    shares = []
    cast_hits(cavity[0], 4, shares.append)
    assert shares[-1] == 1.0
    assert all(0.0 < share <= 1.0 for share in shares)


def test_faces_belong_to_the_emitter_on_their_side():
    plate = mesh_of(block((2.0, 2.0, 0.02)))
    points = np.array([[0.0, 0.0, 0.01], [0.0, 0.0, -0.01]])
    owners = nearest_emitters(plate, points, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), 0.5)
    heights = plate.vertices[plate.faces].mean(axis=1)[:, 2]
    assert set(owners[heights > 0.009].tolist()) == {0}
    assert set(owners[heights < -0.009].tolist()) == {1}


def test_a_body_alone_emits_and_all_receive():
    pair = mesh_of(block((1.0, 1.0, 0.2), (0.0, 0.0, 0.6)), block((1.0, 1.0, 0.2), (0.0, 0.0, -0.6)))
    fine = refined(pair, 0.2)
    whole = Exchange(fine, cast_hits(fine.mesh))
    upper = fine.mesh.vertices[fine.mesh.faces].mean(axis=1)[:, 2] > 0.0
    body = whole.of_body(np.arange(12), upper, np.arange(3))
    points, normals = np.array([[0.0, 0.0, 0.5]]), np.array([[0.0, 0.0, -1.0]])
    matrix = whole.hits.matrix(1.3, body.emitters(points, normals, 0.2), 1).toarray()[:, 0]
    assert matrix[fine.mesh.vertices[:, 2] > 0.3].max() < 0.02  # by way of the other's mirror
    below = (np.abs(fine.mesh.vertices[:, 2] + 0.5) < 1e-3) & (fine.mesh.normals[:, 2] > 0.9)
    assert matrix[below].min() > 0.05


# lamps


def test_flux_of_a_mirrored_lamp_is_kept(cavity):
    """Inside a sphere all light that is mirrored enters at the second or third place, but for F_r of the last."""
    mesh, _ = cavity
    eta, n = 1.5, 2000
    rng = np.random.default_rng(3)
    points = rng.normal(size=(n, 3))
    points *= 0.99 / np.linalg.norm(points, axis=1, keepdims=True)
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    directions = normals + 0.8 * rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    flux = rng.random((n, 3))
    mirror = Mirror(mesh)
    received = mirror.irradiance(mirror.mirrored(points, normals, directions, flux, eta))
    sides = [mesh.vertices[mesh.faces[:, i]] - mesh.vertices[mesh.faces[:, 0]] for i in (1, 2)]
    areas = np.bincount(mesh.faces.ravel(), np.repeat(np.linalg.norm(np.cross(*sides), axis=1) / 6.0, 3))
    cosines = np.einsum("ij,ij->i", normals, directions)
    mirrored = flux * (reflectance(eta, cosines) * (cosines > 0.02))[:, None]
    np.testing.assert_allclose(areas @ received, mirrored.sum(axis=0), rtol=0.02)


def test_averaging_leaves_even_light_even(cavity):
    mirror = Mirror(cavity[0])
    even = mirror._average @ np.ones(len(cavity[0].vertices))
    np.testing.assert_allclose(even, 1.0, atol=1e-12)


def test_mean_transmittance():
    for eta, expected in ((1.3, 0.93887), (1.33, 0.93407), (1.5, 0.90822)):
        assert hemispherical_transmittance(eta) == pytest.approx(expected, abs=2e-5)
