"""Solving again: warm starts, what is kept, what channels share, interruptions."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.grid.convolution import LayerConvolver
from milkglass.core.material.medium import Medium
from milkglass.core.stages import Stages
from milkglass.core.transport.base import EnteringLight
from milkglass.core.transport.diffusion.collisions import _Paths
from milkglass.core.transport.diffusion.solver import NESTED, DiffusionTransport, Problem
from tests.support.diffusing import DOWN, MARBLE, SKIM_MILK, WHOLE_MILK, collimated, samples_of
from tests.support.shapes import ball

THREE = (MARBLE, SKIM_MILK, WHOLE_MILK)


@pytest.fixture
def products(monkeypatch):
    """Convolutions, counted."""
    counts = [0]
    original = LayerConvolver.convolve

    def counted(self, layers, spectra):
        counts[0] += 1
        return original(self, layers, spectra)

    monkeypatch.setattr(LayerConvolver, "convolve", counted)
    return counts


@pytest.fixture
def solver(products):
    """A ball, and solving it in media and light; counts the products of the steps."""
    mesh = ball(20.0, 4)
    samples = samples_of(mesh, 32)
    transport, stages = DiffusionTransport(resolution=32, tolerance=3e-3), Stages()
    grid, light = transport.grid(mesh, np.eye(3)), collimated(samples)

    def solve(media, light=light, go_on=lambda _: True, transport=transport, stages=stages):
        products[0] = 0
        return transport.solve(Problem(mesh, samples, grid, [light], media), stages, go_on)

    solve.samples = samples
    return solve


def test_a_warm_start_needs_fewer_products(solver):
    cold = solver(THREE)
    near = tuple(Medium(1.03 * m.sigma_s_prime, m.sigma_a, m.eta) for m in THREE)
    warm = solver(near)
    fresh = solver(near, transport=DiffusionTransport(resolution=32, tolerance=3e-3), stages=Stages())
    exact = solver(near, transport=DiffusionTransport(resolution=32, tolerance=1e-5), stages=Stages())
    assert sum(warm.convolutions) < sum(fresh.convolutions) <= sum(cold.convolutions) + 3
    for channel in range(3):
        scale = np.abs(exact.two_A_M[channel]).max()
        assert max(warm.residuals) <= 3e-3
        np.testing.assert_allclose(warm.two_A_M[channel], exact.two_A_M[channel], atol=0.02 * scale)
        np.testing.assert_allclose(fresh.two_A_M[channel], exact.two_A_M[channel], atol=0.02 * scale)


def test_nothing_new_costs_nothing(solver, products):
    first = solver(THREE)
    assert products[0] == sum(first.convolutions) + 1  # one for K_L 1
    assert solver(THREE) is first
    assert products[0] == 0


def test_alike_channels_share_the_work_and_dark_ones_cost_nothing(solver, products):
    one = solver((MARBLE,) * 3)
    assert products[0] == one.convolutions[0] + 1
    for channel in (1, 2):
        np.testing.assert_array_equal(one.two_A_M[channel], one.two_A_M[0])
        np.testing.assert_array_equal(one.volume[channel], one.volume[0])
    flux = collimated(solver.samples).flux.copy()
    flux[:, 1] = 0.0
    black = (MARBLE, SKIM_MILK, Medium(0.0, 1.0, 1.5))
    found = solver(black, EnteringLight(flux, direction=DOWN))
    assert found.convolutions[1:] == (0, 0)
    assert found.residuals[1:] == (0.0, 0.0)
    assert not found.volume[1:3].any()
    assert not np.any(found.two_A_M[1:])
    assert found.volume[0].any()


def test_no_light_at_all(solver):
    found = solver(THREE, EnteringLight(np.zeros((len(solver.samples), 3), np.float32), direction=DOWN))
    assert not found.volume[:3].any()
    assert found.convolutions == (0, 0, 0)


def test_goes_on_where_it_was_interrupted(solver):
    whole = solver(THREE, transport=DiffusionTransport(resolution=32, tolerance=3e-3), stages=Stages())
    residuals = []
    for _ in range(30):
        told = []
        found = solver(THREE, go_on=lambda solution, told=told: told.append(solution) or len(told) < 2)
        residuals.append(max(found.residuals))
        if residuals[-1] <= 3e-3:
            break
    assert len(residuals) > 1
    assert residuals[-1] <= 3e-3
    assert np.all(np.diff(residuals) < 0.0)
    for channel in range(3):
        np.testing.assert_allclose(
            found.two_A_M[channel], whole.two_A_M[channel], atol=0.02 * whole.two_A_M[channel].max()
        )


def test_same_bits_every_time(solver):
    one, other = (
        solver(THREE, transport=DiffusionTransport(resolution=32, tolerance=3e-3), stages=Stages()) for _ in range(2)
    )
    np.testing.assert_array_equal(one.volume, other.volume)
    for channel in range(3):
        np.testing.assert_array_equal(one.two_A_M[channel], other.two_A_M[channel])


def test_the_solution_on_half_the_nodes_follows_no_paths_through_thin_parts(monkeypatch):
    """It is there before they are followed, from all nodes, and has first collisions as those tell ever after."""
    mesh, thin = ball(5.0, 3), Medium(0.2, 0.01, 1.4)
    samples = samples_of(mesh, NESTED)
    grid, steps = DiffusionTransport(resolution=NESTED).grid(mesh, np.eye(3)), []
    follow = _Paths.__init__
    monkeypatch.setattr(_Paths, "__init__", lambda *arguments: (steps.append("paths"), follow(*arguments))[1])
    transport, stages, bent = DiffusionTransport(resolution=NESTED), Stages(), []

    def go_on(solution):
        steps.append("all" if solution.boundary.grid == grid else "half")
        bent.append(np.average(solution.boundary.bending(medium), weights=solution.boundary.patches.areas))
        return True

    for medium in (thin, replace(thin, sigma_a=0.02)):
        around = [EnteringLight(np.repeat(samples.areas[:, None], 3, axis=1))]
        transport.solve(Problem(mesh, samples, grid, around, (medium,) * 3), stages, go_on)
        changes = [step for step, before in zip(steps, ["", *steps], strict=False) if step != before]
        first, last = bent[0], bent[-1]
        if medium is thin:
            assert changes == ["half", "paths", "all"]
            assert first < 0.8 * last  # as if all collided, which is known from then on
        else:
            assert changes == ["half", "all"]
            assert first == pytest.approx(last, rel=0.01)
        steps.clear()
        bent.clear()


@pytest.mark.slow
def test_the_detail_of_the_last_solution_serves_the_next(products):
    """On half the nodes first: what these lack is taken from the last solution, and the answer is the same."""
    mesh = ball(20.0, 4)
    samples = samples_of(mesh, 48)
    grid = DiffusionTransport(resolution=48).grid(mesh, np.eye(3))

    def solve(transport, stages, media, direction, go_on=lambda _: True):
        light = collimated(samples, direction)
        return transport.solve(Problem(mesh, samples, grid, [light], media), stages, go_on)

    transport, stages = DiffusionTransport(resolution=48), Stages()
    cold = solve(transport, stages, THREE, DOWN)
    near = tuple(Medium(1.03 * m.sigma_s_prime, m.sigma_a, m.eta) for m in THREE)
    warm = solve(transport, stages, near, DOWN)
    assert sum(warm.convolutions) < 0.7 * sum(cold.convolutions)
    aside = (0.6, 0.0, -0.8)
    turned = solve(transport, stages, near, aside)
    told = []
    solve(transport, stages, THREE, aside, lambda s: told.append(s) or s.boundary.grid != grid)
    resumed = solve(transport, stages, THREE, aside)
    assert told[-1].boundary.grid == grid
    assert max(resumed.residuals) < max(told[-1].residuals)
    for found, media, direction in ((warm, near, DOWN), (turned, near, aside), (resumed, THREE, aside)):
        exact = solve(DiffusionTransport(resolution=48, tolerance=1e-5), Stages(), media, direction)
        assert max(found.residuals) <= transport.tolerance
        for channel in range(3):
            scale = np.abs(exact.two_A_M[channel]).max()
            np.testing.assert_allclose(found.two_A_M[channel], exact.two_A_M[channel], atol=5e-3 * scale)
