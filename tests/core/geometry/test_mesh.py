"""core.geometry.mesh and core.geometry.normals against solids whose normals, volumes and flaws are known."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import (
    UP_AXES,
    Flaws,
    Mesh,
    check_size,
    compact,
    drop_degenerate,
    find_flaws,
    flaws,
    has_no_area,
    place_in_world,
    position_groups,
    signed_volume,
    up_rotation,
    weld,
)
from milkglass.core.geometry.normals import _components, crease_normals, unit, vertex_normals
from tests.support.counting import calls, peak_bytes

CUBE_VERTICES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
CUBE_QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_FACES = np.array([[q[0], q[k], q[k + 1]] for q in CUBE_QUADS for k in (1, 2)], np.int64)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def sphere(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Latitude-longitude sphere of radius 1 with single pole vertices, wound outwards."""
    theta = np.pi * np.arange(1, rows) / rows
    phi = 2.0 * np.pi * np.arange(columns) / columns
    ring = np.stack(
        [
            np.outer(np.sin(theta), np.cos(phi)),
            np.outer(np.cos(theta), np.ones(columns)),
            -np.outer(np.sin(theta), np.sin(phi)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    a = np.arange(rows - 2)[:, None] * columns + np.arange(columns)
    b = np.arange(rows - 2)[:, None] * columns + np.roll(np.arange(columns), -1)
    quads = [np.stack([a, a + columns, b], -1), np.stack([b, a + columns, b + columns], -1)]
    first, last = np.arange(columns), (rows - 2) * columns + np.arange(columns)
    north, south = len(ring), len(ring) + 1
    caps = [
        np.stack([first, np.roll(first, -1), np.full(columns, north)], -1),
        np.stack([np.roll(last, -1), last, np.full(columns, south)], -1),
    ]
    faces = np.concatenate([q.reshape(-1, 3) for q in quads + caps])
    return np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]]), faces


def test_cube_has_six_flat_sides() -> None:
    vertices, normals, faces = crease_normals(CUBE_VERTICES, CUBE_FACES)
    mesh = Mesh.of(vertices, normals, faces)
    assert len(vertices) == 24
    np.testing.assert_allclose(np.sort(np.abs(normals), axis=1), np.tile([0, 0, 1], (24, 1)), atol=1e-15)
    np.testing.assert_array_equal(vertices[faces], CUBE_VERTICES[CUBE_FACES])
    outward = normals[faces]
    centre = vertices[faces].mean(axis=1) - 0.5
    assert (np.einsum("ijk,ik->ij", outward, centre) > 0.3).all()
    assert mesh.volume == pytest.approx(1.0, rel=1e-12)
    assert mesh.area == pytest.approx(6.0, rel=1e-12)
    assert mesh.radius == pytest.approx(np.sqrt(3.0), rel=1e-7)
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 1]])
    assert flaws(mesh).solid


def test_cube_corners_are_shared_when_no_edge_is_a_crease() -> None:
    vertices, normals, faces = crease_normals(CUBE_VERTICES, CUBE_FACES, crease_deg=91.0)
    np.testing.assert_array_equal(vertices, CUBE_VERTICES)
    np.testing.assert_array_equal(faces, CUBE_FACES)
    # Angle weights: three sides of 90 degrees each, however many triangles each is cut into.
    np.testing.assert_allclose(normals, unit(CUBE_VERTICES - 0.5), atol=1e-15)


def test_normals_of_a_fine_sphere_are_radial_and_none_is_split() -> None:
    vertices, faces = sphere(300, 600)
    v, normals, f = crease_normals(vertices, faces)
    np.testing.assert_array_equal(v, vertices)
    np.testing.assert_array_equal(f, faces)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-14)
    # Next to the poles the facets are too skew for more; elsewhere the error is of second order.
    error_deg = np.degrees(np.linalg.norm(np.cross(normals, vertices), axis=1))
    assert error_deg.max() < 0.2
    assert np.median(error_deg) < 1e-2


def test_normals_of_a_sphere_do_not_depend_on_face_order() -> None:
    vertices, faces = sphere(20, 40)
    rng = np.random.default_rng(1)
    shuffled = np.stack([np.roll(f, k) for f, k in zip(faces, rng.integers(0, 3, len(faces)), strict=True)])
    shuffled = shuffled[rng.permutation(len(faces))]
    np.testing.assert_allclose(crease_normals(vertices, faces)[1], crease_normals(vertices, shuffled)[1], atol=1e-14)


