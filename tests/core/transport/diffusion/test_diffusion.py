"""Diffusion in the object: against closed forms, a dense matrix in float64 and photon walks; energy."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.special import iv, ivp, kv, kvp

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.layers import tsc_matrix
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import first_scattering, mean_cosine, refract
from milkglass.core.stages import Stages
from milkglass.core.transport.diffusion.channel import Channel
from milkglass.core.transport.diffusion.green import local_green
from milkglass.core.transport.diffusion.iteration import Iteration, fitted
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from tests.support.dense import Dense
from tests.support.diffusing import DOWN, MARBLE, SKIM_MILK, WHOLE_MILK, collimated, diffuse, samples_of, slab
from tests.support.shapes import ball, cube, plate as plate_of
from tests.support.solids import block, mesh_of

THREE = (MARBLE, SKIM_MILK, WHOLE_MILK)


def torus(sections=(96, 48), radii=(8.0, 3.0)) -> Mesh:
    shape = trimesh.creation.torus(*radii, major_sections=sections[0], minor_sections=sections[1])
    return Mesh.of(shape.vertices, shape.vertex_normals, shape.faces)


def blob(radius=5.0) -> Mesh:
    """A faceted ball with a deep dent on one side and a bump on the other."""
    u = np.asarray(trimesh.creation.icosphere(3).vertices)
    r = radius * (1.0 - 0.55 * np.exp(-4.0 * (1.0 - u[:, 2])) + 0.3 * np.exp(-6.0 * (1.0 - u[:, 0])))
    shape = trimesh.Trimesh(r[:, None] * u, trimesh.creation.icosphere(3).faces)
    split = np.arange(3 * len(shape.faces)).reshape(-1, 3)
    return Mesh.of(shape.triangles.reshape(-1, 3), np.repeat(shape.face_normals, 3, axis=0), split)


def relative(found, expected, weights):
    return float(
        np.sqrt(np.average((found - expected) ** 2, weights=weights) / np.average(expected**2, weights=weights))
    )


# The dense matrix itself, then with it


@pytest.mark.slow
@pytest.mark.parametrize("medium", [MARBLE, Medium(2.62, 0.4, 1.5)])
def test_dense_matrix_has_the_eigenvalues_of_the_sphere(medium):
    shape = trimesh.creation.icosphere(3, 5.0)
    shape.apply_scale(np.sqrt(4.0 * np.pi * 25.0 / shape.area))
    dense, R = Dense(Mesh.of(shape.vertices, shape.vertices, shape.faces), medium), 5.0
    z = dense.centres[:, 2] / np.linalg.norm(dense.centres, axis=1)
    x = medium.attenuation * R
    for degree, harmonic in enumerate([np.ones_like(z), z, 1.5 * z * z - 0.5]):
        order = degree + 0.5
        S = R / medium.diffusion * iv(order, x) * kv(order, x)
        # d/dx (I K / x): S's kernel derived along the radius, taken in the middle of both sides.
        i, k = iv(order, x), kv(order, x)
        K_l = 0.5 * x * x * ((ivp(order, x) * k + i * kvp(order, x)) / x - i * k / x**2)
        inner = harmonic * dense.areas
        assert inner @ dense.S @ harmonic / (inner @ harmonic) == pytest.approx(S, rel=0.01)
        assert inner @ dense.K @ harmonic / (inner @ harmonic) == pytest.approx(K_l, abs=0.01 * 0.5)
    np.testing.assert_allclose(Dense(cube(), Medium(1.0, 0.0, 1.3)).K.sum(axis=1), -0.5, atol=1e-12)


def channel_with(mesh, medium, points, strengths, resolution=48):
    """The equation with point sources deep inside: operator and solver without the entry of light."""
    transport, samples = DiffusionTransport(resolution=resolution), samples_of(mesh)
    found = diffuse(mesh, (medium,) * 3, resolution, samples=samples)
    grid, s = found.boundary.grid, transport.window_width(found.boundary.grid)
    (spectrum,) = transport.kernels.spectra([transport._kernel(grid, medium)], transport._maker(grid))
    convolver = transport.kernels.convolver(transport.shape(grid, medium))
    deposited = tsc_matrix(grid, grid.coordinates(points)) @ strengths.astype(np.float32)
    local = np.zeros(len(found.patches))
    channel = Channel(found.boundary, medium, s, lambda v: convolver.convolve(v, spectrum), deposited, local)
    way = Iteration(channel, fitted(channel, []), 1e-4, 40)
    while way.reached.residual > 1e-4 and way.advance():
        pass
    assert way.reached.residual <= 1e-4
    found.solution = replace(found.solution, channels=(way.reached,))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("medium", [SKIM_MILK, MARBLE, Medium(1.0, 0.1, 1.3)], ids=["skim milk", "marble", "absorbing"])
@pytest.mark.parametrize("shape", [blob, lambda: torus((36, 18), (5.0, 2.5))], ids=["blob", "torus"])
def test_agrees_with_the_dense_solution(shape, medium):
    mesh = shape()
    dense = Dense(mesh, medium)
    points = np.array([[4.0, 0.3, -0.5], [3.5, -1.0, 0.6], [-3.0, -2.0, -0.4]])
    strengths = np.array([1.0, 0.6, 0.8])
    solved = channel_with(mesh, medium, points, strengths)
    expected = dense.exitance(dense.green(points, strengths), solved.bending_of_faces(0))
    found = solved.of_faces(0)
    assert relative(found, expected, dense.areas) < 0.03
    assert dense.areas @ found == pytest.approx(dense.areas @ expected, rel=0.01)


@pytest.mark.slow
def test_agrees_with_the_dense_solution_lit_from_outside():
    """Entry of light too: on a convex body rays and chords have their closed form, sources are 16 a face."""
    medium, R = Medium(1.0, 0.01, 1.3), 5.0
    shape = trimesh.creation.icosphere(3, R)
    mesh = Mesh.of(shape.vertices, shape.vertices / R, shape.faces)
    dense = Dense(mesh, medium)
    fine = shape.subdivide().subdivide()
    n = fine.triangles_center / np.linalg.norm(fine.triangles_center, axis=1, keepdims=True)
    cosine = np.maximum(n[:, 2], 0.0)
    rays = refract(np.broadcast_to(DOWN, n.shape), n, medium.eta)
    chord = -2.0 * R * np.einsum("ij,ij->i", rays, n)
    depths, shares = first_scattering(chord * medium.sigma_t_prime)
    lit = cosine > 0.0
    points = (fine.triangles_center[:, None] + depths[..., None] / medium.sigma_t_prime * rays[:, None])[lit]
    strengths = (medium.albedo * (cosine * fine.area_faces)[:, None] * shares)[lit]
    expected = dense.exitance(dense.green(points.reshape(-1, 3), strengths.ravel()), medium.bending(2.0 / R))
    found = diffuse(mesh, (medium,) * 3).of_faces(0)
    assert relative(found, expected, dense.areas) < 0.03
    back = dense.centres[:, 2] < 0.0
    assert relative(found[back], expected[back], dense.areas[back]) < 0.04


@pytest.mark.parametrize("resolution", [36, 48])
def test_escape_from_a_shell_in_a_ball(resolution):
    """Sources 0.4 mm under the surface of a ball of 5 mm: f(r0) / (f(R) + z_b f'(R)), f = sinh(sigma r) / r."""
    mesh, R, r0 = ball(10.0), 5.0, 4.6
    transport, samples = DiffusionTransport(resolution=resolution), samples_of(mesh)
    found = diffuse(mesh, (MARBLE,) * 3, resolution, samples=samples)
    grid, s, patches = found.boundary.grid, transport.window_width(found.boundary.grid), found.patches
    (spectrum,) = transport.kernels.spectra([transport._kernel(grid, MARBLE)], transport._maker(grid))
    convolver = transport.kernels.convolver(transport.shape(grid, MARBLE))
    points = r0 * samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    shares = samples.areas / samples.areas.sum()
    deposited = tsc_matrix(grid, grid.coordinates(points)) @ shares
    local = np.full(len(patches), float(local_green(MARBLE, s, R - r0)) / (4.0 * np.pi * r0**2))
    channel = Channel(found.boundary, MARBLE, s, lambda v: convolver.convolve(v, spectrum), deposited, local)
    way = Iteration(channel, fitted(channel, []), 1e-4, 40)
    while way.reached.residual > 1e-4 and way.advance():
        pass
    sigma, z_b = MARBLE.attenuation, 2.0 * MARBLE.diffusion * MARBLE.extrapolation_factor
    slope = sigma * np.cosh(sigma * R) / R - np.sinh(sigma * R) / R**2
    flat, expected = (
        np.sinh(sigma * r0) / r0 / (np.sinh(sigma * R) / R + b * z_b * slope) for b in (1.0, MARBLE.bending(2.0 / R))
    )
    assert flat == pytest.approx(0.93641, abs=2e-3)
    assert patches.areas @ way.reached.two_A_M / (2.0 * MARBLE.extrapolation_factor) == pytest.approx(
        expected, rel=4e-3
    )


# Slabs


@pytest.mark.parametrize("thickness", [0.1, 0.25, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("resolution", [36, 48])
def test_the_middle_of_a_plate_is_a_slab(thickness, resolution):
    """20 mm wide: edges are 12 mean free paths away or more, but reach 1 / sigma in the thickest."""
    found = diffuse(mesh_of(block((20.0, 20.0, thickness))), THREE, resolution)
    patches = found.patches
    middle = np.hypot(*patches.points[:, :2].T) < 2.5
    for channel, medium in enumerate(THREE):
        depths, weights = first_scattering(np.array([thickness / medium.mean_free_path]))
        R, T = slab(medium, thickness, depths[0] * medium.mean_free_path, weights[0])
        M = found.exitance(channel)
        assert M[middle & (patches.normals[:, 2] > 0.9)].mean() == pytest.approx(R, rel=0.02)
        assert M[middle & (patches.normals[:, 2] < -0.9)].mean() == pytest.approx(T, rel=0.02)


def read(path):
    with path.open() as lines:
        return [{k: v if k == "entry" else float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def test_closed_form_of_the_slab_against_a_photon_walk(data_dir):
    worst = {0.97: 0.0, 0.99: 0.0, 0.999: 0.0}
    for row in read(data_dir / "transport" / "slab.csv"):
        if row["albedo"] < 0.97 or row["thickness_mfp"] < 4.0 or row["T"] < 2e-3:
            continue
        medium = Medium(row["albedo"], 1.0 - row["albedo"], row["eta"])
        stretch = 1.0 if row["entry"] == "normal" else mean_cosine(row["eta"])
        depths, weights = first_scattering(np.array([row["thickness_mfp"] / stretch]))
        R, T = slab(medium, row["thickness_mfp"], stretch * depths[0], weights[0])
        apart = max(abs(R / row["R"] - 1.0), abs(T / row["T"] - 1.0))
        worst[row["albedo"]] = max(worst[row["albedo"]], apart)
    assert 0.0 < worst[0.97] < 0.05
    assert 0.0 < worst[0.99] < 0.04
    assert 0.0 < worst[0.999] < 0.03


# Balls


@pytest.mark.slow
@pytest.mark.parametrize("eta", [1.3, 1.5])
@pytest.mark.parametrize("radius", [2, 4, 8, 16])
def test_ball_against_a_photon_walk(data_dir, radius, eta):
    rows = [r for r in read(data_dir / "transport" / "sphere.csv") if (r["eta"], r["radius_mfp"]) == (eta, radius)]
    albedos = (0.9, 0.97, 0.99, 0.999)
    mesh = ball(2.0 * radius)
    samples = samples_of(mesh)
    light = collimated(samples, eta=eta)
    for three in (albedos[:3], albedos[1:]):
        found = diffuse(mesh, [Medium(a, 1.0 - a, eta) for a in three], light=light, samples=samples)
        patches = found.patches
        mu = patches.points[:, 2] / np.linalg.norm(patches.points, axis=1)
        bins = np.clip((0.5 * (1.0 - mu) * 16).astype(int), 0, 15)
        for channel, albedo in enumerate(three):
            truth = np.array([r["M"] for r in rows if r["albedo"] == albedo])
            assert len(truth) == 16
            M = np.bincount(bins, patches.areas * found.exitance(channel), 16) / np.bincount(bins, patches.areas, 16)
            assert relative(M, truth, None) < (0.03 if albedo > 0.9 else 0.05)
            assert M[8:].sum() == pytest.approx(truth[8:].sum(), rel=0.03 if albedo > 0.9 else 0.055)


def test_what_the_tolerance_leaves_in_deep_shadow():
    """A residual is relative to the lit side: 3e-3 of it may be much of the dark one, but little of any picture."""
    mesh, medium = ball(32.0), Medium(0.9, 0.1, 1.5)
    exact, quick = (diffuse(mesh, (medium,) * 3, tolerance=tolerance).exitance(0) for tolerance in (1e-5, 3e-3))
    assert 1e-6 < np.abs(quick - exact).max() < 5e-3 * exact.max()


# Energy


@pytest.mark.slow
@pytest.mark.parametrize("shape", [ball, torus, cube], ids=["ball", "torus", "cube"])
def test_what_is_not_absorbed_leaves(shape):
    media = (Medium(2.62, 0.0, 1.5), Medium(0.7, 0.0, 1.3), Medium(10.0, 0.0, 1.3))
    found = diffuse(shape(), media)
    for channel in range(3):
        assert found.leaving(channel) == pytest.approx(found.scattered(channel), rel=1e-3)


@pytest.mark.slow
def test_random_plates_return_no_more_than_entered():
    """Of 24 thicknesses and indices, whose rays are what takes time, each with 9 media."""
    rng = np.random.default_rng(0)
    most = 0.0
    for _ in range(24):
        thickness, eta = float(np.exp(rng.uniform(np.log(0.02), np.log(10.0)))), rng.uniform(1.0, 2.5)
        mesh, stages = mesh_of(block((10.0, 10.0, thickness))), Stages()
        kept = {"samples": samples_of(mesh, 20), "stages": stages}
        for _ in range(3):
            scatter, absorb = np.exp(rng.uniform(np.log([[0.05], [1e-5]]), np.log([[20.0], [1.0]]), (2, 3)))
            found = diffuse(mesh, [Medium(*pair, eta) for pair in zip(scatter, absorb, strict=True)], 20, **kept)
            for channel in range(3):
                share = found.leaving(channel) / found.scattered(channel)
                assert 0.0 <= share <= 1.0 + 1e-6
                most = max(most, share)
    assert most > 0.9


# Pixels and faces


def test_volume_gives_the_surface_back():
    """2 A M = (O + local) / (rho(0) / (2 A) - b K_L 1) where nothing enters: what a pixel does."""
    found = diffuse(ball(20.0), THREE, 48, tolerance=1e-5)
    boundary = found.boundary
    dark = found.patches.normals[:, 2] < -0.1
    s = found.transport.window_width(boundary.grid)
    gathered = boundary.weights.T @ found.solution.volume.reshape(4, -1).T.astype(float)
    for channel, medium in enumerate(THREE):
        own = float(local_green(medium, s, 0.0)) / (2.0 * medium.extrapolation_factor)
        phi = gathered[:, channel] / (own - boundary.bending(medium) * gathered[:, 3])
        expected = found.solution.two_A_M[channel]
        np.testing.assert_allclose(phi[dark], expected[dark], atol=1e-4 * expected.max())


def test_plate_with_faces_of_any_size():
    """12 triangles or 37,000: the same light."""
    coarse, fine = diffuse(mesh_of(block((20.0, 20.0, 1.0))), THREE, 36), diffuse(plate_of(), THREE, 36)
    for channel in range(3):
        assert fine.leaving(channel) == pytest.approx(coarse.leaving(channel), rel=5e-3)
