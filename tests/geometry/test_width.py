"""The width of a domain, by rays from its boundary."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
import width_oracle
from manifold3d import Manifold
from numpy.testing import assert_allclose, assert_array_equal
from shapes import joined, moved
from solids import box, circle, inside_out, outline, turned
from width_oracle import mesh_of

from adaptsize import SimplexMesh
from adaptsize._progress import silent
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.width import Width, boundary_width

# Of exact cases: coordinates and normals are rounded to 2e-16, and near slivers lose some digits.
ROUNDING = 1e-12


def middles(mesh):
    return mesh.points[mesh.cells].mean(axis=1)


def normals(mesh):
    corners = mesh.points[mesh.cells]
    if mesh.dim == 2:
        along = corners[:, 1] - corners[:, 0]
        return along[:, ::-1] * [1, -1] / np.linalg.norm(along, axis=1)[:, None]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return across / np.linalg.norm(across, axis=1)[:, None]


def divided(mesh, n):
    """Return a polygon with each side in n parts."""
    start, end = mesh.points[mesh.cells[:, :1]], mesh.points[mesh.cells[:, 1:]]
    share = (np.arange(n) / n)[None, :, None]
    return outline(((1.0 - share) * start + share * end).reshape(-1, 2))


# --- against the twin -------------------------------------------------------------


@pytest.mark.parametrize("seed", [311, 4207])
@pytest.mark.parametrize("part", [*width_oracle.SOUND_PARTS, *width_oracle.OTHER_PARTS])
def test_the_tree_finds_what_all_facets_give_bit_by_bit(part, seed):
    makers = width_oracle.SOUND_PARTS | width_oracle.OTHER_PARTS
    mesh = makers[part](np.random.default_rng(seed))
    faces = Faces.of(mesh)
    found = Width(faces, 30.0).samples(silent)
    expected = width_oracle.widths(faces, found.points, found.cell)
    assert_array_equal(found.widths, expected)
    assert np.isfinite(expected).any()
    assert_array_equal(boundary_width(mesh), expected[faces.rows] / faces.frame.scale)


# --- exact widths -----------------------------------------------------------------


@pytest.mark.parametrize("sides", [(4.0, 3.0, 0.1), (1.0, 1.0, 5.0)], ids=["plate", "beam"])
@pytest.mark.parametrize("seed", [None, 733, 90210])
def test_a_plate_and_a_square_beam_have_the_distances_of_their_sides(sides, seed):
    block = box(*sides)
    expected = np.abs(normals(block)) @ sides
    mesh = block if seed is None else turned(block, seed)
    assert_allclose(boundary_width(mesh), expected, rtol=ROUNDING)


def test_a_tube_has_the_thickness_of_its_wall():
    n = 48
    outer, inner = (Manifold.cylinder(2.0, r, r, n, True) for r in (1.0, 0.6))
    tube = mesh_of(outer - inner.scale([1.0, 1.0, 2.0]))
    width = boundary_width(turned(tube))
    is_cap = np.abs(normals(tube)[:, 2]) > 0.5
    assert_allclose(width[is_cap], 2.0, rtol=ROUNDING)
    # Strips inside and outside are parallel, at the radii of the inscribed circles.
    assert_allclose(width[~is_cap], 0.4 * np.cos(np.pi / n), rtol=ROUNDING)


def of_second_order(errors):
    """Whether errors on facets half as long are a quarter each time, up to the next order."""
    return all(3.5 < coarse / fine < 4.5 for coarse, fine in pairwise(errors))


def test_the_error_on_a_ball_is_of_second_order():
    balls = [trimesh.creation.icosphere(level) for level in (2, 3, 4)]
    errors = [np.abs(boundary_width(SimplexMesh(b.vertices, b.faces)) - 2.0).max() for b in balls]
    assert of_second_order(errors)
    assert errors[-1] < 0.01


@pytest.mark.parametrize("turn", range(4))
def test_a_ray_that_passes_within_rounding_of_a_wall_hits_it(turn):
    # A ledge 1 above the bottom ends 3e-10 left of the ray from x = .5; beyond it, the top is 2.
    end = 0.5 - 3e-10
    shape = divided(outline([[-1, 0], [2, 0], [2, 2], [end, 2], [end, 1], [-1, 1]]), 21)
    quarter = np.linalg.matrix_power([[0, -1], [1, 0]], turn)
    width = boundary_width(SimplexMesh(shape.points @ quarter.T, shape.cells))
    x, y = middles(shape).T
    ray = (y == 0.0) & (np.abs(x - 0.5) < 1e-9)
    assert ray.sum() == 1
    assert_allclose(width[ray], 1.0, rtol=ROUNDING)
    beyond = (y == 0.0) & (x > 0.5 + 1e-9)
    assert_allclose(width[beyond], 2.0, rtol=ROUNDING)


# --- wedges, corners, tips --------------------------------------------------------


def wedge(degrees, length=3.0):
    """A triangle whose sides at the origin have nodes ever closer to it; the origin is one."""
    along = np.concatenate([[0.0], length * 0.5 ** np.arange(12)[::-1]])
    far = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    return outline(np.concatenate([along[:, None] * [1.0, 0.0], along[:0:-1, None] * far]))


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0, 30.0, 31.0, 40.0, 60.0])
def test_a_wedge_is_narrow_to_its_edge_below_the_corner_angle_only(degrees):
    mesh = wedge(degrees)
    distance = np.linalg.norm(middles(mesh), axis=1)
    near = distance < 2.0  # farther away, rays meet the third side
    expected = distance * np.tan(np.radians(degrees)) if degrees < 30.0 else np.inf * distance
    assert_allclose(boundary_width(mesh)[near], expected[near], rtol=1e-9)
    assert distance.min() < 0.001


def trapezoid(slope, *, gap=0.1, height=1.0):
    """A channel over [-0.5, 3], ``gap`` high left of 0; from there its upper wall rises."""
    end = (height - gap) / np.tan(np.radians(slope))
    return outline([[-0.5, 0], [3, 0], [3, height], [end, height], [0, gap], [-0.5, gap]]), end


def test_a_channel_that_tapers_at_40_degrees_counts_if_its_walls_do_not_meet():
    shape, end = trapezoid(40.0)
    mesh = divided(shape, 30)
    x, y = middles(mesh).T
    bottom = (y == 0.0) & (x > 0.0) & (x < end)
    assert bottom.sum() > 5
    expected = 0.1 + x[bottom] * np.tan(np.radians(40.0))
    assert_allclose(boundary_width(mesh)[bottom], expected, rtol=ROUNDING)


@pytest.mark.parametrize(("slope", "counts"), [(74.0, True), (75.0, True), (76.0, False)])
def test_walls_steeper_than_75_degrees_do_not_count(slope, counts):
    shape, end = trapezoid(slope)
    mesh = divided(shape, 60)
    x, y = middles(mesh).T
    width, bottom = boundary_width(mesh), y == 0.0
    below = bottom & (x > 0.0) & (x < end)
    assert below.sum() > 2
    expected = 0.1 + x * np.tan(np.radians(slope)) if counts else np.full(len(x), np.inf)
    assert_allclose(width[below], expected[below], rtol=ROUNDING)
    assert_allclose(width[bottom & (x > end)], 1.0, rtol=ROUNDING)


def cone(degrees, n=48, rings=8):
    """A cone with its tip at the origin; its strips are at a given angle to those opposite."""
    radius = np.tan(np.radians(degrees / 2.0)) / np.cos(np.pi / n)
    rim = np.column_stack([radius * circle(n), np.ones(n)])
    points = np.concatenate([z * rim for z in 0.5 ** np.arange(rings)] + [[[0, 0, 0], [0, 0, 1]]])
    low, up = np.arange(n), np.roll(np.arange(n), -1)
    tip, base, last = rings * n, rings * n + 1, (rings - 1) * n
    cells = [np.column_stack([low, up, np.full(n, base)])]
    for first in range(0, last, n):
        a, b, c, d = first + low, first + up, first + n + up, first + n + low
        cells += [np.column_stack([b, a, c]), np.column_stack([c, a, d])]
    cells.append(np.column_stack([last + up, last + low, np.full(n, tip)]))
    return SimplexMesh(points, np.concatenate(cells))


def test_a_cone_of_60_degrees_is_not_narrow_at_its_tip():
    mesh = cone(60.0)
    for seed in (7, 91, 415):
        assert np.isinf(boundary_width(turned(mesh, seed))).all()


def test_a_cone_of_19_degrees_is_narrow_to_its_tip():
    mesh = cone(19.0)
    width, at = boundary_width(turned(mesh)), middles(mesh)
    mantle = np.abs(normals(mesh)[:, 2]) < 0.5
    # The distance from the tip along the middle of the strip; the strip opposite is in a plane.
    distance = at[:, 2] / np.cos(np.radians(9.5))
    near = mantle & (distance < 0.9)
    expected = distance[near] * np.tan(np.radians(19.0))
    assert_allclose(width[near], expected, rtol=1e-9)
    assert width[near].min() < 0.002


# --- what is outside, other bodies, sheets ----------------------------------------


def test_a_gap_outside_the_domain_is_not_seen():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    flat = outline(square, square + np.array([1.001, 0.0]))
    solid = joined(box(1, 1, 1), moved(box(1, 1, 1), [1.001, 0.0, 0.0]))
    for pair in (flat, solid):
        assert_allclose(boundary_width(pair), 1.0, rtol=ROUNDING)


def test_a_body_in_another_is_transparent_and_a_cavity_is_a_wall():
    big, small = box(5, 5, 5), moved(box(1, 1, 1), [2.1, 2.2, 2.3])
    filled = boundary_width(joined(big, small))
    assert_allclose(filled[:12], 5.0, rtol=ROUNDING)
    assert np.isinf(filled[12:]).all()  # not part of the boundary
    hollow = boundary_width(joined(big, inside_out(small)))
    # The middles of the box's triangles, at a third of its sides, are beside the cavity.
    assert_allclose(hollow[:12], 5.0, rtol=ROUNDING)
    out = normals(small)
    room = np.where(out > 0.0, 5.0 - small.points.max(axis=0), small.points.min(axis=0))
    assert_allclose(hollow[12:], (np.abs(out) * room).sum(axis=1), rtol=ROUNDING)


def test_a_ray_ends_where_it_leaves_the_last_of_several_bodies():
    bars = [box(4, 1, 1), moved(box(1, 4, 0.9), [1.5, -1.5, 0.05]),
            moved(box(0.5, 0.7, 0.7), [1.6, 0.2, 0.15])]  # fmt: skip
    width = boundary_width(joined(*bars))
    for bar, own in zip(bars, (width[:12], width[12:24]), strict=False):
        lengths = np.ptp(bar.points, axis=0)
        long = np.abs(normals(bar)) @ lengths == 4.0
        assert_allclose(own[long], 4.0, rtol=ROUNDING)
    half = moved(box(4, 0.8, 0.8), [2.5, 0.1, 0.1])  # from inside the first to beyond its end
    left = normals(bars[0])[:, 0] < -0.5
    assert_allclose(boundary_width(joined(bars[0], half))[:12][left], 6.5, rtol=ROUNDING)
    row = [moved(box(1, 1 + 0.01 * k, 1 + 0.01 * k), [0.9 * k, 0, 0]) for k in range(40)]
    left = np.flatnonzero(normals(row[0])[:, 0] < -0.5)
    assert_allclose(boundary_width(joined(*row))[left], 0.9 * 39 + 1.0, rtol=ROUNDING)


@pytest.mark.parametrize("place", [[0.5, 0.25, 0.0], [1.0, 0.25, 0.25], [0.7, 0.5, 0.25]])
def test_overlapping_bodies_may_have_walls_in_one_plane(place):
    # Of 2 x 1 x 1, on one base, or with one end or side. Rays that end there leave both at once.
    width = boundary_width(joined(box(2, 1, 1), moved(box(1, 0.5, 0.5), place)))[:12]
    assert_allclose(width, np.abs(normals(box(2, 1, 1))) @ [2.0, 1.0, 1.0], rtol=ROUNDING)


def test_the_depth_to_which_bodies_overlap_is_no_width():
    # Walls of the one inside the other do not bound the domain; 1 is its least width.
    other = moved(box(2, 1.2, 1.2), [1.999, -0.1, -0.1])
    assert boundary_width(joined(box(2, 1, 1), other)).min() > 0.999


def test_bodies_that_touch_in_another_are_transparent():
    row = [moved(box(1, 1, 1), [x, 0.4, 0.4]) for x in (3.0, 4.0)]
    width = boundary_width(joined(box(10, 2, 2), *row))[:12]
    assert_allclose(width, np.abs(normals(box(10, 2, 2))) @ [10.0, 2.0, 2.0], rtol=ROUNDING)


def test_opposite_walls_of_an_open_shell_count_and_rays_through_the_opening_do_not():
    block = box(1, 2, 3)
    shell = SimplexMesh(block.points, block.cells[normals(block)[:, 2] < 0.5])
    for mesh in (shell, inside_out(shell), turned(shell)):
        expected = np.abs(normals(shell)) @ [1.0, 2.0, 3.0]
        expected[np.abs(normals(shell)[:, 2]) > 0.5] = np.inf
        assert_allclose(boundary_width(mesh), expected, rtol=ROUNDING)


def test_a_single_sheet_has_no_width():
    flat = SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    assert np.isinf(boundary_width(turned(flat))).all()
    assert np.isinf(boundary_width(SimplexMesh([[0, 0], [1, 1], [2, 1]], [[0, 1], [1, 2]]))).all()


def test_a_sheet_across_a_body_is_a_wall_from_both_sides():
    sheet = SimplexMesh([[1.0, y, z] for y, z in ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9))],
                        [[0, 1, 2], [0, 2, 3]])  # fmt: skip
    block = box(3, 1, 1)
    x = normals(block)[:, 0]
    for wall in (sheet, inside_out(sheet)):
        width = boundary_width(joined(block, wall))[:12]
        assert_allclose(width[x < -0.5], 1.0, rtol=ROUNDING)
        assert_allclose(width[x > 0.5], 2.0, rtol=ROUNDING)


def test_the_arms_of_a_line_in_the_plane_are_walls():
    u = SimplexMesh([[0, 3], [0, 0], [1, 0], [1, 3]], [[0, 1], [1, 2], [2, 3]])
    assert_allclose(boundary_width(u), [1.0, np.inf, 1.0], rtol=ROUNDING)


# --- what files contain -----------------------------------------------------------


@pytest.mark.parametrize("make", [width_oracle.random_union, width_oracle.random_polygon])
def test_widths_do_not_change_if_each_facet_has_nodes_of_its_own(make):
    mesh = make(np.random.default_rng(5081))
    soup = SimplexMesh(
        mesh.points[mesh.cells].reshape(-1, mesh.dim),
        np.arange(mesh.cells.size).reshape(mesh.cells.shape),
    )
    assert_array_equal(boundary_width(soup), boundary_width(mesh))
    # Nodes that are merged have the width of their place.
    at_nodes = [Width(Faces.of(m), 30.0).at_nodes(silent) for m in (mesh, soup)]
    assert_array_equal(at_nodes[1], at_nodes[0][mesh.cells.ravel()])


def test_facets_without_area_have_no_width_and_change_nothing():
    block = box(1, 2, 3)
    points = np.concatenate([block.points, [[0.0, 0.0, 1.5]]])
    a, b = (np.flatnonzero((block.points == [0, 0, z]).all(axis=1))[0] for z in (0, 3))
    flat = SimplexMesh(points, np.concatenate([block.cells, [[a, b, 8]]]))
    width = boundary_width(flat)
    assert np.isinf(width[-1])
    assert_array_equal(width[:-1], boundary_width(block))


# --- at nodes and near points -----------------------------------------------------


def test_nodes_have_the_least_width_of_the_facets_around_them():
    block = box(1, 2, 3)
    width = Width(Faces.of(block), 30.0)
    assert_allclose(width.at_nodes(silent), 1.0, rtol=ROUNDING)
    lonely = SimplexMesh(np.concatenate([block.points, [[9, 9, 9]]]), block.cells)
    assert np.isinf(Width(Faces.of(lonely), 30.0).at_nodes(silent)[-1])


def test_points_have_the_width_at_the_closest_place_of_the_boundary():
    shape, end = trapezoid(40.0)
    width = Width(Faces.of(shape), 30.0)
    x = np.linspace(0.2, end - 0.1, 7)
    below = np.column_stack([x, np.full(7, -0.01)])
    expected = 0.1 + x * np.tan(np.radians(40.0))
    assert_allclose(width.near(below, silent), expected, rtol=1e-9)
    assert_allclose(width.near(np.array([[2.0, 0.3]]), silent), 1.0, rtol=1e-9)
    # As far from the bottom as from the right side, where the channel is 3 long.
    assert_allclose(width.near(np.array([[2.75, 0.25]]), silent), 1.0, rtol=1e-9)
