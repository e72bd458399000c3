"""Visibility of an environment on a surface that occludes it.

For every point of a mesh, `core.light.bake` casts rays in a set of directions: one bit says whether a ray leaves the
mesh. Two transfer vectors in real spherical harmonics follow, of all light that enters and of light not occluded:

    U_lm = int F_t(eta, w.n) max(w.n, 0) Y_lm(w) dw,     T_lm = the same with V(w) inside.

The visible share of a light L is T.L / U.L, within [0, 1]. Irradiance is this share of the unoccluded one
(`core.light.probe`), which has full resolution, the shading normal and the medium's eta. A ratio of two vectors from
the same rays is exactly 1 where nothing occludes and 0 in a closed cavity, and has half the error of T.L alone. It
hardly depends on eta: shares for `ETA` have an error of 0.3 % rms at 1.3, 0.04 % at 2, and 2 % at 1.

A new light or a rotation of it costs one dot product a point; see `core.light.harmonics.rotated`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Bytes, Float32
from milkglass.core.light.harmonics import basis, order_of_length
from milkglass.core.material import fresnel

Float16 = npt.NDArray[np.float16]

ETA = 1.5  # index of refraction of the transfer vectors
ORDER = 10  # on the dragon, Uffizi: 5.2 % rms at 4, 1.8 at 8, 1.5 at 10, 1.4 at 16
MIN_ORDER = 4
LOBE_ORDER = 8  # of the occlusion of highlights; dragon, Uffizi, shininess 80: 8.6 % rms at 6, 7.0 at 8, 6.4 at 10
MIN_LOBE = 1e-3  # least share of a lobe above the horizon that is divided by
MAX_BYTES = 256 << 20  # of all vectors of all points: a mesh too large for them gets a lower order
PATTERNS = (
    64  # rotations of the set of directions, so that errors of neighbours are independent: noise in place of bands
)
BLOCK_POINTS = 512  # points handled at a time
MIN_UNOCCLUDED = 1e-6  # of the mean radiance: irradiance below it counts as 0, all visible


@dataclass(frozen=True, eq=False)
class Sight:
    """Directions in which rays from n points leave the mesh.

    Attributes
    ----------
    normals : (n, 3) float32
        Unit, world space.
    bits : (n, directions / 8) uint8
        1 where a ray leaves the mesh, first direction in the highest bit; 0 below the horizon.
    """

    normals: Float32
    bits: Bytes

    @property
    def directions(self) -> int:
        """Number of directions over the whole sphere."""
        return 8 * int(self.bits.shape[1])

    def open_bits(self, points: npt.NDArray[np.intp]) -> Bytes:
        """Return 1 for each direction that leaves the mesh, 0 for the others, at points: (m, directions) uint8."""
        return np.unpackbits(self.bits[points], axis=1)


@dataclass(frozen=True, eq=False)
class Visibility:
    """Transfer vectors of n points.

    Attributes
    ----------
    unoccluded, visible : (n, (L + 1)^2) float32
        U and T.
    sight : Sight
        The rays that they follow from.
    """

    unoccluded: Float32
    visible: Float32
    sight: Sight
    _blocked: list[Float16] = field(default_factory=list, init=False, repr=False)

    def blocked(self, check: Callable[[], object] = lambda: None) -> Float16:
        """Return coefficients of the occluded directions above each horizon, (n, (L + 1)^2) float16, L <= LOBE_ORDER.

        Computed at the first call, in half the time of `transfer`; `check` as there. Exactly 0 where nothing occludes.
        """
        if self._blocked:
            return self._blocked[0]
        order = min(LOBE_ORDER, order_of_length(self.unoccluded.shape[1]))
        result = np.empty((len(self.unoccluded), (order + 1) ** 2), np.float16)
        for points, weights, harmonics in _weighted(self.sight, order, lambda cosines: (cosines > 0.0).astype("f4")):
            check()
            result[points] = (weights * (1 - self.sight.open_bits(points))) @ harmonics
        self._blocked.append(result)
        return result

    def shares(self, sh: Array) -> Float32:
        """Return the visible share of a probe's light at every point, (n, 3) in [0, 1]; `sh` (k, 3) in world space."""
        used = sh[: self.unoccluded.shape[1]].astype(np.float32)
        # Products of the transposes take two thirds of the time.
        unoccluded, visible = (
            np.ascontiguousarray((used.T @ vectors[:, : len(used)].T).T) for vectors in (self.unoccluded, self.visible)
        )
        smallest = np.float32(MIN_UNOCCLUDED * max(float(np.abs(sh[0]).max()), 1e-30))
        # Truncated vectors may give irradiance <= 0: it counts as 0, with a share of 1.
        return np.clip(np.where(unoccluded > smallest, visible / np.maximum(unoccluded, smallest), 1.0), 0.0, 1.0)

    def lobe_shares(self, directions: npt.ArrayLike, shininess: float) -> Float32:
        """Return the visible share of Phong lobes max(0, w.r)^shininess about unit directions r (n, 3): (n,) in [0, 1].

        Directions below the horizon count neither above nor below the fraction. The oracle of highlights_vertices.vert.
        """
        order = order_of_length(self.blocked().shape[1])
        factors = phong_zonal(shininess, order)
        values = basis(directions, order) * np.repeat(factors, 2 * np.arange(order + 1) + 1)
        blocked = np.einsum("nk,nk->n", values, self.blocked().astype(np.float64))
        heights = np.einsum("nk,nk->n", np.asarray(directions, np.float64), self.sight.normals)
        lobe = np.polynomial.legendre.legval(heights, factors * hemisphere_zonal(order))
        return np.asarray(np.clip(1.0 - blocked / np.maximum(lobe, MIN_LOBE), 0.0, 1.0), np.float32)


