"""What a diffusion profile is: a radial function of one colour channel, compared by value."""

from collections.abc import Sequence
from typing import Protocol

import numpy.typing as npt

from milkglass.core.arrays import Array


class Profile(Protocol):
    """A radial diffusion profile of one colour channel, compared by value; `core.profiles.dipole.Dipole` is one."""

    def __hash__(self) -> int:
        """Equal profiles share what is computed of them."""

    @property
    def is_black(self) -> bool:
        """Whether the profile is 0 everywhere."""

    @property
    def mean_free_path(self) -> float:
        """The shortest length over which the profile bends, mm."""

    @property
    def detail(self) -> float:
        """Length that a coarse grid must resolve to transport light through the object, mm."""

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Value at 3-D distance rho (mm), mm^-2."""

    def total(self, e: npt.ArrayLike) -> Array:
        """Integral over a plane at distance e."""

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Integral over the disc of radius r in a plane at distance e."""


Profiles = Sequence[Profile]  # R, G, B
