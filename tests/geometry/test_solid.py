"""The solid that a surface encloses: unions of bodies, and facets of any orientation."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation
from shapes import CORNERS, CUBE_CELLS

from adaptsize import CartesianGrid, SimplexMesh, signed_distance
from adaptsize.background.merging import first_at_place
from adaptsize.geometry.distance.orientation import is_cycle, rule_of
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.geometry.solid import Sides, Solid


def hull(points):
    """The convex hull of points, with normals outward."""
    found = ConvexHull(points)
    cells = found.simplices.copy()
    a, b, c = found.points[cells].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    cells[inward, :2] = cells[inward, 1::-1]
    return SimplexMesh(found.points, cells)


def box(lower, upper):
    return SimplexMesh(lower + CORNERS * np.subtract(upper, lower), CUBE_CELLS)


def cylinder(n, radius, height):
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return hull(np.concatenate([np.column_stack([ring, np.full(n, z)]) for z in (0.0, height)]))


def ball(n, radius):
    """A polyhedron with nodes on a sphere, evenly spread along a spiral."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z * z)
    return hull(radius * np.column_stack([r * np.cos(angle), r * np.sin(angle), z]))


def joined(bodies):
    first = np.cumsum([0, *(body.n_points for body in bodies[:-1])])
    cells = [body.cells + k for body, k in zip(bodies, first, strict=True)]
    return SimplexMesh(np.concatenate([body.points for body in bodies]), np.concatenate(cells))


def flipped(mesh, rows):
    cells = mesh.cells.copy()
    cells[rows, :2] = cells[rows, 1::-1]
    return SimplexMesh(mesh.points, cells)


def common_volume(bodies):
    """The volume that convex bodies have in common."""
    planes = np.concatenate([ConvexHull(body.points).equations for body in bodies])
    # The centre and the radius of the largest ball.
    rows = np.column_stack([planes[:, :3], np.ones(len(planes))])
    bounds = [(None, None)] * 3 + [(0, None)]
    found = linprog([0, 0, 0, -1], A_ub=rows, b_ub=-planes[:, 3], bounds=bounds)
    if found.status != 0 or found.x[3] < 1e-9:
        return 0.0
    return ConvexHull(HalfspaceIntersection(planes, found.x[:3]).intersections).volume


def union_volume(bodies):
    """The volume of the union of convex bodies, by inclusion and exclusion."""
    return sum(
        (-1) ** (k + 1) * sum(common_volume(some) for some in combinations(bodies, k))
        for k in range(1, len(bodies) + 1)
    )


numbers = st.integers(0, 2**32 - 1)


def random_bodies(rng):
    """Two to four boxes, balls and cylinders, some of them on a common grid."""
    bodies = []
    for _ in range(rng.integers(2, 5)):
        kind = rng.integers(3)
        size = rng.choice([0.25, 0.5, 1.0], 3)
        body = (
            box([0, 0, 0], size)
            if kind == 0
            else ball(int(rng.integers(12, 60)), 0.5 * size[0])
            if kind == 1
            else cylinder(int(rng.integers(4, 16)), 0.5 * size[0], size[1])
        )
        on_grid = rng.random() < 0.5
        turn = np.eye(3) if on_grid else Rotation.random(random_state=rng).as_matrix()
        shift = rng.choice([0.0, 0.25, 0.5], 3) if on_grid else rng.normal(0.0, 0.3, 3)
        bodies.append(body.moved(body.points @ turn.T + shift))
    return bodies


@given(numbers)
def test_the_volume_of_a_union_is_exact_however_it_is_turned_and_oriented(seed):
    rng = np.random.default_rng(seed)
    bodies = random_bodies(rng)
    surface = joined(bodies)
    turn = Rotation.random(random_state=rng).as_matrix()
    scale = 10.0 ** rng.integers(-3, 4)
    points = scale * (surface.points @ turn.T + rng.normal(size=3))
    if rng.random() < 0.5:  # as in STL files
        points = points.astype(np.float32).astype(np.float64)
    moved = surface.moved(points)
    # Flips are not clear where bodies that overlap have edges in common.
    share = 0.2 if Solid(moved).surface.facet_cell_counts.max() == 2 else 0.0
    solid = Solid(flipped(moved, rng.random(surface.n_cells) < share))
    assert solid.is_closed
    # Depths up to 1e-6 of the diagonal are contacts, on both sides.
    rounding = 2e-6 * moved.diagonal * moved.measures.sum()
    assert solid.volume == pytest.approx(scale**3 * union_volume(bodies), abs=rounding)
    # The boundary of a union is closed: the sum of its normals times areas is zero.
    a, b, c = solid.skin.points[solid.skin.cells].transpose(1, 0, 2)
    total = 0.5 * np.cross(b - a, c - a).sum(axis=0)
    assert np.abs(total).max() < 1e-4 * solid.skin.measures.sum()


