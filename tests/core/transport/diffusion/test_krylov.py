"""GMRES against a direct solution in float64."""

import numpy as np
import pytest

from milkglass.core.transport.diffusion.krylov import gmres, inner, norm


def system(n=60, seed=0):
    """A matrix far from symmetric, with eigenvalues about 1."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(n) + 0.6 * rng.normal(size=(n, n)) / np.sqrt(n) + 0.3 * np.triu(rng.normal(size=(n, n)), 1) / n
    return matrix, rng.normal(size=n)


def solved(matrix, b, start=None, tolerance=1e-10, most=80, weak=0.0):
    """Steps and the solution after each."""
    x = np.zeros(len(b)) if start is None else start
    found = []
    for step, basis in gmres(lambda v: matrix @ v, b - matrix @ x, norm(b), tolerance, most, weak):
        iterate = x.copy()
        for share, vector in zip(step.coefficients, basis, strict=True):
            iterate += share * vector
        found.append((step, iterate))
    return found


@pytest.mark.parametrize("seed", range(5))
def test_solves(seed):
    matrix, b = system(seed=seed)
    assert np.abs(matrix - matrix.T).max() > 0.1
    found = solved(matrix, b)
    np.testing.assert_allclose(found[-1][1], np.linalg.solve(matrix, b), rtol=0.0, atol=1e-8)
    assert len(found) <= 61


def test_every_product_gives_an_honest_step():
    matrix, b = system()
    found = solved(matrix, b)
    assert [step.matvecs for step, _ in found] == list(range(len(found)))
    residuals = []
    for step, x in found:
        true = np.linalg.norm(b - matrix @ x) / np.linalg.norm(b)
        assert step.residual == pytest.approx(true, rel=1e-6, abs=1e-12)
        residuals.append(true)
    assert residuals[0] == 1.0
    assert np.all(np.diff(residuals) <= 1e-12)
    assert residuals[-1] <= 1e-10 < residuals[-2]


def test_each_iterate_is_the_best_of_its_space():
    """Least residual over start + span(r, A r, ...), found without an Arnoldi basis."""
    matrix, b = system(n=30)
    powers = [b]
    for step, _ in solved(matrix, b)[1:6]:
        space, _ = np.linalg.qr(np.column_stack(powers))
        best = np.linalg.lstsq(matrix @ space, b, rcond=None)[0]
        assert step.residual * norm(b) == pytest.approx(np.linalg.norm(b - matrix @ (space @ best)), rel=1e-7)
        powers.append(matrix @ powers[-1])


def test_one_product_a_step():
    matrix, b = system()
    products = 0

    def multiply(v):
        nonlocal products
        products += 1
        return matrix @ v

    for step, _ in gmres(multiply, b, norm(b), 1e-6, 80):
        assert products == step.matvecs


def test_starts_where_it_is_told():
    matrix, b = system()
    exact = np.linalg.solve(matrix, b)
    near = solved(matrix, b, exact + 1e-4 * np.random.default_rng(1).normal(size=len(b)), 1e-6)
    assert near[0][0].residual < 1e-3
    assert len(near) < len(solved(matrix, b, tolerance=1e-6))
    np.testing.assert_allclose(near[-1][1], exact, atol=1e-4)


def test_an_exact_start_costs_nothing():
    matrix, b = system()
    (only,) = solved(matrix, b, np.linalg.solve(matrix, b), 1e-9)
    assert only[0].matvecs == 0
    assert only[0].residual < 1e-9


def test_nothing_to_solve():
    """b - A start = 0 to the last bit."""
    steps = list(gmres(lambda v: 2.0 * v, np.zeros(7), 1.0, 1e-3, 10))
    assert len(steps) == 1
    assert steps[0][0].residual == 0.0


def test_breakdown_is_the_solution():
    """A matrix of two eigenvalues: the space is whole after two products, whatever the tolerance."""
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.normal(size=(20, 20)))
    matrix = turn @ np.diag([1.0] * 12 + [3.0] * 8) @ turn.T
    b = rng.normal(size=20)
    found = solved(matrix, b, tolerance=0.0)
    assert len(found) == 3
    np.testing.assert_allclose(found[-1][1], np.linalg.solve(matrix, b), atol=1e-10)


def test_a_singular_system_ends_finite():
    found = solved(np.diag([1.0, 1.0, 0.0]), np.array([1.0, 2.0, 3.0]))
    assert np.isfinite(found[-1][1]).all()
    assert found[-1][0].residual == pytest.approx(3.0 / np.sqrt(14.0), rel=1e-6)


def test_weak_directions_get_nothing():
    """One of 20 is multiplied by 0.01, which would make 100 of it; the others are solved as without."""
    rng = np.random.default_rng(4)
    turn, _ = np.linalg.qr(rng.normal(size=(20, 20)))
    values = np.linspace(0.5, 1.5, 20)
    values[7] = 0.01
    b = turn @ np.ones(20)
    (step, x) = solved(turn @ np.diag(values) @ turn.T, b, weak=0.1)[-1]
    expected = 1.0 / values
    expected[7] = 0.0
    np.testing.assert_allclose(turn.T @ x, expected, atol=1e-3)
    assert step.residual < 1e-6


def test_ends_after_the_most_products():
    matrix, b = system()
    assert solved(matrix, b, tolerance=0.0, most=4)[-1][0].matvecs == 4


def test_norms():
    a, b = np.random.default_rng(3).normal(size=(2, 1000))
    assert inner(a, b) == pytest.approx(float(np.dot(a, b)))
    assert norm(a) == pytest.approx(float(np.linalg.norm(a)))
