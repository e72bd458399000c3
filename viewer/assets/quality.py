"""Quality: layers and resolution from what a scene asks for, or from the error it accepts."""

from dataclasses import dataclass, replace

import numpy as np

from milkglass.core.geometry.mesh import Mesh, longest_side
from milkglass.core.grid.assignment import TENT, TSC
from milkglass.core.grid.kernels import CONVOLVERS
from milkglass.core.profiles.base import Profiles
from milkglass.core.transport.accuracy import LIT, SHINING, SURROUNDED, Roughness, predicted_error, spacing_for
from milkglass.core.transport.base import Transport
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from milkglass.core.transport.ewald import LOOSE_TAIL, TAIL, EwaldTransport
from milkglass.core.transport.layered import LayeredTransport
from milkglass.core.transport.methods import METHODS, Method
from milkglass.viewer.scene.settings import TransportSettings

AnyTransport = Transport | DiffusionTransport

DEFAULT_LAYERS, DEFAULT_RESOLUTION = 8, 128  # of `layered`
DEFAULT_ERROR_TARGET = 0.02
# Nodes of `diffusion` at the default target, and how they grow: its error falls with the square of their distance, or
# nearly, and no law foretells it for a shape. With three to spare 62 are 65, and half of them 33, whose transforms of
# 128 and 64 take half the time of those of their neighbours.
DIFFUSION_NODES, DIFFUSION_POWER, DIFFUSION_FINEST = 62, 0.55, 160
COARSEST, FINEST = 32, 512  # nodes along the longest side: below, detail of the light is lost
STEP = 4  # chosen resolutions are multiples of it: a material that changes a little keeps its grid and all plans on it
# Padded nodes, over the channels, that an error target may choose, in those of the paper's setting. Where they meet the
# default target, or nearly, they may take a few times the paper's time, which a picture at rest can wait for; where
# they would miss it by far, no more than the paper's. A target that a person has set may take longer.
PAPER_NODES = 3 * 4 * 512 * 512
NODES, NODES_OUT_OF_REACH, NODES_ASKED_FOR = 4 * PAPER_NODES, 3 * PAPER_NODES // 5, 16 * PAPER_NODES
NEAR = 2.0  # of the target
SURVEY = 80  # nodes along the longest side whose surface samples serve all coarser grids and measure the shape
SAMPLE_EDGE = 1.5  # longest edge of a surface sample's piece, in texels: about two samples a texel


@dataclass(frozen=True)
class Quality:
    """What transport is made for.

    Attributes
    ----------
    method : str
    layers : int or None
        None: as dense as the nodes.
    resolution : int
    assignment : str
        `core.grid.assignment.TENT` or `TSC`; the former for `layered`.
    predicted_error, predicted_lit : float or None
        Rms of exitance to expect: the most that any view has, and what those have that light falls on. None where no
        prediction exists (`layered`).
    error_target : float or None
        What was asked for; None where the resolution was.
    asked_for : bool
        Whether a person set the target.
    tail : float
        See `core.transport.ewald.EwaldTransport`.
    open_surface : float or None
        Where `diffusion` was asked for and the surface is not closed: the row sum furthest from -1/2.
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
    open_surface: float | None = None

    @property
    def facts(self) -> Method:
        """Facts of the method, of the registry of transports."""
        return METHODS[self.method]

    @property
    def grid_alone(self) -> "Quality":
        """What transport itself depends on."""
        return Quality(self.method, self.layers, self.resolution, self.assignment, tail=self.tail)

    @property
    def error(self) -> float:
        """The predicted one; infinite where there is none."""
        return np.inf if self.predicted_error is None else self.predicted_error

    @property
    def summary(self) -> str:
        """What was chosen, and the error to expect where a prediction exists, in a few words."""
        if self.facts.layers_follow_view:
            return f"{self.method}, {self.layers} layers of {self.resolution} texels"
        if self.predicted_error is None:
            return f"{self.method}, {self.resolution} nodes along the object"
        layers = "" if self.layers is None else f", {self.layers} layers"
        return f"{self.method}, {self.resolution} nodes along the object{layers}, {self.expected}"

    @property
    def expected(self) -> str:
        """The error to expect, in a few words."""
        if self.predicted_error is None or self.predicted_lit is None:
            return "no prediction"
        if round(self.predicted_lit, 3) == round(self.predicted_error, 3):
            return f"about {percent(self.predicted_error)} error to expect"
        return (
            f"about {percent(self.predicted_lit)} error to expect where light falls, up to about "
            f"{percent(self.predicted_error)} where it only shines through"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what was asked for and cannot be had."""
        return tuple(sentence for sentence in (self.fallback, self.warning) if sentence is not None)

    @property
    def fallback(self) -> str | None:
        """One sentence where `ewald` had to take the place of `diffusion`."""
        if self.open_surface is None:
            return None
        return (
            "transport diffusion needs a closed surface that is wound outwards, with a row sum of -0.5 everywhere, and "
            f"here it is {self.open_surface:.3f} at worst: rendered with ewald"
        )

    @property
    def warning(self) -> str | None:
        """One sentence where the target cannot be met."""
        if self.error_target is None or self.predicted_error is None or self.predicted_error <= self.error_target:
            return None
        fix = "set transport.error_target to let it take longer, or transport.resolution"
        if self.asked_for:
            fix = "set transport.resolution for more"
        return (
            f"{self.resolution} nodes along the object are too coarse for this material and shape to meet an error of "
            f"{percent(self.error_target)}: {self.expected}; {fix}"
        )


