"""Implicit domains on octrees: sizes between the nodes against closed forms, and refinement."""

import distance_shapes as shapes
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from adaptsize import PointSource, size_function

disc, torus = shapes.ball(1.0), shapes.torus(1.0, 0.3)
G, K = 0.25, 4.0
FREE = {"g": G, "hmax": 100.0, "max_elements": np.inf}
CURVATURE = {**FREE, "elements_per_radian": K, "elements_across": 0.0}
#: In space, where leaves are many more.
COARSE = {**CURVATURE, "elements_per_radian": 0.5 * K}
WIDTH = {**FREE, "elements_per_radian": 0.0, "elements_across": 2.0}
TOLERANCE = 0.05


def ellipse(x):
    """No distance, axes 4 : 1."""
    return x[:, 0] ** 2 + (4.0 * x[:, 1]) ** 2 - 1.0


def ellipse_size(x):
    t = np.linspace(0.0, 2.0 * np.pi, 4001)
    points = np.column_stack([np.cos(t), 0.25 * np.sin(t)])
    radius = (np.sin(t) ** 2 + (0.25 * np.cos(t)) ** 2) ** 1.5 / 0.25
    away = np.linalg.norm(x[:, None] - points, axis=2)
    return (radius / K + G * away).min(axis=1)


def holes(x, half=0.004, radius=0.3):
    """A disc with two holes and a wall of twice ``half`` between them."""
    one, other = (
        radius - np.hypot(x[:, 0] - side * (radius + half), x[:, 1]) for side in (-1.0, 1.0)
    )
    return np.maximum(disc(x), np.maximum(one, other))


def rounded_cube(x, half=0.5, radius=0.25):
    return shapes.box(*[2.0 * (half - radius)] * x.shape[1])(x) - radius


def rounded_cube_size(x, half=0.5, radius=0.25):
    """The size from the rounded edges and corners: its curvature jumps where they end."""
    t = np.linspace(0.0, 0.5 * np.pi, 90)
    arc = half - radius + radius * np.column_stack([np.cos(t), np.sin(t)])
    u, v = (angle.ravel() for angle in np.meshgrid(t, t))
    ball = np.column_stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)])
    away = cKDTree(half - radius + radius * ball).query(np.abs(x))[0]
    for axis in range(3):
        across = cKDTree(arc).query(np.abs(np.delete(x, axis, axis=1)))[0]
        beyond = np.maximum(np.abs(x[:, axis]) - half + radius, 0.0)
        away = np.minimum(away, np.hypot(across, beyond))
    return 2.0 * radius / K + G * away


