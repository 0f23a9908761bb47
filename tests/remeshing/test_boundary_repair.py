"""Repair of the worst cells: everything but the cells stays, within the tolerance both ways."""

import itertools
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.spatial import Delaunay
from shapes import block, facet_areas, joined, two_region_block, two_region_rectangle

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize._kernels.local_mesh import new_work
from adaptsize._kernels.star_changes import _may_vanish as may_vanish
from adaptsize.background.location import in_space
from adaptsize.background.splitting import bisect_edges
from adaptsize.quality.boundary import n_components, overlapping_cells, region_measures
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing import boundary_repair, tuning
from adaptsize.remeshing.boundary_repair import Wanted, angles_of, repaired
from adaptsize.remeshing.following import Follower, Groups
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.straight_edges import feature_edges
from adaptsize.remeshing.surface import facets_of


def positive(points, cells):
    """Cells of full dimension without flat ones, positively oriented."""
    mesh = SimplexMesh(points, cells)
    cells = np.array(mesh.cells[mesh.measures > 1e-9])
    inverted = SimplexMesh(points, cells).signed_measures < 0.0
    cells[inverted, :2] = cells[inverted, 1::-1]
    return SimplexMesh(points, cells)


def ball(n, seed):
    """Tetrahedra between n nodes on a sphere and some inside."""
    k = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * k / n, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z * z)
    sphere = np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    inside = np.random.default_rng(seed).uniform(-0.6, 0.6, (n // 2, 3))
    points = np.concatenate([sphere, inside])
    return positive(points, Delaunay(points).simplices)


def with_details(mesh, seed, share=0.06):
    """The same domain with nodes close to the ends of some edges, which makes thin cells."""
    rng = np.random.default_rng(seed)
    chosen = mesh.edges[rng.random(len(mesh.edges)) < share]
    split = bisect_edges(mesh, chosen)
    made = chosen[split.split]
    points = split.mesh.points.copy()
    t = rng.uniform(0.03, 0.12, len(made))[:, None]
    points[mesh.n_points :] = (1.0 - t) * mesh.points[made[:, 0]] + t * mesh.points[made[:, 1]]
    return replace(split.mesh, points=points)


def turned(mesh, seed=77):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(mesh.dim, mesh.dim)))[0]
    turn *= np.sign(np.linalg.det(turn)) if mesh.dim == 3 else 1.0
    if mesh.dim == 2:
        turn[:, 0] *= np.sign(np.linalg.det(turn))
    return replace(mesh, points=mesh.points @ turn.T)


def dense_samples(skin, n=6):
    """Points of triangles or segments on a fine grid of weights."""
    k = skin.cell_dim + 1
    weights = np.array([w for w in itertools.product(range(n + 1), repeat=k) if sum(w) == n]) / n
    return np.einsum("wk,ckd->cwd", weights, skin.points[skin.cells]).reshape(-1, skin.dim)


def gap(one, other):
    """The larger of the distances of two surfaces or curves from each other, by dense samples."""
    return max(
        float(there.locator.nearest(dense_samples(here))[2].max())
        for here, there in ((one, other), (other, one))
    )


def by_group(mesh):
    """Facets of a mesh by their tag, and the boundary."""
    found = {"boundary": mesh.boundary().mesh} if not mesh.is_closed else {}
    for tag in [] if mesh.facet_tags is None else np.unique(mesh.facet_tags).tolist():
        found[tag] = SimplexMesh(mesh.points, mesh.tagged_facets[mesh.facet_tags == tag])
    return found


def topology_of(mesh):
    """Number of components, Euler number, and the largest number of cells at a facet."""
    euler = int(mesh.in_a_cell.sum()) + (-1) ** mesh.cell_dim * mesh.n_cells
    if mesh.cell_dim > 1:
        euler -= len(mesh.edges)
    if mesh.cell_dim > 2:
        euler += len(mesh.facets)
    return n_components(mesh), euler, int(mesh.facet_cell_counts.max())