def choose_quality(
    settings: TransportSettings, profiles: Profiles, mesh: Mesh, shape: Roughness | None, sharp_light: bool = True
) -> Quality:
    """Fill in what the settings leave open, for a material's profiles, an object and its light.

    Parameters
    ----------
    settings, profiles, mesh
    shape : from `core.transport.accuracy.roughness`
        None will do for `layered`.
    sharp_light : bool
        Whether a light casts shadows; an environment alone does not.
    """
    if settings.method == "diffusion":
        return Quality("diffusion", settings.layers, settings.resolution or _diffusion_nodes(settings), TSC)
    if settings.method == "layered":
        return Quality("layered", settings.layers or DEFAULT_LAYERS, settings.resolution or DEFAULT_RESOLUTION, TENT)
    assert shape is not None  # else `ewald` would quietly become something else
    longest = longest_side(mesh)
    law, lit_law = (SHINING, LIT) if sharp_light else (SURROUNDED, SURROUNDED)
    target = None if settings.resolution is not None else settings.error_target or DEFAULT_ERROR_TARGET

    def made(resolution: int, assignment: str) -> Quality:
        grid = EwaldTransport(resolution=resolution, n_layers=settings.layers).grid(mesh, np.eye(3))
        spacing = max(grid.texel, grid.layer_distance)
        worst, lit = (predicted_error(one, profiles, spacing, shape, assignment) for one in (law, lit_law))
        asked = target is not None and settings.error_target is not None
        return Quality("ewald", settings.layers, resolution, assignment, worst, min(lit, worst), target, asked)

    if settings.resolution is not None:
        told = made(settings.resolution, settings.assignment or TSC)
        return replace(told, tail=TAIL if told.error <= NEAR * DEFAULT_ERROR_TARGET else LOOSE_TAIL)
    assert target is not None
    orders = (TENT, TSC) if settings.assignment is None else (settings.assignment,)
    most = _most_nodes(settings, profiles, mesh, TAIL, NODES if settings.error_target is None else NODES_ASKED_FOR)
    wanted = {order: longest / spacing_for(target, law, profiles, shape, order) + 2.0 for order in orders}
    found = [made(int(np.clip(STEP * np.ceil(n / STEP), COARSEST, most)), order) for order, n in wanted.items()]
    # Tents are read and written in a third of the time: theirs, where they need no finer grid.
    good = [q for q in found if q.error <= target]
    if good:
        return min(good, key=lambda q: q.resolution)
    best = min(found, key=lambda q: q.error)
    if best.error <= NEAR * target:
        return best
    budget = NODES_OUT_OF_REACH if settings.error_target is None else NODES_ASKED_FOR
    most = _most_nodes(settings, profiles, mesh, LOOSE_TAIL, budget)
    return replace(made(most, orders[-1]), tail=LOOSE_TAIL)


def _diffusion_nodes(settings: TransportSettings) -> int:
    tighter = DEFAULT_ERROR_TARGET / (settings.error_target or DEFAULT_ERROR_TARGET)
    return int(np.clip(round(DIFFUSION_NODES * tighter**DIFFUSION_POWER), COARSEST, DIFFUSION_FINEST))


def make_transport(quality: Quality, effort: str = "FFTW_ESTIMATE", keep: int = CONVOLVERS) -> AnyTransport:
    """Make the transport of a quality; `effort` and `keep` as of `core.grid.kernels.Kernels`."""
    if quality.method == "diffusion":
        return DiffusionTransport(n_layers=quality.layers, resolution=quality.resolution, effort=effort, keep=keep)
    if quality.method == "layered":
        return LayeredTransport(n_layers=quality.layers or 1, resolution=quality.resolution, effort=effort, keep=keep)
    return EwaldTransport(
        n_layers=quality.layers,
        resolution=quality.resolution,
        assignment=quality.assignment,
        tail=quality.tail,
        effort=effort,
        keep=keep,
    )


def survey_spacing(mesh: Mesh) -> float:
    """Longest edge of a surface sample's piece, mm, of the samples that serve most grids."""
    return float(SAMPLE_EDGE * longest_side(mesh) / (SURVEY - 1))


def sample_spacing(mesh: Mesh, settings: TransportSettings, resolution: int = SURVEY) -> float:
    """Longest edge of a surface sample's piece, mm, for a resolution that `choose_quality` found.

    The samples of `SURVEY` nodes serve every coarser grid, and finer ones come in steps: a material that changes the
    grid keeps its samples.
    """
    if settings.method == "diffusion":  # merges them into patches of its own
        return min(survey_spacing(mesh), longest_side(mesh) / (resolution - 1))
    if settings.resolution is not None or settings.method == "layered":
        return SAMPLE_EDGE * longest_side(mesh) / ((settings.resolution or DEFAULT_RESOLUTION) - 1)
    steps = max(0, int(np.ceil(2.0 * np.log2(resolution / SURVEY))))
    return float(survey_spacing(mesh) * 2.0 ** (-0.5 * steps))


def percent(share: float) -> str:
    """Return a share as per cent, two digits."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else "100 %"


def _most_nodes(settings: TransportSettings, profiles: Profiles, mesh: Mesh, tail: float, budget: int) -> int:
    """Largest resolution whose padded grid keeps within a budget, by bisection."""
    low, high = COARSEST, FINEST + 1
    while high - low > 1:
        middle = (low + high) // 2
        transport = EwaldTransport(resolution=middle, n_layers=settings.layers, tail=tail)
        fits = padded_nodes(transport, profiles, mesh) <= budget
        low, high = (middle, high) if fits else (low, middle)
    return low // STEP * STEP


def padded_nodes(transport: EwaldTransport, profiles: Profiles, mesh: Mesh) -> int:
    """Nodes that the transforms have at least, over the channels."""
    grid = transport.grid(mesh, np.eye(3))
    return sum(transport.shape(grid, p, mesh.area).least_nodes for p in profiles if not p.is_black)
