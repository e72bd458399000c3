"""Tabulated profiles, measured or drawn: radius in mm and R_d of red, green and blue in mm^-2, as text.

Between the radii log R_d is interpolated by PCHIP (Fritsch and Carlson 1980), which is monotone and leaves exponentials
exponential. Nearer than the first radius R_d is constant. Beyond the last it goes on as the exponential of the last two
values; a table that ends in zeros falls to the first of them in a straight line instead, and is 0 from there on.
"""

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Family, Profile
from milkglass.core.profiles.radial import flux_radius, hankel

HEADER = ("radius_mm", "r", "g", "b")
MAX_RADIUS, MAX_VALUE = 1e6, 1e12  # mm, mm^-2
MAX_ROWS = 10_000
MAX_TOTAL = 1.001  # rounding, not energy
ROW_PIECES = 32  # of a row, over which the integral is interpolated: 1e-7 where R_d falls by a factor of 40


@dataclass(frozen=True)
class TableProfile:
    """The profile of one colour channel.

    Parameters
    ----------
    radii : mm, rising, >= 0
    values : mm^-2, not rising, >= 0; the last two that are not 0 differ, or a 0 follows
    """

    radii: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def is_black(self) -> bool:
        """Whether no light leaves by scattering."""
        return self.values[0] == 0.0

    @property
    def mean_free_path(self) -> float:
        """The shortest length over which R_d falls by e, mm."""
        return _curve(self).shortest

    @property
    def detail(self) -> float:
        """A third of the radius of half of the flux, as of a dipole, mm; at most the `mean_free_path`."""
        return _curve(self).detail

    @property
    def tail_share(self) -> float:
        """Share of the flux beyond the last radius, in [0, 1]."""
        return float(self.total(self.radii[-1]) / self.total(0.0)) if not self.is_black else 0.0

    def radial(self, rho: npt.ArrayLike) -> Array:
        """Return R_d at 3-D distances rho (mm), in mm^-2."""
        return _curve(self).value(np.asarray(rho, np.float64))

    def total(self, e: npt.ArrayLike) -> Array:
        """Return T(e) = 2 pi int_0^inf R_d(sqrt(r^2 + e^2)) r dr."""
        return _curve(self).beyond(np.asarray(e, np.float64))

    def total_within(self, r: npt.ArrayLike, e: npt.ArrayLike = 0.0) -> Array:
        """Return 2 pi int_0^r R_d(sqrt(r'^2 + e^2)) r' dr'; r in mm, may be infinite."""
        e = np.asarray(e, np.float64)
        return self.total(e) - self.total(np.hypot(np.asarray(r, np.float64), e))

    def spectrum(self, k: npt.ArrayLike, e: float = 0.0) -> Array:
        """Return the 2-D Fourier transform of R_d(sqrt(r^2 + e^2)) at angular frequencies k > 0 (mm^-1), numerical."""
        return hankel(self.radial, k, e, self.mean_free_path, self.radii)


class _Curve:
    """The interpolant of a table, and its integral."""

    def __init__(self, profile: TableProfile) -> None:
        radii, values = np.array(profile.radii), np.array(profile.values)
        bright = int(np.count_nonzero(values))
        ends = bright < len(radii)  # in a zero
        r, log = radii[:bright], np.log(values[:bright])
        self._first, self._last = float(r[0]), float(r[-1])
        self._ends, self._zero = ends, float(radii[bright]) if ends else math.inf
        self._at = float(values[0]), float(values[bright - 1])
        lengths = np.diff(r) / np.maximum(-np.diff(log), 1e-300)
        self._decay = float(lengths[-1]) if not ends else self._zero - self._last
        self._log = PchipInterpolator(r, log) if bright > 1 else None
        if self._log is not None:
            self._beyond = self._integral(r)
        self.shortest = float(min([*lengths, self._decay]))
        half = flux_radius(lambda x: self.beyond(np.array(x)), 0.5, self._last or self._decay)
        self.detail = min(self.shortest, half / 3.0)

    def _integral(self, r: Array) -> CubicHermiteSpline:
        """Return the logarithm of B, the integral beyond a radius, between the first and the last radius r."""
        assert self._log is not None
        fine = np.unique(np.concatenate([np.linspace(a, b, ROW_PIECES + 1) for a, b in itertools.pairwise(r)]))
        nodes, weights = np.polynomial.legendre.leggauss(6)
        half = 0.5 * np.diff(fine)
        t = fine[:-1] + half + half * nodes[:, None]
        flux = 2.0 * np.pi * half * (weights[:, None] * np.exp(self._log(t)) * t).sum(axis=0)
        rest = float(self._outer(np.array(self._last)))
        beyond = np.append(np.cumsum(flux[::-1])[::-1] + rest, rest)
        return CubicHermiteSpline(fine, np.log(beyond), -2.0 * np.pi * np.exp(self._log(fine)) * fine / beyond)

    def value(self, rho: Array) -> Array:
        """Return R_d at radii rho."""
        inside = np.clip(rho, self._first, self._last)
        within = np.full(rho.shape, self._at[1]) if self._log is None else np.exp(self._log(inside))
        excess = np.minimum(np.maximum(rho - self._last, 0.0), 1e300)
        fall = np.maximum(0.0, 1.0 - excess / self._decay) if self._ends else np.exp(-excess / self._decay)
        return np.asarray(within * fall)

    def beyond(self, rho: Array) -> Array:
        """Return B(rho) = 2 pi int_rho^inf R_d t dt."""
        inside = np.clip(rho, self._first, self._last)
        core = np.pi * self._at[0] * (self._first**2 - np.square(np.minimum(rho, self._first)))
        rest = self._outer(np.array(self._last))
        within = rest if self._log is None else np.exp(self._beyond(inside))
        return np.asarray(np.where(rho > self._last, self._outer(np.maximum(rho, self._last)), within + core))

    def _outer(self, rho: Array) -> Array:
        """Return B from the last radius onwards at which R_d is not 0: of an exponential, or a line that ends in 0."""
        value, decay = self._at[1], self._decay
        if not self._ends:
            finite = np.minimum(rho, self._last + 700.0 * decay)
            return np.asarray(2.0 * np.pi * value * np.exp(-(finite - self._last) / decay) * decay * (finite + decay))
        left = np.maximum(self._zero - rho, 0.0)
        return np.asarray(2.0 * np.pi * value / decay * left * left * (0.5 * self._zero - left / 3.0))


