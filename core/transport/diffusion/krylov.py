"""GMRES (Saad and Schultz 1986) without restarts that yields every iterate.

SciPy's shows iterates only where it restarts; a picture that refines needs them all.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from milkglass.core.arrays import Array

BREAKDOWN = 1e-7  # share of a product outside the Krylov space at which the space holds the solution


class Step(NamedTuple):
    """The iterate after a number of products with A: start + coefficients @ basis."""

    matvecs: int
    coefficients: Array  # (matvecs,)
    residual: float  # |b - A x| / |b|


def gmres(
    matvec: Callable[[Array], Array],
    residual: Array,
    rhs_norm: float,
    tolerance: float,
    max_matvecs: int,
    weak: float = 0.0,
) -> Iterator[tuple[Step, Array]]:
    """Yield the steps of A x = b, each with its basis (matvecs, n), from a start whose residual b - A start is given.

    The basis is made orthonormal by classical Gram-Schmidt, done twice, which is as stable as the modified one
    (Giraud, Langou and Rozloznik 2005) and reads the vectors half as often.

    Parameters
    ----------
    matvec : callable
        (n,) -> (n,) float64, A times a vector; one call a step.
    residual : (n,) float64
    rhs_norm : float
        Norm of b, > 0.
    tolerance : float
        |b - A x| / |b| at which the steps end.
    max_matvecs : int
        Number of products at which the steps end.
    weak : float
        Singular value of A on the basis below which a direction is noise: it gets nothing, and its share of the
        residual counts as solved. At 0 no direction is.
    """
    beta = norm(residual)
    basis = np.empty((max_matvecs + 1, len(residual)))  # the system gives rows memory when they are written
    yield Step(0, np.zeros(0), beta / rhs_norm), basis[:0]
    if beta <= tolerance * rhs_norm:
        return
    basis[0] = residual / beta
    columns = np.zeros((max_matvecs + 1, max_matvecs))
    for k in range(max_matvecs):
        vector, spanned = matvec(basis[k]), basis[: k + 1]
        length = norm(vector)
        for _ in range(2):  # the second pass leaves no rounding of the first
            shares = np.einsum("kn,n->k", spanned, vector)
            columns[: k + 1, k] += shares
            vector = vector - combined(shares, spanned)
        columns[k + 1, k] = norm(vector)
        target = np.zeros(k + 2)
        target[0] = beta
        square = columns[: k + 2, : k + 1]
        u, strength, v = np.linalg.svd(square, full_matrices=False)
        parts = u.T @ target
        parts[strength <= np.finfo(np.float64).eps * (k + 1) * strength[0]] = 0.0
        left = float(np.linalg.norm(target - u @ parts)) / rhs_norm
        floor = np.maximum(strength, max(1e-2 * weak, np.finfo(np.float64).tiny))  # no power overflows
        yield Step(k + 1, v.T @ (parts / (floor * (1.0 + (weak / floor) ** 8))), left), spanned
        if left <= tolerance or columns[k + 1, k] <= BREAKDOWN * length:
            return
        basis[k + 1] = vector / columns[k + 1, k]


def combined(coefficients: Array, basis: Array) -> Array:
    """Return coefficients (k,) @ basis (k, n); not by BLAS, see `inner`."""
    return np.asarray(np.einsum("k,kn->n", coefficients, basis))


def inner(a: Array, b: Array) -> float:
    """Return the inner product; not by BLAS, whose threads take 5 ms from those of the FFT when they wake."""
    return float(np.einsum("i,i->", a, b))


def norm(a: Array) -> float:
    """Return the Euclidean norm; not by BLAS, see `inner`."""
    return float(np.sqrt(inner(a, a)))
