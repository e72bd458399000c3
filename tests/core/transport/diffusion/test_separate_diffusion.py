"""Diffusion in each body alone, against the body without the others on the whole object's nodes."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material import library as materials
from milkglass.core.material.medium import media
from milkglass.core.stages import Stages
from milkglass.core.transport.diffusion.solver import COARSE_TOLERANCE, TOLERANCE, DiffusionTransport, Problem
from milkglass.core.transport.separate import OfBodies
from tests.support.diffusing import collimated
from tests.support.entering import entering
from tests.support.rendering import relative_rms, surface_points
from tests.support.solids import ball, mesh_of, plates, tubes

TOWARDS = (1.0, 0.0, 0.0)  # the way that light travels
MODELS = {
    "tubes": tubes(),
    "cavity": mesh_of(ball(9.0), ball(6.0, inverted=True), ball(5.9)),
    "plates": plates(1.0, 0.3),
}


class Darkness:
    """No light at any point."""

    def __init__(self, eta):
        self.eta = eta

    def at(self, points, normals, reach, *, thin):
        return []


class Case:
    """A model with light on some of its bodies."""

    def __init__(self, mesh, material="skim milk", resolution=48, lit=(0,)):
        self.mesh, self.media = mesh, media(materials.lookup(material))
        self.transport, self.stages = DiffusionTransport(resolution=resolution), Stages()
        self.bodies = find_bodies(mesh)
        self.samples = surface_samples(mesh, 1.2 * float(np.ptp(mesh.bounds, axis=0).max()) / resolution)
        self.body = self.bodies.of_face[self.samples.faces]
        self.separate = OfBodies(self.transport, mesh, self.bodies, self.samples)
        self.atlas = self.separate.atlas(self.transport.grid(mesh, np.eye(3)))
        self.light, self._entering = self.light_on(lit), {}

    def light_on(self, bodies, towards=TOWARDS):
        return collimated(self.samples, towards, lit=np.isin(self.body, bodies))

    def solve(self, *lights, go_on=lambda _: True):
        self.stages.begin()
        return self.separate.scatter(self.entering(*(lights or (self.light,))), self.stages, go_on)

    def entering(self, *lights):
        """The same arrays for the same lights, as stages have them."""
        if lights not in self._entering:
            self._entering[lights] = entering(self.transport, self.mesh, self.samples, None, lights, media=self.media)
        return self._entering[lights]

    def joined(self, mesh=None, samples=None, light=None):
        grid = self.transport.grid(self.mesh, np.eye(3))
        one = DiffusionTransport(resolution=self.transport.resolution)
        return one.solve(
            Problem(mesh or self.mesh, samples or self.samples, grid, [light or self.light], self.media), Stages()
        )

    def exitance(self, solution, tables, points):
        """M without what light that enters at the points themselves adds."""
        return solution.exitance(points, np.zeros_like(points), Darkness(self.media[0].eta), tables)


def flux(case, solution, body):
    """That leaves a body of a joined solution, per channel."""
    own = (case.body == body) * case.samples.areas
    return np.array([own @ (solution.boundary.patches.sums.T @ phi) for phi in solution.two_A_M])


@pytest.mark.parametrize("material", ["marble", "skim milk"])
def test_touching_tubes_leak_where_they_are_joined_and_nothing_where_they_are_separate(material):
    """Of the other's flux: measured .8 .5 .3 % (marble; R, G, B) and 3.1 1.3 .4 % (skim milk), and exactly nothing."""
    case = Case(MODELS["tubes"], material)
    assert case.bodies.count == 2
    joined, separate = case.joined(), case.solve()
    leak = flux(case, joined, 1) / flux(case, joined, 0)
    assert leak[0] > 0.005
    assert separate.parts[1] is None
    z, y, x = case.atlas.origins[1]
    assert not separate.volume[:, z:, y:, x:][(slice(None), *map(slice, case.atlas.crops[1].shape))].any()
    assert max(separate.residuals) <= TOLERANCE


@pytest.mark.parametrize("lit", [0, 1])
@pytest.mark.parametrize("model", MODELS)
def test_a_body_is_as_it_is_without_the_others(model, lit):
    """Rms over its surface, of the largest: measured at most 8e-6."""
    case = Case(MODELS[model], lit=(0, 1))
    assert case.bodies.count == 2
    solution = case.solve()
    part, own = case.bodies.submesh(case.mesh, lit), case.body == lit
    samples = surface_samples(part, 1.2 * float(np.ptp(case.mesh.bounds, axis=0).max()) / case.transport.resolution)
    np.testing.assert_array_equal(samples.points, case.samples.points[own])
    alone = case.joined(part, samples, replace(case.light, flux=case.light.flux[own]))
    tables = solution.pixel_tables()
    points = surface_points(part, 400)
    found, expected = (case.exitance(each, tables, points) for each in (solution.parts[lit], alone))
    assert relative_rms(found, expected).max() < 1e-3