def test_cylinder_is_smooth_around_and_hard_at_its_rims() -> None:
    n = 500
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    vertices = np.concatenate([ring, ring + np.eye(3)[2], [[0, 0, 0], [0, 0, 1]]])
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = np.concatenate(
        [np.column_stack(c) for c in ([a, b, b + n], [a, b + n, a + n], [b, a, low], [a + n, b + n, high])]
    )
    v, normals, f = crease_normals(vertices, faces)
    assert find_flaws(vertices, faces).solid
    assert len(v) == 4 * n + 2
    side = normals[np.unique(f[: 2 * n])]
    np.testing.assert_allclose(side[:, 2], 0.0, atol=1e-12)
    caps = np.unique(f[2 * n :])
    np.testing.assert_allclose(normals[caps], np.column_stack([np.zeros((len(caps), 2)), 2 * v[caps, 2] - 1]))


def test_double_sided_sheet_keeps_its_sides_apart_and_smooth() -> None:
    faces = np.concatenate([SQUARE_FACES, SQUARE_FACES[:, ::-1]])
    v, normals, f = crease_normals(SQUARE, faces)
    assert len(v) == 8
    np.testing.assert_allclose(normals[f[:2]], np.broadcast_to([0, 0, 1.0], (2, 3, 3)))
    np.testing.assert_allclose(normals[f[2:]], np.broadcast_to([0, 0, -1.0], (2, 3, 3)))


def test_a_sliver_does_not_outvote_its_neighbours() -> None:
    # A point on the square's diagonal, moved by a rounding error, makes a triangle that points anywhere.
    vertices = np.concatenate([SQUARE, [[0.5, 0.5, 1e-9]]])
    faces = np.array([[0, 1, 2], [0, 4, 3], [4, 2, 3], [0, 2, 4]])
    assert not has_no_area(vertices, faces).any()
    normals = vertex_normals(vertices, faces)
    np.testing.assert_allclose(normals, np.broadcast_to([0, 0, 1.0], (5, 3)), atol=1e-5)


def test_vertices_whose_faces_cancel_or_are_missing_still_get_unit_normals() -> None:
    normals = vertex_normals(np.concatenate([SQUARE, [[7, 7, 7]]]), np.array([[0, 1, 2], [2, 1, 0]]))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_components_of_a_long_chain() -> None:
    rng = np.random.default_rng(2)
    names = rng.permutation(3000)
    chain = np.column_stack([names[:1499], names[1:1500]])
    label = _components(3000, chain)
    assert (label[names[:1500]] == names[:1500].min()).all()
    np.testing.assert_array_equal(label[names[1500:]], names[1500:])


@pytest.mark.parametrize("up", UP_AXES)
def test_up_axis_turns_to_y_by_a_proper_rotation(up: str) -> None:
    rotation = up_rotation(up)
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
    np.testing.assert_array_equal(rotation @ axis, [0, 1, 0])
    np.testing.assert_array_equal(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    # +z and -z turn about x, which therefore stays.
    if up[-1] == "z":
        np.testing.assert_array_equal(rotation @ [1, 0, 0], [1, 0, 0])


@pytest.mark.parametrize("up", UP_AXES)
def test_placing_keeps_volume_sign_and_shape(up: str) -> None:
    rng = np.random.default_rng(3)
    vertices = (CUBE_VERTICES @ np.diag([1, 2, 4.0])) + rng.normal(size=3)
    placed = place_in_world(vertices, 100.0, up)
    extents = np.ptp(placed, axis=0)
    assert extents.max() == pytest.approx(100.0, rel=1e-14)
    np.testing.assert_allclose(placed.min(axis=0), -placed.max(axis=0), atol=1e-12)
    assert extents[1] == pytest.approx(100.0 * {"x": 1, "y": 2, "z": 4}[up[-1]] / 4.0, rel=1e-14)
    assert signed_volume(placed, CUBE_FACES) == pytest.approx(8.0 * 25.0**3, rel=1e-12)


def test_placing_far_from_the_origin_keeps_precision() -> None:
    vertices, _ = sphere(20, 40)
    # Powers of two, so that the shifted numbers are exact.
    exact = np.round(vertices * 2**20) / 2**20
    near, far = place_in_world(exact, 50.0), place_in_world(exact + 2.0**24, 50.0)
    np.testing.assert_allclose(far, near, atol=1e-12)


def test_placing_refuses_what_has_no_size() -> None:
    with pytest.raises(InputError, match="longest side is 0"):
        place_in_world(np.ones((4, 3)), 10.0)
    for size in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match=r"model\.size_mm must be a finite length above 0 mm"):
            check_size(size)
    with pytest.raises(InputError, match=r"model\.up must be one of x, y, z, -x, -y, -z, not 'w'"):
        up_rotation("w")


