"""Separable least squares: coefficients of three channels, and brightnesses in which pictures are linear.

    p = sum_k b_k P_k(x_c) + noise,   x_c two coordinates of the material in channel c.

For given x the brightnesses b follow in closed form (variable projection, Golub and Pereyra 1973), and x moves by the
Levenberg-Marquardt method. A channel's pictures depend on its own x alone, so that two further pictures give all
derivatives, which steps then keep up to date (Broyden 1965).

Pixels count by their noise, which is found in the picture: differences of neighbouring residuals, by brightness. What
is far beyond it counts less (Cauchy's weights), and highlights are as uncertain as they are bright.

**Errors** are of the sandwich form H^-1 (sum of g g^T) H^-1, g the gradient of a block of pixels: they hold for
residuals that hang together within blocks (Liang and Zeger 1986). Of blocks of several sizes, and of independent
pixels, the largest is stated, so that what the scene cannot explain makes errors larger. What a solution on nodes is
itself unsure of is added, as one error of each of the finest blocks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from milkglass.core.arrays import Array, Bools, Ints

DIFFERENCE = 0.04  # of a coordinate, by which derivatives are taken
LARGEST_STEP = 1.5  # of a coordinate
MOST_STEPS = 20
SETTLED = 0.3  # standard errors of all coordinates together, or of each SMALL: steps that end the search
SMALL = 5e-4
LEAST_UPDATE = 0.01  # of a coordinate: what is missed over shorter steps is rounding
LEAST_DAMPING = 1e-3  # of Levenberg and Marquardt, where derivatives are new
STALLED = 0.02  # of the sum of squares: what a step must take off it, or derivatives are taken anew
BRIGHTNESS_BINS = 8  # of the noise
LEAST_NOISE = 5e-3, 5e-3  # of a pixel, and of the mean: what a solution on nodes is sure of
DARK = 1e-4  # of the mean, below which logarithms of pictures are as good as constant
OUTLIER = 3.0  # standard deviations at which a pixel counts by half
MAD = 1.4826  # standard deviations in a median absolute deviation of normal noise
SUBSETS = np.array(list(product((False, True), repeat=3))[1:])  # of channels that may move
START_NOISE = 0.1, 0.03  # of a pixel, and of the mean, while nothing is known


@dataclass(frozen=True, eq=False)
class Observed:
    """Pixels of pictures.

    Attributes
    ----------
    values : (n, 3) float64
        Linear RGB.
    counts : (n, 3) bool
    pairs : (2, m) int
        Neighbouring pixels.
    blocks : of (n,) int
        The block of each pixel, for several sizes of blocks.
    """

    values: Array
    counts: Bools
    pairs: Ints
    blocks: Sequence[Ints]


@dataclass(frozen=True, eq=False)
class Modelled:
    """Pictures of some coefficients.

    Attributes
    ----------
    scattered : (K, n, 3) float64
        All radiance at a brightness of 1 each.
    highlights : (K, n, 3) float64
        What of it is highlights.
    """

    scattered: Array
    highlights: Array

    def at(self, brightness: Array) -> tuple[Array, Array]:
        """Return radiance and highlights, (n, 3) each, at brightnesses (K,)."""
        of_all, of_highlights = (np.tensordot(brightness, part, 1) for part in (self.scattered, self.highlights))
        return of_all, of_highlights

    def of_channel(self, channel: int) -> "Modelled":
        """Return pictures that have one channel of these in R, G and B."""
        parts = (part[..., channel : channel + 1] for part in (self.scattered, self.highlights))
        return Modelled(*(np.repeat(part, 3, axis=2) for part in parts))

    @property
    def logarithms(self) -> Array:
        """Logarithms of the pictures, (K, n, 3), which coefficients change more evenly."""
        return np.asarray(np.log(self.scattered + DARK * self.scattered.mean(axis=1, keepdims=True) + 1e-300))


Evaluate = Callable[[Array], Modelled]  # of x, (3, 2)


@dataclass(frozen=True, eq=False)
class Solution:
    """The coefficients and brightnesses of least squares.

    Attributes
    ----------
    x : (3, 2)
        Coordinates of R, G and B.
    brightness : (K,)
    covariance : (6 + K, 6 + K)
        Of x, channel by channel, and of the logarithms of the brightnesses.
    modelled, residual : (n, 3)
        Radiance, and picture less radiance.
    misfit : float
        Rms of residuals over their noise, where they count: 1 where the scene explains all but the noise.
    relative : (3,)
        Rms of residuals over rms of the picture, both weighted by pixels.
    is_settled : bool
        Whether the search came to an end.
    """

    x: Array
    brightness: Array
    covariance: Array
    modelled: Array
    residual: Array
    misfit: float
    relative: Array
    is_settled: bool


@dataclass(eq=False)
class Search:
    """Least squares from a start.

    Parameters
    ----------
    evaluate : callable
        Returns the pictures of coefficients x, (3, 2).
    observed : Observed
    low, high : (2,) arrays
        Bounds of x.
    fixed_brightness : bool
        Whether brightnesses are 1.
    tell : callable
        Told a few words after each step.
    """

    evaluate: Evaluate
    observed: Observed
    low: Array
    high: Array
    fixed_brightness: bool = False
    tell: Callable[[str], None] = lambda _: None
    steps: int = field(default=0, init=False)
    is_settled: bool = field(default=False, init=False)

    def start(self, candidates: Sequence[tuple[Array, Modelled]]) -> Array:
        """Return the best x, (3, 2), of candidates of a channel each: pairs of x, (2,), and pictures of all channels.

        All combinations of three are compared, each with its own brightnesses.
        """
        values, weights = self.observed.values, self._first_weights()
        left = np.array([[_products(m.scattered, weights, c) for _, m in candidates] for c in range(3)])
        right = np.array([[m.scattered[..., c] @ (weights * values)[:, c] for _, m in candidates] for c in range(3)])
        best, least = list[int](), np.inf
        for chosen in product(range(len(candidates)), repeat=3):
            gram, moments = (parts[range(3), chosen].sum(axis=0) for parts in (left, right))
            brightness = self._brightness(gram, moments)
            cost = float(brightness @ gram @ brightness - 2.0 * brightness @ moments)
            if cost < least:
                best, least = list(chosen), cost
        return np.array([candidates[i][0] for i in best])

    def solve(self, x: Array) -> Solution:
        """Return the solution next to a start x, (3, 2)."""
        damping, state = np.full(3, LEAST_DAMPING), self._derived(self._state(np.clip(x, self.low, self.high)))
        for _ in range(MOST_STEPS):
            weights, misfit = self._weights(state)
            state = self._bright(state, weights)
            hessian, gradient, _, _ = self._normal(state, weights)
            step = _solved(hessian, gradient, damping, len(state.brightness))
            step = np.clip(state.x + np.clip(step, -LARGEST_STEP, LARGEST_STEP), self.low, self.high) - state.x
            self.steps += 1
            self.tell(f"step {self.steps}: residual {misfit:.2f} times the noise")
            if gradient[:6] @ step.ravel() <= SETTLED**2 or np.abs(step).max() < SMALL:
                if state.is_fresh:
                    self.is_settled = damping.max() <= 1.0
                    break
                state = self._derived(state)
                continue
            moved, cost = self._state(state.x + step), self._cost(state, weights)
            mixed = [(self._bright(_mixed(state, moved, chosen), weights), chosen) for chosen in SUBSETS]
            least, (best, chosen) = min(
                ((self._cost(candidate, weights), (candidate, chosen)) for candidate, chosen in mixed),
                key=lambda found: found[0],
            )
            damping = np.minimum(np.where(chosen & (least < cost), 0.1, 10.0) * damping, 1e3)
            stalls = not state.is_fresh and least > (1.0 - STALLED) * cost
            if least < cost:
                state = _updated(best, state, moved, step)
            if stalls:
                state = self._derived(state)
        return self._solution(state if state.is_fresh else self._derived(state))

    def _state(self, x: Array) -> "_State":
        return _State(x, self.evaluate(x), np.ones(0), np.zeros(0))

    def _derived(self, state: "_State") -> "_State":
        """Return a state with derivatives of its pictures by differences; steps lead away from a bound."""
        slopes = []
        for i in range(2):
            moved = state.x.copy()
            moved[:, i] += np.where(moved[:, i] + DIFFERENCE > self.high[i], -DIFFERENCE, DIFFERENCE)
            change = self.evaluate(moved).logarithms - state.modelled.logarithms
            slopes.append(change / (moved[:, i] - state.x[:, i]))
        return replace(state, slopes=np.stack(slopes), is_fresh=True)

    def _bright(self, state: "_State", weights: Array) -> "_State":
        """Return a state with the brightnesses of least squares."""
        scattered = state.modelled.scattered
        gram = np.sum([_products(scattered, weights, c) for c in range(3)], axis=0)
        moments = np.einsum("knc,nc->k", scattered, weights * self.observed.values)
        return replace(state, brightness=self._brightness(gram, moments))

    def _brightness(self, gram: Array, moments: Array) -> Array:
        if self.fixed_brightness:
            return np.ones(len(moments))
        found = np.linalg.lstsq(gram, moments, rcond=1e-10)[0]
        return np.asarray(np.maximum(found, 1e-6 * max(np.abs(found).max(), 1e-30)))

    def _weights(self, state: "_State") -> tuple[Array, float]:
        """Return the weights of pixels, (n, 3), by noise, highlights and distance, and the rms residual over noise."""
        values, counts = self.observed.values, self.observed.counts
        if not len(state.brightness):
            state = self._bright(state, self._first_weights())
        modelled, highlights = state.modelled.at(state.brightness)
        residual = values - modelled
        noise = self._noise(modelled, residual) + highlights**2
        # Far from the solution all pixels are about as far off, in proportion.
        size = 0.5 * (values**2 + modelled**2) + (START_NOISE[1] / START_NOISE[0] * self._means) ** 2
        variance = noise + _medians(residual**2 / size, counts) * size
        far = residual / np.sqrt(variance)
        spread = np.maximum(1.0, MAD * _medians(np.abs(far), counts))
        weights = counts / (variance * (1.0 + (far / (OUTLIER * spread)) ** 2))
        total = float((weights * noise).sum())
        return weights, float(np.sqrt((weights * residual**2).sum() / max(total, 1e-30)))

    @property
    def _means(self) -> Array:
        """Mean of each channel of the picture, (3,), where it counts."""
        values, counts = self.observed.values, self.observed.counts
        return np.asarray(np.maximum((values * counts).sum(axis=0) / np.maximum(counts.sum(axis=0), 1), 1e-30))

    def _first_weights(self) -> Array:
        """Return the weights of pixels, (n, 3), while nothing is known."""
        values = self.observed.values
        of_pixel, of_mean = START_NOISE
        return np.asarray(self.observed.counts / ((of_pixel * values) ** 2 + (of_mean * self._means) ** 2))

    def _noise(self, modelled: Array, residual: Array) -> Array:
        """Return the variance of the picture's noise, (n, 3), by brightness: from neighbours' differences."""
        variance = np.empty_like(modelled)
        first, second = self.observed.pairs
        for c in range(3):
            both = self.observed.counts[first, c] & self.observed.counts[second, c]
            difference = (residual[first[both], c] - residual[second[both], c]) / np.sqrt(2.0)
            level = 0.5 * (modelled[first[both], c] + modelled[second[both], c])
            least = self._least_noise(modelled)[:, c]
            bins = np.array_split(np.argsort(level), BRIGHTNESS_BINS)
            bins = [inside for inside in bins if len(inside)]
            if not bins:
                variance[:, c] = least
                continue
            at = [float(level[inside].mean()) for inside in bins]
            of_bins = [(MAD * float(np.median(np.abs(difference[inside])))) ** 2 for inside in bins]
            variance[:, c] = np.maximum(np.interp(modelled[:, c], at, of_bins), least)
        return variance

    def _least_noise(self, modelled: Array) -> Array:
        """Return the variance of what solutions are unsure of, (n, 3)."""
        of_pixel, of_mean = LEAST_NOISE
        return np.asarray((of_pixel * modelled) ** 2 + (of_mean * self._means) ** 2)

    def _cost(self, state: "_State", weights: Array) -> float:
        """Return the weighted sum of squares."""
        modelled, _ = state.modelled.at(state.brightness)
        return float((weights * (self.observed.values - modelled) ** 2).sum())

    def _normal(self, state: "_State", weights: Array) -> tuple[Array, Array, Array, Array]:
        """Return the normal equations of x and the brightnesses' logarithms: matrix and right side, (u,).

        Then what each pixel has of that by its residual, and by what solutions are unsure of, (u, n) each.
        """
        modelled, _ = state.modelled.at(state.brightness)
        residual = self.observed.values - modelled
        unknowns = 6 + len(state.brightness)
        columns = np.zeros((unknowns, *residual.shape))
        for c in range(3):
            parts = state.slopes[..., c] * state.modelled.scattered[..., c]
            columns[2 * c : 2 * c + 2, :, c] = np.tensordot(parts, state.brightness, (1, 0))
        if not self.fixed_brightness:
            columns[6:] = state.brightness[:, None, None] * state.modelled.scattered
        unsure = np.sqrt(self._least_noise(modelled))
        by_residual, by_solution = (np.einsum("inc,nc->in", columns, weights * part) for part in (residual, unsure))
        hessian = np.einsum("inc,jnc->ij", columns * weights, columns, optimize=True)
        return hessian, by_residual.sum(axis=1), by_residual, by_solution

    def _solution(self, state: "_State") -> Solution:
        weights, misfit = self._weights(state)
        state = self._bright(state, weights)
        hessian, _, parts, unsure = self._normal(state, weights)
        modelled, _ = state.modelled.at(state.brightness)
        residual = self.observed.values - modelled
        left, whole = ((weights * values**2).sum(axis=0) for values in (residual, self.observed.values))
        relative = np.sqrt(left / np.maximum(whole, 1e-30))
        covariance = _covariance(hessian, parts, unsure, self.observed.blocks)
        return Solution(state.x, state.brightness, covariance, modelled, residual, misfit, relative, self.is_settled)


@dataclass(frozen=True, eq=False)
class _State:
    """Coefficients, their pictures, brightnesses (K,), and derivatives of the pictures' logarithms, (2, K, n, 3)."""

    x: Array
    modelled: Modelled
    brightness: Array
    slopes: Array
    is_fresh: bool = False  # whether derivatives are by differences, and of this x


