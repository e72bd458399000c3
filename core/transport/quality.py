"""Quality: layers and resolution from what a scene asks for, or from the error that it accepts.

Every method chooses for itself: its module, the `home` of its row in `core.transport.methods`, has functions of the
three names below.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.grid.assignment import TENT
from milkglass.core.grid.kernels import MAX_CONVOLVERS, Kernels
from milkglass.core.material.fresnel import hemispherical_transmittance
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import Roughness
from milkglass.core.transport.base import SeparableTransport
from milkglass.core.transport.methods import METHODS, Method

DEFAULT_ERROR_TARGET = 0.02
COARSEST = 32  # nodes along the longest side: below, detail of the light is lost
SURVEY = 80  # nodes along the longest side whose surface samples serve all coarser grids and measure the shape
SAMPLE_EDGE = 1.5  # longest edge of a surface sample's piece, in texels: about two samples a texel
# Padding: share of a channel's reflectance that may wrap around its box. Next to nothing, for a ball's dark side shows
# LOOSE_TAIL; enough where the nodes err by more.
TAIL, LOOSE_TAIL = 1e-4, 0.02


class QualityRequest(Protocol):
    """What a scene asks of its transport, as `viewer.scene.settings.TransportSettings` has it; None leaves it open."""

    @property
    def method(self) -> str:
        """Return the name of the method in `core.transport.methods`."""

    @property
    def layers(self) -> int | None:
        """Return the wanted layers over the object's depth, or its z extent."""

    @property
    def resolution(self) -> int | None:
        """Return the wanted texels along the longer side of a layer, or nodes along the object's longest side."""

    @property
    def error_target(self) -> float | None:
        """Return the wanted rms error of exitance."""

    @property
    def assignment(self) -> str | None:
        """Return the wanted assignment, `core.grid.assignment.TENT` or `TSC`."""