def check_kept(old, new, tolerance):
    """Domain, topology, regions and tags are those of the old mesh, within the tolerance."""
    assert topology_of(new) == topology_of(old)
    if new.cell_dim == new.dim:
        assert (new.signed_measures > 0.0).all()
    groups, before = by_group(new), by_group(old)
    assert groups.keys() == before.keys()
    for name, part in groups.items():
        assert gap(part, before[name]) <= 1.2 * tolerance
        assert topology_of(part) == topology_of(before[name])
    if new.cell_dim < new.dim:
        assert gap(new, old) <= 1.2 * tolerance
    measures, area = region_measures(new), facets_of(old).measures.sum()
    assert measures.keys() == region_measures(old).keys()
    for tag, measure in region_measures(old).items():
        assert abs(measures[tag] - measure) <= tolerance * area


CASES = {
    "regions": lambda seed: with_details(two_region_block(3), seed),
    "ball": lambda seed: with_details(ball(150, seed), seed),
    "plane": lambda seed: with_details(two_region_rectangle(6), seed),
    "surface": lambda seed: with_details(ball(150, seed).boundary().mesh, seed),
    "open surface": lambda seed: with_details(half_of(ball(200, seed).boundary().mesh), seed),
}


@pytest.mark.parametrize("seed", [1802, 1804, 1810])
def test_samples_of_both_boundaries_are_within_the_tolerance(seed):
    """With 1.05 times the tolerance, samples are up to 1.03 to 1.05 tolerances away."""
    old = CASES["ball"](seed)
    tolerance = 0.002 * old.diagonal
    for new in (repaired(old, old, tolerance), improved(old, old, tolerance / 0.9)):
        skin, given = facets_of(new), facets_of(old)
        nodes, before = skin.points[np.unique(skin.cells)], given.points[np.unique(given.cells)]
        middles = [skin.points[rows].mean(axis=1) for rows in (skin.edges, skin.cells)]
        away = given.locator.nearest(np.concatenate([nodes, *middles]))[2].max()
        lost = skin.locator.nearest(before)[2].max()
        assert 0.75 * tolerance < max(away, lost) <= (1.0 + 1e-6) * tolerance


def half_of(surface):
    """The upper half of a surface, with tags on both sides of a plane and on its rim."""
    z = surface.points[surface.cells].mean(axis=1)[:, 2]
    kept = surface.cells[z > 0.0]
    half = SimplexMesh(surface.points, kept, cell_tags=np.where(z[z > 0.0] > 0.6, 3, 8))
    rim = half.facets[half.facet_cell_counts == 1]
    return replace(half, tagged_facets=rim, facet_tags=np.full(len(rim), 5))


@pytest.mark.parametrize("seed", [1809, 2203])
@pytest.mark.parametrize("case", CASES)
def test_bad_cells_vanish_and_the_rest_stays(case, seed):
    old = CASES[case](seed)
    tolerance = 0.01 * old.diagonal
    new = repaired(old, old, tolerance)
    before, after = angles_of(old), angles_of(new)
    assert (before < 15.0).sum() >= 10
    assert after.min() > before.min()
    assert (after < 15.0).sum() <= 0.1 * (before < 15.0).sum()
    check_kept(old, new, tolerance)
    again = repaired(old, old, tolerance)
    np.testing.assert_array_equal(again.points, new.points)
    np.testing.assert_array_equal(again.cells, new.cells)


@pytest.mark.parametrize("case", ["regions", "surface"])
def test_unit_and_orientation_do_not_matter(case):
    old = CASES[case](431)
    tolerance = 0.01 * old.diagonal
    new = repaired(old, old, tolerance)
    grown = replace(old, points=32.0 * old.points)
    same = repaired(grown, grown, 32.0 * tolerance)
    np.testing.assert_array_equal(same.points, 32.0 * new.points)
    np.testing.assert_array_equal(same.cells, new.cells)
    other = turned(old)
    made = repaired(other, other, tolerance)
    check_kept(other, made, tolerance)
    assert (angles_of(made) < 15.0).sum() <= (angles_of(new) < 15.0).sum() + 1


@pytest.mark.parametrize(
    "mesh", [two_region_block(2), block(3).boundary().mesh, two_region_rectangle(3)]
)
def test_a_mesh_of_good_cells_is_returned_as_it_is(mesh):
    assert repaired(mesh, mesh, 0.1) is mesh


