"""Bodies that overlap are found and named; bodies that only touch are not."""

from itertools import combinations

import numpy as np
import pytest
from shapes import CORNERS
from shapes import CUBE_CELLS as CUBE

from adaptsize import SimplexMesh, size_function
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.remeshing.surface_checks import (
    doubts,
    near_bodies,
    overlapping_bodies,
    warn_of_surface,
)


def boxes(*bounds, at=0.0):
    """Boxes from lower to upper corners, one body each."""
    points = [lower + CORNERS * np.subtract(upper, lower) for lower, upper in bounds]
    cells = [CUBE + 8 * k for k in range(len(bounds))]
    return SimplexMesh(np.concatenate(points) + at, np.concatenate(cells))


UNIT = ((0, 0, 0), (1, 1, 1))
CROSSING = ((0.5, 0.3, 0.4), (1.6, 1.2, 1.3))
SHIFTED = ((0.5, 0, 0), (1.5, 1, 1))


def crosses(one, other):
    """Whether two triangles in general position cross: an edge of one pierces the other."""
    for edges, (a, b, c) in ((one, other), (other, one)):
        for p, q in combinations(edges, 2):
            matrix = np.column_stack([p - q, b - a, c - a])
            t, u, v = np.linalg.solve(matrix, p - a)
            if 0.0 < t < 1.0 and min(u, v, 1.0 - u - v) > 0.0:
                return True
    return False


def test_random_triangles_cross_where_an_edge_pierces_the_other():
    rng = np.random.default_rng(4711)
    corners = rng.random((30, 3, 3))
    found = overlapping_bodies(SimplexMesh(corners.reshape(-1, 3), np.arange(90).reshape(-1, 3)))
    expected = [
        (a + 1, b + 1) for a, b in combinations(range(30), 2) if crosses(corners[a], corners[b])
    ]
    assert found.n_crossing == len(np.unique(expected))
    # For each triangle, the pair of its deepest crossing.
    assert set(found.pairs) <= set(expected)
    assert {a for pair in found.pairs for a in pair} == set(np.unique(expected))
    assert len(expected) > 15


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_crossing_bodies_are_named_with_the_deepest_place(scale):
    mesh = boxes(UNIT, CROSSING, ((5, 0, 0), (6, 1, 1)))
    found = overlapping_bodies(SimplexMesh(scale * mesh.points, mesh.cells))
    assert (found.pairs, found.n_bodies, found.n_crossing) == (((1, 2),), 3, 12)
    # The common part is 0.5 x 0.7 x 0.6.  Common segments end at diagonals of facets, too.
    assert 0.3 <= found.depth / scale <= 0.5
    bodies = [SimplexMesh(mesh.points, mesh.cells[rows]) for rows in (slice(12), slice(12, 24))]
    for body in bodies:
        assert body.locator.nearest([np.array(found.place) / scale])[2][0] < 1e-12


@pytest.mark.parametrize(
    "other",
    [
        ((1, 0, 0), (2, 1, 1)),  # the same facet
        ((1, 0.3, 0.2), (2, 1.4, 1.1)),  # a part of a facet
        ((1, 1, 0), (2, 2, 1)),  # an edge
        ((1, 1, 1), (2, 2, 2)),  # a node
        ((1.2, 0.3, 0.2), (2, 1.4, 1.1)),  # nothing
        ((0.3, 0.3, 0.3), (0.7, 0.7, 0.7)),  # one inside the other
        ((1 - 5e-7, 0.3, 0.2), (2, 1.4, 1.1)),  # deeper by rounding
    ],
)
def test_bodies_that_touch_do_not_overlap(other):
    assert overlapping_bodies(boxes(UNIT, other)) is None


def test_bodies_with_facets_in_common_planes_overlap_without_crossing_triangles():
    found = overlapping_bodies(boxes(UNIT, SHIFTED))
    assert (found.pairs, found.n_crossing) == (((1, 2),), 0)
    # The middle of the facet x = 1 of the first box, in the second one.
    assert found.depth == pytest.approx(0.5)
    assert str(found).startswith("bodies 1 and 2 overlap, by up to 0.5 at (")


def test_bodies_that_overlap_are_not_called_near_as_well():
    mesh = boxes(UNIT, CROSSING, ((1.001, 2, 0), (2, 3, 1)), ((0, 2, 0), (1, 3, 1)))
    overlapping = overlapping_bodies(mesh)
    assert near_bodies(mesh, 0.01).n_pairs == 2
    assert near_bodies(mesh, 0.01, overlapping=overlapping).n_pairs == 1
    with pytest.warns(OpenSurfaceWarning) as record:
        warn_of_surface(mesh, 0.01)
    assert [str(warning.message).split(":")[0] for warning in record] == [
        "bodies 1 and 2 overlap",
        "1 pair of bodies is only 0.001 apart at (1, 2, 0), less than the tolerance of 0.01",
    ]


@pytest.mark.parametrize("other", [CROSSING, ((0.4, 0.4, -0.5), (0.6, 0.6, 1.5)), SHIFTED])
def test_sizes_do_not_fall_to_hmin_where_bodies_overlap(other):
    mesh = boxes(UNIT, other)
    with pytest.warns(OpenSurfaceWarning, match="bodies 1 and 2 overlap.*facets inside of bodies"):
        report = size_function(mesh, hmax=0.06).report
    alone = size_function(boxes(other), hmax=0.06).report
    assert min(report.smallest.values()) >= 0.99 * min(alone.smallest.values())
    assert report.smallest["hmin"] == np.inf


@pytest.mark.parametrize("gap", [0.0, 1e-16, 1e-10])
@pytest.mark.parametrize(
    ("shift", "n_nodes"), [((1, 1, 1), 1), ((1, 1, 0), 2), ((-1, 0, 1), 2), ((0.0, -1.0, -1.0), 2)]
)
def test_contact_in_nodes_and_edges_is_named_with_its_place(gap, shift, n_nodes):
    rng = np.random.default_rng(61)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    shift = np.array(shift, float)
    other = CORNERS + shift + gap * np.sign(shift)
    points = 10.0 * np.vstack([CORNERS, other]) @ turn + 7.0
    mesh = SimplexMesh(points, np.vstack([CUBE, CUBE + 8]))
    (found,) = (record for name, record, _ in doubts(mesh, 1e-3) if name == "touching_bodies")
    assert found.n_nodes == n_nodes
    both = 10.0 * CORNERS[(CORNERS[:, None] == (CORNERS + shift)).all(axis=2).any(axis=1)]
    away = np.linalg.norm(both @ turn + 7.0 - found.place, axis=1)
    assert away.min() < 1e-8


def test_bodies_with_a_common_face_or_none_have_no_contact_in_nodes():
    for shift in ((1.0, 0, 0), (3.0, 0, 0), (0.5, 0.5, 0.5)):
        mesh = SimplexMesh(np.vstack([CORNERS, CORNERS + shift]), np.vstack([CUBE, CUBE + 8]))
        assert "touching_bodies" not in [name for name, _, _ in doubts(mesh, 1e-3)]
