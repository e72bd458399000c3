"""Light as it enters: rays, chords, where sources lie, and what becomes of their flux."""

import numpy as np
import pytest

from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import mean_cosine
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.boundary import Depths
from milkglass.core.transport.diffusion.entry import enter, second_scattering, shallow_sources, sources
from milkglass.core.transport.diffusion.green import local_green
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from tests.support.diffusing import DOWN, MARBLE, collimated, samples_of
from tests.support.shapes import ball, cube
from tests.support.solids import block, mesh_of


class Placed:
    def __init__(self, mesh, resolution=48) -> None:
        self.mesh, self.samples = mesh, samples_of(mesh, resolution)
        self.transport = DiffusionTransport(resolution=resolution)
        self.grid = self.transport.grid(mesh, np.eye(3))
        self.depths = Depths(mesh)
        self.boundary = self.transport.boundary(mesh, self.samples, self.grid, self.depths)
        self.s = self.transport.window_width(self.grid)

    def enter(self, light, eta=1.5):
        return enter(light, self.boundary, self.depths, eta)

    @property
    def all(self):
        """Of each patch's light."""
        return np.ones(len(self.boundary.patches))

    def moments(self, deposited):
        """Sum of the nodes, and the mean of their places."""
        z, y, x = np.indices(self.grid.shape).reshape(3, -1)
        matrix, flux = np.asarray(self.grid.world_to_grid), deposited.astype(float)
        places = (np.column_stack([x, y, z]) - matrix[3, :3]) @ np.linalg.inv(matrix[:3, :3])
        return flux.sum(), flux @ places / flux.sum()


@pytest.fixture(scope="module")
def placed():
    return Placed(ball(20.0))


@pytest.fixture(scope="module")
def box():
    return Placed(cube())


def test_flux_of_what_is_lit(placed):
    light = collimated(placed.samples)
    entry = placed.enter(light)
    np.testing.assert_allclose(entry.flux.sum(axis=0), np.pi * 100.0, rtol=5e-3)
    np.testing.assert_allclose(entry.flux.sum(axis=0), light.flux.sum(axis=0, dtype=float), rtol=1e-5)
    assert (placed.boundary.patches.normals[entry.patches, 2] > -0.1).all()
    assert len(np.unique(entry.patches)) == len(entry.patches)


def test_rays_and_chords_in_a_ball(placed):
    """In a ball a chord is 2 R times the ray's cosine."""
    entry = placed.enter(collimated(placed.samples))
    normals = placed.boundary.patches.normals[entry.patches]
    cosine = np.sqrt(1.0 - (1.0 - np.maximum(normals[:, 2], 0.0) ** 2) / 1.5**2)
    up = normals[:, 2] > 0.0  # patches on the terminator may be half lit and face away
    np.testing.assert_allclose(entry.cosines[up], cosine[up], atol=1e-6)
    np.testing.assert_allclose(entry.cosines, cosine, atol=0.01)
    np.testing.assert_allclose(entry.chords, 20.0 * cosine, rtol=0.03)


def test_a_far_lamp_is_a_direction(placed):
    samples = placed.samples
    flux = collimated(samples).flux
    far = placed.enter(EnteringLight(flux, position=(0.0, 0.0, 1e7)))
    near = placed.enter(EnteringLight(flux, position=(0.0, 0.0, 30.0)))
    along = placed.enter(EnteringLight(flux, direction=DOWN))
    np.testing.assert_allclose(far.rays, along.rays, atol=1e-5)
    # Rays of a near lamp spread: those away from the axis go on outwards.
    off = np.argmax(placed.boundary.patches.points[near.patches, 0])
    assert near.rays[off, 0] > along.rays[off, 0]


def test_diffuse_light_goes_in_along_the_normal(placed):
    samples = placed.samples
    entry = placed.enter(EnteringLight(np.repeat(samples.areas[:, None], 3, axis=1)))
    assert len(entry.patches) == len(placed.boundary.patches)
    np.testing.assert_allclose(entry.rays, -placed.boundary.patches.normals)
    assert entry.stretch == mean_cosine(1.5)
    np.testing.assert_allclose(entry.cosines, entry.stretch)