UNIT = box((0, 0, 0), (1, 1, 1))
#: By name: another body, the volume of the union with the unit cube, and of the hidden facets.
BESIDE = {
    "crossing": (box((0.5, 0.3, 0.4), (1.6, 1.2, 1.3)), 1.681, True),
    "with sides in the same planes": (box((0.5, 0, 0), (1.5, 1, 1)), 1.5, True),
    "inside": (box((0.3, 0.3, 0.3), (0.7, 0.7, 0.7)), 1.0, False),
    "the same": (UNIT, 1.0, False),
    "on a face": (box((1, 0, 0), (2, 1, 1)), 2.0, False),
    "on a part of a face": (box((1, 0.3, 0.2), (2, 1.4, 1.1)), 1.99, True),
    "on a part of a face, up to rounding": (box((1 + 4e-7, 0.3, 0.2), (2, 1.4, 1.1)), 1.99, True),
    "on an edge": (box((1, 1, 0), (2, 2, 1)), 2.0, None),
    "on a node": (box((1, 1, 1), (2, 2, 2)), 2.0, None),
    "apart": (box((1.1, 0, 0), (2.1, 1, 1)), 2.0, None),
}


@pytest.mark.parametrize("name", BESIDE)
def test_bodies_beside_a_cube(name):
    other, volume, is_divided = BESIDE[name]
    surface = joined([UNIT, other])
    solid = Solid(surface)
    assert solid.volume == pytest.approx(volume, rel=1e-6)
    assert solid.is_divided == bool(is_divided)
    if is_divided is None:
        assert not solid.hidden.any()
        assert solid.skin.n_cells == surface.n_cells
    elif not is_divided:
        assert solid.hidden.any()
        assert is_cycle(solid.skin)


def test_the_same_holds_if_nodes_are_shared_and_facets_are_flipped():
    rng = np.random.default_rng(20260)
    # Two cubes with common nodes; the face between them is there once, twice, or with another
    # diagonal the second time.
    pair = joined([UNIT, box((1, 0, 0), (2, 1, 1))])
    on_wall = (pair.points[pair.cells][..., 0] == 1.0).all(axis=1)
    once = pair.cells[~on_wall | (np.arange(24) < 12)]
    wall = pair.cells[:12][on_wall[:12]]
    corners = pair.points[np.unique(wall)][:, 1:]
    order = np.unique(wall)[[int(np.flatnonzero((corners == at).all(axis=1))[0])
                             for at in ([0, 0], [1, 0], [1, 1], [0, 1])]]  # fmt: skip
    shared = {tuple(sorted(cell)) for cell in wall.tolist()}
    other = [order[[0, 1, 2]], order[[0, 2, 3]]]
    if {tuple(sorted(cell.tolist())) for cell in other} == shared:
        other = [order[[1, 2, 3]], order[[1, 3, 0]]]
    for cells in (pair.cells, once, np.concatenate([once, other])):
        for share in (0.0, *[0.3] * 10):
            mesh = flipped(SimplexMesh(pair.points, cells), rng.random(len(cells)) < share)
            solid = Solid(mesh)
            assert solid.volume == pytest.approx(2.0)
            assert (solid.skin.n_cells, is_cycle(solid.skin)) == (20, True)
            inner = (solid.surface.points[solid.surface.cells][..., 0] == 1.0).all(axis=1)
            assert np.array_equal(solid.hidden, inner)


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_a_cavity_stays_one_whatever_facets_are_flipped(share):
    rng = np.random.default_rng(71)
    core = ball(200, 0.3)
    hollow = joined([ball(300, 1.0), flipped(core, slice(None))])
    volume = ConvexHull(hollow.points).volume - ConvexHull(core.points).volume
    rows = rng.random(hollow.n_cells) < share
    solid = Solid(flipped(hollow, rows))
    assert solid.volume == pytest.approx(volume)
    assert np.array_equal(solid.flipped, rows)
    assert not solid.hidden.any()


