"""The width of a domain, by rays from its boundary."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
import width_oracle
from numpy.testing import assert_allclose, assert_array_equal
from shapes import joined, moved
from solids import box, circle, inside_out, outline, turned

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


# --- what is outside, other bodies, sheets ----------------------------------------


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


def test_opposite_walls_of_an_open_shell_count_and_rays_through_the_opening_do_not():
    block = box(1, 2, 3)
    shell = SimplexMesh(block.points, block.cells[normals(block)[:, 2] < 0.5])
    for mesh in (shell, inside_out(shell), turned(shell)):
        expected = np.abs(normals(shell)) @ [1.0, 2.0, 3.0]
        expected[np.abs(normals(shell)[:, 2]) > 0.5] = np.inf
        assert_allclose(boundary_width(mesh), expected, rtol=ROUNDING)


# --- at nodes and near points -----------------------------------------------------


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
