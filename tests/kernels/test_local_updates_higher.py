"""Updates from an edge with slopes, against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import random_sphere, random_square

from adaptsize._kernels.fast_marching import fill_stars
from adaptsize._kernels.headings import fill_headings, fill_twins
from adaptsize._kernels.local_updates_higher import (
    edge_frame,
    gradient_behind,
    minimum_from_source,
    minimum_on_cubic,
    minimum_on_linear,
)

AXES = (0, 0)
K, A, B, Z = 0, 1, 2, 3


@st.composite
def waves(draw, distances=(0.3, 1.0, 10.0)):
    """A node K over the edge (A, B), and a point source Z on the other side of it.

    The straight line from Z to K crosses the edge at the share s.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    s = rng.uniform(0.02, 0.98)
    length = rng.uniform(0.5, 2.0)
    ray = rng.uniform(0.3, math.pi - 0.3)
    ray = np.array([math.cos(ray), math.sin(ray)])
    at = np.array([s * length, 0.0])
    behind = draw(st.sampled_from(distances))
    points = np.array([at + rng.uniform(0.2, 1.5) * ray, [0.0, 0.0], [length, 0.0]])
    points = np.vstack([points, at - behind * length * ray])
    turn = rng.uniform(0.0, 2.0 * math.pi)
    turn = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return points @ turn.T + rng.normal(size=2), s, draw(st.sampled_from([0.1, 0.3, 2.0]))


def _cone(points, g):
    """Return sizes at A and B, and the gradients there, of 1 + g |x - Z|."""
    away = points[[A, B]] - points[Z]
    far = np.linalg.norm(away, axis=1)
    return 1.0 + g * far, g * away / far[:, None]


def _along(points, gradients):
    return gradients @ (points[B] - points[A])


@given(waves())
def test_a_cone_is_continued_exactly_from_its_source(wave):
    points, s, g = wave
    frame = edge_frame(points, AXES, K, A, B)
    (h_a, h_b), gradients = _cone(points, g)
    slopes = _along(points, gradients)
    for known in (False, True):
        value, there = minimum_from_source(
            points, AXES, frame, A, B, Z, 1.0, h_a, h_b, *slopes, known, g, 0.0, (g, g, 0.0), True
        )
        exact = 1.0 + g * np.linalg.norm(points[K] - points[Z])
        assert value == pytest.approx(exact, rel=1e-13)
        assert there == pytest.approx(s, abs=1e-6)


@given(waves())
def test_a_cone_known_at_one_end_is_continued_exactly(wave):
    points, _, g = wave
    frame = edge_frame(points, AXES, K, A, B)
    (h_a, _), gradients = _cone(points, g)
    slope = _along(points, gradients)[0]
    value, _ = minimum_from_source(
        points,
        AXES,
        frame,
        A,
        B,
        Z,
        1.0,
        h_a,
        math.inf,
        slope,
        0.0,
        True,
        g,
        0.0,
        (g, g, 0.0),
        True,
    )
    assert value == pytest.approx(1.0 + g * np.linalg.norm(points[K] - points[Z]), rel=1e-13)


@given(waves())
def test_sizes_below_the_cone_are_not_from_its_source(wave):
    points, _, g = wave
    frame = edge_frame(points, AXES, K, A, B)
    (h_a, h_b), _ = _cone(points, g)
    low = 1.0 + 0.9 * (h_a - 1.0)
    value, _ = minimum_from_source(
        points, AXES, frame, A, B, Z, 1.0, low, h_b, 0.0, 0.0, False, g, 0.0, (g, g, 0.0), True
    )
    assert value == math.inf


def _cubic_cost(points, g_nodes, h, slopes, s):
    """Return f(s) of the module's docstring with the cubic written in Hermite's basis."""
    w = (
        (1 + 2 * s) * (1 - s) ** 2 * h[0]
        + s * (1 - s) ** 2 * slopes[0]
        + s**2 * (3 - 2 * s) * h[1]
        + s**2 * (s - 1) * slopes[1]
    )
    foot = points[A] + np.multiply.outer(s, points[B] - points[A])
    g = 0.5 * (g_nodes[0] + (1 - s) * g_nodes[1] + s * g_nodes[2])
    return w + g * np.linalg.norm(points[K] - foot, axis=-1)