@pytest.mark.parametrize("seed", range(8))
def test_facets_that_are_given_twice_count_once(seed):
    rng = np.random.default_rng(seed)
    skin = CartesianGrid([0.0] * 3, 0.5, (3, 3, 3)).mesh.boundary().mesh
    twice = skin.cells[rng.random(skin.n_cells) < rng.choice([0.02, 0.1, 0.3])]
    cells = np.concatenate([skin.cells, skin.cells[:1], twice])
    flipped = rng.random(len(cells)) < rng.choice([0.0, 0.1])
    cells[flipped] = cells[flipped][:, [1, 0, 2]]
    node = rng.permutation(skin.n_points)
    points = skin.points[np.argsort(node)]
    solid = Solid(SimplexMesh(points, node[cells][rng.permutation(len(cells))]))
    assert solid.volume == pytest.approx(1.0)
    assert solid.is_closed


def test_a_wall_with_holes_bounds_no_solid():
    solid = Solid(SimplexMesh(UNIT.points, UNIT.cells[1:]))
    assert not solid.is_closed
    assert np.isnan(solid.volume)
    assert solid.skin.n_cells == 11


def test_a_sliver_that_is_folded_over_does_not_divide_a_surface():
    # Two nodes in the top have changed places, so that triangles between them are upside down.
    points = [*CORNERS, [0.5, 0.5 + 2e-6, 1.0], [0.5, 0.5 - 2e-6, 1.0]]
    bottom = CUBE_CELLS[(CORNERS[CUBE_CELLS][..., 2] < 1.0).any(axis=1)]
    top = [[1, 5, 8], [5, 7, 8], [7, 9, 8], [7, 3, 9], [3, 8, 9], [3, 1, 8]]
    folded = SimplexMesh(points, [*bottom, *top])
    assert is_cycle(folded)
    solid = Solid(folded)
    assert solid.volume == pytest.approx(1.0, rel=1e-6)
    assert (solid.is_divided, solid.hidden.any(), solid.flipped.any()) == (False, False, False)
    assert np.array_equal(solid.cells, folded.cells)


def test_unions_have_a_conforming_boundary_with_the_tags_of_the_bodies():
    n_joined = n_divided = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        bodies = random_bodies(rng)
        surface = joined(bodies)
        tags = np.repeat(np.arange(len(bodies)), [body.n_cells for body in bodies])
        turn = Rotation.random(random_state=rng).as_matrix()
        solid = Solid(replace(surface, points=surface.points @ turn.T, cell_tags=tags))
        skin, nodes = solid.skin, solid.nodes_of_skin
        if not solid.is_divided:
            continue
        n_divided += 1
        if not skin.is_closed:
            continue
        n_joined += 1
        assert is_cycle(skin)
        assert cone_measures(skin, skin.points[0]).sum() == pytest.approx(solid.volume, rel=1e-5)
        known = nodes >= 0
        np.testing.assert_array_equal(solid.surface.points[nodes[known]], skin.points[known])
        # Each facet is in the plane of a facet of the body of its tag.
        for tag in np.unique(skin.cell_tags):
            of_tag = SimplexMesh(skin.points, skin.cells[skin.cell_tags == tag])
            body = bodies[tag].moved(bodies[tag].points @ turn.T)
            centroids = of_tag.points[of_tag.cells].mean(axis=1)
            assert body.locator.nearest(centroids)[2].max() < 1e-5
    assert n_divided >= 15
    assert n_joined >= n_divided - 1


def test_facets_inside_do_not_bound_a_solid_with_holes():
    lid = (CORNERS[CUBE_CELLS][..., 2] == 1.0).all(axis=1)
    core = box((0.3, 0.3, 0.2), (0.6, 0.6, 0.5))
    solid = Solid(joined([SimplexMesh(CORNERS, CUBE_CELLS[~lid]), core]))
    assert not solid.is_closed
    assert np.array_equal(np.flatnonzero(solid.hidden), np.arange(10, 22))
    assert solid.skin.n_cells == 10


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
def test_an_opening_is_where_the_winding_number_is_near_one_half(scale):
    turn = scale * Rotation.random(random_state=5).as_matrix()
    lid = (CORNERS[CUBE_CELLS][..., 2] == 1.0).all(axis=1)
    solid = Solid(SimplexMesh(CORNERS @ turn.T, CUBE_CELLS[~lid]))
    at = np.array([[0.5, 0.5, 0.9], [0.5, 0.5, 1.1], [0.5, 0.5, 0.5], [0.5, 0.5, 1.6], [3, 3, 3]])
    assert solid.is_opening(at @ turn.T).tolist() == [True, True, False, False, False]
    assert not Solid(SimplexMesh(CORNERS, CUBE_CELLS)).is_opening(at).any()


