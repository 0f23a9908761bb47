"""Faces of surfaces: regions between feature edges."""

import re

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from shapes import block

from adaptsize import SimplexMesh
from adaptsize.geometry import tag_faces

CUBE = block(3).boundary().mesh


def cylinder(n):
    """A closed cylinder; its strips meet at 360 / n degrees."""
    turn = 2.0 * np.pi * np.arange(n) / n
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    points = [np.column_stack([rim, np.full(n, z)]) for z in (0.0, 1.0)] + [[[0, 0, 0], [0, 0, 1]]]
    low, up = np.arange(n), np.roll(np.arange(n), -1)
    cells = [[low, up, up + n], [low, up + n, low + n], [up, low, 0 * low + 2 * n],
             [low + n, up + n, 0 * low + 2 * n + 1]]  # fmt: skip
    return SimplexMesh(np.concatenate(points), np.concatenate([np.array(c).T for c in cells]))


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


@pytest.mark.parametrize(
    ("surface", "angle", "message"),
    [
        (block(1), 40.0, "surface must consist of triangles in 3-D, got SimplexMesh(8 points"),
        ("part.stl", 40.0, "surface must be a SimplexMesh, got 'part.stl'"),
        (CUBE, 181.0, "angle must be at most 180 degrees, got 181"),
        (CUBE, -1.0, "angle must be finite and >= 0, got -1"),
        (CUBE, "sharp", "angle must be a number, got 'sharp'"),
    ],
)
def test_bad_arguments_are_refused(surface, angle, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        tag_faces(surface, angle)
