"""Straight interfaces, tagged facets and lines, and feature edges stay where they are."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import block, facet_areas
from tagged_grids import changes, random_tags, unit_grid

from adaptsize import SimplexMesh, check_mesh, remesh
from adaptsize.errors import BoundaryWarning
from adaptsize.quality.boundary import distances_from, farthest_places, region_measures
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.straight_edges import StraightEdges, feature_edges
from adaptsize.remeshing.surface import facets_of


@pytest.mark.parametrize("is_moved", [False, True])
@pytest.mark.parametrize("dim_and_seed", [*((2, k) for k in range(6)), *((3, k) for k in range(3))])
def test_random_boxes_wedges_and_prisms_keep_their_sides_and_tags(dim_and_seed, is_moved):
    pytest.importorskip("mmgpy")
    dim, seed = dim_and_seed
    given, spacing = random_tags(1809 + seed, dim, is_moved=is_moved)
    rng = np.random.default_rng(seed)
    least = spacing * rng.uniform(*((0.1, 0.4) if dim == 2 else (0.4, 0.7)))
    start, g = given.points[rng.integers(given.n_points)], rng.uniform(0.3, 0.8)
    most = spacing * rng.uniform(0.8, 2.0)

    def size(points):
        return np.minimum(least + g * np.linalg.norm(points - start, axis=1), most)

    new = remesh(given, size)
    for what, change in changes(new, given).items():
        assert change < 1e-9, what
    assert check_mesh(new, original=given, tolerance=1e-9).is_met


def box_in_a_grid():
    """The box [0, 2] x [0, 1]^2, tag 1, in tetrahedra of a grid of spacing 1."""
    index, cells = unit_grid([4, 3, 3])
    middles = index[cells].mean(axis=1) - 1.0
    inside = ((middles > 0.0) & (middles < [2.0, 1.0, 1.0])).all(axis=1)
    return SimplexMesh(index - 1.0, cells, cell_tags=np.where(inside, 1, 2))


@pytest.mark.parametrize("order", [(1, 2), (2, 1), (1, 7)])
def test_a_box_among_tetrahedra_keeps_its_volume(order):
    pytest.importorskip("mmgpy")
    given = box_in_a_grid()
    given = replace(given, cell_tags=np.where(given.cell_tags == 1, *order))
    new = remesh(given, 0.6)
    assert region_measures(new)[order[0]] == pytest.approx(2.0, rel=1e-12)


def bulged_block(n):
    """A unit cube of tetrahedra, its upper side bulged up to .33, with straight edges."""
    mesh = block(n)
    x, y, z = mesh.points.T
    top = z * np.sin(np.pi * x) * np.sin(np.pi * y) * (0.25 + 0.08 * np.sin(7.0 * x + 3.0 * y))
    return mesh.moved(mesh.points + np.outer(top, [0.0, 0.0, 1.0]))


@pytest.mark.parametrize("target", ["auto", "triangles"])
def test_straight_edges_beside_curved_facets_stay_straight(target):
    pytest.importorskip("mmgpy")
    given = bulged_block(12)
    if target == "triangles":
        given = given.boundary().mesh
    new = remesh(given, 0.3, target=target)
    skin = new if target == "triangles" else new.boundary().mesh
    edges = skin.points[feature_edges(skin)]
    assert np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1).sum() == pytest.approx(12.0, rel=1e-9)
    away = np.sort(np.minimum(np.abs(edges), np.abs(1.0 - edges)), axis=2)
    assert away[:, :, :2].max() < 1e-9


def test_nodes_of_straight_edges_are_not_moved_off_by_the_improvement_of_cells():
    given = block(3)
    points = given.points.copy()
    # A node inside next to an edge of the cube makes flat cells around that edge.
    node = int(np.argmin(np.linalg.norm(points - 1.0 / 3.0, axis=1)))
    points[node] = [0.04, 0.04, 1.0 / 3.0]
    mesh = replace(given, points=points)
    assert (mesh.signed_measures * np.sign(given.signed_measures) > 0.0).all()
    cells = mesh.cells.copy()
    inverted = mesh.signed_measures < 0.0
    cells[inverted, :2] = cells[inverted, 1::-1]
    mesh = SimplexMesh(points, cells)
    new = improved(mesh, given, 0.05)
    assert len(feature_edges(facets_of(new))) == 36
    assert new.measures.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("half", "spacing"), [(0.08, 0.2), (0.08, 0.1), (0.1, 0.1)])
def test_the_sharp_edge_of_a_wedge_is_cut_within_the_tolerance(half, spacing):
    # At its cells, with angles of 9 to 11 degrees, repairs end only where the tolerance does.
    pytest.importorskip("mmgpy")
    profile = [[0.0, 0.0, 0.0], [1.0, 0.0, half], [1.0, 0.0, -half]]
    points = np.concatenate([profile, np.add(profile, [0.0, 4.0, 0.0])])
    sides = [[0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]]
    given = SimplexMesh(points, [[0, 1, 2], [3, 5, 4], *sides])
    made = facets_of(remesh(given, spacing, tolerance=4e-3))
    for one, other in ((made, given), (given, made)):
        far = farthest_places(one, other, 1e-3 * given.diagonal).distance.max()
        assert far < 1.02 * 4e-3 * given.diagonal


def test_edges_are_straight_between_corners_or_where_they_go_on():
    angle = 2.0 * np.pi * np.arange(24) / 24
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    n = np.arange(24)
    fan = SimplexMesh([*ring, [0, 0]], np.column_stack([n, (n + 1) % 24, n * 0 + 24]))
    square = SimplexMesh(
        [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0]], [[0, 4, 3], [4, 2, 3], [4, 1, 2]]
    )
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    for mesh, expected in ((fan, 0), (square, 5), (square.moved(square.points @ turn), 5)):
        # Edges across the square connect straight ones.
        assert StraightEdges(mesh).are_parts(mesh).sum() == expected
    off = square.points.copy()
    off[4, 1] = -1e-4
    moved = StraightEdges(square).straightened(square.moved(off), 1e-3)
    np.testing.assert_allclose(moved.points, square.points, atol=1e-15)
    kept = StraightEdges(square).straightened(square.moved(off), 1e-5)
    np.testing.assert_array_equal(kept.points, off)


#: Lines in the plane: ends as multiples of a tenth of the square.
LINES = {
    "inside": [(3, 4, 7, 4)],
    "from the boundary": [(0, 6, 5, 6)],
    "through": [(5, 0, 5, 10)],
    "closed": [(2, 2, 6, 2), (6, 2, 6, 6), (2, 6, 6, 6), (2, 2, 2, 6)],
    "beside an interface": [(3, 0, 3, 10)],
    "crossing": [(0, 3, 10, 3), (7, 0, 7, 10)],
}


def square_with_lines(lines):
    """Triangles of the unit square, regions 4 (x < .4) and 6, tagged lines, and a tagged side."""
    n = 10
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (node[i : i + n, j : j + n].ravel() for i in (0, 1) for j in (0, 1))
    cells = np.concatenate([np.column_stack([a, c, d]), np.column_stack([a, d, b])])
    points = np.column_stack([x.ravel(), y.ravel()]) / n
    edges, tags = [[0, 1]], [9]
    for tag, (i, j, k, m) in enumerate(lines, start=1):
        on_line = node[i : k + 1, j : m + 1].ravel()
        edges += np.column_stack([on_line[:-1], on_line[1:]]).tolist()
        tags += [tag] * (len(on_line) - 1)
    left = points[cells].mean(axis=1)[:, 0] < 0.4
    return SimplexMesh(
        points, cells, cell_tags=np.where(left, 4, 6), tagged_facets=edges, facet_tags=tags
    )


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("h", [0.03, 0.15])
def test_tagged_lines_inside_a_region_of_the_plane_are_kept(name, h):
    pytest.importorskip("mmgpy")
    given = square_with_lines(LINES[name])
    new = remesh(given, h)
    lengths = [1.0 * (max(k - i, m - j)) / 10 for i, j, k, m in LINES[name]]
    found = [facet_areas(new, tag) for tag in range(1, len(lengths) + 1)]
    assert found == pytest.approx(lengths, rel=1e-9)
    assert max(changes(new, given).values()) < 1e-9
    lines = new.tagged_facets[new.facet_tags != 9]
    assert len(np.unique(np.sort(lines, axis=1), axis=0)) == len(lines)
    ends = new.points[lines]
    longest = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max()
    assert longest < 1.6 * h  # lines are divided, and joined, to the size


@pytest.mark.parametrize("h", [0.1, 0.04])
@pytest.mark.parametrize("n_sides", [48, 96])
def test_curved_lines_inside_a_region_are_kept_within_the_tolerance(n_sides, h):
    pytest.importorskip("mmgpy")
    n = np.arange(n_sides)
    angle = 2.0 * np.pi * n / n_sides
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.concatenate([0.4 * ring, 0.7 * ring, ring, [[0.0, 0.0]]])
    after = (n + 1) % n_sides
    cells = [np.column_stack([n, after, n * 0 + 3 * n_sides])]
    for k in (0, n_sides):
        cells.append(np.column_stack([n + k, n + k + n_sides, after + k + n_sides]))
        cells.append(np.column_stack([n + k, after + k + n_sides, after + k]))
    half = np.column_stack([n, after])[: n_sides // 2] + n_sides
    lines = np.concatenate([np.column_stack([n, after]), half])
    given = SimplexMesh(
        points,
        np.concatenate(cells),
        tagged_facets=lines,
        facet_tags=np.repeat([1, 2], [n_sides, n_sides // 2]),
    )
    new = remesh(given, h)
    check = check_mesh(new, original=given, tolerance=1e-3)
    assert check.is_met, check


def test_a_sheet_that_a_generator_loses_is_warned_of():
    given = block(2)
    x = given.points[given.facets][:, :, 0]
    sheet = given.facets[(x == 0.5).all(axis=1)]
    given = replace(given, tagged_facets=sheet, facet_tags=np.full(len(sheet), 40))
    with pytest.warns(BoundaryWarning, match="lost the facets with the tags 40, which tetwild did"):
        new = remesh(given, 0.6, backend="tetwild", tolerance=0.01)
    assert not check_mesh(new, original=given, tolerance=0.05).is_met


def test_distances_of_tagged_sets_are_measured_in_both_directions():
    given = square_with_lines(LINES["inside"])
    shorter = replace(
        given, tagged_facets=given.tagged_facets[:-1], facet_tags=given.facet_tags[:-1]
    )
    old, new = (SimplexMesh(m.points, m.tagged_facets) for m in (given, shorter))
    assert distances_from(new, old).largest == 0.0
    (failure,) = [one for one in check_mesh(shorter, original=given).failures if one.name == "tags"]
    assert failure.value * given.diagonal == pytest.approx(0.1)
    assert failure.text.startswith("2; 1 within 0.1 (0.0707 of the diagonal)")
