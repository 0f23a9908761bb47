"""Single crossings of adapted surfaces, repaired in place."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from shapes import block, joined, moved

from adaptsize import SimplexMesh
from adaptsize.background.interfaces import skin_of
from adaptsize.background.splitting import split_edges
from adaptsize.geometry.enclosed import enclosed_measure, is_oriented
from adaptsize.quality.boundary import farthest_places
from adaptsize.remeshing.crossing_repair import _is_near, repair_crossings
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.remeshing.surface import remove_slivers

TOLERANCE = 0.02


def box(height=1.0):
    """A box with edges of a quarter."""
    skin = skin_of(block(4))[0]
    return skin.moved(skin.points * [1.0, 1.0, height])


def node_at(surface, place):
    away = np.linalg.norm(surface.points - place, axis=1)
    assert away.min() < 1e-12
    return int(away.argmin())


def with_node_at(surface, node, place):
    points = surface.points.copy()
    points[node] = place
    return surface.moved(points)


@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_a_node_beyond_a_thin_wall_returns_to_its_own_side(scale):
    """It is nearer to the other side, which it would only touch."""
    thickness = 0.1 * TOLERANCE
    plate = box(thickness)
    plate = plate.moved(scale * plate.points)
    node = node_at(plate, scale * np.array([0.5, 0.5, thickness]))
    crossed = with_node_at(plate, node, scale * np.array([0.5, 0.5, -0.2 * thickness]))
    assert len(crossing_facets(crossed).cells)
    repaired, new_node = repair_crossings(crossed, plate, scale * TOLERANCE)
    assert_allclose(repaired.points, plate.points, atol=1e-9 * scale)
    assert_array_equal(repaired.cells, plate.cells)
    assert_array_equal(new_node, np.arange(plate.n_points))


def crossed_beside_an_edge(length, depth):
    """A box with a node so far beyond an edge of it, beside a node of that edge."""
    given = box()
    at = node_at(given, [0.0, 0.5, 1.0])
    inside = node_at(given, [0.25, 0.5, 1.0])
    chosen = (np.sort(given.edges, axis=1) == sorted((at, inside))).all(axis=1)
    finer = split_edges(given, chosen).mesh
    crossed = with_node_at(finer, given.n_points, [-length, 0.5, 1.0 - depth])
    assert len(crossing_facets(crossed).cells)
    return given, crossed


def test_short_edges_are_collapsed_where_a_node_cannot_be_put_onto_the_surface():
    given, crossed = crossed_beside_an_edge(0.3 * TOLERANCE, 0.1 * TOLERANCE)
    repaired, new_node = repair_crossings(crossed, given, TOLERANCE)
    assert not len(crossing_facets(repaired).cells)
    assert is_oriented(repaired)
    assert repaired.n_points == given.n_points
    assert new_node[given.n_points] == new_node[node_at(given, [0.0, 0.5, 1.0])]
    assert_allclose(enclosed_measure(repaired), 1.0, rtol=1e-4)


def test_nodes_farther_off_than_the_tolerance_return_by_steps():
    given, crossed = crossed_beside_an_edge(3.0 * TOLERANCE, TOLERANCE)
    repaired, _ = repair_crossings(crossed, given, TOLERANCE)
    assert not len(crossing_facets(repaired).cells)
    assert farthest_places(repaired, given, 0.0).distance.max() < TOLERANCE


def test_a_surface_that_cannot_be_repaired_stays_as_it_is():
    crossed = joined(box(), moved(box(), [0.3, 0.4, 0.6]))
    repaired, new_node = repair_crossings(crossed, crossed, TOLERANCE)
    assert repaired is crossed
    assert_array_equal(new_node, np.arange(crossed.n_points))


def test_what_cannot_be_filled_afterwards_stays_as_it_is():
    given, crossed = crossed_beside_an_edge(0.3 * TOLERANCE, 0.1 * TOLERANCE)
    opened = SimplexMesh(crossed.points, crossed.cells[1:])
    assert len(crossing_facets(opened).cells)
    assert repair_crossings(opened, given, TOLERANCE)[0] is opened


def test_a_surface_without_crossings_stays_as_it_is():
    assert repair_crossings(box(), box(), TOLERANCE)[0].n_points == box().n_points
    surface = box()
    assert repair_crossings(surface, box(), TOLERANCE)[0] is surface


def test_slivers_are_removed_between_some_nodes_only():
    given = box()
    finer = given
    for place in ([0.25, 0.5, 1.0], [0.25, 0.5, 0.0]):
        ends = sorted(node_at(finer, [x, *place[1:]]) for x in (0.25, 0.5))
        chosen = (np.sort(finer.edges, axis=1) == ends).all(axis=1)
        finer = split_edges(finer, chosen).mesh
        finer = with_node_at(finer, finer.n_points - 1, np.add(place, [1e-3, 0.0, 0.0]))
    above = finer.points[:, 2] > 0.5
    assert remove_slivers(finer, 1e-2)[0].n_points == given.n_points
    part, new_node = remove_slivers(finer, 1e-2, above)
    assert part.n_points == given.n_points + 1
    assert len(np.unique(new_node[~above])) == np.count_nonzero(~above)


@pytest.mark.parametrize(
    ("was", "now", "is_near"), [(0.0, 0.9, True), (0.0, 1.2, False), (3.0, 2.9, True)]
)
def test_changes_keep_the_tolerance_or_what_was_farther_away(was, now, is_near):
    given = box()
    node = node_at(given, [0.5, 0.5, 1.0])
    where = np.arange(given.n_points) == node
    before, after = (
        (with_node_at(given, node, [0.5, 0.5, 1.0 - share * TOLERANCE]), where)
        for share in (was, now)
    )
    assert _is_near(before, after, given, TOLERANCE) == is_near