def test_welding_joins_a_triangle_soup_in_the_order_given() -> None:
    soup = CUBE_VERTICES[CUBE_FACES].reshape(-1, 3)
    vertices, faces = weld(soup, np.arange(36).reshape(-1, 3))
    assert len(vertices) == 8
    np.testing.assert_array_equal(vertices[faces].reshape(-1, 3), soup)
    np.testing.assert_array_equal(vertices, soup[np.sort(np.unique(soup, axis=0, return_index=True)[1])])
    assert find_flaws(vertices, faces).solid


def test_welding_tells_apart_what_float32_tells_apart_across_the_box() -> None:
    line = np.zeros((100_000, 3))
    line[:, 0] = np.linspace(0.0, 1.0, len(line))
    first, group = position_groups(line)
    np.testing.assert_array_equal(first, np.arange(len(line)))
    np.testing.assert_array_equal(group, first)
    assert len(position_groups(np.array([[0, 0, 0], [1, 0, 0], [1 + 1e-12, 0, 0]]))[0]) == 2


def test_degenerate_faces_are_dropped() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [0, 1e-4, 0]], np.float64)
    faces = np.array([[0, 0, 1], [0, 1, 2], [0, 1, 3], [2, 3, 2], [0, 2, 4]])
    np.testing.assert_array_equal(drop_degenerate(vertices, faces), [[0, 1, 3], [0, 2, 4]])
    # The judgement does not depend on the unit.
    np.testing.assert_array_equal(drop_degenerate(vertices * 1e-30, faces), [[0, 1, 3], [0, 2, 4]])


def test_compact_leaves_out_unused_vertices() -> None:
    used, faces = compact(np.array([[5, 2, 9]]), 12)
    np.testing.assert_array_equal(used, [2, 5, 9])
    np.testing.assert_array_equal(faces, [[1, 0, 2]])


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        (CUBE_FACES, Flaws(0, 0, 0, False)),
        (CUBE_FACES[:, ::-1], Flaws(0, 0, 0, True)),
        (CUBE_FACES[1:], Flaws(3, 0, 0, False)),
        (np.concatenate([CUBE_FACES[:1, ::-1], CUBE_FACES[1:]]), Flaws(0, 0, 3, False)),
        # A wall through the cube from edge to edge: each of its four sides meets two faces already.
        (np.concatenate([CUBE_FACES, [[0, 1, 7], [0, 7, 6]]]), Flaws(0, 4, 0, False)),
    ],
    ids=["solid", "inverted", "open", "inconsistent", "non-manifold"],
)
def test_flaws_of_a_cube(faces: np.ndarray, expected: Flaws) -> None:
    found = find_flaws(CUBE_VERTICES, faces)
    assert found == expected
    assert found.closed == (expected.boundary_edges == 0)
    assert found.solid == (expected == Flaws(0, 0, 0, False))


def test_a_mesh_needs_a_normal_a_vertex_and_rows_of_three() -> None:
    with pytest.raises(InputError, match="3 normals for 4 vertices"):
        Mesh.of(SQUARE, SQUARE[:3], SQUARE_FACES)
    with pytest.raises(InputError, match="mesh faces must have shape"):
        Mesh.of(SQUARE, SQUARE, np.array([[0, 1, 2, 3]]))
    mesh = Mesh.of(SQUARE, np.tile([0, 0, 1], (4, 1)), SQUARE_FACES)
    assert (mesh.vertices.dtype, mesh.normals.dtype, mesh.faces.dtype) == (np.float32, np.float32, np.int32)
    assert len({mesh, mesh}) == 1


def test_what_normals_cost_grows_as_the_faces_do() -> None:
    """No loop over them, and no array of pairs of them, where noise makes creases everywhere."""
    count, held = [], []
    for n in (50, 150):
        vertices, faces = sphere(n, n)
        soup = vertices[faces].reshape(-1, 3)
        shared, welded = weld(soup, np.arange(len(soup)).reshape(-1, 3))
        rough = shared + np.random.default_rng(4).normal(scale=0.01, size=shared.shape)
        count.append(calls(lambda rough=rough, welded=welded: crease_normals(rough, welded)))
        held.append(peak_bytes(lambda rough=rough, welded=welded: crease_normals(rough, welded)) / len(faces))
    assert count[1] < 1.1 * count[0]
    assert held[1] < 1.5 * held[0]  # what creases share depends on how long its edges are beside the noise
