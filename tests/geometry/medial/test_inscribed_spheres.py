"""Largest spheres inside a boundary: known widths, corners, and a slow twin."""

import numpy as np
import pytest
from curved_shapes import irregular_ellipsoid, irregular_torus, sliver_cylinder
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import random_sphere
from scipy.spatial import ConvexHull
from solids import box, circle, hull, outline, wedge_plate
from sphere_radii import EXCESS, assert_radii, sagitta, smallest

from adaptsize import SimplexMesh
from adaptsize.geometry import inscribed_spheres

# Half the default separation angle.
SINE = np.sin(np.deg2rad(20.0))


# --- exact widths -----------------------------------------------------------------


@pytest.mark.parametrize("edges", [(10, 10, 1), (10, 1, 1), (3, 2, 1), (1, 1, 1)])
def test_a_box_of_twelve_triangles_is_as_thick_as_its_shortest_edge(edges):
    assert_radii(smallest(box(*edges)), 0.5)


def test_a_plate_is_as_thick_in_the_middle_of_its_faces():
    points = np.random.default_rng(811).uniform([0, 0, -1], [20, 10, 2], (200, 3))
    points[:, 2] = np.where(points[:, 2] < 0.5, -0.1, 1.1)
    assert_radii(smallest(box(20, 10, 1), points), 0.5)


def test_the_gap_between_two_plates_does_not_count():
    one = box(10, 10, 1)
    two = SimplexMesh(
        np.concatenate([one.points, one.points + np.array([0, 0, 1.1])]),
        np.concatenate([one.cells, one.cells + one.n_points]),
    )
    assert_radii(smallest(two), 0.5)


def test_a_gap_that_varies_has_its_width_everywhere():
    x = np.linspace(0.3, 2.7, 30)
    plate = wedge_plate(3.0, 2.0, 0.4, 1.0)
    # The sphere at (x, 1, 0) that touches the plane z = 0.4 + 0.2 x with normal (-0.2, 0, 1) / s.
    s = np.hypot(0.2, 1.0)
    exact = (0.4 + 0.2 * x) / (s + 1.0)
    assert_radii(smallest(plate, np.column_stack([x, np.ones(30), np.zeros(30)])), exact)


def test_annulus():
    n = 60
    ring = outline(circle(n, 2.0), circle(n, 1.5)[::-1])
    # Chords of the outer circle lie inside by 2 (1 - cos(pi / n)), of the inner one outside.
    assert_radii(smallest(ring), 0.25, 1.0 - (1 - np.cos(np.pi / n)) * 2.0 / 0.25)


def test_ellipse():
    angle = 2 * np.pi * np.arange(600) / 600
    x, y = 2.0 * np.cos(angle), np.sin(angle)
    # Touches at (x, y) and (x, -y): centre on the long axis.
    normal = np.column_stack([x / 4.0, y])
    normal_y = np.abs(normal[:, 1]) / np.linalg.norm(normal, axis=1)
    seen = normal_y > SINE
    radii = smallest(outline(np.column_stack([x, y])))
    assert_radii(radii[seen], np.abs(y[seen]) / normal_y[seen], 0.999)
    # Beyond, at the tip, the curve is less than 40 degrees of its circle of curvature.
    assert_radii(radii[~seen], 0.5, 1.0, 1.1)