def test_sources_lie_a_mean_free_path_deep(box):
    """Into a flat side: all flux scatters once, on average 1 / s_t' deep; a' of it goes on."""
    medium = Medium(1.35, 0.15, 1.5)
    lit = box.samples.normals[:, 2] > 0.9
    entry = box.enter(collimated(box.samples, lit=lit))
    deposited, local = sources(entry, box.boundary, medium, 0, box.s, box.all)
    total, place = box.moments(deposited)
    assert total == pytest.approx(0.9 * 400.0, rel=1e-4)
    np.testing.assert_allclose(place, [0.0, 0.0, 10.0 - medium.mean_free_path], atol=2e-3)
    top = box.boundary.patches.normals[:, 2] > 0.9
    inner = top & (np.abs(box.boundary.patches.points[:, :2]).max(axis=1) < 9.0)
    depths = np.array([0.585786, 3.414214]) * medium.mean_free_path
    expected = 0.9 * np.array([0.853553, 0.146447]) @ local_green(medium, box.s, depths)
    np.testing.assert_allclose(local[inner], expected, rtol=2e-3)
    assert not local[~top].any()


def test_slanting_light_goes_in_along_the_refracted_ray(box):
    direction, medium = np.array([0.6, 0.0, -0.8]), Medium(2.0, 0.0, 1.5)
    lit = (box.samples.normals[:, 2] > 0.9) & (np.abs(box.samples.points[:, 0]) < 5.0)
    entry = box.enter(collimated(box.samples, tuple(direction), lit=lit))
    total, place = box.moments(sources(entry, box.boundary, medium, 0, box.s, box.all)[0])
    sine = 0.6 / 1.5
    assert total == pytest.approx(entry.flux[:, 0].sum(), rel=1e-4)
    start = np.average(box.boundary.patches.points[entry.patches], axis=0, weights=entry.flux[:, 0])
    np.testing.assert_allclose(place - start, [0.5 * sine, 0.0, -0.5 * np.sqrt(1.0 - sine**2)], atol=3e-3)


@pytest.mark.parametrize("thickness", [0.1, 0.5, 2.0])
def test_thin_parts_keep_their_sources_inside(thickness):
    plate = Placed(mesh_of(block((20.0, 20.0, thickness))))
    lit = plate.samples.normals[:, 2] > 0.9
    entry = plate.enter(collimated(plate.samples, lit=lit))
    np.testing.assert_allclose(entry.chords, thickness, rtol=0.02)
    deposited, _ = sources(entry, plate.boundary, MARBLE, 0, plate.s, plate.all)
    total, place = plate.moments(deposited)
    chord = thickness * MARBLE.sigma_t_prime
    assert total == pytest.approx(MARBLE.albedo * 400.0 * -np.expm1(-chord), rel=0.02)
    mean = (1.0 - (1.0 + chord) * np.exp(-chord)) / -np.expm1(-chord) / MARBLE.sigma_t_prime
    assert place[2] == pytest.approx(0.5 * thickness - mean, abs=0.01 * thickness + 1e-3)


def test_sources_of_a_sheet_reach_the_other_side():
    plate = Placed(mesh_of(block((20.0, 20.0, 0.3))))
    lit = plate.samples.normals[:, 2] > 0.9
    _, local = sources(plate.enter(collimated(plate.samples, lit=lit)), plate.boundary, MARBLE, 0, plate.s, plate.all)
    patches = plate.boundary.patches
    middle = np.abs(patches.points[:, :2]).max(axis=1) < 8.0
    assert np.abs(local[middle & (patches.normals[:, 2] < -0.9)]).min() > 0.0
    thick = Placed(cube())
    lit = thick.samples.normals[:, 2] > 0.9
    _, local = sources(thick.enter(collimated(thick.samples, lit=lit)), thick.boundary, MARBLE, 0, thick.s, thick.all)
    assert not local[thick.boundary.patches.normals[:, 2] < -0.9].any()


