"""The fitted and chosen constants of transport `diffusion`, each with the shapes that it was fitted to or chosen on.

Everything else in the family is a formula, or a numerical parameter (nodes of a rule, size of a table, limit of an
iteration) on which no result depends beyond the error that the parameter stands for. `milkglass bench` prints the
table, and its errors against photons apart for shapes that appear here and shapes that do not.
"""

from dataclasses import dataclass

from milkglass.core.material.medium import BOUNDARY_CONDITION, BoundaryConditionConstants
from milkglass.core.paths.resolution import RESOLVED, ResolvedConstants
from milkglass.core.provenance import chosen, fitted

CONVEX_EDGES = "cube", "cylinder", "cone"
# Shapes of the benchmark whose errors against photons were in view while thresholds were chosen.
BENCHMARK = "ball", "plate", "bowl", "knot", "torus", "washer", "dish", "cube"
SCANS = "dragon", "buddha", "sculpture"


@dataclass(frozen=True)
class CurvatureConstants:
    """How the curvature of patches is measured."""

    same_face_cosine: float = chosen(0.7, "cosine between normals from which on they are of one face", *BENCHMARK)
    normal_separation: float = chosen(
        1.0, "patches that normals a right angle apart count as, so that the sides of a slab are apart", *BENCHMARK
    )
    smooth_turn: float = chosen(0.15, "radians that a surface turns over a patch up to which it is smooth", *BENCHMARK)
    edge_turn: float = chosen(0.35, "radians that a surface turns over a patch from which on it is an edge", *BENCHMARK)
    width: float = chosen(0.5, "mean free paths over which curvature is smoothed", "ball", "bowl")
    edgeless_chord: float = chosen(
        2.0, "mean free paths over mean chord at which edges have ceased to count, fading from one below", *BENCHMARK
    )


@dataclass(frozen=True)
class EdgeConstants:
    """Which patches and faces make an edge, how much each counts, and how curved an edge is."""

    plain_evenness: float = chosen(0.96, "evenness above which a patch may be of a face with edges", *SCANS)
    reach: float = chosen(2.5, "mean free paths from a patch to a piece of another face", *BENCHMARK)
    weight_width: float = chosen(1.2, "mean free paths: pieces count by exp(-(distance / width)^2)", *BENCHMARK)
    piece_size: float = chosen(1.0, "mean free paths that a piece of a face extends over", *BENCHMARK)
    other_face_cosine: float = chosen(0.3, "cosine between normals up to which pieces are two faces", *BENCHMARK)
    opposite_cosine: float = chosen(-0.8, "cosine between normals up to which faces are two sides, no edge", *BENCHMARK)
    blade_cosine: float = chosen(-0.5, "cosine between normals from which on faces make an edge in full", *BENCHMARK)
    rough_evenness: float = chosen(0.93, "evenness around a piece up to which it is of no face", *SCANS)
    flat_evenness: float = chosen(0.98, "evenness around a piece from which on it is of a face in full", *SCANS)
    sharp_turn: float = chosen(0.7, "mean free paths over which a surface turns at an edge", *BENCHMARK)
    round_turn: float = chosen(1.4, "mean free paths over which a surface turns where there is no edge", *BENCHMARK)
    resolved_spacing: float = chosen(0.5, "patches in mean free paths up to which edges are seen whole", *BENCHMARK)
    unresolved_spacing: float = chosen(1.0, "patches in mean free paths from which on no edge is seen", *BENCHMARK)
    curvature_width: float = fitted(
        0.2, "mean free paths over which an edge is curved; wider, boxes have bright frames", *CONVEX_EDGES
    )
    hidden_strip: float = chosen(
        4.0, "curvature of an edge counts where patches are smaller than this many mean free paths", *BENCHMARK
    )
    least_share: float = chosen(0.5, "share of an edge up to which a pair counts as the only one", *BENCHMARK)
    least_pairs: float = chosen(
        2e-3, "share of the patches in pairs below which these are a scan's chance edges", *SCANS
    )
    concave_tolerance: float = chosen(
        0.15,
        "mean free paths that a patch may lie above the other face's plane, if that is not quite flat",
        *BENCHMARK,
    )
    largest_loss: float = chosen(0.5, "share of a patch's light that may leave by another face", *BENCHMARK)


@dataclass(frozen=True)
class LastFlightConstants:
    """Which patches are beside a concave edge."""

    width: float = chosen(2.0, "mean free paths over which a concave edge counts", "washer", "dish", "bowl")
    flat_turn: float = chosen(0.05, "radians that an edge turns by, up to which it does not count", "dish", *SCANS)
    sharp_turn: float = chosen(0.2, "radians that an edge turns by, from which on it counts in full", "dish", *SCANS)
    convex_limit: float = chosen(
        0.1, "curvature of convex edges times mean free path beside which a concave one does not count", "dish"
    )
    rough_evenness: float = chosen(0.98, "evenness up to which an edge is a crease of a scan", *SCANS)
    even_evenness: float = chosen(0.995, "evenness from which on an edge counts in full", *SCANS)
    least_share: float = chosen(0.01, "share of the patches beside edges up to which they are not followed", *SCANS)
    full_share: float = chosen(0.02, "share of the patches beside edges from which on all are followed", *SCANS)


@dataclass(frozen=True)
class SheetConstants:
    """Which patches are of thin slabs."""

    least_parallel: float = chosen(0.6, "cosine between the sides of a slab up to which there is none", "plate", *SCANS)
    parallel: float = chosen(0.95, "cosine between the sides of a slab from which on it is one", "plate", *SCANS)


@dataclass(frozen=True)
class RegularisationConstants:
    """Directions in which the equation is all but singular, as the grid can make it."""

    weak_singular_value: float = chosen(
        0.06, "singular value of the preconditioned equation below which a direction gets no light", "ball", *SCANS
    )
    weak_eigenvalue: float = chosen(
        0.16, "eigenvalue of a point's own equation below which the neighbourhood's mean counts", *SCANS, "plate"
    )


@dataclass(frozen=True)
class HalfSpaceConstants:
    """In which matter light counts times what a half space returns over what diffusion has of it."""

    dark_albedo: float = chosen(0.7, "albedo up to which light that enters counts as a half space returns it", "ball")
    bright_albedo: float = chosen(
        0.9, "albedo from which on it counts as it is: what crosses an object is right in diffusion", "ball"
    )


@dataclass(frozen=True)
class DiffusionConstants:
    """All fitted and chosen constants of transport `diffusion`."""

    boundary_condition: BoundaryConditionConstants = BOUNDARY_CONDITION
    curvature: CurvatureConstants = CurvatureConstants()
    edges: EdgeConstants = EdgeConstants()
    last_flight: LastFlightConstants = LastFlightConstants()
    sheets: SheetConstants = SheetConstants()
    regularisation: RegularisationConstants = RegularisationConstants()
    half_space: HalfSpaceConstants = HalfSpaceConstants()
    resolved: ResolvedConstants = RESOLVED


CONSTANTS = DiffusionConstants()
