"""Light within clear and murky bodies: collisions order by order against photons, and white furnaces."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import qmc

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.normals import across
from milkglass.core.geometry.samples import SurfaceSamples, surface_samples
from milkglass.core.material.fresnel import transmittance
from milkglass.core.material.medium import Medium
from milkglass.core.paths.beams import Beams, traced
from milkglass.core.paths.deposit import collided
from milkglass.core.paths.emission import Ball, parallel, surrounding
from milkglass.core.paths.filled import filled
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.surface import Surface
from milkglass.core.paths.surroundings import Surroundings
from milkglass.core.paths.tree import Seen, Sight, Tree
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem, Solution
from tests.support.ball_paths import seen_halves
from tests.support.diffusing import collimated
from tests.support.solids import ball, block, mesh_of

ETA, RADIUS, NODES, BEAMS = 1.33, 25.0, 62, 8000
ALBEDOS = 0.5, 0.9, 0.999
# Of what has entered a sphere of so many mean free paths, what scatters twice and more before it leaves, for the three
# albedos, what scatters once and leaves, over the albedo, and what crosses (photons, standard error about 0.3 %).
ORDERS = {
    0.01: ((0.00055, 0.00250, 0.00342), 0.01440, 0.9821),
    0.1: ((0.00704, 0.03104, 0.04236), 0.1214, 0.8361),
    0.3: ((0.0253, 0.1136, 0.1563), 0.2555, 0.5876),
    1.0: ((0.0643, 0.3518, 0.5274), 0.2934, 0.1768),
    2.0: ((0.0631, 0.4445, 0.7750), 0.1871, 0.0335),
    3.0: ((0.0505, 0.4185, 0.8524), 0.1331, 0.0066),
    8.0: ((0.0325, 0.2955, 0.8914), 0.0889, 0.0),
}
# Of what scatters for the first time, what leaves at once.
AT_ONCE = {0.01: 0.807, 0.1: 0.741, 0.3: 0.619, 1.0: 0.356, 2.0: 0.194, 3.0: 0.134, 8.0: 0.089}
# What scatters for the first time in an infinite plate of so many mean free paths, lit along its normal, over what has
# entered; of it, what leaves at once by the front and by the back, and what collides again (without absorption).
IN_PLATES = {
    0.1: (0.0969, 0.0153, 0.0154, 0.0662),
    0.3: (0.2631, 0.0364, 0.0359, 0.1907),
    1.0: (0.6368, 0.0656, 0.0539, 0.5172),
}
# What leaves spheres scattered, over what has entered, in eighths of the cosine of its direction to that from
# which parallel light comes, by radius in mean free paths and g (2 million photons by Henyey and Greenstein's phase
# function, 0.3 % each; the last eighth goes back towards the light).
FAR = {
    (2.0, 0.9): (0.1133, 0.1180, 0.1208, 0.1225, 0.1236, 0.1248, 0.1256, 0.1267),
    (3.0, 0.85): (0.0822, 0.0961, 0.1075, 0.1173, 0.1270, 0.1357, 0.1443, 0.1531),
}
# What leaves a sphere of so many mean free paths and an albedo of 0.9 scattered, over what has entered, by height: 16
# parts of one area, from the dark pole to the lit one (2 million photons each).
LEAVING = {
    0.3: (
        0.03164, 0.02498, 0.02187, 0.02068, 0.02006, 0.01987, 0.01966, 0.01974,
        0.02006, 0.02035, 0.02063, 0.02065, 0.02072, 0.02078, 0.02089, 0.02149,
    ),
    1.0: (
        0.04443, 0.03839, 0.03546, 0.03392, 0.03350, 0.03361, 0.03401, 0.03506,
        0.03618, 0.03809, 0.03953, 0.04065, 0.04198, 0.04263, 0.04361, 0.04477,
    ),
    3.0: (
        0.01339, 0.01404, 0.01467, 0.01599, 0.01742, 0.01956, 0.02209, 0.02565,
        0.03046, 0.03637, 0.04233, 0.04795, 0.05310, 0.05793, 0.06238, 0.06667,
    ),
    8.0: (
        0.00024, 0.00038, 0.00063, 0.00095, 0.00155, 0.00253, 0.00415, 0.00712,
        0.01299, 0.02194, 0.03198, 0.04162, 0.05096, 0.05918, 0.06661, 0.07371,
    ),
}  # fmt: skip


@dataclass
class Object:
    """A mesh with beams through it."""

    mesh: Mesh
    surface: Surface
    samples: SurfaceSamples
    beams: Beams

    def solved(self, media, stages: Stages, light=None) -> Solution:
        transport = DiffusionTransport(resolution=NODES)
        dark = EnteringLight(np.zeros((len(self.samples), 3), np.float32))
        grid = transport.grid(self.mesh, np.eye(3))
        problem = Problem(self.mesh, self.samples, grid, [light or dark], media, beams=self.beams, media_within=media)
        return transport.solve(problem, stages)

    def pixels(self, extinction: Array, resolved, around: Surroundings) -> Array:
        """Radiance of the pixels of the object, seen along -z."""
        side = RADIUS * ((np.arange(90) + 0.5) / 45.0 - 1.0)
        x, y = np.meshgrid(side, side)
        origins = np.stack([x, y, np.full_like(x, 100.0)], axis=-1).reshape(-1, 3)
        directions = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
        found = self.seen(origins, directions, extinction, resolved.glow, around)
        return found.mirror + found.unscattered + found.scattered

    def seen(
        self, origins: Array, directions: Array, extinction: Array, glow: Glow, surroundings: Surroundings
    ) -> Seen:
        """What those rays see that meet the object."""
        origins, directions = origins.astype(np.float32), directions.astype(np.float32)
        face, distance, u, v = self.surface.rays.places(origins, directions)
        met = face >= 0
        weights = np.stack([1.0 - u - v, u, v], axis=1)
        normals = np.einsum("ij,ijk->ik", weights, self.surface.faces.normals[self.surface.faces.corners[face]])
        normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        points = origins + distance[:, None] * directions
        sight = Sight(points[met], normals[met], directions[met], np.zeros(met.sum(), np.int32))
        return Tree(self.surface, extinction.astype(np.float32)[None], surroundings, (glow,)).trace(sight)

    def leaving(self, extinction: Array, glow: Glow, parts: int) -> Array:
        """Scattered flux that leaves a sphere, by height in parts of one area: (parts, 3)."""
        each = 1024
        along, turn, mu2, around = qmc.Sobol(4, seed=0).random(each * parts).T
        height = (2.0 * (np.arange(each * parts) // each + along) / parts - 1.0)[:, None]
        angle = 2.0 * np.pi * turn[:, None]
        ring = np.sqrt(1.0 - height**2)
        normals = np.concatenate([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
        first, second = across(normals)
        aside, angle = np.sqrt(1.0 - mu2)[:, None], 2.0 * np.pi * around[:, None]
        towards = np.sqrt(mu2)[:, None] * normals + aside * (np.cos(angle) * first + np.sin(angle) * second)
        origins = 0.999 * RADIUS * normals + RADIUS * towards
        found = self.seen(origins, -towards, extinction, glow, Surroundings.of())
        exitance = np.pi * found.scattered.reshape(parts, each, 3).mean(axis=1)
        return 4.0 * np.pi * RADIUS**2 / parts * exitance

    def far(self, extinction: Array, glow: Glow, parts: int) -> Array:
        """Scattered flux that leaves a sphere, by the cosine of its direction to z in equal parts: (parts, 3)."""
        side = RADIUS * ((np.arange(64) + 0.5) / 32.0 - 1.0)
        x, y = (at.ravel()[:, None] for at in np.meshgrid(side, side))
        found = np.empty((parts, 3))
        for part in range(parts):
            mu = 2.0 * (part + 0.5) / parts - 1.0
            towards = np.array([np.sqrt(1.0 - mu * mu), 0.0, mu])
            first, second = across(towards[None])
            origins = 2.0 * RADIUS * towards + x * first + y * second
            seen = self.seen(origins, np.tile(-towards, (len(x), 1)), extinction, glow, Surroundings.of())
            found[part] = seen.scattered.sum(axis=0) * (RADIUS / 32.0) ** 2 * 4.0 * np.pi / parts
        return found


def lit(part, light) -> Object:
    mesh = mesh_of(part)
    surface = Surface.of(mesh, ETA)
    return Object(mesh, surface, surface_samples(mesh, 2.0 * RADIUS / NODES), traced(surface, light(Ball.around(mesh))))


def sun(around: Ball):
    return parallel((0.0, 0.0, 1.0), (1.0,) * 3, around, BEAMS)


def sky(around: Ball):
    return surrounding(np.ones((16, 32, 3)), np.eye(3), around, 4 * BEAMS)


@pytest.fixture(scope="module")
def sphere() -> Object:
    return lit(ball(RADIUS, subdivisions=5), sun)


@pytest.mark.slow
@pytest.mark.parametrize("radius", ORDERS)
def test_orders_of_scattering_in_a_sphere(sphere, radius):
    """Order by order, and by height on the sphere; errors are of all that is scattered."""
    stages, mu = Stages(), (np.arange(2000) + 0.5) / 2000
    entered = 2.0 * np.pi * RADIUS**2 * np.mean(mu * transmittance(ETA, mu))
    extinction = radius / RADIUS
    media = [Medium(albedo * extinction, (1.0 - albedo) * extinction, ETA) for albedo in ALBEDOS]
    solution = sphere.solved(media, stages)
    assert solution.resolved.shares == (1.0, 1.0, 1.0)
    first = stages.kept(Stage.FIRST_VOLUME)[1][0].power
    thickness, resolved = np.full(3, extinction), solution.resolved
    alone, all_orders = (sphere.leaving(thickness, glow, 16) / entered for glow in (resolved.once, resolved.glow))
    often, once, crossing = ORDERS[radius]
    for i, (albedo, expected) in enumerate(zip(ALBEDOS, often, strict=True)):
        scattered, begun = expected + albedo * once, first[i].sum(dtype=float) / entered
        assert 1.0 - begun / albedo == pytest.approx(crossing, abs=3e-3)
        assert alone[:, i].sum() == pytest.approx(albedo * once, rel=0.03)
        assert alone[:, i].sum() / begun == pytest.approx(AT_ONCE[radius], rel=0.03)
        assert all_orders[:, i].sum() - alone[:, i].sum() == pytest.approx(expected, abs=0.04 * scattered)
    if radius in LEAVING:
        error = all_orders[:, 1] - LEAVING[radius]
        assert np.sqrt(np.mean(error**2)) < 0.04 * np.sqrt(np.mean(np.square(LEAVING[radius])))


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.0, 0.72, 0.56)])
def test_clear_and_murky_bodies_in_a_white_furnace_are_white(stretch):
    part = ball(RADIUS, subdivisions=5)
    part.apply_scale(stretch)
    found, white = lit(part, sky), Surroundings.of(np.ones((2, 4, 3), np.float32))
    for paths in ((500.0, 100.0, 50.0), (25.0, 12.0, 6.0), (4.0, 3.0, 2.1)):
        media = [Medium(1.0 / path, 0.0, ETA) for path in paths]
        radiance = found.pixels(1.0 / np.array(paths), found.solved(media, Stages()).resolved, white)
        np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=0.02)
        assert radiance.std(axis=0).max() < 0.04


@pytest.mark.slow
def test_a_colour_that_a_light_gains_is_scattered_as_often_as_the_others(sphere):
    """While it was dark, even light was asked for nothing of it."""
    media, stages = [Medium(0.1, 0.0, ETA)] * 3, Stages()
    red = np.array([1.0, 0.0, 0.0], np.float32)
    replace(sphere, beams=replace(sphere.beams, power=sphere.beams.power * red)).solved(media, stages)
    leaving = sphere.leaving(np.full(3, 0.1), sphere.solved(media, stages).resolved.glow, 2)
    np.testing.assert_allclose(leaving[:, 1:], leaving[:, [0, 0]], rtol=1e-3)


@pytest.mark.slow
def test_forward_scattering_in_a_white_furnace_is_white():
    """What flies on forward, and what the surface sends back of it, add up to light from everywhere alike."""
    found, white = lit(ball(RADIUS, subdivisions=5), sky), Surroundings.of(np.ones((2, 4, 3), np.float32))
    media = [Medium(1.0 / path, 0.0, ETA, g=g) for path, g in ((50.0, 0.9), (12.0, 0.98), (4.2, 0.5))]
    resolved = found.solved(media, Stages()).resolved
    assert resolved.shares == (1.0, 1.0, 1.0)
    radiance = found.pixels(np.array([medium.delta_eddington().sigma_t for medium in media]), resolved, white)
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=0.02)
    assert radiance.std(axis=0).max() < 0.04


@pytest.mark.slow
def test_forward_scattering_is_that_of_paths():
    """Lit from the front and from behind; by reduced coefficients the second ball's front is 0.023 too bright."""
    cases, g = ((50.0, 1.0), (25.0, 0.5), (10.0, 0.2)), 0.9
    media = [Medium(a / path, (1.0 - a) / path, ETA, g=g) for path, a in cases]
    extinction = np.array([medium.delta_eddington().sigma_t for medium in media])
    mesh = mesh_of(ball(RADIUS, subdivisions=5))
    surface, samples = Surface.of(mesh, ETA), surface_samples(mesh, 2.0 * RADIUS / NODES)
    found = np.empty((2, 3))
    for half, columns in enumerate((np.r_[0:8, 24:32], np.r_[8:24])):  # of the map, whose middle is at -z
        light = np.zeros((16, 32, 3), np.float32)
        light[:, columns] = 1.0
        beams = traced(surface, surrounding(light, np.eye(3), Ball.around(mesh), 2 * BEAMS))
        lit_half = Object(mesh, surface, samples, beams)
        around = Surroundings.of(np.repeat(np.repeat(light, 8, axis=0), 8, axis=1))
        found[half] = lit_half.pixels(extinction, lit_half.solved(media, Stages()).resolved, around).mean(axis=0)
    paths = [seen_halves(RADIUS * m.sigma_s_prime / (1.0 - g), RADIUS * m.sigma_a, g, ETA, 400_000) for m in media]
    np.testing.assert_allclose(found.T, paths, atol=0.015)
    np.testing.assert_allclose(found.T[2], paths[2], rtol=0.1)