def test_no_edge_becomes_longer_than_the_size_allows():
    old = CASES["regions"](56)
    new = repaired(old, old, 0.05, lambda points: np.full(len(points), 0.2))
    longest = old.edge_lengths.max()
    assert new.edge_lengths.max() <= longest * (1.0 + 1e-12)
    assert angles_of(new).min() > angles_of(old).min()


def test_sharp_edges_of_a_block_stay_straight_and_complete():
    old = with_details(block(4), 92)
    new = repaired(old, old, 0.05)
    assert angles_of(new).min() > 15.0 > angles_of(old).min()
    skin = facets_of(new)
    edges = skin.points[feature_edges(skin)]
    assert np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1).sum() == pytest.approx(12.0, rel=1e-9)
    assert new.measures.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("place", [0.46, 0.49, 0.51, 0.54])
def test_a_node_between_two_tags_of_a_straight_line_stays(place):
    square = two_region_rectangle(6)
    x, y = square.points.T
    side = square.facets[(square.facet_cell_counts == 1) & (y[square.facets] == 0.0).all(axis=1)]
    tags = np.where(x[side].mean(axis=1) < 0.5, 4, 6)
    points = square.points.copy()
    near = np.round(np.sign(place - 0.5) + 3.0) / 6.0
    points[(y == 0.0) & np.isclose(x, near), 0] = place  # close to the node between the tags
    old = SimplexMesh(points, square.cells, tagged_facets=side, facet_tags=tags)
    new = repaired(old, old, 0.05)
    assert angles_of(new).min() > angles_of(old).min()
    for tag in (4, 6):
        assert facet_areas(new, tag) == pytest.approx(facet_areas(old, tag), rel=1e-12)


def test_an_angle_is_the_least_dihedral_one_or_less_for_needles():
    mesh = positive(*_random_cells(60, 18))
    angles, dihedral = angles_of(mesh), minimum_angles(mesh)
    corners = mesh.points[mesh.cells]
    pairs = itertools.combinations(range(4), 2)
    squares = [((corners[:, a] - corners[:, b]) ** 2).sum(axis=1) for a, b in pairs]
    shape = 6.0 * 2.0**0.5 * mesh.measures / np.mean(squares, axis=0) ** 1.5
    np.testing.assert_allclose(angles, np.minimum(dihedral, 200.0 * shape), rtol=1e-6)
    surface = mesh.boundary().mesh
    np.testing.assert_allclose(angles_of(surface), minimum_angles(surface), rtol=1e-9)


def _random_cells(n, seed):
    points = np.random.default_rng(seed).random((n, 3))
    return points, Delaunay(points).simplices


def spike(height):
    """A block with a needle of tetrahedra on its upper side: 0.02 wide, of the given height."""
    corners = block(2).points
    inner = np.random.default_rng(5).uniform(0.2, 0.8, (12, 3))
    base = np.array([[0.31, 0.3, 1.0], [0.33, 0.3, 1.0], [0.32, 0.32, 1.0]])
    points = np.concatenate([corners, inner, base])
    mesh = positive(points, Delaunay(points).simplices)
    n = len(points)
    apex = [0.32, 0.31, 1.0 + height]
    return SimplexMesh([*points, apex], [*mesh.cells, [n - 3, n - 2, n - 1, n]])


def test_a_needle_longer_than_the_tolerance_stays_though_its_base_is_near():
    # The facets of the block that would close its base are near the old surface.
    old = spike(0.2)
    assert angles_of(old)[-1] < 15.0
    new = repaired(old, old, 0.05)
    assert new.points[:, 2].max() >= 1.15
    assert gap(new.boundary().mesh, old.boundary().mesh) <= 0.06
    low = spike(0.03)
    flat = repaired(low, low, 0.05)
    assert flat.n_cells < low.n_cells
    assert gap(flat.boundary().mesh, low.boundary().mesh) <= 0.06


def test_the_sides_of_a_gap_thinner_than_the_tolerance_do_not_overlap():
    one = with_details(block(3), 7)
    other = replace(one, points=one.points * [1.0, 1.0, -1.0] - [0.0, 0.0, 0.01])
    other = replace(other, cells=other.cells[:, [1, 0, 2, 3]])
    old = joined(one, other)
    new = repaired(old, old, 0.03)
    assert angles_of(new).min() > 15.0 > angles_of(old).min()
    assert overlapping_cells(new) is None
    check_kept(old, new, 0.03)