def test_what_is_not_kept_is_in_neither_part(placed):
    entry = placed.enter(collimated(placed.samples))
    whole = sources(entry, placed.boundary, MARBLE, 0, placed.s, placed.all)
    half = sources(entry, placed.boundary, MARBLE, 0, placed.s, 0.5 * placed.all)
    for part, of in zip(half, whole, strict=True):
        np.testing.assert_allclose(part, 0.5 * of, rtol=1e-4, atol=1e-6)


def test_flux_grows_with_the_light(placed):
    light = collimated(placed.samples)
    one = sources(placed.enter(light), placed.boundary, MARBLE, 1, placed.s, placed.all)
    two = sources(
        placed.enter(EnteringLight(2.0 * light.flux, direction=DOWN)), placed.boundary, MARBLE, 1, placed.s, placed.all
    )
    for single, double in zip(one, two, strict=True):
        np.testing.assert_allclose(double, 2.0 * single, rtol=1e-5)


def test_light_that_meets_a_side_under_total_reflection_goes_on(box):
    """Down into a cube at a slant: what comes to the side x = 10 turns there, and ends at the bottom."""
    direction, medium = np.array([0.6, 0.0, -0.8]), Medium(0.05, 0.0, 1.5)
    lit = (box.samples.normals[:, 2] > 0.9) & (box.samples.points[:, 0] > 5.0)
    entry = box.enter(collimated(box.samples, tuple(direction), lit=lit))
    second, sine = entry.second, 0.6 / 1.5
    cosine = np.sqrt(1.0 - sine**2)
    assert len(second.rays) > 0.5 * len(entry.patches)
    np.testing.assert_allclose(second.starts[:, 0], 10.0, atol=1e-3)
    np.testing.assert_allclose(second.reflected, 1.0)
    np.testing.assert_allclose(second.directions, np.tile([-sine, 0.0, -cosine], (len(second.rays), 1)), atol=1e-6)
    np.testing.assert_allclose((entry.chords[second.rays] + second.chords) * cosine, 20.0, atol=0.02)
    again, depths, shares = second_scattering(entry, medium)
    np.testing.assert_array_equal(again, np.arange(len(second.rays)))
    first = np.exp(-entry.chords[second.rays] * medium.sigma_t_prime)
    np.testing.assert_allclose(shares.sum(axis=1), first - np.exp(-20.0 / cosine * medium.sigma_t_prime), rtol=3e-3)
    assert (depths * medium.mean_free_path < second.chords[:, None]).all()
    total, _ = box.moments(sources(entry, box.boundary, medium, 0, box.s, box.all)[0])
    scattered = entry.flux[:, 0] @ -np.expm1(-entry.chords * medium.sigma_t_prime)
    assert total == pytest.approx(scattered + entry.flux[second.rays, 0] @ shares.sum(axis=1), rel=1e-3)


@pytest.mark.parametrize("medium", [MARBLE, Medium(1.5, 0.05, 1.3)])
def test_shallow_light_is_that_from_all_around(box, medium):
    """Below a flat side the potential is the same, of free paths of one cell and of one and a half."""
    samples, patches = box.samples, box.boundary.patches
    entry = box.enter(EnteringLight(np.repeat(samples.areas[:, None], 3, axis=1)), medium.eta)
    flux = patches.sums @ samples.areas.astype(np.float64)
    exact = sources(entry, box.boundary, medium, 0, box.s, box.all)
    found = shallow_sources(flux, box.boundary, medium, box.s)
    assert found[0].sum() == pytest.approx(exact[0].sum(), rel=0.02)
    (spectrum,) = box.transport.kernels.spectra(
        [box.transport._kernel(box.grid, medium)], box.transport._maker(box.grid)
    )
    convolver = box.transport.kernels.convolver(box.transport.shape(box.grid, medium))
    values = [
        box.boundary.weights.T @ convolver.convolve(nodes.reshape(box.grid.shape), spectrum).ravel() + local
        for nodes, local in (exact, found)
    ]
    inner = (patches.normals[:, 2] > 0.9) & (np.abs(patches.points[:, :2]).max(axis=1) < 5.0)
    np.testing.assert_allclose(values[1][inner], values[0][inner], rtol=0.03)
