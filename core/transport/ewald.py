"""Particle-mesh Ewald split of equation (1): a smooth part on the layers, the rest local.

R_d = R_L + (R_d - R_L). R_L is R_d filtered in three dimensions by a window of width s, a little above the spacing of
the layers, so that they can carry it; what remains has a range of s and sees a surface that is flat and evenly lit,
where it acts as one factor rho_s on the irradiance of the point itself (Hockney and Eastwood 1988; Ewald 1921).
That factor is applied at every pixel, with the pixel's own irradiance, and restores the detail that layers lose.

Works for any radial profile: the filter needs no Bessel functions, only the profile's values along a line.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.grid.assignment import SHEET_REACH, TENT, TSC, undo_assignment
from milkglass.core.grid.kernels import Kernels
from milkglass.core.grid.layers import LayerGrid, fit_nodes, tent_matrix, tsc_matrix
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.grid.spectra import kernel_spectrum
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.transport.accuracy import LIT, SHINING, SURROUNDED, Roughness, predicted_error, spacing_for
from milkglass.core.transport.fft import FftTransport
from milkglass.core.transport.pixels import LocalTerm
from milkglass.core.transport.quality import (
    COARSEST,
    DEFAULT_ERROR_TARGET,
    LOOSE_TAIL,
    SAMPLE_EDGE,
    SURVEY,
    TAIL,
    Quality,
    QualityRequest,
    survey_spacing,
)

SHEET_NODES = 64  # thicknesses at which a local term is tabulated


@dataclass(eq=False)
class EwaldTransport(FftTransport):
    """Particle-mesh Ewald split on layers that are fixed to the object, so that orbiting convolves nothing.

    Parameters
    ----------
    resolution : int
        Nodes along the object's longest side.
    n_layers : int, optional
        Layers over the object's z extent; as dense as the nodes if not given, which is best.
    assignment : str
        ``tsc``, quadratic B-splines over 27 nodes, or ``tent``, linear ones over 8.
    tail : float
        See `tail_reach`; the padding follows from it.
    kernels : Kernels
    """

    resolution: int = 60
    n_layers: int | None = None
    assignment: str = TSC
    tail: float = TAIL

    @property
    def smooth(self) -> bool:
        """Whether the assignment is TSC."""
        return self.assignment == TSC

    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Fit layers to the mesh itself, whatever the view."""
        return fit_nodes(mesh.bounds, self.resolution, self.n_layers)

    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the B-spline weights of points, of the assignment's order."""
        return tsc_matrix(grid, coordinates) if self.smooth else tent_matrix(grid, coordinates)

    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """Return rho_s of every channel, see `local_table`."""
        s = self._window_width(grid)
        thickness = np.linspace(0.0, SHEET_REACH * s, SHEET_NODES)
        factors = [np.zeros(SHEET_NODES) if p.is_black else local_table(p, s)(thickness) for p in profiles]
        return LocalTerm(np.stack(factors, axis=-1), float(thickness[-1]))

    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Return sizes padded by a channel's `tail_reach`, at most by the extent."""
        spacing = np.array([grid.layer_distance, grid.texel, grid.texel])
        counts = np.array(grid.shape)
        extra = np.minimum(np.ceil(tail_reach(profile, area, self.tail) / spacing), np.maximum(counts - 2, 0))
        depth, height, width = (int(n) for n in counts + extra)
        return ConvolutionShape(*grid.shape, padding=(depth, height, width))

    def _window_width(self, grid: LayerGrid) -> float:
        return WINDOW[self.assignment] * max(grid.texel, grid.layer_distance)

    def spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        """Return the spectrum of R_L, with the assignment undone."""
        spacing = np.array([grid.layer_distance, grid.texel, grid.texel])
        furthest = float(np.linalg.norm(spacing * (np.array(shape.quadrant) - 1)))
        kernel = long_range(profile, self._window_width(grid), furthest)
        return node_spectrum(kernel, grid, shape, self.assignment)


@functools.lru_cache(maxsize=1024)  # every body asks again
def tail_reach(profile: Profile, area: float, tail: float) -> float:
    """Return the distance, mm, beyond which all sources' tails together are negligible, on an object of `area` mm^2.

    The smallest D with A R_d(D) <= tail T(0), by bisection: R_d falls with distance. 0 for black.
    """
    if profile.is_black:
        return 0.0
    threshold = tail * float(profile.total(0.0)) / area
    low, high = 0.0, np.sqrt(area)
    while float(profile.radial(high)) > threshold:
        high *= 2.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(profile.radial(middle)) > threshold else (low, middle)
    return float(high)