@pytest.mark.slow
def test_light_that_scatters_often_keeps_its_direction(sphere):
    """By shares of what leaves; where the flux of later collisions is that of even light alone they err by 0.006."""
    media = [Medium(0.995 * r / RADIUS, 0.005 * r / RADIUS, ETA, g=g) for r, g in FAR]
    resolved = sphere.solved([*media, media[-1]], Stages()).resolved
    extinction = np.array([medium.delta_eddington().sigma_t for medium in (*media, media[-1])])
    found = sphere.far(extinction, resolved.glow, 8)
    for i, expected in enumerate(FAR.values()):
        np.testing.assert_allclose(found[:, i] / found[:, i].sum(), np.array(expected) / np.sum(expected), atol=0.004)


@pytest.mark.slow
def test_orders_of_scattering_in_a_plate():
    """Lit along its normal, seen from all directions; what is trapped in the thinner ones gets out by their sides."""
    half, deep, count = 20.0, 4.0, 4096
    plate = lit(
        block((2.0 * half, 2.0 * half, deep)),
        lambda around: parallel((0.0, 0.0, 1.0), (1.0,) * 3, around, 5 * BEAMS),
    )
    stages, extinction = Stages(), np.array(list(IN_PLATES)) / deep
    resolved = plate.solved([Medium(scattering, 0.0, ETA) for scattering in extinction], stages).resolved
    first, second = stages.kept(Stage.FIRST_VOLUME)[1][0].power, stages.kept(Stage.SECOND_VOLUME)[1].power
    entered = 4.0 * half * half * float(transmittance(ETA, 1.0))
    mu2, turn, u, v = qmc.Sobol(4, seed=0).random(count).T
    places = np.stack([1.5 * half * (u - 0.5), 1.5 * half * (v - 0.5), np.zeros(count)], axis=1)
    sine, angle, leaving = np.sqrt(1.0 - mu2), 2.0 * np.pi * turn, []
    for side in (1.0, -1.0):
        towards = np.stack([sine * np.cos(angle), sine * np.sin(angle), side * np.sqrt(mu2)], axis=1)
        origins = places + np.array([0.0, 0.0, 0.5 * side * deep]) + towards
        seen = plate.seen(origins, -towards, extinction, resolved.once, Surroundings.of())
        leaving.append(4.0 * np.pi * half * half / entered * seen.scattered.mean(axis=0, dtype=float))
    for i, (met, front, back, _) in enumerate(IN_PLATES.values()):
        assert first[i].sum(dtype=float) / entered == pytest.approx(met, rel=3e-3)
        np.testing.assert_allclose([leaving[0][i], leaving[1][i]], [front, back], rtol=0.03)
    middle, (met, _, _, again) = (slice(None), *[slice(20, 45)] * 2), IN_PLATES[1.0]
    collided = second[2][middle].sum(dtype=float) / first[2][middle].sum(dtype=float)
    assert collided == pytest.approx(again / met, rel=0.04)


