"""Walls that are straight up to the rounding of their coordinates, or up to coarser noise.

The reference is the same problem before its coordinates were turned, moved and rounded.
"""

from functools import cache

import domains
import numpy as np
import pytest
from meshes import jittered_cube, structured_square
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from solids_of_cubes import solid_of_cubes

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.geometry.plane_boundary import plane_boundary
from adaptsize.limiting import Exact

G = 0.3
EPS = np.finfo(float).eps

#: All walls are straight, so that each has a dozen nodes between its corners.
SHAPES = {
    "L": domains.l_shape,
    "slit": domains.slit_square,
    "blocks": domains.blocks,
    "maze": domains.maze,
    "spiral": domains.spiral,
    "star holes": domains.star_holes,
    "30 squares": lambda n, seed: domains.holes(n, 30, 4, seed=seed),
}

#: A path passes at most 15 corners in these domains.  Where noise moves them, each piece between
#: two of them changes by the noise at both of its ends.
N_BENDS = 15


def turned(points):
    cosine, sine = np.cos(0.3), np.sin(0.3)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def rounded(decimals):
    return lambda points, rng: np.round(turned(points), decimals), 0.5 * 10.0**-decimals


def moved(distance):
    return lambda points, rng: turned(points) + np.array([distance, 0.7 * distance]), EPS * distance


def noisy(share):
    return lambda points, rng: points + 100.0 * share * rng.uniform(-1, 1, points.shape), (
        100.0 * share
    )


VARIANTS = {
    "float32": (lambda points, rng: turned(points).astype(np.float32).astype(float), 4e-6),
    **{f"{k} decimals": rounded(k) for k in range(6, 17)},
    **{f"at {x:g}": moved(x) for x in (1.0, 1e2, 1e4, 1e6, 1e8)},
    **{f"noise {x:g}": noisy(x) for x in 10.0 ** np.arange(-16, -5)},
}


@cache
def original(name, n_nodes=1200):
    mesh, _ = SHAPES[name](n_nodes, seed=2251)
    h0, _ = domains.point_sources(mesh, [(-45, 45), (45, -45)], (1.0, 5.0))
    return mesh, h0, limit_gradient(mesh, h0, G, method=Exact(face_sources=False))


def assert_off_by_noise_only(name, change, noise, rng):
    mesh, h0, expected = original(name)
    points = change(mesh.points, rng)
    other = SimplexMesh(points, mesh.cells)
    h, info = limit_gradient.with_info(other, h0, G, method=Exact(face_sources=False))
    # Turning rounds, too.
    off_by = noise + 4.0 * EPS * np.abs(points).max()
    assert_allclose(h, expected, rtol=0.0, atol=2.0 * np.sqrt(2.0) * (N_BENDS + 1) * G * off_by)
    assert info.n_proved == mesh.n_points


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", SHAPES)
def test_rounded_coordinates_change_sizes_by_the_rounding_only(name, variant):
    rng = np.random.default_rng(2252)
    assert_off_by_noise_only(name, *VARIANTS[variant], rng)


@pytest.mark.parametrize("share", [3e-16, 1e-15, 3e-15, 1e-14, 3e-14, 1e-13])
def test_noise_about_the_tolerance_leaves_no_node_without_its_path(share):
    # Regression: corners that a path passes within the tolerance hid what was behind them.
    for seed in range(30):
        assert_off_by_noise_only("maze", *noisy(share), np.random.default_rng(seed))


def _is_around(x):
    return np.abs(x[:, :2] - 2.5).max(axis=1) > 1.0


SOLIDS = {
    "box": lambda: jittered_cube(5, 2296),
    "wall": lambda: domains.wall_box(200, seed=2291)[0],
    "thin wall": lambda: domains.wall_box(200, width=0.1, seed=2295)[0],
    "window": lambda: domains.window_box(250, seed=2292)[0],
    "frame": lambda: solid_of_cubes(_is_around, (5, 5, 2), 5),
}


@cache
def original_solid(name):
    # Faces are oblique, so that each of their triangles is tilted by the rounding.
    mesh, rng = SOLIDS[name](), np.random.default_rng(2293)
    points = mesh.points @ Rotation.random(random_state=2294).as_matrix() / mesh.diagonal
    h0 = np.full(mesh.n_points, np.inf)
    h0[rng.choice(mesh.n_points, 3)] = 0.01, 0.05, 0.1
    mesh = SimplexMesh(points, mesh.cells)
    return mesh, h0, limit_gradient(mesh, h0, G, method=Exact())


@pytest.mark.parametrize("decimals", range(5, 12))
@pytest.mark.parametrize("name", SOLIDS)
def test_rounded_solids_are_those_with_plane_faces(name, decimals):
    mesh, h0, expected = original_solid(name)
    rounded_mesh = SimplexMesh(np.round(mesh.points, decimals), mesh.cells)
    h = limit_gradient(rounded_mesh, h0, G, method=Exact())
    assert_allclose(h, expected, rtol=0.0, atol=30.0 * G * 10.0**-decimals)
    i, j = mesh.edges.T
    length = np.linalg.norm(rounded_mesh.points[i] - rounded_mesh.points[j], axis=1)
    assert (np.abs(h[i] - h[j]) <= G * length * (1.0 + 1e-12) + 1e-15).all()


@pytest.mark.parametrize("distance", [0.0, 1e3, 1e6])
def test_walls_straight_to_rounding_are_one_and_others_are_not(distance):
    mesh = original("L")[0]
    points = turned(mesh.points) + distance
    unit = EPS * np.abs(points).max()
    for noise, straight in ((0.5 * unit, True), (100.0 * unit, False)):
        rng = np.random.default_rng(2281)
        changed = SimplexMesh(points + noise * rng.uniform(-1, 1, points.shape), mesh.cells)
        found = plane_boundary(changed, flat_boundary(changed))
        assert (len(found.walls) == 6) == straight
        assert (len(found.corners) == 1) == straight


def sagging_square(n, inwards):
    """Return a square whose lower side turns inwards by this angle at each of its inner nodes."""
    mesh = structured_square(n, half_width=1.0)
    points = mesh.points.copy()
    on_side = np.flatnonzero(points[:, 1] == -1.0)
    x = points[on_side, 0]
    points[on_side, 1] += inwards * (1.0 - x * x) * n / 4.0  # a parabola: second difference
    return SimplexMesh(points, mesh.cells), on_side


@pytest.mark.parametrize(("total", "expected"), [(1e-7, True), (4e-7, False)])
def test_sides_may_turn_inwards_as_long_as_no_distance_changes(total, expected):
    n = 40
    mesh, on_side = sagging_square(n, total / (n - 1))
    assert is_convex(mesh.points, flat_boundary(mesh)) == expected
    side = mesh.points[on_side[np.argsort(mesh.points[on_side, 0])]]
    length = np.linalg.norm(np.diff(side, axis=0), axis=1).sum()
    straight = np.linalg.norm(side[-1] - side[0])
    assert (length / straight - 1.0 <= 5e-15) or not expected
