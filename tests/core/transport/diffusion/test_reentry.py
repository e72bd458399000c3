"""Light that enters again, in the boundary integral equation: furnaces, dark channels, convex objects, two bodies."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.geometry.refine import refined
from milkglass.core.light.exchange import Exchange, cast_hits
from milkglass.core.material.library import Material
from milkglass.core.material.medium import Medium
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringFlux, EnteringLight, WholeObject
from milkglass.core.transport.diffusion.reentry import diffuse_reflectance
from milkglass.core.transport.diffusion.solver import DiffusionTransport, Problem
from milkglass.core.transport.separate import OfBodies
from tests.support.diffusing import MARBLE, collimated, samples_of
from tests.support.furnaces import bowl, coarse_sculpture, furnace, knot, shape, sphere, torus
from tests.support.solids import ball, block, mesh_of

BLACK = Medium(0.002, 30.0, 1.5)


def exchange_of(mesh, edge=0.05) -> Exchange:
    fine = refined(mesh, edge * float(np.ptp(mesh.bounds, axis=0).max()))
    return Exchange(fine, cast_hits(fine.mesh))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.01, 0.1, 0.2])
@pytest.mark.parametrize("make", [sphere, torus, bowl, knot, coarse_sculpture])
def test_an_object_in_a_white_furnace_is_white(make, share):
    """What enters is what surroundings of radiance 1 bring, wherever they are seen, mirrored or through matter."""
    mesh = shape(make)
    found = furnace(mesh, share * float(np.ptp(mesh.bounds, axis=0).max()))
    assert found.entering == pytest.approx(1.0, abs=0.02)
    assert found.unevenness < 0.035
    assert found.mean <= found.entering + 0.005
    assert found.error < 0.06  # in petals it was 0.14, and in the bowl
    if make is not coarse_sculpture and share == 0.01:
        assert found.kept == pytest.approx(1.0, abs=0.012)
        assert found.deviation < 0.04


@pytest.mark.slow
def test_light_between_parts_takes_no_further_products():
    without, found = (furnace(shape(knot), 0.2, exchanges=exchanges) for exchanges in (False, True))
    assert without.mean < 0.9
    assert max(found.solution.convolutions) <= max(without.solution.convolutions) + 1


def test_a_convex_object_is_solved_as_without():
    mesh = mesh_of(ball(10.0))
    samples = samples_of(mesh, 24)
    transport = DiffusionTransport(resolution=24)
    problem = Problem(mesh, samples, transport.grid(mesh, np.eye(3)), [collimated(samples)], (MARBLE,) * 3)
    without = transport.solve(problem, Stages())
    between = DiffusionTransport(resolution=24).solve(replace(problem, exchange=exchange_of(mesh)), Stages())
    np.testing.assert_array_equal(between.volume, without.volume)
    assert not between.reentering.any()


def test_a_dark_channel_is_solved_as_without():
    """Where next to nothing leaves, nothing of it is looked for."""
    mesh = mesh_of(block((10.0, 10.0, 2.0)), block((2.0, 10.0, 8.0), (4.0, 0.0, 4.9)))
    samples = samples_of(mesh, 24)
    transport = DiffusionTransport(resolution=24)
    media = MARBLE, BLACK, MARBLE
    problem = Problem(mesh, samples, transport.grid(mesh, np.eye(3)), [collimated(samples)], media)
    without = transport.solve(problem, Stages())
    between = DiffusionTransport(resolution=24).solve(replace(problem, exchange=exchange_of(mesh)), Stages())
    np.testing.assert_array_equal(between.two_A_M[1], without.two_A_M[1])
    assert between.two_A_M[0].sum() > 1.01 * without.two_A_M[0].sum()


def test_diffuse_reflectance_ends_at_nothing_and_all():
    assert diffuse_reflectance(Medium(1.0, 0.0, 1.4)) == pytest.approx(1.0)
    assert diffuse_reflectance(BLACK) < 1e-3


@pytest.mark.slow
def test_bodies_light_each_other_as_one_object_does():
    """Two slabs face each other, one of them lit: solved apart with light between them, or as one."""
    gap, mesh = 6.0, mesh_of(block((12.0, 12.0, 4.0), (0.0, 0.0, 5.0)), block((12.0, 12.0, 4.0), (0.0, 0.0, -5.0)))
    samples, medium = samples_of(mesh, 40), Medium(4.0, 0.002, 1.4)
    lit = (samples.points[:, 2] > 0.5 * gap - 0.01) & (samples.points[:, 2] < 0.5 * gap + 0.01)  # inner side of one
    flux = np.repeat((samples.areas * lit)[:, None], 3, axis=1).astype(np.float32)
    exchange = exchange_of(mesh)
    whole = DiffusionTransport(resolution=40)
    grid = whole.grid(mesh, np.eye(3))
    joined = whole.solve(Problem(mesh, samples, grid, [EnteringLight(flux)], (medium,) * 3, exchange), Stages())
    apart = DiffusionTransport(resolution=40)
    bodies = OfBodies(apart, mesh, find_bodies(mesh), samples)
    profiles = dipoles(Material(None, (4.0,) * 3, (0.002,) * 3, 1.4))
    entering = EnteringFlux(
        WholeObject(mesh, samples), grid, grid.coordinates(samples.points).astype(np.float32), flux,
        (EnteringLight(flux),), profiles, (medium,) * 3, exchange,
    )  # fmt: skip
    separate = bodies.scatter(entering, Stages())
    dark = exchange.refined.mesh.vertices[:, 2] < 0.0
    assert separate.is_solved
    lower = min(separate.parts, key=lambda part: part.boundary.patches.points[:, 2].mean())
    received = float((lower.exitance_of_patches[:, 0] * lower.boundary.patches.areas).sum())
    points = joined.boundary.patches.points[:, 2] < 0.0
    expected = float((joined.exitance_of_patches[points, 0] * joined.boundary.patches.areas[points]).sum())
    # Light that enters again in one body has no corrections at its edges; from another body it has.
    assert received == pytest.approx(expected, rel=0.03)
    assert received > 0.05 * float(flux[:, 0].sum())
    np.testing.assert_allclose(separate.reentering[dark].mean(axis=0), joined.reentering[dark].mean(axis=0), rtol=0.02)


@pytest.mark.slow
def test_the_first_picture_knows_what_entered_again():
    """On half the nodes light that enters again is the last solution's: next to all of what it will be, unlike none."""
    mesh = shape(knot)
    samples, transport, stages = samples_of(mesh, 44), DiffusionTransport(resolution=44), Stages()
    light, grid = collimated(samples), transport.grid(mesh, np.eye(3))
    exchange = exchange_of(mesh)

    def pictures(factor, *, settles=True):
        told = []
        medium = Medium(factor * MARBLE.sigma_s_prime, MARBLE.sigma_a, MARBLE.eta)
        problem = Problem(mesh, samples, grid, [light], (medium,) * 3, exchange)
        last = transport.solve(problem, stages, lambda solution: told.append(solution) or (settles or not coarse(told)))
        return next(solution for solution in told if coarse([solution])), last

    def coarse(told):
        return told[-1].is_solved and told[-1].grid != grid

    def leaving(solution):
        return float((solution.exitance_of_patches[:, 0] * solution.boundary.patches.areas).sum())

    unknown, settled = pictures(1.0)
    assert unknown.reentering is None
    assert leaving(unknown) < 0.93 * leaving(settled)
    first, settled = pictures(1.05)
    assert leaving(first) == pytest.approx(leaving(settled), rel=0.01)
    np.testing.assert_allclose(first.reentering.mean(), settled.reentering.mean(), rtol=0.02)
    for factor in (1.2, 1.4, 1.6):  # of a drag, which ends each before it is settled
        _, ended = pictures(factor, settles=False)
        assert ended.grid != grid
    first, settled = pictures(1.7)
    np.testing.assert_allclose(first.reentering.mean(), settled.reentering.mean(), rtol=0.02)
    assert leaving(first) == pytest.approx(leaving(settled), rel=0.01)
