"""Faces of surfaces: regions between feature edges; curves, corners and tips."""

import numpy as np
import pytest
from meshes import structured_square
from numpy.testing import assert_array_equal
from shapes import block
from solids import circle, hull, outline

from adaptsize import SimplexMesh
from adaptsize.geometry.faces import Faces, tag_faces

CUBE = block(3).boundary().mesh


def cylinder(n):
    """A closed cylinder; its strips meet at 360 / n degrees."""
    flat = np.column_stack([circle(n), np.zeros(n)])
    return hull(np.concatenate([flat, flat + np.array([0.0, 0.0, 1.0])]))


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


@pytest.mark.parametrize("seed", [2291, 5530])
def test_faces_do_not_depend_on_the_orientation_and_order_of_triangles(seed):
    rng = np.random.default_rng(seed)
    order = rng.permutation(CUBE.n_cells)
    cells = np.array([rng.permutation(cell) for cell in CUBE.cells[order]])
    mixed = tag_faces(SimplexMesh(CUBE.points, cells)).cell_tags
    plain = tag_faces(CUBE).cell_tags[order]
    assert len(set(zip(mixed.tolist(), plain.tolist(), strict=True))) == 6
    first = np.unique(mixed, return_index=True)[1]
    assert (np.diff(first) > 0).all()  # numbered in the order of first triangles


def test_parts_that_do_not_touch_and_sheets_at_one_edge_are_faces_of_their_own():
    apart = SimplexMesh(
        np.concatenate([CUBE.points, CUBE.points + 5.0]),
        np.concatenate([CUBE.cells, CUBE.cells + CUBE.n_points]),
    )
    assert tag_faces(apart).cell_tags.max() == 12
    book = SimplexMesh(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0.1, 0], [1, 0.2, 0]],
        [[0, 1, 2], [0, 1, 3], [0, 1, 4]],
    )
    assert tag_faces(book, 180.0).cell_tags.tolist() == [1, 2, 3]


def test_all_but_the_tags_of_cells_and_their_names_is_kept():
    mesh = SimplexMesh(
        CUBE.points, CUBE.cells, cell_tags=np.full(CUBE.n_cells, 9),
        tagged_facets=CUBE.edges[:2], facet_tags=[3, 4], tag_names={(2, 9): "all", (1, 3): "rim"},
        point_data={"u": np.arange(CUBE.n_points)},
    )  # fmt: skip
    tagged = tag_faces(mesh)
    assert_array_equal(tagged.cells, mesh.cells)
    assert_array_equal(tagged.facet_tags, [3, 4])
    assert_array_equal(tagged.point_data["u"], mesh.point_data["u"])
    assert tagged.tag_names == {(1, 3): "rim"}
    assert (mesh.cell_tags == 9).all()


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


def cone(degrees, n=32):
    """A cone over the unit circle with a given angle at its tip."""
    tip = [0.0, 0.0, 1.0 / np.tan(np.radians(degrees / 2.0))]
    return hull(np.concatenate([np.column_stack([circle(n), np.zeros(n)]), [tip]]))


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


def test_the_mantle_of_a_cone_meets_itself_at_its_tip():
    mesh = cone(60.0)
    faces = Faces.of(mesh)
    assert numbers(faces) == (2, 1, 0)
    mantle = int(faces.face[np.flatnonzero((mesh.points[mesh.cells][..., 2] > 0).any(axis=1))[0]])
    assert meeting(faces) == {(0, 1), (mantle, mantle)}


def test_a_tip_lacks_more_than_half_a_radian_of_a_full_turn():
    # Unrolled, a cone is a sector of 2 pi sin(half its angle).
    limit = 2.0 * np.degrees(np.arcsin(1.0 - 0.5 / (2.0 * np.pi)))
    for degrees, has_tip in ((limit - 2.0, True), (limit + 2.0, False)):
        faces = Faces.of(cone(degrees, 256), crease_angle=20.0)
        assert numbers(faces) == (2, 1, 0)
        assert any(a == b for a, b in meeting(faces)) == has_tip


def sheet(n, lifted=(), height=0.0):
    """A square of n x n squares of two triangles; some of its nodes (i, j) are lifted."""
    flat = structured_square(n, half_width=0.5 * n)
    points = np.column_stack([flat.points + 0.5 * n, np.zeros(flat.n_points)])
    nodes = [(n + 1) * a + b for a, b in lifted]
    points[nodes, 2] = height
    return points, flat.cells, nodes


def test_a_face_meets_itself_only_because_of_what_was_removed_from_it():
    for height, expected in ((0.0, set()), (np.tan(np.radians(25.0)), {(0, 0)})):
        points, cells, _ = sheet(8, [(3, 4), (4, 4), (5, 4)], height)
        top = SimplexMesh(points, cells)
        rim = top.facets[top.facet_cell_counts == 1]
        below = np.column_stack([rim, np.full(len(rim), len(points))])
        pyramid = SimplexMesh([*points, [4.0, 4.0, -3.0]], [*cells, *below])
        faces = Faces.of(pyramid)
        assert numbers(faces) == (5, 8, 5)
        assert {(a, b) for a, b in meeting(faces) if a == b} == expected


def test_what_a_loose_edge_hung_on_is_removed_too_but_not_what_has_no_loose_end():
    mesh = SimplexMesh(*sheet(8, [(i, 4) for i in range(1, 6)], np.tan(np.radians(25.0)))[:2])
    assert numbers(Faces.of(mesh)) == (1, 4, 4)
    across = SimplexMesh(*sheet(8, [(i, 4) for i in range(9)], np.tan(np.radians(25.0)))[:2])
    faces = Faces.of(across)
    assert faces.n_faces == 2
    assert meeting(faces) == {(0, 1)} | {(0, 0), (1, 1)}  # at the rim, each alone


def test_tagged_edges_are_kept_though_their_ends_are_loose():
    points, cells, ridge = sheet(8, [(3, 4), (4, 4), (5, 4)], np.tan(np.radians(25.0)))
    edges = [ridge[:2], [0, 1]]
    mesh = SimplexMesh(points, cells, tagged_facets=edges, facet_tags=[7, 0])
    faces = Faces.of(mesh)
    assert faces.n_faces == 1
    assert ridge[:2] in faces.features.tolist()
    assert ridge[1:] not in faces.features.tolist()
    assert np.flatnonzero(faces.is_corner[ridge]).tolist() == [0, 1]
    flat = SimplexMesh(*sheet(4)[:2], tagged_facets=[[6, 11], [11, 16]], facet_tags=[1, 1])
    assert numbers(Faces.of(flat)) == (1, 5, 6)


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


def test_normals_point_outward_and_are_zero_where_a_facet_has_no_area():
    middle = 0.5 * (CUBE.points[CUBE.edges[0, 0]] + CUBE.points[CUBE.edges[0, 1]])
    flat = [*CUBE.edges[0], CUBE.n_points]
    mesh = SimplexMesh([*CUBE.points, middle], [*CUBE.cells, flat])
    normals = Faces.of(mesh).normals
    assert_array_equal(normals[-1], 0.0)
    corners = CUBE.points[CUBE.cells]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    assert np.abs(normals[:-1] - across).max() < 1e-14