def hemisphere_zonal(order: int) -> Array:
    """Return coefficients of P_l(n.w) of the function that is 1 above the horizon and 0 below: (order + 1,)."""
    # (2l + 1) / 2 int_0^1 P_l = (P_{l-1}(0) - P_{l+1}(0)) / 2.
    at_zero = [float(np.polynomial.legendre.legval(0.0, np.eye(order + 2)[ell])) for ell in range(order + 2)]
    return np.array([0.5] + [0.5 * (at_zero[ell - 1] - at_zero[ell + 1]) for ell in range(1, order + 1)])


def phong_zonal(shininess: float, order: int) -> Array:
    """Return the factors of bands under convolution with a Phong lobe of integral 1, (order + 1,), in [0, 1]."""
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
    """Return unit directions evenly over the sphere, (count, 3): a spherical Fibonacci set."""
    i = np.arange(count) + 0.5
    y, phi = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - y * y)
    return np.stack([ring * np.sin(phi), y, ring * np.cos(phi)], axis=1)


def pattern_directions(count: int, pattern: int) -> Array:
    """Return the set of directions of a pattern, (count, 3): `direction_set` rotated at random."""
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
    """Return the pattern of each of n points, shuffled so that neighbours have different ones in any numbering."""
    return np.random.default_rng(2).permutation(np.arange(n) % PATTERNS)


def blocks(n: int) -> Iterator[tuple[int, npt.NDArray[np.intp]]]:
    """Yield points of one pattern, at most BLOCK_POINTS at a time: (pattern, indices)."""
    patterns = patterns_of(n)
    order = np.argsort(patterns, kind="stable")
    starts = np.searchsorted(patterns[order], np.arange(PATTERNS + 1))
    for pattern in range(PATTERNS):
        points = order[starts[pattern] : starts[pattern + 1]]
        for start in range(0, len(points), BLOCK_POINTS):
            yield pattern, points[start : start + BLOCK_POINTS]


def order_for(n: int) -> int:
    """Return the order of transfer vectors of n points for which all vectors fit into MAX_BYTES."""
    for order in range(ORDER, MIN_ORDER, -1):
        if n * (8 * (order + 1) ** 2 + 2 * (min(order, LOBE_ORDER) + 1) ** 2) <= MAX_BYTES:
            return order
    return MIN_ORDER


def transfer(sight: Sight, order: int | None = None, check: Callable[[], object] = lambda: None) -> Visibility:
    """Return the transfer vectors of points, in 1 to 2 s of a processor for 50,000 of them.

    `check` is called every few hundredths of a second and may raise.
    """
    table = _kernel_table()
    scale, half = np.float32(len(table) - 2), np.float32(1.5)

    def entering(cosines: Float32) -> Float32:
        np.add(np.multiply(cosines, scale, out=cosines), half, out=cosines)
        return table[np.maximum(cosines, 0.0, out=cosines).astype(np.int32)]

    order = order_for(len(sight.normals)) if order is None else order
    unoccluded, visible = (np.empty((len(sight.normals), (order + 1) ** 2), np.float32) for _ in range(2))
    for points, weights, harmonics in _weighted(sight, order, entering):
        check()
        unoccluded[points] = weights @ harmonics
        np.multiply(weights, sight.open_bits(points), out=weights)
        visible[points] = weights @ harmonics
    return Visibility(unoccluded, visible, sight)


def _weighted(
    sight: Sight, order: int, weigh: Callable[[Float32], Float32]
) -> Iterator[tuple[npt.NDArray[np.intp], Float32, Float32]]:
    """Yield blocks of points: their indices, weights of the cosines (m, directions), Y_lm dw (directions, k)."""
    count = sight.directions
    current, (x, y, z), harmonics = -1, np.empty((3, 0), np.float32), np.empty(0, np.float32)
    for pattern, points in blocks(len(sight.normals)):
        if pattern != current:
            current, exact = pattern, pattern_directions(count, pattern)
            x, y, z = exact.T.astype(np.float32)
            harmonics = (basis(exact, order) * (4.0 * np.pi / count)).astype(np.float32)
        normals = sight.normals[points]
        # Three products written out take a third of the time of a matrix product of so few columns.
        yield points, weigh(normals[:, :1] * x + normals[:, 1:2] * y + normals[:, 2:] * z), harmonics


def _kernel_table(size: int = 4096) -> Float32:
    """Return F_t(ETA, mu) mu at mu = (i - 1) / size, i = 1..size + 1; 0 for i = 0, below the horizon."""
    table = np.zeros(size + 2, np.float32)
    mu = np.arange(1, size + 1) / size
    table[2:] = fresnel.transmittance(ETA, mu) * mu
    return table
