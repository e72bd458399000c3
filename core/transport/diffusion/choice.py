"""Choice of the nodes of `diffusion`, and of its surface samples."""

import numpy as np

from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.grid.assignment import TSC
from milkglass.core.grid.kernels import Kernels
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import Roughness
from milkglass.core.transport.diffusion.solver import TOLERANCE, DiffusionTransport
from milkglass.core.transport.quality import COARSEST, DEFAULT_ERROR_TARGET, Quality, QualityRequest, survey_spacing

# Nodes at the default target, and how they grow: the error falls with the square of their distance, or nearly, and no
# law foretells it for a shape. With three to spare 62 are 65, and half of them 33, whose transforms of 128 and 64 take
# half the time of those of their neighbours.
DIFFUSION_NODES, DIFFUSION_POWER, DIFFUSION_FINEST = 62, 0.55, 160


def choose_quality(
    request: QualityRequest, profiles: Profiles, mesh: Mesh, shape: Roughness | None, *, sharp_light: bool = True
) -> Quality:
    """Return the quality for a request, without a predicted error; see `core.transport.quality.choose_quality`."""
    tighter = DEFAULT_ERROR_TARGET / (request.error_target or DEFAULT_ERROR_TARGET)
    nodes = int(np.clip(round(DIFFUSION_NODES * tighter**DIFFUSION_POWER), COARSEST, DIFFUSION_FINEST))
    return Quality(request.method, request.layers, request.resolution or nodes, TSC)


def make_transport(quality: Quality, kernels: Kernels) -> DiffusionTransport:
    """Make the transport of a quality."""
    tolerance = TOLERANCE if quality.tolerance is None else quality.tolerance
    return DiffusionTransport(
        n_layers=quality.layers, resolution=quality.resolution, tolerance=tolerance, kernels=kernels
    )


def sample_spacing(mesh: Mesh, request: QualityRequest, resolution: int) -> float:
    """Return the distance of surface samples, mm, which are then merged into patches."""
    return min(survey_spacing(mesh), longest_side(mesh) / (resolution - 1))
