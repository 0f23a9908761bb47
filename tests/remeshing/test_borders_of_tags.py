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
