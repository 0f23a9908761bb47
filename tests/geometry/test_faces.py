"""Faces of surfaces: regions between feature edges; curves, corners and tips."""

import numpy as np
from numpy.testing import assert_array_equal
from shapes import block, joined, moved
from solids import circle, cylinder, outline

from adaptsize import SimplexMesh
from adaptsize.geometry.creases import tag_faces
from adaptsize.geometry.faces import Faces

CUBE = block(3).boundary().mesh


def test_a_cube_has_six_faces_one_for_each_normal():
    tagged = tag_faces(CUBE)
    corners = CUBE.points[CUBE.cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).round(12)
    sides = np.unique(normals, axis=0, return_inverse=True)[1].reshape(-1)
    assert len(set(zip(tagged.cell_tags.tolist(), sides.tolist(), strict=True))) == 6
    assert sorted(set(tagged.cell_tags.tolist())) == [1, 2, 3, 4, 5, 6]


def test_the_angle_tells_which_edges_separate_faces():
    mesh = cylinder(12)  # strips meet at 30 degrees, caps at 90
    assert tag_faces(mesh).cell_tags.max() == 3
    assert tag_faces(mesh, 29.0).cell_tags.max() == 14
    assert tag_faces(mesh, 31.0).cell_tags.max() == 3
    assert tag_faces(mesh, 91.0).cell_tags.max() == 1


def test_parts_that_do_not_touch_and_sheets_at_one_edge_are_faces_of_their_own():
    assert tag_faces(joined(CUBE, moved(CUBE, 5.0))).cell_tags.max() == 12
    book = SimplexMesh(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0.1, 0], [1, 0.2, 0]],
        [[0, 1, 2], [0, 1, 3], [0, 1, 4]],
    )
    assert tag_faces(book, 180.0).cell_tags.tolist() == [1, 2, 3]


# --- faces, curves, corners -------------------------------------------------------


def numbers(faces):
    """Return the number of faces, of curves, and of corners."""
    return faces.n_faces, len(set(faces.curve.tolist())), int(faces.is_corner.sum())


def meeting(faces):
    """Return the pairs of faces that meet, the smaller one first."""
    first, items = faces.meets
    owners = np.repeat(np.arange(len(first) - 1), np.diff(first))
    pairs = set(zip(owners.tolist(), items.tolist(), strict=True))
    assert pairs == {(b, a) for a, b in pairs}
    return {(a, b) for a, b in pairs if a <= b}


def test_a_cube_has_6_faces_12_curves_and_8_corners_and_each_face_meets_4():
    faces = Faces.of(CUBE)
    assert numbers(faces) == (6, 12, 8)
    assert len(faces.features) == 12 * 3
    assert (np.diff(faces.meets.first) == 4).all()
    assert len(meeting(faces)) == 12
    assert not faces.is_rough


def test_a_cylinder_has_3_faces_and_2_curves_without_corners():
    faces = Faces.of(cylinder(24))
    assert numbers(faces) == (3, 2, 0)
    mantle = faces.face[np.abs(faces.normals[:, 2]).argmin()]
    assert meeting(faces) == {tuple(sorted((mantle, cap))) for cap in {0, 1, 2} - {mantle}}


def test_a_curve_has_a_corner_where_it_turns_by_more_than_the_crease_angle():
    assert numbers(Faces.of(cylinder(8))) == (10, 24, 16)  # 45 degrees
    assert numbers(Faces.of(cylinder(10))) == (3, 2, 0)  # 36 degrees


def test_faces_of_a_line_in_the_plane_are_its_parts_between_corners():
    square = outline([[0, 0], [1, 0], [2, 0], [2, 2], [0, 2]], 0.3 * circle(20)[::-1] + 1.0)
    faces = Faces.of(square)
    assert numbers(faces) == (5, 4, 4)
    assert faces.features.tolist() == [[0], [2], [3], [4]]
    assert len(meeting(faces)) == 4  # the hole meets nothing
    drop = outline(np.concatenate([[[0.0, -2.0]], circle(36)[np.arange(-2, 21)]]))
    assert numbers(Faces.of(drop)) == (1, 1, 1)
    assert meeting(Faces.of(drop)) == {(0, 0)}


def test_nodes_at_one_place_are_merged_and_repeated_facets_left_out():
    soup = SimplexMesh(
        CUBE.points[CUBE.cells].reshape(-1, 3), np.arange(CUBE.cells.size).reshape(-1, 3)
    )
    twice = SimplexMesh(soup.points, np.concatenate([soup.cells, soup.cells[::2]]))
    faces = Faces.of(twice)
    assert numbers(faces) == (6, 12, 8)
    n = CUBE.n_cells
    assert_array_equal(faces.rows, [*range(n), *range(0, n, 2)])
    assert_array_equal(soup.points[faces.targets], soup.points)
    assert len(np.unique(faces.targets)) == CUBE.n_points


def test_faces_do_not_depend_on_the_orientation_and_order_of_triangles():
    rng = np.random.default_rng(2291)
    order = rng.permutation(CUBE.n_cells)
    cells = np.array([rng.permutation(cell) for cell in CUBE.cells[order]])
    mixed = tag_faces(SimplexMesh(CUBE.points, cells)).cell_tags
    plain = tag_faces(CUBE).cell_tags[order]
    assert len(set(zip(mixed.tolist(), plain.tolist(), strict=True))) == 6
    first = np.unique(mixed, return_index=True)[1]
    assert (np.diff(first) > 0).all()  # numbered in the order of first triangles
