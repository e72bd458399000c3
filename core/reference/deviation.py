"""Deviation of exitance from a reference, as the benchmark and `milkglass render --report` print it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array


@dataclass(frozen=True)
class Deviation:
    """Deviation of exitance M from a reference, for each channel, over the rms of the reference over the points.

    Attributes
    ----------
    rms, p99 : (3,) tuples
        Root mean square and 99th percentile of |M - M_ref|.
    ratio : (3,) tuple
        Mean of M over mean of M_ref, below 1 where light is lost.
    rms_together : float
        Root mean square over all channels, over that of the reference.
    """

    rms: tuple[float, ...]
    p99: tuple[float, ...]
    ratio: tuple[float, ...]
    rms_together: float

    @classmethod
    def of(cls, exitance: npt.ArrayLike, reference: Array) -> "Deviation":
        """Return the deviation of exitance (n, 3) from a reference (n, 3); a channel that is black in both has none."""
        M, M_ref = np.asarray(exitance, np.float64), reference
        size = np.sqrt(np.mean(M_ref**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        difference = np.abs(M - M_ref)
        mean = M_ref.mean(axis=0)
        return cls(
            rms=tuple((np.sqrt(np.mean(difference**2, axis=0)) / size).tolist()),
            p99=tuple((np.percentile(difference, 99.0, axis=0) / size).tolist()),
            ratio=tuple(np.divide(M.mean(axis=0), mean, out=np.ones(3), where=mean > 0.0).tolist()),
            rms_together=float(np.sqrt(np.mean(difference**2) / (np.mean(M_ref**2) or 1.0))),
        )

    def columns(self) -> dict[str, float]:
        """Return rms, 99th percentile and ratio of each channel by name, as a row of a CSV file has them."""
        values = {"rms": self.rms, "p99": self.p99, "mean_ratio": self.ratio}
        return {f"{name}_{c}": value for name, three in values.items() for c, value in zip("rgb", three, strict=True)}
