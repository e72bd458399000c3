"""GMRES (Saad and Schultz 1986) that gives every iterate away and multiplies as seldom as it can.

SciPy's keeps its iterates to itself until it restarts; a picture that refines needs each.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Array

BREAKDOWN = 1e-7  # of a product, when what is known is taken off: the space holds the solution


class Step(NamedTuple):
    """What is known after `matvecs` products: the solution is start + sum of coefficients times basis."""

    matvecs: int
    coefficients: Array
    residual: float  # relative to the right side


def gmres(
    matvec: Callable[[Array], Array],
    residual: Array,
    rhs_norm: float,
    tolerance: float,
    max_matvecs: int,
    weak: float = 0.0,
) -> Iterator[tuple[Step, Array]]:
    """Solve A x = b from a start whose residual b - A start is given.

    Yields a step and the basis, (matvecs, n), after each product. Vectors are made orthogonal to all before them at
    once, twice, which is as stable as one by one (Giraud, Langou and Rozloznik 2005) and reads them half as often.

    Parameters
    ----------
    matvec : callable
        (n,) -> (n,) float64, A times a vector; called once a step.
    residual : (n,) float64
    rhs_norm : float
        Norm of b, > 0.
    tolerance : float
        Of |b - A x| / |b|; it ends the steps.
    max_matvecs : int
        Products; they end the steps too.
    weak : float
        Directions in which A multiplies by less are noise, and get nothing; their share of the residual counts as
        solved. At 0 all get theirs.
    """
    beta = norm(residual)
    basis = np.empty((max_matvecs + 1, len(residual)))  # the system gives rows memory when they are written
    yield Step(0, np.zeros(0), beta / rhs_norm), basis[:0]
    if beta <= tolerance * rhs_norm:
        return
    basis[0] = residual / beta
    columns = np.zeros((max_matvecs + 1, max_matvecs))
    for k in range(max_matvecs):
        vector, known = matvec(basis[k]), basis[: k + 1]
        length = norm(vector)
        for _ in range(2):  # the second pass leaves no rounding of the first
            shares = np.einsum("kn,n->k", known, vector)
            columns[: k + 1, k] += shares
            vector = vector - combined(shares, known)
        columns[k + 1, k] = norm(vector)
        target = np.zeros(k + 2)
        target[0] = beta
        square = columns[: k + 2, : k + 1]
        u, strength, v = np.linalg.svd(square, full_matrices=False)
        parts = u.T @ target
        parts[strength <= np.finfo(np.float64).eps * (k + 1) * strength[0]] = 0.0
        left = float(np.linalg.norm(target - u @ parts)) / rhs_norm
        least = np.maximum(strength, max(1e-2 * weak, np.finfo(np.float64).tiny))  # no power overflows
        yield Step(k + 1, v.T @ (parts / (least * (1.0 + (weak / least) ** 8))), left), known
        if left <= tolerance or columns[k + 1, k] <= BREAKDOWN * length:
            return
        basis[k + 1] = vector / columns[k + 1, k]


def combined(coefficients: Array, basis: Array) -> Array:
    """Sum of coefficients (k,) times the rows of a basis (k, n); not by BLAS, see `inner`."""
    return np.asarray(np.einsum("k,kn->n", coefficients, basis))


def inner(a: Array, b: Array) -> float:
    """Inner product; not by BLAS, whose waking threads take 5 ms off those of the FFT."""
    return float(np.einsum("i,i->", a, b))


def norm(a: Array) -> float:
    """Euclidean norm, likewise."""
    return float(np.sqrt(inner(a, a)))