@dataclass(frozen=True)
class Quality:
    """What a transport is made for.

    Attributes
    ----------
    method : str
    layers : int or None
        None: as dense as the nodes.
    resolution : int
    assignment : str
        `core.grid.assignment.TENT` or `TSC`.
    predicted_error, predicted_lit : float or None
        Rms of exitance to expect: the most that any view has, and what those have that light falls on. None where no
        prediction exists.
    error_target : float or None
        What was asked for; None where the resolution was.
    asked_for : bool
        Whether a person set the target.
    tail : float
        See `core.transport.ewald.EwaldTransport`.
    instead_of : str or None
        The method that was asked for, where it needs a closed surface and this is none.
    open_surface : float or None
        Then: the row sum furthest from -1/2.
    tolerance : float or None
        Relative residual at which a method that solves ends; its usual one if None.
    """

    method: str
    layers: int | None
    resolution: int
    assignment: str = TENT
    predicted_error: float | None = None
    predicted_lit: float | None = None
    error_target: float | None = None
    asked_for: bool = False
    tail: float = TAIL
    instead_of: str | None = None
    open_surface: float | None = None
    tolerance: float | None = None

    @property
    def facts(self) -> Method:
        """Return the method's row of the registry of transports."""
        return METHODS[self.method]

    @property
    def grid_alone(self) -> "Quality":
        """Return what the transport itself depends on."""
        return Quality(self.method, self.layers, self.resolution, self.assignment, tail=self.tail)

    @property
    def error(self) -> float:
        """Return the predicted error; infinite where there is none."""
        return np.inf if self.predicted_error is None else self.predicted_error

    @property
    def summary(self) -> str:
        """Say what was chosen, and the error to expect where a prediction exists, in a few words."""
        if self.facts.layers_follow_view:
            return f"{self.method}, {self.layers} layers of {self.resolution} texels"
        if self.predicted_error is None:
            return f"{self.method}, {self.resolution} nodes along the object"
        layers = "" if self.layers is None else f", {self.layers} layers"
        return f"{self.method}, {self.resolution} nodes along the object{layers}, {self.expected}"

    @property
    def expected(self) -> str:
        """Say what error is to be expected, in a few words."""
        if self.predicted_error is None or self.predicted_lit is None:
            return "no prediction"
        if round(self.predicted_lit, 3) == round(self.predicted_error, 3):
            return f"about {percent(self.predicted_error)} error to expect"
        return (
            f"about {percent(self.predicted_lit)} error to expect where light falls, up to about "
            f"{percent(self.predicted_error)} where it only shines through"
        )

    def exit_normalisation(self, eta: float) -> float:
        """Return N, sr, of L = F_t(mu) M / N, the radiance that leaves: the one place where exitance becomes radiance.

        N = int F_t mu dw = pi T, T = 2 int_0^1 F_t(mu) mu dmu from outside, where the method normalises flux, so that
        the flux of L is M; else pi, equation (7).
        """
        return np.pi * (hemispherical_transmittance(eta) if self.facts.normalises_flux else 1.0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return sentences on what was asked for and cannot be had."""
        return tuple(sentence for sentence in (self.fallback, self.warning) if sentence is not None)

    @property
    def fallback(self) -> str | None:
        """Return a sentence where the method had to take the place of another."""
        if self.instead_of is None:
            return None
        return (
            f"transport {self.instead_of} needs a closed surface that is wound outwards, with a row sum of -0.5 "
            f"everywhere, and here it is {self.open_surface:.3f} at worst: rendered with {self.method}"
        )

    @property
    def warning(self) -> str | None:
        """Return a sentence where the target cannot be met, by the keys of a scene file."""
        return self.missed_target("transport.error_target", "transport.resolution")

    def missed_target(self, error_target: str, resolution: str) -> str | None:
        """Return a sentence where the target cannot be met; `error_target` and `resolution` are named so in it."""
        if self.error_target is None or self.predicted_error is None or self.predicted_error <= self.error_target:
            return None
        fix = f"set {error_target} to let it take longer, or {resolution}"
        if self.asked_for:
            fix = f"set {resolution} for more"
        return (
            f"{self.resolution} nodes along the object are too coarse for this material and shape to meet an error of "
            f"{percent(self.error_target)}: {self.expected}; {fix}"
        )


def choose_quality(
    request: QualityRequest, profiles: Profiles, mesh: Mesh, shape: Roughness | None, *, sharp_light: bool = True
) -> Quality:
    """Fill in what a scene leaves open, for a material's profiles, an object and its light.

    Parameters
    ----------
    request, profiles, mesh
    shape : from `core.transport.accuracy.roughness`
        None will do where the method needs no roughness.
    sharp_light : bool
        Whether a light casts shadows; an environment alone does not.
    """
    quality: Quality = _home(request.method).choose_quality(request, profiles, mesh, shape, sharp_light=sharp_light)
    return quality


def make_transport(quality: Quality, effort: str = "FFTW_ESTIMATE", keep: int = MAX_CONVOLVERS) -> SeparableTransport:
    """Make the transport of a quality; `effort` and `keep` as of `core.grid.kernels.Kernels`."""
    kernels = Kernels(effort=effort, keep=keep)
    transport: SeparableTransport = _home(quality.method).make_transport(quality, kernels)
    return transport


def sample_spacing(mesh: Mesh, request: QualityRequest, resolution: int = SURVEY) -> float:
    """Return the longest edge of a surface sample's triangle, mm, for a resolution that `choose_quality` found."""
    return float(_home(request.method).sample_spacing(mesh, request, resolution))


def survey_spacing(mesh: Mesh) -> float:
    """Return the longest edge of a surface sample's triangle, mm, of the samples that serve most grids."""
    return float(SAMPLE_EDGE * longest_side(mesh) / (SURVEY - 1))


def percent(share: float) -> str:
    """Return a share as per cent, two digits."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else "100 %"


def _home(method: str) -> Any:
    return import_module(METHODS[method].home)
