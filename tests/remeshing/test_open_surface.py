"""Open surfaces and bodies that nearly touch: what is found, and how holes are closed."""

import numpy as np
import pytest
from shapes import CORNERS as UNIT
from shapes import CUBE_CELLS, joined, moved

from adaptsize import SimplexMesh
from adaptsize.remeshing.hole_filling import close_holes
from adaptsize.remeshing.surface_checks import near_bodies, open_boundary

CORNERS = UNIT * [2.0, 1.0, 1.0]
CUBE = CUBE_CELLS.tolist()


def box(without=()):
    return SimplexMesh(CORNERS, [c for k, c in enumerate(CUBE) if k not in without])


def tube(outline, length=3.0):
    """A tube along z with the given outline in the plane, open at both ends."""
    n = len(outline)
    points = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (0.0, length)])
    i = np.arange(n)
    j = (i + 1) % n
    cells = np.concatenate([np.column_stack([i, j, n + j]), np.column_stack([i, n + j, n + i])])
    return SimplexMesh(points, cells)


def volume(mesh):
    return np.linalg.det(mesh.points[mesh.cells]).sum() / 6.0


def test_a_closed_surface_has_no_open_boundary_and_stays_as_it_is():
    assert open_boundary(box()) is None
    np.testing.assert_array_equal(close_holes(box()).cells, CUBE)


def test_the_largest_hole_is_reported():
    holes = open_boundary(box(without=(8, 10, 11)))
    assert (holes.n_edges, holes.n_loops, holes.n_loose) == (7, 2, 0)
    assert holes.length == pytest.approx(6.0)
    assert holes.place == pytest.approx((1.0, 0.5, 1.0))
    assert holes.area == pytest.approx(3.0)
    assert (
        str(holes)
        == "7 open edges in 2 loops with an area of 3, the largest 6 long around (1, 0.5, 1)"
    )


def test_gaps_narrower_than_the_tolerance_are_not_reported():
    points = np.concatenate([CORNERS, [[0.0, 0.5, 0.501]]])
    # The diagonal from (0, 0, 0) to (0, 1, 1) runs through the new point on one side only.
    cells = [*CUBE[1:], [0, 1, 8], [8, 1, 3]]
    mesh = SimplexMesh(points, cells)
    gap = open_boundary(mesh)
    assert (gap.n_edges, gap.n_loops) == (3, 1)
    assert open_boundary(mesh, 1e-3) is None
    assert open_boundary(box(without=(10, 11)), 1e-3) is not None


def test_edges_that_form_no_loop_are_counted():
    # Three triangles on one edge, and another triangle in the middle of it.
    fins = [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    points = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]]
    holes = open_boundary(SimplexMesh(points, fins))
    assert holes.n_edges == 6
    assert holes.n_loose == 2
    with pytest.raises(ValueError, match="2 open edges that form no loop"):
        close_holes(SimplexMesh(points, fins))


def test_holes_are_closed_with_matching_orientation():
    closed = close_holes(box(without=(8, 10, 11)))
    assert closed.n_cells == 12
    assert closed.is_closed
    assert volume(closed) == pytest.approx(volume(box()))


STAR = [
    (2 + (k % 2) * -1.2) * np.array([np.cos(t), np.sin(t)])
    for k, t in enumerate(np.linspace(0, 2 * np.pi, 14, endpoint=False))
]
CIRCLE = [np.array([np.cos(t), np.sin(t)]) for t in np.linspace(0, 2 * np.pi, 700, endpoint=False)]
NOTCHED = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]

#: Triangles of least perimeter would lie partly outside.
BENT = [(0.36, 0.24), (0.03, 0.09), (0, 0.21), (-0.23, 0.45), (-0.59, 0.67), (-0.13, -1.24)]
BENT += [(1.8, -0.78)]


@pytest.mark.parametrize(
    "outline", [STAR, CIRCLE, NOTCHED, BENT], ids=["star", "circle", "notched", "bent"]
)
def test_plane_holes_get_their_interior(outline):
    outline = np.array(outline, dtype=float)
    x, y = outline.T
    area = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
    open_tube = tube(outline)
    closed = close_holes(open_tube)
    caps = closed.measures[open_tube.n_cells :]
    assert closed.is_closed
    assert caps.sum() == pytest.approx(2.0 * area, rel=1e-9)
    assert volume(closed) == pytest.approx(3.0 * area, rel=1e-9)


def test_nodal_fields_are_kept_and_new_triangles_have_the_tag_0():
    mesh = box(without=(10, 11))
    # Every triangle has corners of its own, as in an STL file.
    points, cells = mesh.points[mesh.cells].reshape(-1, 3), np.arange(30).reshape(-1, 3)
    data = {"x": points[:, 0]}
    apart = SimplexMesh(points, cells, cell_tags=np.arange(1, 11), point_data=data)
    closed = close_holes(apart)
    assert closed.n_points == 8
    assert closed.cell_tags.tolist() == [*range(1, 11), 0, 0]
    np.testing.assert_array_equal(closed.point_data["x"], closed.points[:, 0])


def two_boxes(gap, at=0.0):
    return moved(joined(box(), moved(box(), [0.0, 0.0, 1.0 + gap])), at)


def test_bodies_are_near_within_the_distance_only():
    assert near_bodies(box(), 1.0) is None
    assert near_bodies(two_boxes(0.01), 0.009) is None
    near = near_bodies(two_boxes(0.01), 0.011)
    assert near.n_pairs == 1
    assert near.distance == pytest.approx(0.01)
    assert near.place[2] == pytest.approx(1.0)


def test_all_pairs_of_near_bodies_are_counted():
    first, second = two_boxes(0.01), two_boxes(0.02, at=10.0)
    near = near_bodies(joined(first, second), 0.03)
    assert near.n_pairs == 2
    assert near.distance == pytest.approx(0.01)
    assert str(near).startswith("2 pairs of bodies are down to 0.01 apart at (")


def test_two_holes_that_touch_are_closed():
    # The triangles 0 and 10 have only a corner in common.
    mesh = box(without=(1, 10))
    closed = close_holes(mesh)
    assert closed.is_closed
    assert volume(closed) == pytest.approx(2.0)


def test_a_sheet_encloses_nothing():
    scale = 1e-9
    sheet = SimplexMesh(scale * CORNERS[[2, 3, 7, 6]], [[0, 1, 2], [0, 2, 3]])
    with pytest.raises(ValueError, match="it is a sheet"):
        close_holes(sheet)
    solid = close_holes(SimplexMesh(scale * CORNERS, CUBE[:10]))
    assert solid.is_closed