@pytest.mark.slow
def test_without_forward_scattering_all_is_as_by_reduced_coefficients(sphere):
    """Nothing is drawn and no light is kept apart: the volumes are the sums of before, bit for bit."""
    media = [Medium(albedo / RADIUS, (1.0 - albedo) / RADIUS, ETA, g=0.0) for albedo in ALBEDOS]
    flights = [medium.delta_eddington() for medium in media]
    assert [flight.sigma_t for flight in flights] == [medium.sigma_t_prime for medium in media]
    resolved = sphere.solved(media, Stages()).resolved
    assert not resolved.glow.is_directed
    assert not resolved.once.lobes.size
    np.testing.assert_array_equal(resolved.glow.nodes, resolved.once.nodes + resolved.often.nodes)
    grid = DiffusionTransport(resolution=NODES).grid(sphere.mesh, np.eye(3))
    met = collided(sphere.beams, [medium.sigma_t_prime for medium in media], grid)
    scale = np.float32(1.0 / (4.0 * np.pi * grid.texel**3)) / filled(sphere.mesh, grid).weight
    for i, medium in enumerate(media):
        np.testing.assert_array_equal(resolved.once.nodes[..., i], np.float32(medium.albedo) * met[i] * scale)


@pytest.mark.slow
def test_the_surface_is_solved_as_without_beams(sphere):
    """Bit for bit; and matter that nodes do not resolve sends out nothing along rays."""
    light, murky, clear = collimated(sphere.samples), Medium(2.0, 0.01, ETA), Medium(0.05, 0.01, ETA)
    without = replace(sphere, beams=None).solved([murky, murky, clear], Stages(), light)
    dense, mixed = (sphere.solved([murky, murky, last], Stages(), light) for last in (murky, clear))
    assert dense.resolved is None
    assert mixed.resolved.shares == (0.0, 0.0, 1.0)
    assert not mixed.resolved.glow.nodes[..., :2].any()
    np.testing.assert_array_equal(mixed.volume, without.volume)
