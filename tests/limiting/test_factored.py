"""Factored fast marching: exact for constant g, second order for smooth g."""

import numpy as np
import pytest
from meshes import jittered_square, random_sphere, random_square
from scipy.spatial import Delaunay
from test_hermite import G, solve

from adaptsize import SimplexMesh

SOURCES = np.array([[-10.0, 0.0], [10.0, 0.0]])
SIZES = np.array([1.0, 5.0])

# The gradient of 1/g, with which rays are arcs of circles.
ALPHA = np.array([0.023, 0.023])


def _with_sources(mesh):
    """Move the nearest nodes to SOURCES; return the mesh and h0."""
    points = mesh.points.copy()
    nodes = [int(np.argmin(np.linalg.norm(points - place, axis=1))) for place in SOURCES]
    points[nodes] = SOURCES
    h0 = np.full(len(points), np.inf)
    h0[nodes] = SIZES
    return SimplexMesh(points, Delaunay(points).simplices), h0


def _limits(points):
    """Return 1 / (3.58 + ALPHA . x): 0.17 to 0.78 on the square (-50, 50)^2."""
    return 1.0 / (3.58 + points @ ALPHA)


def _exact(points):
    """Return the limited sizes for that g: arccosh formula for a slowness with linear inverse."""
    a2 = ALPHA @ ALPHA
    away2 = ((points[:, None] - SOURCES) ** 2).sum(axis=2)
    product = _limits(points)[:, None] * _limits(SOURCES)
    return (SIZES + np.arccosh(1.0 + 0.5 * a2 * away2 * product) / np.sqrt(a2)).min(axis=1)


@pytest.mark.parametrize(
    "mesh",
    [jittered_square(61, seed=661), random_square(3000, seed=662, half_width=50.0)],
    ids=["jittered", "random"],
)
def test_constant_g_is_exact_in_a_convex_domain(mesh):
    mesh, h0 = _with_sources(mesh)
    away = np.linalg.norm(mesh.points[:, None] - SOURCES, axis=2)
    exact = (SIZES + G * away).min(axis=1)
    assert solve(mesh, h0, method="factored").h == pytest.approx(exact, abs=1e-11)


def test_smooth_g_is_met_to_second_order():
    # Measured on such meshes of 2.6k, 10k, 40k, 160k nodes: mean errors 7.5e-4, 2.0e-4, 4.7e-5,
    # 1.2e-5, at most .0064, .0020, .0005, .0002; fast marching: .17, .12, .07, .04.
    means, largest = [], []
    for n_side in (26, 51, 101):
        mesh, h0 = _with_sources(jittered_square(n_side, seed=663))
        error = np.abs(
            solve(mesh, h0, _limits(mesh.points), method="factored").h - _exact(mesh.points)
        )
        means.append(error.mean())
        largest.append(error.max())
    order = np.log2(np.divide(means[:-1], means[1:]))
    assert (order > 1.6).all(), f"errors {means}, orders {order}"
    assert means[-1] < 5e-4
    assert largest[-1] < 0.01


def test_is_more_accurate_than_gradients_alone():
    mesh, h0 = _with_sources(jittered_square(51, seed=664))
    g = _limits(mesh.points)
    errors = {
        method: np.abs(solve(mesh, h0, g, method=method).h - _exact(mesh.points)).mean()
        for method in ("hermite", "factored")
    }
    assert errors["factored"] < 0.6 * errors["hermite"], errors


def test_sizes_of_sources_side_by_side_are_data_along_their_line():
    # Sizes 3 + 0.1 y on the left side of the square, of slope 0.1 < g: rays leave at the angle
    # with sine 1/3, and above the lowest of them the limit is linear, with slope g.  What lies
    # below, a fan from the corner, is met less well and tells on nodes close to that ray.
    mesh = jittered_square(41, seed=665)
    x, y = mesh.points[:, 0] + 50.0, mesh.points[:, 1] + 50.0
    h = solve(mesh, np.where(x == 0.0, 3.0 + 0.1 * y, np.inf), method="factored").h
    plane = 3.0 + 0.1 * y + np.sqrt(G**2 - 0.1**2) * x
    above = y > x / np.sqrt(8.0) + 5.0
    assert above.sum() > 500
    error = np.abs(h - plane)[above]
    assert np.median(error) < 1e-9
    assert error.max() < 0.01


def test_where_it_does_not_apply_is_told():
    flat = jittered_square(5, seed=666)
    with pytest.raises(ValueError, match="one per cell"):
        solve(flat, np.ones(flat.n_points), np.full(flat.n_cells, G), method="factored")
    sphere = random_sphere(20, seed=667)
    with pytest.raises(ValueError, match="triangles in the plane"):
        solve(sphere, np.ones(20), method="factored")
