"""Lamps near an object, as paths from the eye meet them."""

from dataclasses import dataclass

import numpy as np

from milkglass.core.arrays import Array


@dataclass(frozen=True, eq=False)
class NearBall:
    """A ball of even radiance.

    Attributes
    ----------
    centre : (3,)
        mm.
    radius : float
        mm.
    radiance : (3,)
    """

    centre: Array
    radius: float
    radiance: Array

    def arriving(self, directions: Array, places: Array) -> Array:
        """See `core.reference.eye_paths.SeenLight.arriving`."""
        towards = self.centre - places
        along = np.einsum("ij,ij->i", towards, directions)
        beside = np.square(towards).sum(axis=1) - along**2
        return np.asarray(((along > 0.0) & (beside <= self.radius**2))[:, None] * self.radiance)


@dataclass(frozen=True, eq=False)
class NearPanel:
    """A panel of even radiance, which shines from its front.

    Attributes
    ----------
    centre, width, height, forward : (3,)
        mm; half sides, mm; unit, from its front.
    radiance : (3,)
    """

    centre: Array
    width: Array
    height: Array
    forward: Array
    radiance: Array

    def arriving(self, directions: Array, places: Array) -> Array:
        """See `core.reference.eye_paths.SeenLight.arriving`."""
        facing, towards = -(directions @ self.forward), self.centre - places
        ahead = -(towards @ self.forward)
        meets = (facing > 0.0) & (ahead > 0.0)
        off = (ahead / np.where(meets, facing, 1.0))[:, None] * directions - towards
        for side in (self.width, self.height):
            meets = meets & (np.abs(off @ side) <= side @ side)
        return np.asarray(meets[:, None] * self.radiance)