@functools.lru_cache(maxsize=16)
def _curve(profile: TableProfile) -> _Curve:
    return _Curve(profile)


def parse_table(text: str, name: str) -> tuple[TableProfile, TableProfile, TableProfile]:
    """Read the red, green and blue profiles of a CSV text: radius_mm, R, G, B; a header, blanks and # lines may be.

    Parameters
    ----------
    text : str
    name : str
        What messages call it.

    Raises
    ------
    InputError
        Naming the line, what is wrong there and what is wanted.
    """
    rows: list[tuple[float, ...]] = []
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        fields = [field.strip() for field in line.split("#")[0].split(",")]
        if fields == [""] or (not rows and tuple(field.casefold() for field in fields) == HEADER):
            continue
        where = f"{name}, line {number}"
        rows.append(_row(fields, rows[-1] if rows else None, where))
        if len(rows) > MAX_ROWS:
            raise InputError(f"{where}: a profile has at most {MAX_ROWS} radii")
    if len(rows) < 2:
        raise InputError(f"{name}: a profile needs 2 radii at least; write lines of radius_mm, R, G, B")
    radii = tuple(row[0] for row in rows)
    red, green, blue = (_profile(radii, tuple(row[i] for row in rows), c, name) for i, c in enumerate("RGB", start=1))
    return red, green, blue


def _row(fields: list[str], before: tuple[float, ...] | None, where: str) -> tuple[float, ...]:
    try:
        row = tuple(float(field) for field in fields)
    except ValueError:
        row = ()
    if len(row) != 4 or not all(map(math.isfinite, row)):
        raise InputError(f"{where}: expected 4 numbers (radius_mm, R, G, B), not {','.join(fields)[:60]!r}")
    if not 0.0 <= row[0] <= MAX_RADIUS or not all(0.0 <= value <= MAX_VALUE for value in row[1:]):
        raise InputError(
            f"{where}: a radius is from 0 to {MAX_RADIUS:g} mm and a value from 0 to {MAX_VALUE:g} per mm^2"
        )
    if before is not None and row[0] <= before[0]:
        raise InputError(f"{where}: the radius {row[0]:g} mm does not rise above {before[0]:g} mm of the line before")
    for channel, value, last in zip("RGB", row[1:], (before or row)[1:], strict=True):
        if value > last:
            raise InputError(f"{where}: {channel} rises from {last:g} to {value:g}; profiles fall with the radius")
    return row


def _profile(radii: tuple[float, ...], values: tuple[float, ...], channel: str, name: str) -> TableProfile:
    profile = TableProfile(radii, values)
    if profile.is_black:
        return profile
    if values[-1] > 0.0 and values[-1] == values[-2]:
        raise InputError(f"{name}: {channel} does not fall at its end, so that its tail has none; add a row of 0")
    total = float(profile.total(0.0))
    if total > MAX_TOTAL:
        raise InputError(
            f"{name}: {channel} returns {total:.3g} times the light that enters (2 pi int R r dr); values are per mm^2"
        )
    return profile


def _channel(material: Material, channel: int) -> Profile:
    raise InputError("the profile table needs a file of radii and values")


FAMILY = Family(_channel, has_given_total=True, has_given_widths=True)
