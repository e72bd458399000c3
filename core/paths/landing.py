"""Light that crosses clear or murky matter, or is mirrored by it, and ends on a plane below: caustics in its shadow.

Rays depend on the surface, the lights and the index of refraction alone; matter attenuates them afterwards.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.light.ground import SIDE, GroundPlane
from milkglass.core.paths.beams import Emitted, tracked_rays
from milkglass.core.paths.events import most_events
from milkglass.core.paths.surface import Surface

# Places, the standard deviation of a Gaussian over what ends on the map: of a lamp, and from all around, which has no
# caustics as sharp.
OF_LAMP, OF_SURROUNDINGS = 0.7, 2.0


@dataclass(frozen=True, eq=False)
class Landings:
    """Where k rays of light end on the map of a plane.

    Attributes
    ----------
    ends : (k,) int64
        Place of the map.
    lengths : (k, m) float32
        Of the way in each kind of matter that scatters, mm.
    power : (k, 3) float32
        R, G and B, but for what that matter takes away.
    smoothed : float
        Standard deviation of a Gaussian over what ends on the map, places.
    """

    ends: Ints
    lengths: Float32
    power: Float32
    smoothed: float

    def irradiance(self, plane: GroundPlane, extinctions: Float32) -> Float32:
        """Return the irradiance at the places of the plane's map, (n, 3).

        `extinctions` are those of each kind of matter for R, G and B, (m, 3) 1/mm.
        """
        flux = self.power * np.exp(-(self.lengths @ extinctions))
        sums = np.stack([np.bincount(self.ends, column, SIDE**2) for column in flux.T], axis=1).astype(np.float64)
        # Areas are smoothed likewise, so that even light stays even.
        return np.asarray(self._smooth(sums) / self._smooth(plane.areas()[:, None]), np.float32)

    def _smooth(self, values: Array) -> Array:
        width = self.smoothed, self.smoothed, 0.0
        return np.asarray(gaussian_filter(values.reshape(SIDE, SIDE, -1), width)).reshape(len(values), -1)


def landed(surface: Surface, light: Emitted, plane: GroundPlane, *, of_lamp: bool) -> Landings:
    """Return where light ends on a plane that has met a surface; of a lamp with what has only been mirrored by it."""
    parts = list[tuple[Ints, Float32, Float32]]()
    tracked = tracked_rays(surface, light.origins, light.directions, events=most_events(surface))
    for number, (event, _, travelled) in enumerate(tracked):
        escaped = event.escaped
        ends = plane.ends(escaped.origins, escaped.directions)
        mirrored = of_lamp and number > 0  # rays that escape before have met nothing
        kept = np.flatnonzero((ends >= 0) & (mirrored | (escaped.parents >= 0)))
        parents = escaped.parents[kept]
        lengths = np.zeros((len(kept), surface.kinds), np.float32)
        lengths[parents >= 0] = travelled[parents[parents >= 0]]
        if surface.is_nested and not of_lamp:  # clear parts cast no shadow that this would lighten
            in_matter = lengths.any(axis=1)
            kept, lengths = kept[in_matter], lengths[in_matter]
        parts.append((ends[kept], lengths, light.power[escaped.sources[kept]] * escaped.weights[kept]))
    smoothed = OF_LAMP if of_lamp else OF_SURROUNDINGS
    if not parts:
        none = np.empty((0, surface.kinds), np.float32), np.empty((0, 3), np.float32)
        return Landings(np.empty(0, np.int64), *none, smoothed)
    ends_of_all, lengths_of_all, power = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Landings(ends_of_all, lengths_of_all, power, smoothed)
