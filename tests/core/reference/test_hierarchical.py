"""The hierarchical sum against the direct one."""

import numpy as np
import pytest

from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.reference.hierarchical import MAX_LEAF_SOURCES, build_tree, hierarchical_exitance, tree_exitance
from tests.support.rendering import BACK, FRONT, relative_rms
from tests.support.shapes import ball, plate, torus_knot

SKIM_MILK = dipoles(materials.lookup("skim milk"))


class Lit:
    def __init__(self, mesh, direction=FRONT, edge=0.5):
        samples = surface_samples(mesh, edge)
        E = Occluder(mesh).irradiance(samples.points, samples.normals, samples.normals, direction, (3, 2, 1), 1.3)
        self.sources, self.areas = samples.points.astype(np.float64), samples.areas.astype(np.float64)
        self.flux = E * self.areas[:, None]
        self.points = self.sources[np.random.default_rng(0).choice(len(self.sources), 80, replace=False)]
        self.expected = direct_exitance(self.points, self.sources, self.flux, SKIM_MILK)

    def summed(self, tolerance):
        return hierarchical_exitance(self.points, self.sources, self.flux, self.areas, SKIM_MILK, tolerance)


@pytest.fixture(scope="module")
def lit():
    return {
        "ball": Lit(ball(subdivisions=4)),
        "knot from behind": Lit(torus_knot(), BACK),
        "plate from behind": Lit(plate(n=40), BACK),
    }


SCENES = ["ball", "knot from behind", "plate from behind"]


@pytest.mark.parametrize("scene", SCENES)
def test_tolerance_0_is_the_direct_sum(lit, scene):
    np.testing.assert_allclose(lit[scene].summed(0.0), lit[scene].expected, rtol=1e-12)


@pytest.mark.parametrize("scene", SCENES)
def test_error_falls_with_the_tolerance(lit, scene):
    """By a factor of two at least for each of four, once clusters are smaller than the distance."""
    errors = np.array([relative_rms(lit[scene].summed(t), lit[scene].expected).max() for t in (0.8, 0.2, 0.05, 0.0125)])
    assert np.all(errors[1:] < 0.6 * errors[:-1]), errors
    assert errors[-1] < 1e-3, errors


def test_one_source_is_exact_at_any_tolerance():
    rng = np.random.default_rng(0)
    points, source, flux = rng.normal(size=(9, 3)), rng.normal(size=(1, 3)), rng.random((1, 3))
    expected = direct_exitance(points, source, flux, SKIM_MILK)
    for tolerance in (0.0, 0.1, 1e9):
        found = hierarchical_exitance(points, source, flux, [0.3], SKIM_MILK, tolerance)
        np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_coinciding_sources_are_one():
    source, flux = np.tile([[1.0, 2.0, 3.0]], (50, 1)), np.random.default_rng(0).random((50, 3))
    found = hierarchical_exitance([[0.0, 0.0, 0.0]], source, flux, np.ones(50), SKIM_MILK, 0.1)
    np.testing.assert_allclose(found, direct_exitance([[0.0, 0.0, 0.0]], source, flux, SKIM_MILK), rtol=1e-12)


def test_no_light_and_no_points_give_nothing():
    assert not hierarchical_exitance(
        np.zeros((2, 3)), np.ones((4, 3)), np.zeros((4, 3)), np.ones(4), SKIM_MILK, 1
    ).any()
    assert hierarchical_exitance(
        np.zeros((0, 3)), np.ones((4, 3)), np.ones((4, 3)), np.ones(4), SKIM_MILK, 1
    ).shape == (
        0,
        3,
    )


def test_a_huge_tolerance_takes_the_root_from_outside(lit):
    case = lit["ball"]
    tree = build_tree(case.sources, case.flux, case.areas)
    far = np.array([[100.0, 20.0, -30.0]])
    rho = np.linalg.norm(far[0] - tree.centroids[0])
    expected = [p.radial(rho) * f for p, f in zip(SKIM_MILK, tree.flux[0], strict=True)]
    np.testing.assert_allclose(tree_exitance(far, tree, SKIM_MILK, 1e9)[0], expected, rtol=1e-12)


def test_the_root_holds_all_flux_and_area(lit):
    for case in lit.values():
        tree, bright = build_tree(case.sources, case.flux, case.areas), case.flux.any(axis=1)
        np.testing.assert_allclose(tree.flux[0], case.flux.sum(axis=0), rtol=1e-12)
        assert tree.areas[0] == pytest.approx(case.areas[bright].sum(), rel=1e-12)
        weight = case.flux.sum(axis=1)
        np.testing.assert_allclose(tree.centroids[0], weight @ case.sources / weight.sum(), atol=1e-9)
        np.testing.assert_array_equal(tree.low[0], case.sources[bright].min(axis=0))
        np.testing.assert_array_equal(tree.high[0], case.sources[bright].max(axis=0))


def test_children_share_out_what_their_parent_holds(lit):
    case = lit["knot from behind"]
    tree = build_tree(case.sources, case.flux, case.areas)
    inner = np.flatnonzero(tree.n_children)
    assert len(inner) > 100
    for node in inner:
        children = slice(tree.first_child[node], tree.first_child[node] + tree.n_children[node])
        np.testing.assert_allclose(tree.flux[children].sum(axis=0), tree.flux[node], rtol=1e-9)
        assert tree.n_sources[children].sum() == tree.n_sources[node]
        assert tree.first_source[children][0] == tree.first_source[node]
    leaves = tree.n_children == 0
    assert tree.n_sources[leaves].max() <= MAX_LEAF_SOURCES
    assert tree.n_sources[leaves].sum() == len(tree.sources)