def samples(function, half, dim, n=1500, seed=20251):
    x = np.random.default_rng(seed).uniform(-1.0, 1.0, (40 * n, dim)) * half
    values = function(x)
    inside = np.flatnonzero(values < 0.0)
    near = inside[np.argsort(-values[inside])[: len(inside) // 10]]
    return np.concatenate([x[inside[:n]], x[near[:n]]])


@pytest.mark.parametrize(
    ("function", "half", "options", "exact"),
    [
        pytest.param(disc, [1.3, 1.2], CURVATURE, lambda x: 1.0 / K - G * disc(x), id="disc"),
        pytest.param(disc, [1.3, 1.2], WIDTH, lambda x: np.ones(len(x)), id="disc width"),
        pytest.param(ellipse, [1.2, 0.4], CURVATURE, ellipse_size, id="ellipse"),
        pytest.param(torus, [1.4, 1.4, 0.4], COARSE, lambda x: 0.6 / K - G * torus(x), id="torus"),
        pytest.param(torus, [1.4, 1.4, 0.4], WIDTH, lambda x: np.full(len(x), 0.3), id="width"),
        pytest.param(rounded_cube, [0.6, 0.61, 0.62], COARSE, rounded_cube_size, id="cube"),
    ],
)
def test_sizes_between_the_nodes_are_right_within_5_per_cent(function, half, options, exact):
    half = np.array(half)
    size = size_function(function, box=(-half, half), **options)
    x = samples(function, half, len(half))
    assert_allclose(size(x), exact(x), rtol=TOLERANCE)
    assert size.background.n_points < (5000 if len(half) == 2 else 100_000)


def test_a_wall_far_thinner_than_the_first_leaves_is_found():
    size = size_function(holes, box=([-1.1, -1.1], [1.1, 1.1]), **{**WIDTH, "hmax": 0.1})
    # Half the width in the middle of the wall, and more along it by g times the distance.
    y = np.linspace(-0.02, 0.02, 21)
    wall = np.column_stack([np.zeros(21), y])
    half_width = np.hypot(0.304, y) - 0.3
    assert_allclose(size([[0.0, 0.0]]), 0.004, rtol=TOLERANCE)
    assert (size(wall) <= half_width * (1.0 + TOLERANCE)).all()
    assert size.background.leaf_sizes.min() < 0.004
    assert size.background.n_points < 5000


def test_a_wedge_of_17_degrees_is_narrow_up_to_its_tip_and_its_other_corners_are_not():
    slope = 0.15

    def wedge(x):  # no distance; its tip is at (-1, 0)
        return np.maximum(np.abs(x[:, 1]) - slope * (x[:, 0] + 1.0), x[:, 0] - 0.9)

    size = size_function(wedge, box=([-1.1, -0.8], [1.1, 0.8]), **{**WIDTH, "hmin": 1e-3})
    x = samples(wedge, np.array([1.1, 0.8]), 2)
    # Half of the ray from the closest point of the nearer side to the other side.
    along = (x[:, 0] + 1.0 + slope * np.abs(x[:, 1])) / np.hypot(1.0, slope)
    exact = np.maximum(0.5 * along * np.tan(2.0 * np.arctan(slope)), 1e-3)
    left = x[:, 0] < 0.4
    assert_allclose(size(x[left]), exact[left], rtol=TOLERANCE)
    assert (size(x[~left]) > 0.9 * exact[~left]).all()
    assert size.background.n_points < 5000


def test_rounded_corners_below_the_leaves_are_found():
    size = size_function(
        lambda x: rounded_cube(x, 1.0, 0.02), box=([-1.3, -1.3], [1.3, 1.3]), **CURVATURE
    )
    at = (1.0 - 0.02) + 0.02 / np.sqrt(2.0)
    assert_allclose(size([[at, at], [at, -at]]), 0.02 / K, rtol=TOLERANCE)


def test_point_sources_and_functions_refine_too():
    source = PointSource([0.3, 0.1], 0.002)
    box = ([-1.2, -1.2], [1.2, 1.2])
    size = size_function(disc, box=box, sources=source, g=G, hmin=1e-3, hmax=0.2)
    away = np.array([0.0, 0.004, 0.02, 0.1])
    x = np.column_stack([0.3 + away, np.full(4, 0.1)])
    assert_allclose(size(x), 0.002 + G * away, rtol=2.0 * TOLERANCE)
    h0 = size_function(disc, box=box, h0=lambda p: 0.01 + 0.2 * np.abs(p[:, 0]), g=G, hmax=0.2)
    x = samples(disc, 1.0, 2)
    assert_allclose(h0(x), np.minimum(0.01 + 0.2 * np.abs(x[:, 0]), 0.2), rtol=TOLERANCE)


@pytest.mark.parametrize(
    ("function", "box", "expected"),
    [
        (disc, ([2.0, 2.0], [3.0, 3.0]), "negative at a node"),
        (disc, ([-0.2, -0.2], [0.2, 0.2]), "boundary in the background"),
        (lambda x: np.full(len(x), np.nan), ([-1, -1], [1, 1]), "must be finite"),
        (lambda x: x, ([-1, -1], [1, 1]), "must have shape"),
    ],
)
def test_bad_functions_are_refused(function, box, expected):
    with pytest.raises(ValueError, match=expected):
        size_function(function, box=box)
