"""Diffusion profiles as curves over the radius: to be plotted, and to be written as a table.

Radii are even in log r. They begin far inside a mean free path, where some profiles diverge as 1 / r and hold next to
no light, and end where next to none is left.
"""

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.profiles.radial import flux_radius
from milkglass.core.profiles.table import MAX_RADIUS, MAX_VALUE, TableProfile

CURVE_POINTS = 512
FIRST_RADIUS = 1e-4  # of the shortest mean free path
FLUX_BEYOND = 1e-9  # share of the flux beyond the last radius
LAST_RADIUS = 1e5  # of the longest mean free path, for tails of 1 / r^3


def reach(profiles: Profiles, rest: float = FLUX_BEYOND) -> float:
    """Return the radius beyond which no channel has more than a share `rest` of its flux, mm; 0 if all are black."""
    return max((_reach(profile, rest) for profile in profiles if not profile.is_black), default=0.0)


def _reach(profile: Profile, rest: float) -> float:
    far = flux_radius(lambda r: profile.total(r), 1.0 - rest, profile.mean_free_path)
    return min(far, LAST_RADIUS * profile.mean_free_path)


def curve_radii(profiles: Profiles) -> Array:
    """Return the radii at which profiles are sampled: (n,) mm, rising, > 0; the radii of tables are among them."""
    bright = [profile for profile in profiles if not profile.is_black]
    shortest = min((profile.mean_free_path for profile in bright), default=1.0)
    last = min(MAX_RADIUS, max(reach(bright), shortest))
    radii = np.geomspace(min(FIRST_RADIUS * shortest, 0.5 * last), last, CURVE_POINTS)
    for profile in bright:
        tabulated = np.asarray(getattr(profile, "radii", ()), np.float64)
        radii = np.union1d(radii, tabulated[tabulated > 0.0])
    return radii


def sampled(profiles: Profiles, radii: Array) -> Array:
    """Return R_d of red, green and blue at radii (n,) mm: (3, n) mm^-2."""
    return np.stack([np.zeros_like(radii) if p.is_black else p.radial(radii) for p in profiles])


def table_text(profiles: Profiles, remark: str = "") -> str:
    """Return CSV of radius_mm, R, G, B, as `core.profiles.table.parse_table` reads it; `remark` is one line on top.

    Read back, it is the same profile within 3e-4 of each channel's total, constant nearer than the first radius; of
    tables the very same.
    """
    if all(isinstance(profile, TableProfile) for profile in profiles):
        radii = np.array(profiles[0].radii)  # type: ignore[attr-defined]
    else:
        radii = curve_radii(profiles)
    # Splines of a table may rise by rounding, and what diverges is as high as a table may be.
    values = np.minimum(np.minimum.accumulate(sampled(profiles, radii), axis=1), MAX_VALUE)
    lines = [f"# {' '.join(remark.split())}"] * bool(remark) + ["radius_mm,R,G,B"]
    lines += [",".join(f"{value:.9g}" for value in row) for row in np.column_stack([radii, *values])]
    return "\n".join(lines) + "\n"