def collapsed(mesh, i, j):
    """The cells with node i at j, in any geometry."""
    cells = np.where(mesh.cells == i, j, mesh.cells)
    ordered = np.sort(cells, axis=1)
    left = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    tags = None if mesh.cell_tags is None else mesh.cell_tags[left]
    return cells[left], tags


def complexes_of(mesh, cells, tags):
    """The topology of each region and of its boundary."""
    found = {}
    for tag in [0] if tags is None else np.unique(tags):
        one = SimplexMesh(mesh.points, cells if tags is None else cells[tags == tag])
        boundary = one.facets[one.facet_cell_counts == 1]
        found[int(tag)] = [topology_of(one)]
        if len(boundary):
            found[int(tag)].append(topology_of(SimplexMesh(mesh.points, boundary)))
    return found


def is_repeated(cells):
    return len(np.unique(np.sort(cells, axis=1), axis=0)) < len(cells)


@numba.njit
def may_vanish_compiled(mesh, i, j, work):
    return may_vanish(mesh, i, j, work)


@pytest.mark.parametrize("case", ["regions", "ball", "surface"])
def test_collapses_that_are_allowed_change_no_topology(case):
    mesh = {
        "regions": lambda: two_region_block(2),
        "ball": lambda: positive(*_random_cells(40, 61)),
        "surface": lambda: tube(5),
    }[case]()
    follower = boundary_repair.Follower(
        *2 * [in_space(mesh.points)], 0.1, np.ones(mesh.n_points, np.bool_)
    )
    sizes = np.ones(mesh.n_points)
    local, _ = boundary_repair.local_mesh(mesh, mesh, follower, sizes, 20.0, keep_sharp=False)
    work = new_work(len(local.points), len(local.angle))
    before, allowed = complexes_of(mesh, mesh.cells, mesh.cell_tags), []
    for i, j in np.concatenate([mesh.edges, mesh.edges[:, ::-1]]).tolist():
        allowed.append(bool(may_vanish_compiled(local, i, j, work)))
        if allowed[-1]:
            cells, tags = collapsed(mesh, i, j)
            assert not is_repeated(cells)
            assert complexes_of(mesh, cells, tags) == before
    assert 0.02 < np.mean(allowed) < 0.98


def tube(n):
    """A closed surface of genus 1: a ring of n triangular cross-sections."""
    around, across = np.meshgrid(np.arange(n), np.arange(3), indexing="ij")
    a, b = 2.0 * np.pi * around / n, 2.0 * np.pi * across / 3
    radius = 1.0 + 0.3 * np.cos(b)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), 0.3 * np.sin(b)], axis=-1)
    at = lambda i, k: (i % n) * 3 + k % 3  # noqa: E731
    cells = []
    for i, k in itertools.product(range(n), range(3)):
        one, two, three, four = at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)
        cells += [[one, two, three], [one, three, four]]
    return SimplexMesh(points.reshape(-1, 3), cells)


@pytest.mark.parametrize("seed", [0, 4])
def test_nodes_are_inserted_where_nothing_else_helps(seed, monkeypatch):
    old = positive(*_random_cells(60, seed))
    tolerance = 1e-3  # the boundary is as good as fixed
    new = repaired(old, old, tolerance)
    check_kept(old, new, tolerance)
    monkeypatch.setattr(tuning, "INSERTED_BELOW", 0.0)
    without = repaired(old, old, tolerance)
    assert 4 * (angles_of(new) < 15.0).sum() < (angles_of(without) < 15.0).sum()
    assert angles_of(new).min() > 11.0 > angles_of(without).min()


def with_wanted(mesh, given, tolerance, places, facets):
    """The mesh with nodes inserted in facets, and next to nothing repaired."""
    wanted, sizes = Wanted(places, facets, 1.0), np.full(mesh.n_points, 0.05)
    return boundary_repair._improved(
        mesh, given, tolerance, sizes, 5.0, keep_sharp=False, wanted=wanted
    )[0]