def test_a_wall_between_bodies_is_found_although_facets_cross():
    # Two cubes with a common wall, given once, and a body that crosses all of them.
    pair = joined([UNIT, box((1, 0, 0), (2, 1, 1))])
    second = (pair.points[pair.cells][..., 0] == 1.0).all(axis=1) & (np.arange(24) >= 12)
    merged = first_at_place(pair.points, 1e-9)[pair.cells]
    across = box((-0.5, 0.3, 0.4), (2.6, 0.7, 0.9))
    surface = joined([SimplexMesh(pair.points, merged[~second]), across])
    solid = Solid(surface)
    assert solid.volume == pytest.approx(2.0 + 1.1 * 0.4 * 0.5)
    wall = (surface.points[surface.cells][..., 0] == 1.0).all(axis=1)
    assert solid.hidden[wall].all()


@pytest.mark.parametrize("turn", [np.eye(3), Rotation.random(random_state=3).as_matrix()])
def test_bodies_that_cross_exactly_along_edges_of_others(turn):
    grid = CartesianGrid([0.0] * 3, 0.125, (9, 9, 9)).mesh.boundary().mesh
    for lower, upper, volume in (
        ((0.5, 0.25, 0.25), (1.5, 0.75, 0.75), 1.125),
        ((0.25, 0.25, 0.75), (0.75, 0.75, 1.25), 1.0625),
    ):
        both = joined([grid, box(lower, upper)])
        solid = Solid(both.moved(both.points @ turn.T))
        assert solid.volume == pytest.approx(volume)
        assert solid.skin.is_closed


def test_no_volume_is_given_if_parts_of_a_union_leave_gaps(monkeypatch):
    both = joined([UNIT, box((0.5, 0.3, 0.4), (1.6, 1.2, 1.3))])
    assert Solid(both).volume == pytest.approx(1.681)
    skin = Sides.skin
    monkeypatch.setattr(Sides, "skin", lambda self: tuple(rows[1:] for rows in skin(self)))
    solid = Solid(both)
    assert np.isnan(solid.volume)
    assert not solid.skin.is_closed


def prism(corners, outline, ends):
    """The surface over an outline in the plane, which is to the right of its segments."""
    n = len(corners)
    points = np.concatenate([np.column_stack([corners, np.full(n, z)]) for z in (0.0, 1.0)])
    i, j = np.array(outline), np.roll(outline, -1)
    sides = np.concatenate([np.column_stack([j, i, i + n]), np.column_stack([j, i + n, j + n])])
    return SimplexMesh(points, np.concatenate([ends, np.array(ends)[:, ::-1] + n, sides]))


def test_what_is_turned_inside_out_beside_a_solid_is_none():
    # Over two triangles that meet where two sides of one line cross, as in a bow tie.
    line = [[-1.0, -1.0], [2.0, 2.0], [2.0, -2.0], [-1.0, 1.0]]
    surface = prism(line, range(4), [[0, 1, 2], [0, 2, 3]])
    solid = Solid(surface)
    places = np.array([[1.0, 0.1, 0.5], [-0.7, 0.1, 0.5], [0.0, 1.5, 0.5]])
    assert np.rint(solid.winding(places)).tolist() == [1, -1, 0]
    assert solid.contains(places).tolist() == [True, False, False]
    assert solid.volume == pytest.approx(4.0)
    inside_out = SimplexMesh(surface.points, surface.cells[:, ::-1])
    assert Solid(inside_out).contains(places).tolist() == [True, False, False]