# c: width of the window in spacings. At 1.0 the rms error of smooth parts is a third lower, but what bright parts leave
# at the layers' highest frequency reaches the dark ones as rings; at 1.25 it has fallen to 2 % and they are gone.
# Tents see more of that frequency and are best a little wider.
WINDOW = {TENT: 1.4, TSC: 1.25}
WINDOW_WIDTHS = 8.0  # beyond which the window is below 1e-11 of its peak
MAX_NODES = 1 << 20  # of the radial table


def window(t: npt.ArrayLike, s: float) -> Array:
    """Return the window of unit integral, w(t) = exp(-u/2) (15 - 10 u + u^2) / (8 s sqrt(2 pi)), u = (t/s)^2.

    Its moments up to the fifth vanish: in Fourier space it is exp(-x) (1 + x + x^2/2), x = (s k)^2 / 2, flat to the
    sixth order at k = 0.
    """
    u = np.square(np.asarray(t, np.float64) / s)
    return np.asarray(np.exp(-0.5 * u) * (15.0 - 10.0 * u + u * u) / (8.0 * s * np.sqrt(2.0 * np.pi)))


def long_range(profile: Profile, s: float, furthest: float) -> CubicSpline:
    """Return the radial function R_L(rho), mm^-2, for 0 <= rho <= furthest, mm.

    R_L(rho) = (1 / rho) int w(t) (rho - t) R_d(|rho - t|) dt: in three dimensions rho f(rho) of a radial function f
    behaves as in one, so filtering by a radial window is a convolution along a line.
    """
    reach = WINDOW_WIDTHS * s
    step = max(min(s / 20.0, profile.mean_free_path / 6.0), (furthest + 2.0 * reach) / MAX_NODES)
    n, m = int(np.ceil(furthest / step)) + 1, int(np.ceil(reach / step))
    t = step * np.arange(-2 * m, n + 2 * m + 1)
    strength = t * profile.radial(np.abs(t))
    smooth = step * _convolve(strength, window(step * np.arange(-m, m + 1), s))
    rho = t[m:-m]
    # rho R_L is odd; its slope at 0 is R_L(0), which the quotient cannot give.
    odd = CubicSpline(rho, smooth)
    rho = step * np.arange(n + 1)
    values = np.concatenate([[float(odd(0.0, 1))], odd(rho[1:]) / rho[1:]])
    return CubicSpline(rho, values)


def local_table(profile: Profile, s: float) -> CubicSpline:
    """Return rho_s(e), what R_L leaves out of an evenly lit plane at distance e, for 0 <= e <= SHEET_REACH s, mm.

    rho_s(e) = T(e) - int w(t) T(|e - t|) dt. rho_s(0) is the factor on a point's own irradiance; at the thickness of a
    thin slab it is the one on the irradiance of the other side.
    """
    furthest, reach = SHEET_REACH * s, WINDOW_WIDTHS * s
    step = max(min(s / 20.0, profile.mean_free_path / 6.0), (furthest + 2.0 * reach) / MAX_NODES)
    n, m = int(np.ceil(furthest / step)) + 1, int(np.ceil(reach / step))
    total = profile.total(step * np.abs(np.arange(-m, n + m + 1)))
    smooth = step * _convolve(total, window(step * np.arange(-m, m + 1), s))
    return CubicSpline(step * np.arange(n + 1), total[m:-m] - smooth)


def _convolve(values: Array, weights: Array) -> Array:
    """Return the convolution along a line, where all weights meet a value."""
    # Imported here: with it comes scipy.stats, 20 MB and half a second, of which `diffusion` has no need.
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(values, weights, mode="valid"))


def node_spectrum(
    radial: Callable[[Array], Array], grid: LayerGrid, shape: ConvolutionShape, assignment: str = TSC
) -> Float32:
    """Return the spectrum of a smooth radial kernel between nodes, assignment undone: `shape.quadrant` float32."""
    z, y, x = (np.arange(n, dtype=np.float64) for n in shape.quadrant)
    z, y, x = z * grid.layer_distance, y * grid.texel, x * grid.texel
    rho = np.sqrt(np.square(z)[:, None, None] + np.square(y)[:, None] + np.square(x))
    return undo_assignment(kernel_spectrum(radial(rho), shape), shape, assignment)


# Choice of the grid


