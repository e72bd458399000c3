"""The interface of diffusion profiles: a radial function of one colour channel, compared by value."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.material.library import Material


class Profile(Protocol):
    """A radial diffusion profile R_d of one colour channel; `core.profiles.dipole.Dipole` is one."""

    def __hash__(self) -> int:
        """Return the same for equal profiles, which share what is computed of them."""

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
        """Return R_d at 3-D distances rho (mm), mm^-2; the shape of rho."""

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr, the integral over a plane at distances e (mm)."""

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return the part of `total` inside a disc of radius r (mm; may be infinite) in that plane."""


Profiles = Sequence[Profile]  # R, G, B


@dataclass(frozen=True)
class Family:
    """The profiles of one name, one for each material and channel.

    Attributes
    ----------
    channel : callable
        Returns the profile of a material in a channel (0, 1, 2) in which it scatters.
    reflectance : callable, optional
        Returns the diffuse reflectance T(0) for a reduced albedo in [0, 1] and an index of refraction, where that is
        faster than `total` of a profile.
    has_given_total : bool
        Whether T(0) is not the profile's own result: it is set to the standard dipole's, or the material has no part in
        it.
    has_given_widths : bool
        Whether the material's mean free path changes nothing of its widths.
    """

    channel: Callable[[Material, int], Profile]
    reflectance: Callable[[float, float], float] | None = None
    has_given_total: bool = False
    has_given_widths: bool = False
