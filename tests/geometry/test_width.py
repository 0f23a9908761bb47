"""The width of a domain, by rays from its boundary."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
import width_oracle
from manifold3d import CrossSection, Manifold
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from shapes import joined
from solids import box, circle, outline
from width_oracle import mesh_of

from adaptsize import SimplexMesh
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.width import Width, boundary_width

# Of exact cases: coordinates and normals are rounded to 2e-16, and near slivers lose some digits.
ROUNDING = 1e-12


def quiet(*_):
    """A report of progress that goes nowhere."""


def turned(mesh, seed=20261):
    turn = Rotation.random(random_state=seed).as_matrix()
    return SimplexMesh(mesh.points @ turn.T, mesh.cells)


def shifted(mesh, by):
    return SimplexMesh(mesh.points + np.asarray(by, float), mesh.cells)


def inside_out(mesh):
    return SimplexMesh(mesh.points, mesh.cells[:, ::-1])


def middles(mesh):
    return mesh.points[mesh.cells].mean(axis=1)


def normals(mesh):
    corners = mesh.points[mesh.cells]
    if mesh.dim == 2:
        along = corners[:, 1] - corners[:, 0]
        return along[:, ::-1] * [1, -1] / np.linalg.norm(along, axis=1)[:, None]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return across / np.linalg.norm(across, axis=1)[:, None]


def extruded(points, height):
    return mesh_of(Manifold.extrude(CrossSection([points]), height))


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
    found = Width(faces, 30.0).samples(quiet)
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


def torus(n, big=1.0, small=0.3):
    """Twice as many facets around the hole as around the tube, all in the same direction."""
    i, j = np.meshgrid(np.arange(2 * n), np.arange(n), indexing="ij")
    u, v = np.pi * i / n, 2.0 * np.pi * j / n
    away = big + small * np.cos(v)
    points = np.stack([away * np.cos(u), away * np.sin(u), small * np.sin(v)], axis=-1)

    def node(a, b):
        return ((i + a) % (2 * n) * n + (j + b) % n).ravel()

    lower = np.column_stack([node(0, 0), node(1, 0), node(1, 1)])
    upper = np.column_stack([node(0, 0), node(1, 1), node(0, 1)])
    return SimplexMesh(points.reshape(-1, 3), np.concatenate([lower, upper]))


def test_the_error_on_a_torus_is_of_second_order():
    # Rays through the tube. Steeper ones, from inside the hole, would cross it lengthwise.
    errors = [np.abs(boundary_width(torus(n)) - 0.6).max() for n in (16, 32, 64)]
    assert of_second_order(errors)
    assert errors[-1] < 0.002


def test_a_ligament_between_two_holes_is_as_wide_as_the_least_distance():
    n, gap = 40, 0.2
    # Facets face each other in the middle of the ligament.
    turn = Rotation.from_euler("z", 180.0 / n, degrees=True).as_matrix()[:2, :2]
    holes = [0.5 * circle(n)[::-1] @ turn.T + [x, 0.0] for x in (-0.6, 0.6)]
    least = gap + 1.0 - np.cos(np.pi / n)
    plate = outline([[-3, -2], [3, -2], [3, 2], [-3, 2]], *holes)
    assert_allclose(boundary_width(plate).min(), least, rtol=ROUNDING)
    solid = Manifold.cube([6.0, 4.0, 1.0], True)
    for hole in holes:
        solid -= Manifold.extrude(CrossSection([hole[::-1]]), 4.0).translate([0.0, 0.0, -2.0])
    # Cross sections are rounded to some 1e-9.
    assert_allclose(boundary_width(turned(mesh_of(solid))).min(), least, rtol=1e-7)


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


def prism(degrees, height=4.0):
    """The wedge as a body; its ends are strips between the two sides."""
    flat = wedge(degrees).points
    m, n = (len(flat) - 1) // 2, len(flat)
    low, up = 1 + np.arange(m), n - 1 - np.arange(m)
    ends = [[0, low[0], up[0]]]
    for k in range(m - 1):
        ends += [[low[k], low[k + 1], up[k + 1]], [low[k], up[k + 1], up[k]]]
    ends, i = np.array(ends), np.arange(n)
    j = np.roll(i, -1)
    sides = [np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])]
    points = [np.column_stack([flat, np.full(n, z)]) for z in (0.0, height)]
    return SimplexMesh(np.concatenate(points), np.concatenate([ends[:, ::-1], ends + n, *sides]))


def tapers_from_edge(mesh, axis_distance, width, degrees):
    """Return which facets have the width of the wedge at their distance from its edge."""
    expected = axis_distance * np.tan(np.radians(degrees))
    return np.abs(width - expected) <= 1e-9 * expected


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0])
def test_a_wedge_below_the_corner_angle_is_narrow_to_its_edge(degrees):
    mesh = wedge(degrees)
    distance = np.linalg.norm(middles(mesh), axis=1)
    near = distance < 2.0  # farther away, rays meet the third side
    assert tapers_from_edge(mesh, distance, boundary_width(mesh), degrees)[near].all()
    assert distance.min() < 0.001


@pytest.mark.parametrize("degrees", [30.0, 31.0, 40.0, 60.0])
def test_a_wedge_above_the_corner_angle_is_a_corner_and_not_narrow(degrees):
    mesh = wedge(degrees)
    distance = np.linalg.norm(middles(mesh), axis=1)
    assert np.isinf(boundary_width(mesh)[distance < 2.0]).all()


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0, 31.0, 40.0, 60.0])
def test_a_prism_over_a_wedge_is_narrow_where_the_wedge_is(degrees):
    mesh = prism(degrees)
    width, middle = boundary_width(turned(mesh)), middles(mesh)
    distance = np.linalg.norm(middle[:, :2], axis=1)
    sides = (np.abs(normals(mesh)[:, 2]) < 0.5) & (distance < 2.0)
    assert sides.sum() > 40
    if degrees < 30.0:
        assert tapers_from_edge(mesh, distance, width, degrees)[sides].all()
    else:
        assert np.isinf(width[sides]).all()


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


def test_a_blunt_trailing_edge_is_as_wide_as_its_thickness():
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 81)))  # NACA 0012, .00252 thick at its end
    half = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1015 * x**4)
    lower, upper = np.column_stack([x, -half]), np.column_stack([x, half])[:0:-1]
    mesh = outline(np.concatenate([lower, upper]))
    width, at = boundary_width(mesh), middles(mesh)
    side = (at[:, 0] > 0.3) & (np.abs(normals(mesh)[:, 0]) < 0.5)
    thickness = 2.0 * np.interp(at[side, 0], x, half)
    # A ray is 1/cos longer than the way straight up and meets a wall inclined by up to 17 degrees.
    assert_allclose(width[side], thickness, rtol=0.05)
    assert width[side].min() < 0.003


def test_a_trailing_edge_of_40_degrees_is_a_corner_and_the_middle_is_narrow():
    rise = np.tan(np.radians(20.0)) / np.pi
    x = np.linspace(0.0, 1.0, 101)
    half = rise * np.sin(np.pi * x)
    lower, upper = np.column_stack([x, -half]), np.column_stack([x, half])[-2:0:-1]
    mesh = outline(np.concatenate([lower, upper]))
    width, at = boundary_width(mesh), middles(mesh)[:, 0]
    # The walls are at twice the slope to each other: 30 degrees at x = .24 and .76.
    middle, ends = np.abs(at - 0.5) < 0.2, np.abs(at - 0.5) > 0.3
    expected = 2.0 * np.interp(at, x, half)
    assert_allclose(width[middle], expected[middle], rtol=0.1)
    assert_allclose(width[np.abs(at - 0.5) < 0.01], 2.0 * rise, rtol=0.002)
    assert np.isinf(width[ends]).all()


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


def c_ring(gap, *, n=60, inner=0.8):
    """A ring without a piece of ``gap`` at its right."""
    half = np.arcsin(0.5 * gap)
    angle = np.linspace(half, 2.0 * np.pi - half, n)
    arc = np.column_stack([np.cos(angle), np.sin(angle)])
    ends = inner * arc
    ends[[0, -1], 1] = arc[[0, -1], 1]  # the walls of the gap are parallel
    return np.concatenate([arc, ends[::-1]])


def test_a_gap_outside_the_domain_is_not_seen():
    ring = c_ring(0.01)
    assert_allclose(boundary_width(outline(ring)).min(), 0.2, rtol=0.01)
    assert_allclose(boundary_width(extruded(ring, 1.0)).min(), 0.2, rtol=0.01)
    pair = joined(box(1, 1, 1), shifted(box(1, 1, 1), [1.001, 0.0, 0.0]))
    assert_allclose(boundary_width(pair), 1.0, rtol=ROUNDING)


def test_a_body_in_another_is_transparent_and_a_cavity_is_a_wall():
    big, small = box(5, 5, 5), shifted(box(1, 1, 1), [2.1, 2.2, 2.3])
    filled = boundary_width(joined(big, small))
    assert_allclose(filled[:12], 5.0, rtol=ROUNDING)
    assert np.isinf(filled[12:]).all()  # not part of the boundary
    hollow = boundary_width(joined(big, inside_out(small)))
    at, out = middles(big), normals(big)
    # Rays that miss the cavity cross the box, as those of the cavity's end at the sides of the box.
    for k, (width, x, n) in enumerate(zip(hollow[:12], at, out, strict=True)):
        lower, upper = small.points.min(axis=0), small.points.max(axis=0)
        axis = np.abs(n).argmax()
        across = [d for d in range(3) if d != axis]
        meets = all(lower[d] < x[d] < upper[d] for d in across)
        wall = (5.0 - upper[axis] if n[axis] > 0.0 else lower[axis]) if meets else 5.0
        assert_allclose(width, wall, rtol=ROUNDING, err_msg=str(k))
    out = normals(small)
    room = np.where(out > 0.0, 5.0 - small.points.max(axis=0), small.points.min(axis=0))
    assert_allclose(hollow[12:], (np.abs(out) * room).sum(axis=1), rtol=ROUNDING)


def test_a_ray_ends_where_it_leaves_the_last_of_several_bodies():
    bars = [box(4, 1, 1), shifted(box(1, 4, 0.9), [1.5, -1.5, 0.05]),
            shifted(box(0.5, 0.7, 0.7), [1.6, 0.2, 0.15])]  # fmt: skip
    width = boundary_width(joined(*bars))
    for bar, own in zip(bars, (width[:12], width[12:24]), strict=False):
        lengths = np.ptp(bar.points, axis=0)
        long = np.abs(normals(bar)) @ lengths == 4.0
        assert_allclose(own[long], 4.0, rtol=ROUNDING)
    half = shifted(box(4, 0.8, 0.8), [2.5, 0.1, 0.1])  # from inside the first to beyond its end
    left = normals(bars[0])[:, 0] < -0.5
    assert_allclose(boundary_width(joined(bars[0], half))[:12][left], 6.5, rtol=ROUNDING)
    row = [shifted(box(1, 1 + 0.01 * k, 1 + 0.01 * k), [0.9 * k, 0, 0]) for k in range(40)]
    left = np.flatnonzero(normals(row[0])[:, 0] < -0.5)
    assert_allclose(boundary_width(joined(*row))[left], 0.9 * 39 + 1.0, rtol=ROUNDING)


@pytest.mark.parametrize("place", [[0.5, 0.25, 0.0], [1.0, 0.25, 0.25], [0.7, 0.5, 0.25]])
def test_overlapping_bodies_may_have_walls_in_one_plane(place):
    # Of 2 x 1 x 1, on one base, or with one end or side. Rays that end there leave both at once.
    width = boundary_width(joined(box(2, 1, 1), shifted(box(1, 0.5, 0.5), place)))[:12]
    assert_allclose(width, np.abs(normals(box(2, 1, 1))) @ [2.0, 1.0, 1.0], rtol=ROUNDING)


def test_the_depth_to_which_bodies_overlap_is_no_width():
    # Walls of the one inside the other do not bound the domain; 1 is its least width.
    other = shifted(box(2, 1.2, 1.2), [1.999, -0.1, -0.1])
    assert boundary_width(joined(box(2, 1, 1), other)).min() > 0.999


def test_bodies_that_touch_in_another_are_transparent():
    row = [shifted(box(1, 1, 1), [x, 0.4, 0.4]) for x in (3.0, 4.0)]
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

PARTS = {
    "union": lambda: width_oracle.random_union(np.random.default_rng(5081)),
    "ball": lambda: width_oracle.noisy_ball(np.random.default_rng(5082)),
    "polygon": lambda: width_oracle.random_polygon(np.random.default_rng(5083)),
}


@pytest.mark.parametrize("part", PARTS)
def test_widths_do_not_change_if_a_tenth_of_the_facets_is_flipped(part):
    mesh = PARTS[part]()
    cells = mesh.cells.copy()
    flipped = np.random.default_rng(8112).random(len(cells)) < 0.1
    cells[flipped] = cells[flipped][:, ::-1]
    assert flipped.sum() > 2
    assert_array_equal(boundary_width(SimplexMesh(mesh.points, cells)), boundary_width(mesh))


@pytest.mark.parametrize("part", PARTS)
def test_widths_do_not_change_if_facets_are_repeated(part):
    mesh = PARTS[part]()
    again = np.arange(0, mesh.n_cells, 3)
    cells = mesh.cells[again]
    if mesh.dim == 3:
        cells = np.roll(cells, 1, axis=1)  # the same facet, from another corner
    twice = SimplexMesh(mesh.points, np.concatenate([mesh.cells, cells]))
    assert_array_equal(boundary_width(twice)[: mesh.n_cells], boundary_width(mesh))


@pytest.mark.parametrize("part", PARTS)
def test_widths_do_not_change_if_each_facet_has_nodes_of_its_own(part):
    mesh = PARTS[part]()
    soup = SimplexMesh(
        mesh.points[mesh.cells].reshape(-1, mesh.dim),
        np.arange(mesh.cells.size).reshape(mesh.cells.shape),
    )
    assert_array_equal(boundary_width(soup), boundary_width(mesh))


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
    assert_allclose(width.at_nodes(quiet), 1.0, rtol=ROUNDING)
    lonely = SimplexMesh(np.concatenate([block.points, [[9, 9, 9]]]), block.cells)
    assert np.isinf(Width(Faces.of(lonely), 30.0).at_nodes(quiet)[-1])


def test_nodes_that_were_merged_have_the_width_of_their_place():
    mesh = PARTS["union"]()
    soup = SimplexMesh(
        mesh.points[mesh.cells].reshape(-1, 3), np.arange(mesh.cells.size).reshape(-1, 3)
    )
    at_nodes = [Width(Faces.of(m), 30.0).at_nodes(quiet) for m in (mesh, soup)]
    assert_array_equal(at_nodes[1], at_nodes[0][mesh.cells.ravel()])


def test_points_have_the_width_at_the_closest_place_of_the_boundary():
    shape, end = trapezoid(40.0)
    width = Width(Faces.of(shape), 30.0)
    x = np.linspace(0.2, end - 0.1, 7)
    below = np.column_stack([x, np.full(7, -0.01)])
    expected = 0.1 + x * np.tan(np.radians(40.0))
    assert_allclose(width.near(below, quiet), expected, rtol=1e-9)
    assert_allclose(width.near(np.array([[2.0, 0.3]]), quiet), 1.0, rtol=1e-9)
    # As far from the bottom as from the right side, where the channel is 3 long.
    assert_allclose(width.near(np.array([[2.75, 0.25]]), quiet), 1.0, rtol=1e-9)


# --- arguments --------------------------------------------------------------------