@pytest.mark.parametrize("has_pocket", [False, True])
@pytest.mark.parametrize("merged", [False, True])
def test_the_same_holds_if_the_surface_touches_itself(has_pocket, merged):
    # A bow tie, continued by a square, in which a triangle is cut out up to a point of its side.
    corners = [[-1, -1], [2, 2], [4, 2], [3, 0], [5, 0], [6, 2], [6, -2], [2, -2], [-1, 1], [4, 2]]
    of_square = [[1, 2, 3], [1, 3, 7], [3, 6, 7], [3, 4, 6], [4, 5, 6], [9, 5, 4]]
    outline = [0, 1, 2, 3, 4, 9, 5, 6, 7, 8]
    surface = prism(np.array(corners, float), outline, [[0, 1, 7], [0, 7, 8], *of_square])
    points, cells = surface.points, surface.cells
    if has_pocket:  # of no thickness
        cells = np.concatenate([cells, cells[:1], cells[:1, ::-1]])
    if merged:
        points, which = np.unique(points, axis=0, return_inverse=True)
        cells = which.reshape(-1)[cells]
    solid = Solid(SimplexMesh(points, cells))
    places = [[1.0, 0.1, 0.5], [-0.7, 0.1, 0.5], [4.0, 0.8, 0.5], [3.0, -1.0, 0.5]]
    assert solid.contains(np.array(places)).tolist() == [True, False, False, True]
    assert solid.volume == pytest.approx(4.0 + 16.0 - 2.0)


def test_facets_of_two_layers_of_a_surface_may_coincide():
    surface = CartesianGrid([0.0] * 3, 1.0, (6, 6, 2)).mesh.boundary().mesh
    points = np.array(surface.points)
    below = surface.cells[(points[surface.cells, 2] == 0.0).all(axis=1)]
    corner = points[below].mean(axis=1)
    one, other = (below[np.linalg.norm(corner - [x, x, 0.0], axis=1).argmin()] for x in (1.6, 3.6))
    points[other] = points[one]
    assert rule_of(SimplexMesh(points, surface.cells)).is_signed


@pytest.mark.parametrize(("gap", "is_crack"), [(1e-6, True), (1e-3, False)])
def test_walls_of_cracks_do_not_bound_a_union_that_could_not_be_made(monkeypatch, gap, is_crack):
    crossing = box((0.2, 0.2, 0.9), (0.8, 0.8, 1.5))
    beside = box((1.0 + gap, 0.0, 0.0), (2.0, 1.0, 1.0))
    skin = Sides.skin
    monkeypatch.setattr(Sides, "skin", lambda self: tuple(rows[1:] for rows in skin(self)))
    solid = Solid(joined([UNIT, crossing, beside]))
    middles = solid.skin.points[solid.skin.cells].mean(axis=1)
    walls = np.abs(middles[:, 0] - 1.0) < 2.0 * gap
    assert not solid.skin.is_closed
    assert walls.any() != is_crack


@pytest.mark.parametrize("move", [(1.0, 1.0, 0.0), (1.0, 0.0, 0.0)], ids=["edge", "face"])
@pytest.mark.parametrize("merged", [False, True])
def test_bodies_that_touch_are_solid_whatever_their_orientation(move, merged):
    cube = CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh.boundary().mesh
    points = np.concatenate([cube.points, cube.points + move])
    cells = np.concatenate([cube.cells, cube.cells[:, ::-1] + cube.n_points])
    if merged:
        points, which = np.unique(points, axis=0, return_inverse=True)
        cells = which.reshape(-1)[cells]
    solid = Solid(SimplexMesh(points, cells))
    assert solid.volume == pytest.approx(2.0)
    middle = np.array([[0.5] * 3, np.add([0.5] * 3, move)])
    assert solid.contains(middle).all()


def test_what_is_turned_inside_out_is_left_out_of_solid_and_distances():
    """A prism over a quadrilateral that crosses itself."""
    corners = [[0.0, 0.0], [2.0, 1.0], [2.0, 0.0], [0.0, 1.5]]
    points = np.array([[*corner, z] for z in (0.0, 1.0) for corner in corners])
    sides = [[i, (i + 1) % 4, (i + 1) % 4 + 4] for i in range(4)]
    sides += [[i, (i + 1) % 4 + 4, i + 4] for i in range(4)]
    ends = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
    surface = SimplexMesh(points, sides + ends)
    solid, inside = Solid(surface), np.array([[0.3, 0.6, 0.5], [1.8, 0.5, 0.5]])
    assert solid.contains(inside).sum() == 1
    grid = CartesianGrid([-0.5] * 3, 0.1, (31, 26, 21))
    phi = signed_distance(grid, surface)
    where = np.rint((inside + 0.5) / 0.1).astype(int)
    assert ((phi[tuple(where.T)] < 0.0) == solid.contains(inside)).all()