FINEST = 512  # nodes along the longest side
STEP = 4  # chosen resolutions are multiples of it: a material that changes a little keeps its grid and all plans on it
# Padded nodes, over the channels, that an error target may choose, in those of the paper's setting. Where they meet the
# default target, or nearly, they may take a few times the paper's time, which a picture at rest can wait for; where
# they would miss it by far, no more than the paper's. A target that a person has set may take longer.
PAPER_NODES = 3 * 4 * 512 * 512
NODES, NODES_OUT_OF_REACH, NODES_ASKED_FOR = 4 * PAPER_NODES, 3 * PAPER_NODES // 5, 16 * PAPER_NODES
NEAR_TARGET = 2.0  # times the target: an error that still passes for meeting it


def choose_quality(
    request: QualityRequest, profiles: Profiles, mesh: Mesh, shape: Roughness | None, *, sharp_light: bool = True
) -> Quality:
    """Return the quality for a request: nodes from the error that `core.transport.accuracy` predicts."""
    assert shape is not None
    longest = longest_side(mesh)
    law, lit_law = (SHINING, LIT) if sharp_light else (SURROUNDED, SURROUNDED)
    target = None if request.resolution is not None else request.error_target or DEFAULT_ERROR_TARGET
    has_target = target is not None and request.error_target is not None

    def quality(resolution: int, assignment: str, tail: float = TAIL) -> Quality:
        grid = EwaldTransport(resolution=resolution, n_layers=request.layers).grid(mesh, np.eye(3))
        spacing = max(grid.texel, grid.layer_distance)
        worst, lit = (predicted_error(error_law, profiles, spacing, shape, assignment) for error_law in (law, lit_law))
        return Quality(
            request.method, request.layers, resolution, assignment, worst, min(lit, worst), target, has_target, tail
        )

    if request.resolution is not None:
        chosen = quality(request.resolution, request.assignment or TSC)
        return replace(chosen, tail=TAIL if chosen.error <= NEAR_TARGET * DEFAULT_ERROR_TARGET else LOOSE_TAIL)
    assert target is not None
    orders = (TENT, TSC) if request.assignment is None else (request.assignment,)
    max_nodes = _most_nodes(request, profiles, mesh, TAIL, NODES if request.error_target is None else NODES_ASKED_FOR)
    nodes_by_order = {order: longest / spacing_for(target, law, profiles, shape, order) + 2.0 for order in orders}
    found = [
        quality(int(np.clip(STEP * np.ceil(n / STEP), COARSEST, max_nodes)), order)
        for order, n in nodes_by_order.items()
    ]
    # Tents are read and written in a third of the time: theirs, where they need no finer grid.
    good = [q for q in found if q.error <= target]
    if good:
        return min(good, key=lambda q: q.resolution)
    best = min(found, key=lambda q: q.error)
    if best.error <= NEAR_TARGET * target:
        return best
    budget = NODES_OUT_OF_REACH if request.error_target is None else NODES_ASKED_FOR
    return quality(_most_nodes(request, profiles, mesh, LOOSE_TAIL, budget), orders[-1], LOOSE_TAIL)


def make_transport(quality: Quality, kernels: Kernels) -> EwaldTransport:
    """Make the transport of a quality."""
    return EwaldTransport(
        resolution=quality.resolution,
        n_layers=quality.layers,
        assignment=quality.assignment,
        tail=quality.tail,
        kernels=kernels,
    )


def sample_spacing(mesh: Mesh, request: QualityRequest, resolution: int) -> float:
    """Return the distance of surface samples for a request, mm; see `core.transport.quality.sample_spacing`.

    The samples of `SURVEY` nodes serve every coarser grid, and finer ones come in steps: a material that changes the
    grid keeps its samples.
    """
    if request.resolution is not None:
        return SAMPLE_EDGE * longest_side(mesh) / (request.resolution - 1)
    steps = max(0, int(np.ceil(2.0 * np.log2(resolution / SURVEY))))
    return float(survey_spacing(mesh) * 2.0 ** (-0.5 * steps))


def _most_nodes(request: QualityRequest, profiles: Profiles, mesh: Mesh, tail: float, budget: int) -> int:
    """Return the largest resolution whose padded grid keeps within a budget, by bisection."""
    low, high = COARSEST, FINEST + 1
    while high - low > 1:
        middle = (low + high) // 2
        transport = EwaldTransport(resolution=middle, n_layers=request.layers, tail=tail)
        fits = padded_nodes(transport, profiles, mesh) <= budget
        low, high = (middle, high) if fits else (low, middle)
    return low // STEP * STEP


def padded_nodes(transport: EwaldTransport, profiles: Profiles, mesh: Mesh) -> int:
    """Return how many nodes the transforms have at least, over the channels."""
    grid = transport.grid(mesh, np.eye(3))
    return sum(transport.shape(grid, p, mesh.area).required_nodes for p in profiles if not p.is_black)
