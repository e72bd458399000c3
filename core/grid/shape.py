"""Sizes of a layer convolution: those of the maps, and the padded ones, which FFTW transforms fast."""

import functools
import itertools
import math
from dataclasses import dataclass

PAIRS_UP_TO = 8  # layers; measured on 2 cores, see `milkglass bench`
PRODUCT = 6.0  # what multiplying by a spectrum costs, in units of `_cost` a node
MAX_LENGTH = 2.0  # of what is needed: longer transforms are not tried


@dataclass(frozen=True)
class ConvolutionShape:
    """Sizes of a layer convolution: the maps' and the padded ones.

    A kernel that is even in every axis convolves n values without an error on a period of 2 n - 2: -(n - 1) and n - 1,
    the furthest distances, fall on one another there, and the kernel is the same at both.

    `padding` asks for padded sizes of at least (layers, rows, columns) instead; layers then mix by FFT, and the kernel
    is given on the whole octant.
    """

    n_layers: int
    height: int
    width: int
    padding: tuple[int, int, int] | None = None

    @property
    def padded_height(self) -> int:
        """Rows after zero padding, even."""
        return self._padded[1]

    @property
    def padded_width(self) -> int:
        """Columns after zero padding, even."""
        return self._padded[2]

    @property
    def padded_layers(self) -> int:
        """Layers after zero padding, even, where they are mixed by FFT; n_layers where pair by pair."""
        return self._padded[0]

    @property
    def least_nodes(self) -> int:
        """Nodes that zero padding asks for, before lengths are rounded up to fast ones: what time goes by."""
        return math.prod(self._least)

    @property
    def mixes_pairs(self) -> bool:
        """Whether layers mix pair by pair."""
        return self.padding is None and self.n_layers <= PAIRS_UP_TO

    @property
    def quadrant(self) -> tuple[int, int, int]:
        """Shape of the non-redundant part of an even kernel's spectrum: (layer distances, rows, columns)."""
        depth = self.n_layers if self.mixes_pairs else self.padded_layers // 2 + 1
        return depth, self.padded_height // 2 + 1, self.padded_width // 2 + 1

    @property
    def _least(self) -> tuple[int, int, int]:
        own = self.n_layers, self.height, self.width
        depth, height, width = self.padding or (max(2 * n - 2, 1) for n in own)
        return self.n_layers if self.mixes_pairs else depth, height, width

    @property
    def _padded(self) -> tuple[int, int, int]:
        return _fast_lengths((self.n_layers, self.height, self.width), self._least, self.mixes_pairs)


@functools.lru_cache(maxsize=1024)
def _fast_lengths(own: tuple[int, int, int], least: tuple[int, int, int], pairs: bool) -> tuple[int, int, int]:
    """Even padded sizes of at least `least` that cost least together: rows are transformed first, layers last."""
    n, rows, _ = own

    def cost(lengths: tuple[int, int, int]) -> float:
        depth, height, width = lengths
        mixed = n * n * PRODUCT / 2.0 if pairs else depth * (_cost(depth) + PRODUCT)
        return width * (n * rows * _plain_cost(width) + height * (n * _cost(height) + mixed))

    depths = [n] if pairs else _lengths(least[0])
    return min(itertools.product(depths, _lengths(least[1]), _lengths(least[2])), key=cost)


def _lengths(least: int) -> list[int]:
    """Even lengths without prime factors above 7, from `least` on."""
    least = max(least, 2)
    found = [n for n in range(least + least % 2, int(MAX_LENGTH * least) + 9, 2) if _is_smooth(n)]
    return found[: 1 + next(i for i, n in enumerate(found) if n & (n - 1) == 0)]  # the next power of two is the last


def _cost(n: int) -> float:
    """Relative time a value of FFTW's complex transforms of length n: powers of two take half of it."""
    return math.log2(n) if n & (n - 1) == 0 else _plain_cost(n)


def _plain_cost(n: int) -> float:
    """The same of real transforms, for which powers of two are nothing special; measured with ``FFTW_ESTIMATE``."""
    return math.log2(n) * (2.1 if n % 8 == 0 else 2.5 if n % 4 == 0 else 3.2)


def _is_smooth(n: int) -> bool:
    for prime in (2, 3, 5, 7):
        while n % prime == 0:
            n //= prime
    return n == 1
