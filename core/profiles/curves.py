"""Diffusion profiles as curves over the radius: to be looked at, and to be written as a table of one's own.

Radii are even in log r. They begin far inside a mean free path, where some profiles diverge as 1 / r and hold next to
no light, and end where next to none is left.
"""

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.profiles.radial import flux_radius
from milkglass.core.profiles.table import MAX_RADIUS, MAX_VALUE, TableProfile

POINTS = 512
NEAREST = 1e-4  # of the shortest mean free path
REST = 1e-9  # share of the flux beyond the last radius
FARTHEST = 1e5  # of the longest mean free path, for tails of 1 / r^3


def reach(profiles: Profiles, rest: float = REST) -> float:
    """Radius beyond which no channel keeps more than a share `rest` of its flux, mm; 0 if all are black."""
    return max((_reach(profile, rest) for profile in profiles if not profile.is_black), default=0.0)


def _reach(profile: Profile, rest: float) -> float:
    far = flux_radius(lambda r: profile.total(r), 1.0 - rest, profile.mean_free_path)
    return min(far, FARTHEST * profile.mean_free_path)


def curve_radii(profiles: Profiles) -> Array:
    """Radii that show profiles: (n,) mm, rising, > 0; the radii of tables are among them."""
    bright = [profile for profile in profiles if not profile.is_black]
    shortest = min((profile.mean_free_path for profile in bright), default=1.0)
    last = min(MAX_RADIUS, max(reach(bright), shortest))
    radii = np.geomspace(min(NEAREST * shortest, 0.5 * last), last, POINTS)
    for profile in bright:
        own = np.asarray(getattr(profile, "radii", ()), np.float64)
        radii = np.union1d(radii, own[own > 0.0])
    return radii


def sampled(profiles: Profiles, radii: Array) -> Array:
    """R_d of red, green and blue at radii (n,) mm: (3, n) mm^-2."""
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