@given(waves((3.0, 10.0)), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
@settings(max_examples=40)
def test_cubic_update_is_the_least_over_the_edge(wave, more_k, more_b):
    # Away from the tip, and g varying by up to 20 per cent, f has one minimum; steps of
    # 1/4000 find it to f'' / 2 * (1/8000)^2 < 1e-6 g L.
    points, _, g = wave
    length2, foot, height2 = edge_frame(points, AXES, K, A, B)
    h, gradients = _cone(points, g)
    slopes = _along(points, gradients)
    edge = points[B] - points[A]
    normal = np.array([-edge[1], edge[0]]) * math.copysign(1.0, _cross(edge, points[K] - points[A]))
    leans = slopes / (gradients @ normal)
    g_nodes = g * np.array([1.0 + more_k, 1.0, 1.0 + more_b])
    c_a, c_rise = 0.5 * (g_nodes[0] + g_nodes[1]), 0.5 * (g_nodes[2] - g_nodes[1])
    value, s = minimum_on_cubic(
        length2, foot, height2, h[0], h[1] - h[0], *slopes, *leans, c_a, c_rise
    )
    shares = np.linspace(0.0, 1.0, 4001)
    least = _cubic_cost(points, g_nodes, h, slopes, shares).min()
    assert value <= least + 1e-12
    assert value >= least - 1e-6 * g * math.sqrt(length2)
    assert value == pytest.approx(_cubic_cost(points, g_nodes, h, slopes, s), rel=1e-13)


def _cross(u, v):
    return u[0] * v[1] - u[1] * v[0]


@given(waves())
def test_linear_update_of_a_plane_wave_is_exact(wave):
    points, s, g = wave
    ray = points[K] - points[Z]
    ray = ray / np.linalg.norm(ray)
    h_a, h_b = 5.0 + g * (points[[A, B]] - points[A]) @ ray
    frame = edge_frame(points, AXES, K, A, B)
    value, there = minimum_on_linear(*frame, h_a, h_b - h_a, g, 0.0)
    assert value == pytest.approx(5.0 + g * (points[K] - points[A]) @ ray, rel=1e-13)
    assert there == pytest.approx(s, abs=1e-9)


@given(waves(), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
@settings(max_examples=50)
def test_gradient_points_where_the_size_grows(wave, more_k, more_b):
    # The size at x is c(x) |x - y| for y on the edge and g linear in the triangle: its
    # gradient by central differences, which err by 1e-9 or less.
    points, s, g = wave
    g_nodes = g * np.array([1.0 + more_k, 1.0, 1.0 + more_b])
    corners = np.column_stack([points[[K, A, B]], np.ones(3)])
    field = np.linalg.solve(corners, g_nodes)
    y = points[A] + s * (points[B] - points[A])

    def size(x):
        at = field @ [*x, 1.0]
        return 0.5 * (at + field @ [*y, 1.0]) * np.linalg.norm(x - y)

    step = 1e-5
    numeric = np.array(
        [(size(points[K] + d) - size(points[K] - d)) / (2 * step) for d in step * np.eye(2)]
    )
    along, across = gradient_behind(edge_frame(points, AXES, K, A, B), s, *g_nodes)
    edge = (points[B] - points[A]) / np.linalg.norm(points[B] - points[A])
    normal = np.array([-edge[1], edge[0]]) * math.copysign(1.0, _cross(edge, points[K] - points[A]))
    found = along * edge + across * normal
    assert np.linalg.norm(found) == pytest.approx(g_nodes[0], rel=1e-12)
    assert found / g_nodes[0] == pytest.approx(numeric / np.linalg.norm(numeric), abs=1e-7)


def _headings(mesh):
    n = mesh.n_points
    star_ptr = np.empty(n + 1, np.int64)
    star = np.empty((mesh.cells.size, 2), np.int32)
    fill_stars(mesh.cells, star_ptr, star, np.empty(0, np.int32))
    heading = np.empty((mesh.cells.size, 2, 2))
    bends = np.empty(n, np.bool_)
    order = np.empty(int(np.diff(star_ptr).max()), np.int64)
    fill_headings(mesh.points, (0,) * mesh.dim, star_ptr, star, order, heading, bends)
    twin = np.empty((mesh.cells.size, 2), np.int32)
    fill_twins(mesh.cells, star_ptr, twin)
    return star_ptr, star, heading, bends, twin


def _lifted(mesh):
    """Return a flat mesh in the plane z = 0 of space."""
    return type(mesh)(np.column_stack([mesh.points, np.zeros(mesh.n_points)]), mesh.cells)


def test_headings_on_a_plane_are_its_directions():
    mesh = random_square(200, seed=631)
    star_ptr, star, heading, bends, _ = _headings(_lifted(mesh))
    assert not bends.any()
    for j in range(mesh.n_points):
        here = slice(star_ptr[j], star_ptr[j + 1])
        true = mesh.points[star[here]] - mesh.points[j]
        true = (true[..., 0] + 1j * true[..., 1]).ravel()
        laid = (heading[here, :, 0] + 1j * heading[here, :, 1]).ravel()
        turn = laid / (true / abs(true))
        if np.ptp(turn.imag) > 1e-9:  # laid out the other way around
            turn = laid.conj() / (true / abs(true))
        assert np.allclose(turn, turn[0], atol=1e-9)


def test_headings_on_a_sphere_fill_a_circle():
    mesh = random_sphere(200, seed=632)
    star_ptr, star, heading, bends, twin = _headings(mesh)
    assert not bends.any()
    for j in range(mesh.n_points):
        here = np.arange(star_ptr[j], star_ptr[j + 1])
        first, second = heading[here, 0], heading[here, 1]
        turned = np.arctan2(
            first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0],
            np.einsum("ij,ij->i", first, second),
        )
        assert abs(turned.sum()) == pytest.approx(2.0 * np.pi, rel=1e-9)
        for v in range(2):
            other = twin[here, v]
            assert (star[other, 1 - v] == j).all()
            assert (star[other, v] == star[here, 1 - v]).all()


def test_nodes_without_one_fan_have_no_headings():
    # Three triangles on one edge; two nodes of it have no plane of their own.
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]
    mesh = type(random_sphere(8, seed=633))(points, [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    star_ptr, _, heading, bends, _ = _headings(mesh)
    assert bends[:2].all()
    assert (heading[: star_ptr[2]] == 0.0).all()
    assert np.linalg.norm(heading[star_ptr[2] :], axis=2) == pytest.approx(1.0)
