"""The family's constants: all of them say what they are and on which shapes they were fitted or chosen."""

from milkglass.core.material import medium
from milkglass.core.provenance import constants, shapes_in_sample
from milkglass.core.transport.diffusion.constants import CONSTANTS


def test_every_constant_has_a_meaning_and_shapes():
    found = list(constants(CONSTANTS))
    assert len({constant.name for constant in found}) == len(found) >= 40
    for constant in found:
        assert constant.meaning
        assert constant.shapes
    assert {constant.kind for constant in found} == {"fitted", "chosen"}


def test_the_boundary_condition_is_fitted_to_balls_slabs_and_convex_edges():
    assert CONSTANTS.boundary_condition is medium.BOUNDARY_CONDITION
    fits = [constant for constant in constants(CONSTANTS) if constant.kind == "fitted"]
    assert {shape for constant in fits for shape in constant.shapes} == {"ball", "plate", "cube", "cylinder", "cone"}
    assert {"gyroid", "bolt", "gear"}.isdisjoint(shapes_in_sample(CONSTANTS))


def test_bounds_of_smooth_steps_ascend():
    curvature, edges, flight, sheets = CONSTANTS.curvature, CONSTANTS.edges, CONSTANTS.last_flight, CONSTANTS.sheets
    for low, high in (
        (curvature.smooth_turn, curvature.edge_turn),
        (edges.other_face_cosine, curvature.same_face_cosine),
        (edges.opposite_cosine, edges.blade_cosine),
        (edges.rough_evenness, edges.flat_evenness),
        (edges.sharp_turn, edges.round_turn),
        (edges.resolved_spacing, edges.unresolved_spacing),
        (flight.flat_turn, flight.sharp_turn),
        (flight.rough_evenness, flight.even_evenness),
        (flight.least_share, flight.full_share),
        (sheets.least_parallel, sheets.parallel),
        (CONSTANTS.half_space.dark_albedo, CONSTANTS.half_space.bright_albedo),
    ):
        assert low < high