def test_a_ball_in_a_hollow_shell_stays_dark():
    case = Case(MODELS["cavity"], lit=(0,))
    dark = [part is None for part in case.solve().parts]
    assert dark == [False, True]
    assert np.count_nonzero(case.bodies.of_face == 0) == 2 * np.count_nonzero(case.bodies.of_face == 1)


def test_only_what_changed_runs_again():
    case = Case(MODELS["tubes"], lit=(0, 1))
    first = case.solve()
    assert case.stages.timings.keys() >= {"body flux of light 1", "boundary", "solution", "coarse solution", "bodies"}
    assert case.solve() is first
    assert not case.stages.timings
    moved = case.light_on((0, 1), (0.0, 0.0, -1.0))
    second = case.solve(moved)
    assert "boundary" not in case.stages.timings
    assert max(second.residuals) <= TOLERANCE
    one_more = case.solve(moved, case.light_on((1,)))  # that reaches the second body alone
    assert one_more.parts[0] is second.parts[0]
    assert one_more.parts[1] is not second.parts[1]
    assert one_more.boundaries == second.boundaries


def test_coarse_solutions_of_all_bodies_are_told_before_the_fine_ones_and_false_ends_there():
    case, told = Case(MODELS["tubes"], lit=(0, 1)), []

    def go_on(solution):
        told.append(solution)
        return max(solution.residuals) > COARSE_TOLERANCE

    given_up = case.solve(go_on=go_on)
    assert [max(each.residuals) for each in told[:2]] == [1.0, 1.0]  # while the second body waits
    assert given_up is told[-1]
    assert given_up.grid.width < case.atlas.grid.width
    assert given_up.volume.shape == (4, *given_up.atlas.shape)
    assert None not in given_up.parts
    known = len(told)
    solution = case.solve(go_on=lambda each: not told.append(each))
    assert solution.grid == case.atlas.grid
    assert max(solution.residuals) <= TOLERANCE
    on_the_way = told[known:]
    assert all(max(each.residuals) <= COARSE_TOLERANCE for each in on_the_way if each.grid != solution.grid)
    assert any(each.grid != solution.grid for each in on_the_way)  # shown until all fine ones are there


def test_giving_up_at_once_gives_nothing_that_may_be_seen():
    case = Case(MODELS["tubes"], lit=(0, 1))
    assert case.solve(go_on=lambda _: False).residuals == (1.0, 1.0, 1.0)


def test_without_light_nothing_is_solved():
    case = Case(MODELS["tubes"])
    for lights in ((), (case.light_on(()),)):
        solution = case.separate.scatter(case.entering(*lights), Stages())
        assert (solution.residuals, solution.convolutions) == ((0.0, 0.0, 0.0), (0, 0, 0))
        assert not solution.volume.any()
        assert solution.pixel_tables().equation.depths is None


@pytest.mark.slow
def test_specks_take_few_nodes_and_share_their_kernels():
    """35 of less than a cell: measured 0.15 s on two busy cores beside the 0.5 s of the ball."""
    rng = np.random.default_rng(1)
    around = rng.normal(size=(35, 3))
    places = around / np.linalg.norm(around, axis=1, keepdims=True) * rng.uniform(14.0, 25.0, (35, 1))
    mesh = mesh_of(ball(12.0), *(ball(rng.uniform(0.05, 0.2), at, 0) for at in places))
    case = Case(mesh, resolution=64, lit=tuple(range(36)))
    solution = case.solve()
    assert case.bodies.count == 36
    assert max(max(crop.shape) for crop in solution.atlas.crops[1:]) <= 8
    assert np.prod(solution.atlas.shape) < np.prod(solution.grid.shape)
    assert len(case.transport.kernels._convolvers) < 10
    assert np.isfinite(solution.volume).all()
    assert min(phi.max() for part in solution.parts for phi in part.two_A_M) > 0.0


def test_letting_go_keeps_nothing_and_solves_the_same_again():
    case = Case(MODELS["plates"], lit=(0, 1))
    first = case.solve().volume
    case.separate.release()
    assert all(not body.stages._kept for body in case.separate._bodies)
    case.stages.clear()
    np.testing.assert_array_equal(case.solve().volume, first)