def _products(scattered: Array, weights: Array, channel: int) -> Array:
    """Return the inner products of pictures in a channel, (K, K)."""
    of_channel = scattered[..., channel]
    return np.asarray((of_channel * weights[:, channel]) @ of_channel.T)


def _mixed(state: _State, moved: _State, chosen: Bools) -> _State:
    """Return a state of which some channels, (3,), have moved."""
    modelled = Modelled(
        np.where(chosen, moved.modelled.scattered, state.modelled.scattered),
        np.where(chosen, moved.modelled.highlights, state.modelled.highlights),
    )
    return replace(state, x=np.where(chosen[:, None], moved.x, state.x), modelled=modelled, is_fresh=False)


def _updated(best: _State, state: _State, moved: _State, step: Array) -> _State:
    """Return the best state with derivatives that are true for the step that was tried (Broyden)."""
    slopes = state.slopes.copy()
    change = moved.modelled.logarithms - state.modelled.logarithms
    for c in range(3):
        length = float(step[c] @ step[c])
        if length > LEAST_UPDATE**2:
            missed = change[..., c] - np.tensordot(step[c], slopes[..., c], 1)
            slopes[..., c] += step[c][:, None, None] * missed / length
    return replace(best, slopes=slopes)


def _medians(values: Array, counts: Bools) -> Array:
    """Return the median of each channel, (3,), of values (n, 3) that count."""
    return np.array([np.median(values[counts[:, c], c]) if counts[:, c].any() else 0.0 for c in range(3)])