def test_spheroid():
    mesh, _ = irregular_ellipsoid(0.12, 812, axes=(1.0, 1.0, 2.0))
    normal = mesh.points / np.array([1.0, 1.0, 4.0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.linalg.norm(normal[:, :2], axis=1)
    seen = across > 0.5
    exact = np.linalg.norm(mesh.points[:, :2], axis=1)[seen] / across[seen]
    low = 1.0 - 4.3 * sagitta(mesh, 0.7)  # the tightest normal section has a radius of 0.7 there
    radii = smallest(mesh)[seen]
    assert_radii(radii, exact, low, 1.03)  # normals are estimates
    assert np.median(radii / exact) > 0.97


def test_torus():
    mesh, _ = irregular_torus(36, 813)
    radii = smallest(mesh)
    assert_radii(radii, 0.4, 1.0 - 4.3 * sagitta(mesh, 0.4) / 0.4)
    assert np.median(radii) > 0.96 * 0.4


@pytest.mark.parametrize("height", [2.0, 20.0])
def test_cylinder_of_slivers(height):
    mesh = sliver_cylinder(48, 814, height=height)
    # A chord of up to 1.5 mean steps lies inside by 0.5 (1.5 pi / 48)^2, which counts
    # 4.3 times at the low end; caps are held by the mantle on all sides.
    assert_radii(smallest(mesh), 1.0, 1.0 - 4.3 * 0.5 * (1.5 * np.pi / 48) ** 2)


def test_shell_with_a_cavity():
    outer, inner = random_sphere(1500, 815), random_sphere(1500, 816, radius=0.6)
    cells = np.concatenate([outer.cells, inner.cells[:, ::-1] + outer.n_points])
    shell = SimplexMesh(np.concatenate([outer.points, inner.points]), cells)
    low = 1.0 - 4.3 * sagitta(outer, 1.0) / 0.2
    assert_radii(smallest(shell), 0.2, low, 1.0 + sagitta(inner, 0.6) / 0.2 + 0.01)


# --- corners -----------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [10, 20, 29])
def test_wedges_below_the_corner_angle_are_narrow(degrees):
    half = 0.5 * np.deg2rad(degrees)
    x = np.array([0.05, 0.5, 1.0, 2.0, 3.0])
    wedge = outline([[0, 0], [4, 0], 4 * np.array([np.cos(2 * half), np.sin(2 * half)])])
    points = np.column_stack([x, np.zeros(5)])
    assert_radii(smallest(wedge, points), x * np.tan(half))
    wide = smallest(wedge, points, corner_angle=degrees - 1.0)
    assert (wide[:3] > 2.0 * x[:3] * np.tan(half)).all()


@pytest.mark.parametrize("apex", [[0.5, 0.5], [0.2, 0.7], [0.0, 1.0]])
def test_triangles_are_as_wide_as_their_inscribed_circle(apex):
    triangle = outline([[0, 0], [1, 0], apex])
    sides = triangle.edge_lengths
    inradius = apex[1] / sides.sum()  # twice the area over the perimeter
    t = np.linspace(0.0, 1.0, 11)[:, None]
    points = np.concatenate(
        [(1 - t) * triangle.points[i] + t * triangle.points[j] for i, j in triangle.cells]
    )
    # Larger where the ball at the point meets the end of a wall, and not its inside.
    assert_radii(smallest(triangle, points), inradius, 1.0, 1.1)


@pytest.mark.parametrize("n", [3, 4, 5, 6, 8])
def test_corners_of_polygons_do_not_drive_the_radius_to_zero(n):
    polygon = outline(circle(n))
    corners, apothem = circle(n), np.cos(np.pi / n)
    t = np.linspace(0.0, 1.0, 41)[:, None]
    radii = smallest(polygon, (1 - t) * corners[0] + t * corners[1])
    assert radii[20] == pytest.approx(apothem, rel=0.01)
    # Near corners a side further on is met, at more than half the apothem.
    assert (radii > 0.5 * apothem).all()
    assert (radii <= apothem * EXCESS).all()


def test_a_face_between_corners_bounds_the_radius():
    # A cut-off corner of a square: the short side is 0.1 sqrt(2) long, the walls at its ends
    # stand at 135 degrees, so that the sphere in its middle has half of it times tan(67.5).
    square = outline([[0.1, 0], [1, 0], [1, 1], [0, 1], [0, 0.1]])
    radii = smallest(square, [[0.05, 0.05], [0.09, 0.01], [0.02, 0.08]])
    assert_radii(radii, 0.05 * np.sqrt(2) * np.tan(np.deg2rad(67.5)))


def test_regular_tetrahedron():
    points = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 1.0
    solid = hull(points)
    inradius = 2.0 * np.sqrt(2.0) / np.sqrt(24.0)
    centres = points[solid.cells].mean(axis=1)
    assert_radii(smallest(solid, centres), inradius)
    assert (smallest(solid) >= inradius).all()


def test_the_tip_of_a_cone_is_a_corner():
    base = np.column_stack([circle(64), np.zeros(64)])
    cone = hull([*base, [0, 0, 1.0]])
    z = np.array([0.5, 0.9, 0.99, 0.999])
    radii = smallest(cone, np.column_stack([1 - z, 0 * z, z]))
    assert (radii > 0.3).all()  # (1 - z) tan(45 degrees) sqrt(2) if it counted


def test_reentrant_corners_are_widths():
    # Legs 1 and 2 wide.
    shape = outline([[0, 0], [6, 0], [6, 1], [2, 1], [2, 6], [0, 6]])
    spheres = inscribed_spheres(shape, [[4, 0], [0, 4], [2, 1]])
    assert_radii(spheres.smallest(), [0.5, 1.0, 0.5])
    assert_radii(np.sort(spheres.radii[spheres.owners == 2]), [0.5, 1.0])  # one for each leg


def test_both_sides_of_a_crease_count():
    # Along the reentrant edge of the same shape, 3 deep, where no node is.
    profile = np.array([[0, 0], [6, 0], [6, 1], [2, 1], [2, 6], [0, 6]])
    caps = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    i = np.arange(6)
    j = (i + 1) % 6
    sides = np.concatenate([np.column_stack([i, j, j + 6]), np.column_stack([i, j + 6, i + 6])])
    points = np.concatenate([np.column_stack([profile, np.full(6, z)]) for z in (0.0, 3.0)])
    solid = SimplexMesh(points, np.concatenate([caps[:, ::-1], caps + 6, sides]))
    spheres = inscribed_spheres(solid, [[2, 1, 1.4]])
    assert spheres.owners.tolist() == [0, 0]
    assert_radii(np.sort(spheres.radii), [0.5, 1.0])


# --- the slow twin -------------------------------------------------------------------


def slow_radii(mesh, points, normals, n=16):
    """Least r(q) over a fine sampling of each facet, as the kernel's docstring has it."""
    w = np.array([[i, j, n - i - j] for i in range(n + 1) for j in range(n + 1 - i)]) / n
    corners = mesh.points[mesh.cells]
    normal = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    samples = np.einsum("sk,ckd->csd", w, corners)
    radii = []
    for p, inward in zip(points, normals, strict=True):
        faces = np.einsum("cd,cd->c", normal, p - corners[:, 0]) > 1e-9
        way = samples[faces] - p
        above, length = way @ inward, np.linalg.norm(way, axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            r = np.where(above > 0.0, length**2 / (2.0 * above), np.inf)
        best = r.argmin(axis=1)[:, None]
        high = np.take_along_axis(above, best, 1) >= SINE * np.take_along_axis(length, best, 1)
        radii.append(np.take_along_axis(r, best, 1)[high].min())
    return np.array(radii)


@pytest.mark.parametrize("seed", [821, 822])
def test_radii_are_those_of_a_search_over_all_facets(seed):
    mesh, _ = irregular_torus(12, seed)  # coarse, so that facets, not nodes, are touched
    outward = np.array(mesh.cells)
    corners = mesh.points[outward]
    centre = corners.mean(axis=1)
    axis = centre * [1, 1, 0] / np.linalg.norm(centre[:, :2], axis=1, keepdims=True)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turn = np.einsum("cd,cd->c", normal, centre - axis) < 0.0
    outward[turn] = outward[turn][:, [1, 0, 2]]
    mesh = SimplexMesh(mesh.points, outward)
    spheres = inscribed_spheres(mesh, crease_angle=90.0)
    # Facets near the separation angle may fall on either side of it, as their sampling may.
    few = slice(None, None, 5)
    ratio = spheres.radii[few] / slow_radii(mesh, spheres.points[few], spheres.normals[few])
    assert np.quantile(ratio, 0.05) > 0.98
    assert np.quantile(ratio, 0.95) <= EXCESS


# --- laws ----------------------------------------------------------------------------


def test_spheres_hold_nothing_of_the_boundary_and_touch_it_twice():
    mesh, _ = irregular_torus(24, 823)
    spheres = inscribed_spheres(mesh, crease_angle=80.0)  # no corners
    away = np.linalg.norm(spheres.contacts - spheres.centres, axis=1)
    np.testing.assert_allclose(away, spheres.radii, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(spheres.normals, axis=1), 1.0)
    nearest = mesh.locator.nearest(spheres.centres)[2]
    # Less by what lies below the separation angle: nodes of this torus, seen from facets.
    assert (nearest > 0.9 * spheres.radii).mean() > 0.99
    assert (nearest > 0.8 * spheres.radii).all()
    assert (mesh.locator.nearest(spheres.contacts)[2] < 1e-9).all()


@given(st.integers(0, 2**32 - 1), st.floats(-6, 6))
@settings(max_examples=8, deadline=None)
def test_radii_turn_move_and_scale_with_the_boundary(seed, power):
    rng = np.random.default_rng(seed)
    base, _ = irregular_torus(18, 824)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # mirrored as well, at times
    scale = 10.0**power
    moved = SimplexMesh(scale * (base.points @ turn.T + rng.uniform(-5, 5, 3)), base.cells)
    # Another tree leaves other things undone.
    ratio = smallest(moved, crease_angle=80.0) / smallest(base, crease_angle=80.0) / scale
    assert np.abs(np.log(ratio)).max() < 0.03
    assert np.abs(np.log(np.median(ratio))) < 1e-3


def test_points_and_nodes_agree():
    mesh, _ = irregular_torus(24, 825)
    np.testing.assert_allclose(smallest(mesh, mesh.points), smallest(mesh), rtol=EXCESS - 1.0)


# --- arguments --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"crease_angle": -1.0}, "crease_angle must be finite and >= 0, got -1"),
        ({"separation_angle": 181.0}, "separation_angle must be at most 180 degrees, got 181"),
        ({"corner_angle": np.nan}, "corner_angle must be finite"),
        ({"points": [[0.0, 0.0]]}, r"points must have shape \(n, 3\)"),
    ],
)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        inscribed_spheres(box(1, 1, 1), **options)


def test_other_meshes_are_refused():
    flat = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="segments in 2-D or triangles in 3-D"):
        inscribed_spheres(flat)


def test_no_points_and_progress():
    reports = []
    spheres = inscribed_spheres(
        box(1, 1, 1), np.empty((0, 3)), progress=lambda text, share: reports.append(share)
    )
    assert len(spheres.radii) == 0
    assert spheres.smallest().shape == (0,)
    torus, _ = irregular_torus(30, 831)
    inscribed_spheres(torus, progress=lambda text, share: reports.append(share))
    assert reports[-1] == 1.0


@pytest.mark.parametrize("seed", [1, 2])
def test_radii_are_positive_where_coordinates_are_rounded_coarsely(seed):
    # Regression: division by zero, and a negative radius.
    corners = np.random.default_rng(seed).normal(size=(60, 3))
    corners = np.round(4.0 * corners / np.linalg.norm(corners, axis=1)[:, None])
    far = SimplexMesh(corners / 8.0 + 1e15, ConvexHull(corners).simplices)
    assert (inscribed_spheres(far).radii > 0.0).all()
