"""core.geometry.repair: faces that are there twice or turned about, and holes."""

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.bodies import component_of_faces
from milkglass.core.geometry.mesh import find_flaws, signed_volume
from milkglass.core.geometry.repair import caps, repeated_faces, turned_about


def closed(part: trimesh.Trimesh, *dropped: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Vertices and faces of a part without those at some vertices, with caps, and how many holes these close."""
    vertices, faces = np.asarray(part.vertices), np.asarray(part.faces)
    faces = faces[~np.isin(faces, dropped).any(axis=1)]
    found = caps(vertices, faces, component_of_faces(faces, len(vertices)))
    return vertices, np.concatenate([faces, found.faces]), found.holes


def test_faces_turned_about_are_turned_back_and_no_others() -> None:
    ball = trimesh.creation.icosphere(3)
    few = np.random.default_rng(0).random(len(ball.faces)) < 0.3
    faces = np.where(few[:, None], ball.faces[:, ::-1], ball.faces)
    np.testing.assert_array_equal(turned_about(faces, len(ball.vertices)), few)


def test_a_surface_of_one_side_stays_as_it_is() -> None:
    n = 20
    i = np.arange(n)
    low, high, low_next, high_next = i, i + n, np.roll(i, -1), np.roll(i, -1) + n
    low_next[-1], high_next[-1] = n, 0
    strip = np.concatenate([np.column_stack([low, low_next, high]), np.column_stack([high, low_next, high_next])])
    assert not turned_about(strip, 2 * n).any()


def test_what_is_there_twice_counts_once() -> None:
    box = trimesh.creation.box()
    for second in (box.faces, np.roll(box.faces, 1, axis=1), box.faces[:, ::-1]):
        faces = np.concatenate([box.faces, second])
        left = faces[~repeated_faces(faces, np.zeros(len(faces), np.int64))]
        np.testing.assert_array_equal(left, box.faces)


def test_sheets_with_two_sides_keep_both_and_walls_between_blocks_go() -> None:
    sheet = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])
    assert not repeated_faces(sheet, np.zeros(4, np.int64)).any()
    box = trimesh.creation.box()
    beside = box.vertices + np.array([1.0, 0.0, 0.0])
    both = trimesh.Trimesh(np.concatenate([box.vertices, beside]), np.concatenate([box.faces, box.faces + 8]))
    vertices, faces = np.asarray(both.vertices), np.asarray(both.faces)
    wall = (np.abs(vertices[faces][..., 0] - 0.5) < 1e-9).all(axis=1)
    ordered = np.sort(faces[wall], axis=1)
    same = len(np.unique(ordered, axis=0)) < len(ordered)
    dropped = repeated_faces(faces, np.zeros(len(faces), np.int64))
    np.testing.assert_array_equal(dropped, wall & same)


@pytest.mark.parametrize("holes", [1, 3])
def test_holes_are_closed_and_volumes_are_those_of_the_solid(holes: int) -> None:
    box = trimesh.creation.box((2, 3, 4)).subdivide().subdivide().subdivide()
    middles = [int(np.argmin(np.linalg.norm(box.vertices - at, axis=1))) for at in ([1, 0, 0], [0, 1.5, 0], [0, 0, -2])]
    vertices, faces, closed_holes = closed(box, *middles[:holes])
    assert closed_holes == holes
    assert find_flaws(vertices, faces).solid
    assert signed_volume(vertices, faces) == pytest.approx(24.0)


def test_a_concave_rim_is_closed_within_itself() -> None:
    corners = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], float)
    u = trimesh.creation.extrude_triangulation(
        corners, [[0, 1, 5], [1, 4, 5], [0, 5, 7], [5, 6, 7], [1, 2, 4], [2, 3, 4]], 5.0
    )
    vertices, faces = np.asarray(u.vertices), np.asarray(u.faces)
    below = (vertices[faces][..., 2] < 1e-9).all(axis=1)
    open_faces = faces[~below]
    found = caps(vertices, open_faces, np.zeros(len(open_faces), np.int64))
    assert found.holes == 1
    area = trimesh.Trimesh(vertices, found.faces, process=False).area
    assert area == pytest.approx(7.0)
    assert signed_volume(vertices, np.concatenate([open_faces, found.faces])) == pytest.approx(35.0)


def test_sheets_and_surfaces_that_pass_through_their_hole_stay_open() -> None:
    for part in (
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]),
        inner_cone(),
    ):
        assert closed(part)[2] == 0


def inner_cone() -> trimesh.Trimesh:
    """A cup whose bottom was pushed up through its mouth."""
    profile = np.array([[0.0, 3.0], [0.6, 0.2], [1.0, 0.0], [1.0, 2.0], [0.9, 2.0]])
    return trimesh.creation.revolve(profile, sections=24)
