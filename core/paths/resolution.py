"""Which light is worth following in an object: where it scatters at all, where nodes resolve its free paths.

There it is followed from collision to collision.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.medium import DeltaEddington, Medium
from milkglass.core.provenance import chosen


@dataclass(frozen=True)
class ResolvedConstants:
    """Where free paths are long enough for nodes, and which light is worth following."""

    least_path: float = chosen(1.5, "mean free paths over a cell up to which nodes do not resolve them", "ball")
    full_path: float = chosen(2.5, "mean free paths over a cell from which on nodes resolve them", "ball")
    least_scattered: float = chosen(
        0.005, "share of the light that crosses an object which scatters, below which none is followed", "ball"
    )
    least_albedo: float = chosen(0.02, "albedo below which light that scatters twice is left out", "ball")


RESOLVED = ResolvedConstants()


def scattered_share(medium: Medium, chord: float) -> float:
    """Return the share of light that scatters on a way of `chord`, mm, through a medium: a' (1 - e^-s_t' l)."""
    return float(-medium.albedo * np.expm1(-medium.sigma_t_prime * chord))


def scatters(media: Sequence[Medium], chord: float) -> bool:
    """Return whether more light than is to be left out scatters in an object of a mean `chord`, mm."""
    return any(scattered_share(medium, chord) >= RESOLVED.least_scattered for medium in media)


def resolved_share(medium: Medium, grid: LayerGrid) -> float:
    """Return by how much nodes resolve a medium's free paths, [0, 1]; those that are not evenly spaced do not.

    Paths are those between the collisions that are followed, without the forward peak.
    """
    if grid.layer_distance != grid.texel:
        return 0.0
    cells = medium.delta_eddington().mean_free_path / grid.texel
    return float(np.clip((cells - RESOLVED.least_path) / (RESOLVED.full_path - RESOLVED.least_path), 0.0, 1.0))


def scatters_once(medium: Medium, grid: LayerGrid) -> bool:
    """Return whether nodes resolve a medium's free paths, and what scatters twice in it is left out."""
    return not medium.is_black and medium.albedo < RESOLVED.least_albedo and resolved_share(medium, grid) == 1.0


def scaled(medium: Medium, grid: LayerGrid) -> DeltaEddington:
    """Return a medium as light crosses it between collisions that are followed.

    Its forward peak counts as unscattered as far as nodes resolve its free paths: what the surface lets out in their
    stead is all that leaves by reduced coefficients, and what crosses unscattered by these completes it.
    """
    return medium.delta_eddington(resolved_share(medium, grid))


def needs_beams(medium: Medium, grid: LayerGrid) -> bool:
    """Return whether a medium scatters light that nodes resolve."""
    return not medium.is_black and resolved_share(medium, grid) > 0.0
