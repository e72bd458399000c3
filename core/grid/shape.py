"""Sizes of a layer convolution: those of the maps, and padded lengths that FFTW transforms fast."""

import functools
import itertools
import math
from dataclasses import dataclass

MAX_PAIRED_LAYERS = 8  # layers; measured on 2 cores, see `milkglass bench`
PRODUCT_COST = 6.0  # cost of multiplying by a spectrum, in units of `_cost` a node
MAX_LENGTH_RATIO = 2.0  # to the required length: longer transforms are not tried


@dataclass(frozen=True)
class ConvolutionShape:
    """Sizes of a layer convolution: those of the maps, and the padded ones.

    A kernel that is even in every axis convolves n values without an error on a period of 2 n - 2: -(n - 1) and n - 1,
    the furthest distances, coincide there, and the kernel has the same value at both.

    `padding` sets smallest padded sizes (layers, rows, columns) instead; layers then mix by FFT, and the kernel is
    given on the whole octant.
    """

    n_layers: int
    height: int
    width: int
    padding: tuple[int, int, int] | None = None

    @property
    def padded_height(self) -> int:
        """Number of rows after zero padding, even."""
        return self._padded[1]

    @property
    def padded_width(self) -> int:
        """Number of columns after zero padding, even."""
        return self._padded[2]

    @property
    def padded_layers(self) -> int:
        """Number of layers after zero padding, even, where they mix by FFT; n_layers where they mix pair by pair."""
        return self._padded[0]

    @property
    def required_nodes(self) -> int:
        """Number of nodes with zero padding, before lengths are rounded up to fast ones: a measure of cost."""
        return math.prod(self._required)

    @property
    def mixes_pairs(self) -> bool:
        """Whether layers mix pair by pair rather than by FFT."""
        return self.padding is None and self.n_layers <= MAX_PAIRED_LAYERS

    @property
    def quadrant(self) -> tuple[int, int, int]:
        """Shape of the non-redundant part of an even kernel's spectrum: (layer distances, rows, columns)."""
        depth = self.n_layers if self.mixes_pairs else self.padded_layers // 2 + 1
        return depth, self.padded_height // 2 + 1, self.padded_width // 2 + 1

    @property
    def _required(self) -> tuple[int, int, int]:
        sizes = self.n_layers, self.height, self.width
        depth, height, width = self.padding or (max(2 * n - 2, 1) for n in sizes)
        return self.n_layers if self.mixes_pairs else depth, height, width

    @property
    def _padded(self) -> tuple[int, int, int]:
        return _fast_lengths((self.n_layers, self.height, self.width), self._required, pairs=self.mixes_pairs)


@functools.lru_cache(maxsize=1024)
def _fast_lengths(sizes: tuple[int, int, int], required: tuple[int, int, int], *, pairs: bool) -> tuple[int, int, int]:
    """Return even sizes of at least `required` with the smallest total cost: rows transformed first, layers last."""
    n, rows, _ = sizes

    def cost(lengths: tuple[int, int, int]) -> float:
        depth, height, width = lengths
        mixed = n * n * PRODUCT_COST / 2.0 if pairs else depth * (_cost(depth) + PRODUCT_COST)
        return width * (n * rows * _plain_cost(width) + height * (n * _cost(height) + mixed))

    depths = [n] if pairs else _lengths(required[0])
    return min(itertools.product(depths, _lengths(required[1]), _lengths(required[2])), key=cost)


def _lengths(required: int) -> list[int]:
    """Return even lengths without prime factors above 7, from `required` on."""
    required = max(required, 2)
    found = [n for n in range(required + required % 2, int(MAX_LENGTH_RATIO * required) + 9, 2) if _is_smooth(n)]
    return found[: 1 + next(i for i, n in enumerate(found) if n & (n - 1) == 0)]  # the next power of two is the last


def _cost(n: int) -> float:
    """Return the relative time a value of a complex transform of length n by FFTW: powers of two take half of it."""
    return math.log2(n) if n & (n - 1) == 0 else _plain_cost(n)


def _plain_cost(n: int) -> float:
    """Return the relative time a value of a real transform of length n, measured with ``FFTW_ESTIMATE``."""
    return math.log2(n) * (2.1 if n % 8 == 0 else 2.5 if n % 4 == 0 else 3.2)


def _is_smooth(n: int) -> bool:
    for prime in (2, 3, 5, 7):
        while n % prime == 0:
            n //= prime
    return n == 1