def _solved(hessian: Array, gradient: Array, damping: Array, brightnesses: int) -> Array:
    """Return the step of x, (3, 2), with brightnesses that follow it freely; damping is of each channel, (3,)."""
    scales = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    damped = hessian / np.outer(scales, scales)
    damped[np.diag_indices(6)] += np.repeat(damping, 2)
    step = np.linalg.lstsq(damped, gradient / scales, rcond=1e-12)[0] / scales
    return np.asarray(step[: len(step) - brightnesses].reshape(3, 2))


def _covariance(hessian: Array, parts: Array, unsure: Array, blocks: Sequence[Ints]) -> Array:
    """Return the covariance of all unknowns: the correlations of the coarsest blocks, and the largest errors.

    What solutions are unsure of, (u, n), hangs together within the finest blocks.
    """
    scales = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    inverse = np.linalg.pinv(hessian / np.outer(scales, scales), rcond=1e-12) / np.outer(scales, scales)
    common = _spread(unsure, blocks[0])
    covariance, largest = inverse, np.zeros(len(inverse))
    for of_pixels in (np.arange(parts.shape[1]), *blocks):
        present = max(len(np.unique(of_pixels)), 2)
        inner = _spread(parts, of_pixels) * (present / (present - 1.0)) + common
        sandwich = inverse @ inner @ inverse
        largest = np.maximum(largest, np.diag(sandwich))
        covariance = sandwich if present > 3 * len(hessian) else covariance
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlations = covariance / np.outer(deviations, deviations)
    return np.asarray(correlations * np.sqrt(np.outer(largest, largest)))


def _spread(parts: Array, blocks: Ints) -> Array:
    """Return the sum of g g^T over blocks of pixels, (u, u), g the sum of a block's parts, (u, n)."""
    gradients = np.stack([np.bincount(blocks, part) for part in parts])
    return np.asarray(gradients @ gradients.T)