@pytest.mark.parametrize("seed", [5, 6])
def test_nodes_inserted_in_facets_change_nothing_else(seed):
    old, rng = turned(two_region_block(3)), np.random.default_rng(seed)
    skin = facets_of(old)
    rows = rng.choice(skin.n_cells, 24, replace=False)
    weights = rng.dirichlet([4, 4, 4], len(rows))
    weights[:4, 0], weights[:4, 1:] = 0.0, 0.5  # on edges
    places = np.einsum("nk,nkd->nd", weights, skin.points[skin.cells[rows]])
    new = with_wanted(old, old, 1e-3, places, skin.cells[rows])
    found = [np.linalg.norm(new.points - place, axis=1).min() < 1e-9 for place in places]
    assert sum(found) >= 22
    assert new.n_points == old.n_points + sum(found)
    check_kept(old, new, 1e-3)
    assert new.measures.sum() == pytest.approx(old.measures.sum(), rel=1e-12)
    assert angles_of(new).min() > 1.0


def above_a_facet(weights, height, has_top):
    """A block, a place above one of its facets, and its surface with a tiny triangle there."""
    mesh = block(3)
    facets = mesh.facets[(mesh.points[mesh.facets][:, :, 2] == 1.0).all(axis=1)]
    facet = facets[np.abs(mesh.points[facets].mean(axis=1)[:, :2] - 0.5).sum(axis=1).argmin()]
    place = np.array(weights) @ mesh.points[facet] + [0.0, 0.0, height]
    skin = mesh.boundary().mesh
    if has_top:
        tiny = place + 1e-4 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0]])
        cells = np.vstack([skin.cells, skin.n_points + np.arange(3)])
        skin = SimplexMesh(np.vstack([skin.points, tiny]), cells)
    return mesh, skin, place[None], facet[None]


def sampled_gap(new, given, height):
    """The distance of a lattice of the new surface, in quarters, from that given, and back.

    Back are nodes, middles and centroids, from the block only.
    """
    skin = new.boundary().mesh
    lattice = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4.0
    lattice = np.vstack([lattice, np.full(3, 1.0 / 3.0)])
    places = np.einsum("lv,mvd->lmd", lattice, skin.points[skin.cells]).reshape(-1, 3)
    back = [given.points[nodes].mean(axis=1) for nodes in (given.edges, given.cells)]
    back = np.concatenate([given.points, *back])
    back = back[back[:, 2] < 1.0 + 0.5 * height]
    return max(given.locator.nearest(places)[2].max(), skin.locator.nearest(back)[2].max())


def test_samples_on_long_given_edges_are_as_close_as_the_shortest_new_edges_there():
    """Facets of 1 x .02 and of 1 x 1 on two halves of a square of two given triangles."""
    sides = np.concatenate([np.linspace(0.0, 1.0, 51), [2.0]])
    points = np.array([[x, y, 0.0] for x in sides for y in (0.0, 1.0)])
    i = 2 * np.arange(len(sides) - 1)[:, None]
    new = np.concatenate([i + np.array(one) for one in ([0, 2, 3], [0, 3, 1])]).astype(np.int32)
    given = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
    cells = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    groups = Groups.of(np.zeros((len(new), 1), int), np.zeros((2, 1), int))
    for tolerance, spacing in ((1e-4, 0.01), (0.1, 0.05)):
        follower = Follower(given, points, tolerance, np.ones(len(points), np.bool_))
        found = follower.sampled(cells, groups, new, 0)[1].at
        on = np.unique(found[found[:, 1] == 0.0][:, 0])
        gaps = np.diff(on)
        assert gaps[on[1:] <= 0.9].max() <= spacing
        assert gaps[on[:-1] > 1.2].max() <= 0.5
        assert len(on) < 2.2 / spacing + 120


@pytest.mark.parametrize(
    ("weights", "has_top"),
    [([0.7, 0.15, 0.15], True), ([0.34, 0.33, 0.33], True), ([0.7, 0.15, 0.15], False)],
)
def test_a_node_is_inserted_only_if_samples_of_both_surfaces_stay_within_the_tolerance(
    weights, has_top
):
    """Far are the middles of new edges, a sample below the new facets, and the node itself."""
    height = 0.05
    mesh, given, place, facet = above_a_facet(weights, height, has_top)
    high = with_wanted(mesh, given, 1.2 * height, place, facet)
    assert high.n_points == mesh.n_points + 1
    gap = sampled_gap(high, given, height)
    assert 0.49 * height < gap <= height * (1.0 + 1e-9)
    assert with_wanted(mesh, given, 1.01 * gap, place, facet).n_points == mesh.n_points + 1
    assert with_wanted(mesh, given, gap / 1.03, place, facet) is mesh


