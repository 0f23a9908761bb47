"""Lines between tags of curved boundaries: nodes on them leave them by the tolerance at most."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import block

from adaptsize import SimplexMesh
from adaptsize.quality.boundary import distances_from
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing.borders import BorderLines, Borders
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.surface import facets_of


def column(n, rise):
    """Tetrahedra of a column with curved sides, tagged below and above a line around it.

    ``rise`` gives the height of the line at points of the sides.
    """
    mesh = block(n)
    x, y, z = (2.0 * mesh.points - 1.0).T
    side = np.maximum(np.abs(x), np.abs(y))
    length = np.maximum(np.hypot(x, y), 1e-12)
    x, y = (v * (0.3 * side / length + 0.7) for v in (x, y))
    height = z + (1.0 - z * z) * rise(x, y)
    mesh = replace(mesh, points=np.column_stack([x, y, height]))
    facets = mesh.facets[mesh.facet_cell_counts == 1]
    middle = block(n).points[facets].mean(axis=1)
    sides = (np.abs(2.0 * middle[:, :2] - 1.0).max(axis=1)) > 1.0 - 1e-9
    tags = np.where(middle[sides, 2] < 0.5, 4, 9)
    return replace(mesh, tagged_facets=facets[sides], facet_tags=tags)


def border(mesh):
    """The line between the tags."""
    sides = SimplexMesh(mesh.points, mesh.tagged_facets, cell_tags=mesh.facet_tags)
    return SimplexMesh(mesh.points, BorderLines.of(sides).edges)


RISES = {
    "slanted": lambda x, y: 0.25 * x + 0.1 * y,
    "wound": lambda x, y: 0.08 * np.sin(3.0 * np.arctan2(y, x)) + 0.15 * x,
}


@pytest.mark.parametrize("rise", RISES)
def test_the_line_between_two_tags_of_a_curved_side_stays(rise):
    given, mesh = column(16, RISES[rise]), column(6, RISES[rise])
    rng = np.random.default_rng(3)
    points = mesh.points.copy()
    inside = np.setdiff1d(np.arange(mesh.n_points), facets_of(mesh).cells)
    points[inside] += rng.uniform(-0.04, 0.04, (len(inside), 3))
    mesh = mesh.moved(points)
    size = lambda x: np.full(len(x), 0.3)  # noqa: E731
    skins = [facets_of(one) for one in (given, mesh)]
    before = max(distances_from(*pair).largest for pair in (skins, skins[::-1]))
    tolerance = 0.5 * before
    new = improved(mesh, given, tolerance, size)
    skin = facets_of(new)
    lines = border(new), border(given)
    for pair in (lines, lines[::-1]):
        assert distances_from(*pair).largest <= 1.01 * tolerance
    skin = facets_of(new)
    for pair in ((skin, skins[0]), (skins[0], skin)):
        assert distances_from(*pair).largest <= 1.05 * tolerance
    assert minimum_angles(new).min() > 15.0


def test_a_line_is_compared_with_those_between_the_same_tags_only():
    given = column(8, RISES["slanted"])
    x, _, z = given.points[given.tagged_facets].mean(axis=1).T
    tags = np.where((x > 0.0) & (z > 0.5), 2, given.facet_tags)
    mesh = replace(given, facet_tags=tags)
    skin = facets_of(mesh)
    own, alien = Borders(mesh, mesh), Borders(given, mesh)
    assert not len(own.nodes_off(skin, 1e-9)[0])
    assert not len(alien.nodes_off(skin, 1e-9)[0])
    between = BorderLines.of(SimplexMesh(mesh.points, mesh.tagged_facets, cell_tags=tags))
    nodes = np.unique(between.edges[(between.kinds[:, :2] == [2, 9]).all(axis=1)])
    others = np.unique(between.edges[(between.kinds[:, :2] == [4, 9]).all(axis=1)])
    nodes = np.setdiff1d(nodes, others)
    assert len(nodes) > 3
    away = alien.nearest_of_nodes(skin, nodes, mesh.points[nodes])[1]
    assert np.isinf(away[mesh.points[nodes, 2] < 0.9]).all()


def test_lines_farther_away_than_an_edge_are_no_aim():
    given = column(8, RISES["slanted"])
    middle = block(8).points[given.tagged_facets].mean(axis=1)
    for height, is_near in ((0.5 + 1.0 / 8.0, True), (0.5 + 3.0 / 8.0, False)):
        mesh = replace(given, facet_tags=np.where(middle[:, 2] < height, 4, 9))
        nodes, _ = Borders(given, mesh).nodes_off(facets_of(mesh), 1e-3)
        assert len(nodes) > 10 if is_near else len(nodes) == 0


def test_nodes_at_which_a_line_turns_stay_and_others_are_put_onto_it():
    """The line around a cube at half its height turns at four edges."""
    n = 4
    mesh = block(n)
    facets = mesh.facets[mesh.facet_cell_counts == 1]
    tags = np.where(mesh.points[facets].mean(axis=1)[:, 2] < 0.5, 4, 9)
    given = replace(mesh, tagged_facets=facets, facet_tags=tags)
    skin = facets_of(given)
    nodes = np.unique(border(given).cells)
    at = skin.points[nodes]
    assert len(nodes) == 4 * n
    edges = np.full((len(nodes), 2), -1, np.int32)
    there, may = Borders(given, given).kept_on(skin, nodes, edges, at + 0.05 * np.eye(3)[2], 0.01)
    is_turn = np.isin(at[:, :2], [0.0, 1.0]).all(axis=1)
    assert is_turn.sum() == 4
    np.testing.assert_array_equal(may, ~is_turn)
    np.testing.assert_allclose(there[may], at[may], atol=1e-12)


def test_a_node_does_not_move_along_a_curved_line_until_an_edge_there_is_too_far_away():
    given, mesh = column(16, RISES["slanted"]), column(8, RISES["slanted"])
    borders, skin, line = Borders(given, mesh), facets_of(mesh), border(mesh)
    edge = line.cells[np.argmin(np.abs(line.points[line.cells].mean(axis=1) - [1, 0, 0.25]).sum(1))]
    start, end = skin.points[edge]
    none = np.full((1, 2), -1, np.int32)
    for share, limit, is_allowed in ((0.1, 0.005, True), (0.9, 0.005, False), (0.9, 0.1, True)):
        there = (start + share * (end - start))[None]
        may = borders.kept_on(skin, edge[:1], none, there, limit)[1]
        assert may.tolist() == [is_allowed]


def test_lines_of_a_surface_have_their_own_tags_and_are_compared_by_them():
    skin = block(4).boundary().mesh
    middles = skin.points[skin.edges].mean(axis=1)
    heights = {0.25: 5, 0.5: 6}
    rows = {
        h: np.flatnonzero(np.abs(skin.points[skin.edges] - [0, 0, h])[:, :, 2].max(1) < 1e-9)
        for h in heights
    }
    rows = {
        h: found[np.isin(middles[found, :2], [0.0, 1.0]).any(axis=1)] for h, found in rows.items()
    }
    edges = {h: skin.edges[found] for h, found in rows.items()}
    given = replace(
        skin,
        tagged_facets=np.concatenate([*edges.values()]),
        facet_tags=np.repeat([*heights.values()], [len(one) for one in edges.values()]),
    )
    lines = BorderLines.of(given)
    for h, tag in heights.items():
        own = lines.rows_of(np.sort(edges[h], axis=1))
        assert len(own) == 16
        assert (lines.kinds[own, 2] == tag).all()
    # The line of one tag where the other one was: what is near is of another tag.
    swapped = replace(given, facet_tags=11 - given.facet_tags)
    nodes = np.unique(edges[0.5])
    one, other = (
        Borders(old, given).nearest_of_nodes(given, nodes, given.points[nodes])[1]
        for old in (given, swapped)
    )
    np.testing.assert_allclose(one, 0.0, atol=1e-12)
    assert (other > 0.2).all()
