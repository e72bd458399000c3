"""What a grid of `ewald` can carry: the error to expect from its spacing, the material, the shape and the light.

Two lengths and a number decide: the spacing h of the nodes, the profile's `detail` d, and the roughness kappa(h) of the
surface, how far it is from a plane at the size of a cell. Fitted to 1,900 channels of measured pictures (ball, torus
knot, plates of 0.5 and 1 mm, three scans and the sculpture at 20 to 100 mm; marble, two milks, ketchup, jade; 32 to 120
nodes along the object; equation (1) summed in float64 as the reference), the rms error over rms exitance follows

    rms = a (h / d)^p kappa^q

within a factor of two. Light that falls on what is seen follows one such law; light that only shines through, seen from
the dark side, others: there all exitance has come across edges and thin parts, which the nodes must resolve, and in
strong absorbers around the edge of the light, where the kernel's very shape decides.
"""

from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.assignment import TENT, TSC
from milkglass.core.profiles.base import Profile, Profiles

CELLS = (20, 40, 80)  # along the longest side, where roughness is measured; between and beyond, a power law
SMOOTHEST = 1e-4  # roughness below which errors fall no further
LEAST_ERROR = 0.002  # surface samples and padding
TENT_ERROR = 0.02  # what tents add: the most of ball, knot, plates and a scan
COARSEST = 1e6  # of the finest detail: spacings beyond are not searched


@dataclass(frozen=True)
class ErrorLaw:
    """The greatest of terms min(a (h / d)^p kappa^q tau^r, b), each given as (a, p, q, r, b).

    tau = 1 - detail / mean free path is 0 without absorption and nears 1 with much; kappa counts thin slabs or not.
    """

    terms: tuple[tuple[float, float, float, float, float], ...]
    with_sheets: bool = False

    def __call__(self, profile: Profile, spacing: float, kappa: float, assignment: str = TSC) -> float:
        """Return the error to expect in a channel, for a spacing of the nodes, mm, and the roughness at it."""
        if profile.is_black:
            return 0.0
        x, tau = spacing / profile.detail, max(0.0, 1.0 - profile.detail / profile.mean_free_path)
        law = max(min(a * x**p * max(kappa, SMOOTHEST) ** q * tau**r, b) for a, p, q, r, b in self.terms)
        added = TENT_ERROR if assignment == TENT else 0.0
        return float(min(1.0, np.sqrt(law * law + LEAST_ERROR**2 + added**2)))


# Scales are a little above the fit's: 6 channels of 7 keep below. What lamps light, what an environment does, and what
# lamps shine through.
LIT = ErrorLaw(((0.025, 1.02, 0.35, 0.0, 1.0),))
SURROUNDED = replace(LIT, with_sheets=True)
SHINING = ErrorLaw(((0.10, 1.60, 0.42, 0.0, 1.0), (0.0057, 3.4, 0.0, 2.0, 0.3)))


@dataclass(frozen=True)
class Roughness:
    """Roughness kappa(h) of a surface, how far it is from planes in cells of size h.

    Attributes
    ----------
    sizes : cell sizes h, mm, falling
    values : kappa at them, in [0, 1/3]
    with_sheets : (1 - |mean normal|^2) / 2 at them, in [0, 1/2]
        Where both sides of a flat slab lie in a cell they count too.
    """

    sizes: tuple[float, ...]
    values: tuple[float, ...]
    with_sheets: tuple[float, ...]

    def __call__(self, size: float, *, with_sheets: bool = False) -> float:
        """Return kappa at any cell size, mm: a power law between and beyond, never above the coarsest."""
        values = self.with_sheets if with_sheets else self.values
        x, y = np.log(self.sizes[::-1]), np.log(np.maximum(values[::-1], 1e-12))
        y = np.maximum.accumulate(y)  # a larger cell is never smoother, whatever its place says
        t = np.log(size)
        if t < x[0]:
            slope = np.clip((y[1] - y[0]) / (x[1] - x[0]), 0.0, 2.0)  # 2: any smooth surface
            return float(np.exp(y[0] + slope * (t - x[0])))
        return float(np.exp(np.interp(t, x, y)))


def roughness(samples: SurfaceSamples, bounds: Array) -> Roughness:
    """Measure how far a surface is from planes, cell by cell.

    In a cell with the normals' second moments T = sum n n^T dA / sum dA, kappa = (1 - tr T^2) / 2: 0 on a plane and on
    both sides of a flat slab, 1/3 for normals all around. The thin-slab term of `core.transport.ewald` knows the other
    side where lamps light it; where an environment does it does not, hence `with_sheets`.

    Parameters
    ----------
    samples : SurfaceSamples
        As dense as the finest of `CELLS` at least.
    bounds : (2, 3) array
        Lowest and highest corner, mm.
    """
    low, high = np.asarray(bounds, np.float64)
    longest = float((high - low).max())
    normals, areas = samples.normals.astype(np.float64), samples.areas.astype(np.float64)
    pairs = [(i, j, normals[:, i] * normals[:, j] * areas) for i in range(3) for j in range(i, 3)]
    values: list[float] = []
    sheets: list[float] = []
    for cells in CELLS:
        size = longest / (cells - 1)
        shape = tuple(np.floor((high - low) / size).astype(int) + 1)
        place = np.minimum(np.floor((samples.points - low) / size).astype(int), np.array(shape) - 1)
        cell = np.ravel_multi_index(tuple(np.maximum(place, 0).T), shape)
        area = np.bincount(cell, areas)
        square = sum((1.0 if i == j else 2.0) * np.bincount(cell, moment) ** 2 for i, j, moment in pairs)
        mean = sum(np.bincount(cell, normals[:, i] * areas) ** 2 for i in range(3))
        for found, part in ((values, square), (sheets, mean)):
            spread = area - part / np.maximum(area, np.finfo(np.float64).tiny)
            found.append(0.5 * float(max(spread.sum(), 0.0) / max(area.sum(), np.finfo(np.float64).tiny)))
    return Roughness(tuple(longest / (cells - 1) for cells in CELLS), tuple(values), tuple(sheets))


def predicted_error(
    law: ErrorLaw, profiles: Profiles, spacing: float, shape: Roughness, assignment: str = TSC
) -> float:
    """Return the rms error over rms exitance to expect in the worst channel, for a spacing of the nodes, mm."""
    kappa = shape(spacing, with_sheets=law.with_sheets)
    return max(law(profile, spacing, kappa, assignment) for profile in profiles)


def spacing_for(target: float, law: ErrorLaw, profiles: Profiles, shape: Roughness, assignment: str = TSC) -> float:
    """Return the spacing, mm, at which `predicted_error` meets the target, by bisection; infinite where all do."""
    details = [profile.detail for profile in profiles if not profile.is_black]
    if not details:
        return np.inf
    low, high = 1e-6 * min(details), COARSEST * max(details)
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        fits = predicted_error(law, profiles, middle, shape, assignment) <= target
        low, high = (middle, high) if fits else (low, middle)
    return low