def film(n, thin):
    """A plate of n x n cells whose middle is much thinner than these."""
    mesh = CartesianGrid([0.0, 0.0, -0.5], [1.0] * 3, (n + 1, n + 1, 2)).mesh
    points = mesh.points.copy()
    away = np.linalg.norm(points[:, :2] - 0.5 * n, axis=1)
    points[:, 2] *= np.clip(thin + 0.4 * (away - 2.0), thin, 1.0)
    return mesh.moved(points)


@pytest.mark.parametrize("tolerance", [0.3, 0.5])
def test_nodes_leave_the_surface_where_a_wall_is_much_thinner_than_the_tolerance(tolerance):
    mesh = film(10, 0.06)
    new = repaired(mesh, mesh, tolerance)
    assert minimum_angles(mesh).min() < 4.0
    assert minimum_angles(new).min() > 15.0
    assert gap(facets_of(new), facets_of(mesh)) <= tolerance
    assert overlapping_cells(new) is None


def test_sizes_are_evaluated_near_bad_cells_only(monkeypatch):
    rng = np.random.default_rng(3_107)
    points = rng.random((4000, 2))
    corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    points = np.concatenate([CartesianGrid((0.0, 0.0), 1 / 60, (61, 61)).mesh.points, corners])[
        :3721
    ]
    inner = ((points > 0.0) & (points < 1.0)).all(axis=1)
    points[inner] += 0.002 * rng.random((inner.sum(), 2))
    at = np.argmin(np.linalg.norm(points - [0.3, 0.6], axis=1))
    points[at] += [0.012, 0.004]
    mesh = positive(points, Delaunay(points).simplices)
    bad = angles_of(mesh) < tuning.GOAL["plane triangles"]
    assert 0 < bad.sum() <= 10
    asked = []

    def size(x):
        asked.append(len(x))
        return np.full(len(x), 1 / 60)

    new = repaired(mesh, mesh, 1e-3, size)
    assert sum(asked) < 0.2 * mesh.n_points
    assert angles_of(new).min() > angles_of(mesh).min()
    monkeypatch.setattr(tuning, "RINGS_OF_REPAIR", 100)
    same = repaired(mesh, mesh, 1e-3, size)
    assert sum(asked) > mesh.n_points
    np.testing.assert_array_equal(same.points, new.points)
    np.testing.assert_array_equal(same.cells, new.cells)


@pytest.mark.parametrize("seed", [3, 8])
def test_a_repair_with_samples_near_bad_cells_is_that_of_the_whole_mesh(seed, monkeypatch):
    given = block(18)
    mesh = with_details(given, seed, 2e-4)
    counts, near, of_follower = [], [], boundary_repair.Follower.sampled

    def sampled(self, *args):
        found = of_follower(self, *args)
        counts.append(len(found[1].at))
        near.append(self.near)
        return found

    monkeypatch.setattr(boundary_repair.Follower, "sampled", sampled)
    new = repaired(mesh, given, 0.01)
    n_near, counts[:] = sum(counts), []
    assert angles_of(new).min() > angles_of(mesh).min()
    before, after = facets_of(mesh), facets_of(new)
    places = {tuple(map(tuple, np.sort(corners, axis=0))) for corners in after.points[after.cells]}
    corners = np.sort(before.points[before.cells], axis=1)
    is_gone = np.array([tuple(map(tuple, one)) not in places for one in corners])
    assert is_gone.any()
    assert near[0][before.cells[is_gone]].all()  # facets that are replaced have samples
    monkeypatch.setattr(tuning, "RINGS_OF_REPAIR", 100)
    same = repaired(mesh, given, 0.01)
    assert n_near < 0.9 * sum(counts)
    np.testing.assert_array_equal(same.points, new.points)
    np.testing.assert_array_equal(same.cells, new.cells)
