"""Swapping and smoothing of tetrahedra: no cell becomes worse than the worst."""

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from shapes import block, two_region_block

import adaptsize as ads
from adaptsize._kernels.smoothing import fill_quality, smooth_nodes
from adaptsize._kernels.swapping import Tetrahedra, new_work, swap
from adaptsize.background import topology
from adaptsize.background.topology import regions_beside
from adaptsize.quality.boundary import distances_from
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing.improvement import _Balls as Balls
from adaptsize.remeshing.improvement import _Far as Far
from adaptsize.remeshing.improvement import _in_rounds as in_rounds
from adaptsize.remeshing.improvement import _keys_of, improved
from adaptsize.remeshing.improvement import _with_nodes as with_nodes
from adaptsize.remeshing.surface import facets_of


def volume_length(points, cells):
    """The measure by its definition: regular simplices of unit edges have 3^(1/2)/4, 2^(1/2)/12."""
    corners = points[cells]
    dim = points.shape[1]
    measures = np.linalg.det(corners[:, 1:] - corners[:, :1]) / (2.0 if dim == 2 else 6.0)
    pairs = itertools.combinations(range(dim + 1), 2)
    squares = [((corners[:, a] - corners[:, b]) ** 2).sum(axis=1) for a, b in pairs]
    regular = {2: 3.0**0.5 / 4.0, 3: 2.0**0.5 / 12.0}[dim]
    return measures / (regular * np.mean(squares, axis=0) ** (dim / 2))


def random_cells(dim, n, seed):
    points = np.random.default_rng(seed).random((n, dim))
    cells = Delaunay(points).simplices.astype(np.int32)
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0.0
    cells[negative, :2] = cells[negative, 1::-1]
    return points, np.ascontiguousarray(cells)


@pytest.mark.parametrize("dim", [2, 3])
def test_quality_is_the_volume_length_measure_signed(dim):
    points, cells = random_cells(dim, 30, 8)
    cells[::2, :2] = cells[::2, 1::-1]
    quality = np.empty(len(cells))
    fill_quality(points, cells, quality)
    np.testing.assert_allclose(quality, volume_length(points, cells), atol=1e-12)
    assert (quality[::2] < 0.0).all()
    assert (quality[1::2] > 0.0).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_smoothing_makes_no_worst_cell_worse_and_respects_normals(dim):
    points, cells = random_cells(dim, 60, 31)
    skin = np.unique(ads.SimplexMesh(points, cells).boundary().nodes)
    nodes = np.setdiff1d(np.arange(len(points)), skin).astype(np.int64)
    normals = np.zeros_like(points)
    normals[nodes[::2], 0] = 1.0
    before, old = volume_length(points, cells), points.copy()
    ring_ptr, ring_of = topology.rings(cells, len(points))
    moves = (nodes, normals, np.full(len(points), 0.1))
    smooth_nodes(points, cells, (ring_ptr, ring_of), moves)
    after = volume_length(points, cells)
    worst = [
        q[ring_of[ring_ptr[i] : ring_ptr[i + 1]]].min() for q in (before, after) for i in nodes
    ]
    assert after.min() >= before.min()
    assert np.mean(worst[len(nodes) :]) > np.mean(worst[: len(nodes)])
    np.testing.assert_array_equal(points[skin], old[skin])
    np.testing.assert_array_equal(points[nodes[::2], 0], old[nodes[::2], 0])
    assert (points[nodes] != old[nodes]).any()


