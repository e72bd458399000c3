"""Loops over rays, compiled to machine code when they are first called and kept on disk for the next process."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
T = TypeVar("T")


def compiled(loop: Callable[P, T]) -> Callable[P, T]:
    """Return a function of arrays compiled by Numba; other threads run meanwhile, and 0 / 0 is NaN as in NumPy.

    What is kept on disk is compiled again when the loop's own file changes, and not when a constant of another does.
    """
    return cast(Callable[P, T], numba.njit(loop, cache=True, nogil=True, error_model="numpy"))
