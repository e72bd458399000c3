"""How much of an environment's light reaches a surface that is in its own way.

Of every point it is known, once a mesh, which of a set of directions lead out (`core.light.bake`): one bit a ray.
Two transfer vectors in real spherical harmonics follow, of all the light that enters and of what is not blocked:

    U_lm = int F_t(eta, w.n) max(w.n, 0) Y_lm(w) dw,     T_lm = the same with V(w) inside.

The visible share of a light L is T.L / U.L, within [0, 1], and irradiance is that share of the unoccluded one
(`core.light.probe`), which keeps its own resolution, its own normal and its own eta. A ratio of two vectors from the
same rays is exactly 1 where nothing is in the way and 0 in a closed cavity, and half as wrong as T.L alone. It hardly
knows eta: shares for `ETA` leave 0.3 % rms at 1.3, 0.04 % at 2, and 2 % at 1.

Another light or another turn of it costs one product a point; see `core.light.harmonics.rotated`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.light.harmonics import basis, order_of_length
from milkglass.core.material import fresnel

Float16 = npt.NDArray[np.float16]
Bytes = npt.NDArray[np.uint8]

ETA = 1.5  # that shares are for
ORDER = 10  # on the dragon, Uffizi: 5.2 % rms at 4, 1.8 at 8, 1.5 at 10, 1.4 at 16
LEAST_ORDER = 4
LOBE_ORDER = 8  # of what blocks highlights; dragon, Uffizi, shininess 80: 8.6 % rms at 6, 7.0 at 8, 6.4 at 10
LEAST_LOBE = 1e-3  # of a lobe above the horizon
MOST_BYTES = 256 << 20  # of all vectors of all points: a mesh too large for them gets a lower order
PATTERNS = 64  # turns of the set of directions, so that neighbours do not share its errors: bands become faint noise
ROWS = 512  # points handled at a time
DARK = 1e-6  # of the mean radiance: below it nothing is to be shared


@dataclass(frozen=True, eq=False)
class Sight:
    """Which directions lead out, at n points.

    Attributes
    ----------
    normals : (n, 3) float32
        Unit.
    bits : (n, directions / 8) uint8
        1 where a ray leaves the mesh, first direction in the highest bit; 0 below the horizon.
    """

    normals: Float32
    bits: Bytes

    @property
    def directions(self) -> int:
        """How many, over the whole sphere."""
        return 8 * int(self.bits.shape[1])

    def seen(self, points: npt.NDArray[np.intp]) -> Bytes:
        """1 for each direction that leads out of some points, (m, directions)."""
        return np.unpackbits(self.bits[points], axis=1)


@dataclass(frozen=True, eq=False)
class Visibility:
    """Transfer vectors of n points.

    Attributes
    ----------
    whole, visible : (n, (L + 1)^2) float32
        U and T.
    sight : Sight
        What they are of.
    """

    whole: Float32
    visible: Float32
    sight: Sight
    _kept: list[Float16] = field(default_factory=list, init=False, repr=False)

    def blocked(self, go_on: Callable[[], object] = lambda: None) -> Float16:
        """Coefficients of what is in the way above each point, (n, (L + 1)^2), L at most LOBE_ORDER.

        Made when they are first asked for, in half the time of `transfer`; `go_on` as there. Exactly 0 where nothing is
        in the way.
        """
        if self._kept:
            return self._kept[0]
        order = min(LOBE_ORDER, order_of_length(self.whole.shape[1]))
        result = np.empty((len(self.whole), (order + 1) ** 2), np.float16)
        for points, weights, harmonics in _weighted(self.sight, order, lambda cosines: (cosines > 0.0).astype("f4")):
            go_on()
            result[points] = (weights * (1 - self.sight.seen(points))) @ harmonics
        self._kept.append(result)
        return result

    def shares(self, sh: Array) -> Float32:
        """Visible share of the light of a probe at every point, (n, 3) in [0, 1]; `sh` (k, 3) in world space."""
        used = sh[: self.whole.shape[1]].astype(np.float32)
        # Turned round, these take two thirds of the time.
        unoccluded, visible = (
            np.ascontiguousarray((used.T @ vectors[:, : len(used)].T).T) for vectors in (self.whole, self.visible)
        )
        smallest = np.float32(DARK * max(float(np.abs(sh[0]).max()), 1e-30))
        # Light that a short vector makes negative is none: all of nothing is visible.
        return np.clip(np.where(unoccluded > smallest, visible / np.maximum(unoccluded, smallest), 1.0), 0.0, 1.0)

    def lobe_shares(self, directions: npt.ArrayLike, shininess: float) -> Float32:
        """Visible share of a Phong lobe max(0, w.r)^shininess about unit directions r (n, 3): (n,) in [0, 1].

        Below the horizon nothing counts, on either side of the ratio. shaders/highlights_vertices.vert does the same.
        """
        order = order_of_length(self.blocked().shape[1])
        factors = phong_zonal(shininess, order)
        values = basis(directions, order) * np.repeat(factors, 2 * np.arange(order + 1) + 1)
        blocked = np.einsum("nk,nk->n", values, self.blocked().astype(np.float64))
        heights = np.einsum("nk,nk->n", np.asarray(directions, np.float64), self.sight.normals)
        lobe = np.polynomial.legendre.legval(heights, factors * hemisphere_zonal(order))
        return np.asarray(np.clip(1.0 - blocked / np.maximum(lobe, LEAST_LOBE), 0.0, 1.0), np.float32)


def hemisphere_zonal(order: int) -> Array:
    """Coefficients of P_l(n.w) that are 1 above the horizon and 0 below it, l = 0..order: (order + 1,)."""
    # (2l + 1) / 2 int_0^1 P_l = (P_{l-1}(0) - P_{l+1}(0)) / 2.
    at_zero = [float(np.polynomial.legendre.legval(0.0, np.eye(order + 2)[ell])) for ell in range(order + 2)]
    return np.array([0.5] + [0.5 * (at_zero[ell - 1] - at_zero[ell + 1]) for ell in range(1, order + 1)])


def phong_zonal(shininess: float, order: int) -> Array:
    """Factors of the bands under convolution with a Phong lobe of integral 1, (order + 1,); in [0, 1]."""
    # int_0^1 mu^s P_l dmu / int_0^1 mu^s dmu, by the recurrence of Ramamoorthi and Hanrahan 2001: a band is
    # (s - l + 2) / (s + l + 1) of the one two below it.
    factors = np.ones(order + 1)
    for ell in range(1, order + 1):
        if ell == 1:
            factors[1] = (shininess + 1.0) / (shininess + 2.0)
        else:
            factors[ell] = factors[ell - 2] * (shininess - ell + 2.0) / (shininess + ell + 1.0)
    return np.maximum(factors, 0.0)


def direction_set(count: int) -> Array:
    """Unit directions spread evenly over the sphere, (count, 3): a spherical Fibonacci set."""
    i = np.arange(count) + 0.5
    y, phi = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - y * y)
    return np.stack([ring * np.sin(phi), y, ring * np.cos(phi)], axis=1)


def pattern_directions(count: int, pattern: int) -> Array:
    """The set as the points of a pattern see it, turned at random: (count, 3)."""
    q = np.random.default_rng((1, pattern)).normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.asarray(direction_set(count) @ turn)


def patterns_of(n: int) -> npt.NDArray[np.intp]:
    """Pattern of each of n points, shuffled: neighbours have others, however they are numbered."""
    return np.random.default_rng(2).permutation(np.arange(n) % PATTERNS)


def blocks(n: int) -> Iterator[tuple[int, npt.NDArray[np.intp]]]:
    """Points of one pattern at a time, at most ROWS: (pattern, indices)."""
    patterns = patterns_of(n)
    order = np.argsort(patterns, kind="stable")
    starts = np.searchsorted(patterns[order], np.arange(PATTERNS + 1))
    for pattern in range(PATTERNS):
        points = order[starts[pattern] : starts[pattern + 1]]
        for start in range(0, len(points), ROWS):
            yield pattern, points[start : start + ROWS]


def order_for(n: int) -> int:
    """Order of the transfer vectors of n points that keeps all that is known of them within MOST_BYTES."""
    for order in range(ORDER, LEAST_ORDER, -1):
        if n * (8 * (order + 1) ** 2 + 2 * (min(order, LOBE_ORDER) + 1) ** 2) <= MOST_BYTES:
            return order
    return LEAST_ORDER


def transfer(sight: Sight, order: int | None = None, go_on: Callable[[], object] = lambda: None) -> Visibility:
    """Project what the points see on spherical harmonics; a second or two of a processor for 50,000 of them.

    `go_on` is called every few hundredths of a second and may raise.
    """
    table = _kernel_table()
    scale, half = np.float32(len(table) - 2), np.float32(1.5)

    def entering(cosines: Float32) -> Float32:
        np.add(np.multiply(cosines, scale, out=cosines), half, out=cosines)
        return table[np.maximum(cosines, 0.0, out=cosines).astype(np.int32)]

    order = order_for(len(sight.normals)) if order is None else order
    whole, visible = (np.empty((len(sight.normals), (order + 1) ** 2), np.float32) for _ in range(2))
    for points, weights, harmonics in _weighted(sight, order, entering):
        go_on()
        whole[points] = weights @ harmonics
        np.multiply(weights, sight.seen(points), out=weights)
        visible[points] = weights @ harmonics
    return Visibility(whole, visible, sight)


def _weighted(
    sight: Sight, order: int, weigh: Callable[[Float32], Float32]
) -> Iterator[tuple[npt.NDArray[np.intp], Float32, Float32]]:
    """Some points at a time: their indices, weights of the cosines (m, directions), Y_lm dw (directions, k)."""
    count = sight.directions
    at, (x, y, z), harmonics = -1, np.empty((3, 0), np.float32), np.empty(0, np.float32)
    for pattern, points in blocks(len(sight.normals)):
        if pattern != at:
            at, exact = pattern, pattern_directions(count, pattern)
            x, y, z = exact.T.astype(np.float32)
            harmonics = (basis(exact, order) * (4.0 * np.pi / count)).astype(np.float32)
        normals = sight.normals[points]
        # Three products written out take a third of the time of a matrix product of so few columns.
        yield points, weigh(normals[:, :1] * x + normals[:, 1:2] * y + normals[:, 2:] * z), harmonics


def _kernel_table(size: int = 4096) -> Float32:
    """F_t(ETA, mu) mu at mu = (i - 1) / size, i = 1..size + 1; 0 for i = 0, below the horizon."""
    table = np.zeros(size + 2, np.float32)
    mu = np.arange(1, size + 1) / size
    table[2:] = fresnel.transmittance(ETA, mu) * mu
    return table