def swapped(points, cells):
    quality = np.empty(len(cells))
    fill_quality(points, cells, quality)
    bad = np.argsort(quality)[: len(cells) // 2]
    ring_ptr, ring_of = topology.rings(cells, len(points))
    dead = np.zeros(len(cells), np.bool_)
    made = np.empty((40 * len(cells), 4), np.int32)
    mesh = Tetrahedra(points, cells, ring_ptr, ring_of, quality, dead)
    n_made = swap(mesh, bad, new_work(), made)
    return np.concatenate([cells[~dead], made[:n_made]]), quality


@pytest.mark.parametrize("seed", [3, 17, 2025])
def test_swaps_fill_the_same_space_with_better_tetrahedra(seed):
    points, cells = random_cells(3, 60, seed)
    volume = ads.SimplexMesh(points, cells).measures.sum()
    skin = ads.SimplexMesh(points, cells).boundary().mesh.measures.sum()
    new, quality = swapped(points, cells)
    mesh = ads.SimplexMesh(points, new)
    assert len(new) != len(cells) or (new != cells).any()
    assert (mesh.signed_measures > 0.0).all()
    assert mesh.facet_cell_counts.max() == 2
    assert mesh.measures.sum() == pytest.approx(volume, rel=1e-12)
    assert mesh.boundary().mesh.measures.sum() == pytest.approx(skin, rel=1e-12)
    assert np.sort(volume_length(points, new))[:20].sum() > np.sort(quality)[:20].sum()


@pytest.mark.parametrize(("height", "reached"), [(0.1, 0.1), (0.2, 0.1), (3.0, None)])
def test_an_edge_is_divided_only_if_its_node_or_one_halfway_spoils_no_cell(height, reached):
    cell = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    there = np.array([[0.5, height, height]])
    new, surface = with_nodes(cell, facets_of(cell), cell.edges[:1], there, 0.2)
    assert same_facets(surface, facets_of(new))
    added = np.empty((0, 3)) if reached is None else [[0.5, reached, reached]]
    np.testing.assert_allclose(new.points[4:], added, atol=1e-15)
    assert volume_length(new.points, new.cells).min() > 0.2


def test_a_plane_edge_too_far_from_the_old_boundary_gets_a_node_there():
    angles = np.arange(48) * np.pi / 24.0
    points = [*np.stack([np.cos(angles), np.sin(angles)], axis=1), [0.0, 0.0]]
    given = ads.SimplexMesh(points, [[i, (i + 1) % 48, 48] for i in range(48)])
    cells = [[i, i + 1, 48] for i in range(46)] + [[46, 0, 48]]  # without node 47
    mesh = ads.SimplexMesh(points, cells, tagged_facets=[[46, 0], [0, 1]], facet_tags=[3, 4])
    away = 1.0 - np.cos(np.pi / 24.0)
    new = improved(mesh, given, 0.95 * away)
    assert np.linalg.norm(new.points - points[47], axis=1).min() < 1e-3
    assert (new.n_cells, sorted(new.facet_tags)) == (48, [3, 3, 4])
    assert improved(mesh, given, 1.05 * away).n_cells == 47


def with_tip(mesh, corners, height):
    """A mesh with a node above the middle of a boundary facet, from which its cell is divided."""
    cell = int(np.flatnonzero(np.isin(mesh.cells, corners).sum(axis=1) == 3)[0])
    row, tip = mesh.cells[cell], mesh.points[corners].mean(axis=0)
    tip[2] += height
    parts = [np.where(row == corner, mesh.n_points, row) for corner in corners]
    cells = np.vstack([np.delete(mesh.cells, cell, axis=0), parts])
    return ads.SimplexMesh(np.vstack([mesh.points, tip]), cells)


def test_nodes_are_put_back_if_they_are_off_by_more_than_half_of_the_tolerance():
    given, tolerance = block(4), 0.02
    heights = np.array([-1.2, -0.51, -0.49, -0.2, 0.2, 0.49, 0.51, 1.2])
    points = given.points.copy()
    is_on_top = (points[:, 2] == 1.0) & (np.abs(points[:, :2] - 0.5) < 0.3).all(axis=1)
    nodes = np.flatnonzero(is_on_top)[: len(heights)]
    points[nodes, 2] += heights * tolerance
    new = improved(given.moved(points), given, tolerance)
    left = np.where(np.abs(heights) > 0.5, 0.0, heights)
    np.testing.assert_allclose(new.points[nodes, 2], 1.0 + left * tolerance, atol=1e-12)


def same_facets(one, other):
    """Whether the facets are the same, in any order, with the same groups."""
    rows = [np.column_stack([np.sort(x.cells, axis=1), x.cell_tags]) for x in (one, other)]
    return np.array_equal(*(x[np.lexsort(x.T)] for x in rows)) and np.array_equal(
        one.points, other.points
    )


def with_meshes(old, limit, found):
    """What rounds call: the next step has the mesh that ``found`` returns."""

    def made(now, least, spoiled):
        mesh = found(now, least, spoiled)
        return now if mesh is now.mesh else now.with_mesh(mesh, facets_of(mesh), old, limit)

    return made


def test_facets_are_divided_with_their_cells():
    mesh = two_region_block(3)
    surface = facets_of(mesh)
    for _ in range(4):
        on_surface = surface.edges[::5]
        there = mesh.points[on_surface].swapaxes(1, 2) @ [0.45, 0.55]
        mesh, surface = with_nodes(mesh, surface, on_surface, there, 0.05)
        assert same_facets(surface, facets_of(mesh))
    assert surface.n_cells > 1.5 * facets_of(two_region_block(3)).n_cells


def test_later_rounds_place_the_nodes_that_would_have_spoilt_cells():
    flat = block(8)
    skin = flat.boundary()
    facets = skin.nodes[skin.mesh.cells]
    corners = facets[np.flatnonzero((flat.points[facets][:, :, 2] == 1.0).all(axis=1))[7]]
    high, thin = with_tip(flat, corners, 0.05), with_tip(flat, corners, -0.0415)
    assert minimum_angles(thin).min() < 5.0
    assert minimum_angles(high).min() > 10.0
    old = high.boundary().mesh
    asked = []

    def run(*rounds):
        asked.clear()

        def made(now, least, spoiled):
            assert now.far.surface.n_cells == now.mesh.boundary().mesh.n_cells
            asked.append((least, len(spoiled.radii)))
            return rounds[min(len(asked), len(rounds)) - 1]

        return in_rounds(flat, old, 0.02, with_meshes(old, 0.018, made))

    assert run(high) is high  # near at once
    assert asked == [(0.2, 0)]
    assert run(flat, high) is high
    assert asked == [(0.2, 0), (0.05, 0)]
    assert run(flat) is flat  # no nearer
    assert run(flat, thin, high) is high  # a flat cell is no price for an edge, and is avoided
    assert [n for _, n in asked] == [0, 0, 1]
    beside = ads.SimplexMesh(
        np.vstack([high.points, high.points + np.array([0.3, 0.2, 0.0])]),
        np.vstack([high.cells, high.cells + high.n_points]),
    )
    assert run(flat, beside, high) is high  # neither are facets that cross
    assert [n > 0 for _, n in asked] == [False, False, True]
    assert run(beside, high) is high  # nor in the first round
    assert [(least, n > 0) for least, n in asked] == [(0.2, False), (0.2, True)]
    assert run(beside, beside, beside, high) is high  # which may be left out
    assert [least for least, _ in asked] == [0.2, 0.2, 0.2, 0.05]
    slightly = with_tip(flat, corners, 0.0015)
    assert run(flat, slightly, high) is high  # so little nearer that lower qualities are next
    assert [least for least, _ in asked] == [0.2, 0.05, 0.01]


@pytest.mark.parametrize(
    ("tolerance", "height", "gives_up", "is_final"),
    [
        (0.0164, 0.0, True, True),
        (0.0164, 0.0, False, False),  # no other mesh would follow
        (0.0024, 0.0, False, True),  # so far away that no mesh of this one is near
        (0.0172, 0.0, True, False),  # not that far away
        (0.014, 0.0065, True, False),  # the first round has brought it nearer
        (0.014, 0.0035, True, True),
    ],
)
def test_rounds_end_where_the_first_one_leaves_a_place_far_away(
    tolerance, height, gives_up, is_final
):
    flat = block(8)
    skin = flat.boundary()
    facets = skin.nodes[skin.mesh.cells]
    corners = facets[np.flatnonzero((flat.points[facets][:, :, 2] == 1.0).all(axis=1))[7]]
    high = with_tip(flat, corners, 0.05)
    after_first = with_tip(flat, corners, height) if height else flat
    made = iter([after_first, high])
    old = high.boundary().mesh
    calls = []
    give_up = partial(calls.append, True) if gives_up else None
    rounds = with_meshes(old, 0.9 * tolerance, lambda *_: next(made))
    new = in_rounds(flat, old, tolerance, rounds, give_up)
    assert new is (after_first if is_final else high)
    assert calls == ([True] if is_final and gives_up else [])


def test_distances_after_changes_are_those_of_the_whole_mesh():
    rng = np.random.default_rng(4)
    flat = block(8)
    points = flat.points.copy()
    points += 0.03 * rng.uniform(-1.0, 1.0, points.shape)
    mesh, old = flat.moved(points), flat.boundary().mesh
    far = Far.of(mesh.boundary().mesh, old, 0.01)
    points[::9] += 0.03 * rng.uniform(-1.0, 1.0, points[::9].shape)
    changed = ads.SimplexMesh(points, mesh.cells[rng.permutation(mesh.n_cells)]).boundary().mesh
    assert (points != mesh.points).any()
    found, whole = far.after(changed, old, 0.01), Far.of(changed, old, 0.01)
    np.testing.assert_array_equal(found.surface.cells, whole.surface.cells)
    for one, other in ((found.new, whole.new), (found.lost, whole.lost)):
        over = other.distance > 0.0102
        assert over.sum() > 20
        np.testing.assert_allclose(one.distance[over], other.distance[over], rtol=0.011)
        assert (one.distance[~over] < 0.0103).all()
    again = found.after(changed, old, 0.01)
    np.testing.assert_array_equal(again.new.distance, found.new.distance)
    np.testing.assert_array_equal(again.lost.distance, found.lost.distance)


def test_balls_contain_what_is_around_cells():
    mesh = block(2)
    first = np.arange(mesh.n_cells) == 0
    both = Balls.around(mesh, first).and_also(Balls.around(mesh, ~first))
    assert len(both.radii) == mesh.n_cells
    here = mesh.points[mesh.cells[:1]].mean(axis=1)
    far = here + 100.0
    assert Balls.around(mesh, first).contain(np.concatenate([here, far])).tolist() == [True, False]


def ball_of(n, seed):
    """Tetrahedra in the unit ball with nodes on the sphere and in the centre."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points = np.vstack([points, np.zeros(3)])
    cells = ConvexHull(points[:-1]).simplices
    cells = np.column_stack([cells, np.full(len(cells), n)]).astype(np.int32)
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0.0
    cells[negative, :2] = cells[negative, 1::-1]
    return ads.SimplexMesh(points, cells)


def sheet(n):
    """An open surface over the unit square, with a hill at its rim."""
    flat = ads.CartesianGrid([0.0, 0.0], 1.0 / n, (n + 1, n + 1)).mesh
    x, y = flat.points.T
    hill = 0.2 * np.exp(-((x - 0.45) ** 2 + (y - 0.05) ** 2) / 0.03)
    return ads.SimplexMesh(np.column_stack([x, y, hill]), flat.cells)


COARSE = {
    "tetrahedra": (ball_of(3000, 5).boundary().mesh, ball_of(300, 6)),
    "surface": (ball_of(3000, 5).boundary().mesh, ball_of(300, 6).boundary().mesh),
    "open surface": (sheet(40), sheet(10)),
}


@pytest.mark.parametrize("kind", COARSE)
def test_facets_are_divided_where_they_are_truly_far(kind):
    given, mesh = COARSE[kind]

    def farthest(mesh):
        skin = facets_of(mesh)
        return max(distances_from(*pair).largest for pair in ((given, skin), (skin, given)))

    tolerance = 0.6 * farthest(mesh)
    new = improved(mesh, given, tolerance, lambda x: np.full(len(x), 0.2))
    assert farthest(new) <= 1.02 * tolerance
    assert new.n_cells < 1.5 * mesh.n_cells
    if mesh.cell_dim < mesh.dim:
        assert new.facet_cell_counts.max() == 2
        assert new.is_closed == mesh.is_closed
        assert minimum_angles(new).min() > 10.0


def test_lines_between_tags_of_a_surface_stay_where_facets_are_divided():
    given, mesh = sheet(40), sheet(10)
    left = lambda mesh: mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.4  # noqa: E731
    given, mesh = (replace(one, cell_tags=np.where(left(one), 3, 8)) for one in (given, mesh))
    tolerance = 0.5 * max(distances_from(*pair).largest for pair in ((given, mesh), (mesh, given)))
    new = improved(mesh, given, tolerance, lambda x: np.full(len(x), 0.2))
    assert new.n_cells > mesh.n_cells
    lowest, highest = regions_beside(new.cell_facets, new.cell_tags, len(new.facets))
    border = new.points[np.unique(new.facets[lowest != highest])]
    np.testing.assert_allclose(border[:, 0], 0.4, atol=1e-9)


def test_facets_of_regular_grids_have_keys_of_their_own():
    skin = block(6).boundary().mesh
    i, j = np.divmod(np.arange(49), 7)
    slope = np.column_stack([i, j, 6 - i]) / 6.0  # x + z is constant
    corners = (np.arange(36) // 6 * 7 + np.arange(36) % 6)[:, None]
    tilted = ads.SimplexMesh(slope, corners + np.array([[0, 1, 7]]))
    for surface in (skin, tilted):
        assert len(np.unique(_keys_of(surface))) == surface.n_cells
