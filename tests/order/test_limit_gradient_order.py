"""Order of convergence of the schemes, with the tips of the cones taken out.

At a point source the rings of cells around it are never small compared with the
distance to it, which costs a factor log(1/a).  So exact data are given within a
fixed distance of the source; what is left must fall like the edge length a.
"""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient
from meshes import jittered_cube, jittered_square, random_sphere, random_square, structured_square

G = 0.3
# Add a scheme here with its order.
ORDERS = {"fast-marching": 1.0, "positive-coefficient": 1.0}


def _error_from_cone(mesh, distance, tip, method):
    exact = 1.0 + G * distance
    h = limit_gradient(mesh, np.where(distance < tip, exact, np.inf), G, method=method)
    return np.abs(h - exact).mean()


def _flat(mesh, method):
    distance = np.linalg.norm(mesh.points - 0.1, axis=1)
    return _error_from_cone(mesh, distance, 0.2 * np.abs(mesh.points).max(), method)


def _plane(n_side, method):
    return _flat(jittered_square(n_side, seed=51), method)


def _random_plane(n_side, method):
    return _flat(random_square(n_side**2, seed=52, half_width=50.0), method)


def _stretched(n_side, method):
    # Random points meshed in a strip and stretched 3:1: obtuse slivers everywhere.
    rng = np.random.default_rng(53)
    points = rng.uniform(-50.0, 50.0, (n_side**2, 2))
    cells = Delaunay(points * [3.0, 1.0]).simplices
    return _flat(SimplexMesh(points, cells), method)


def _volume(n_side, method):
    return _flat(jittered_cube(n_side, seed=54), method)


def _sphere(n_side, method):
    mesh = random_sphere(n_side**2, seed=55)
    angle = np.arccos(np.clip(mesh.points[:, 2], -1.0, 1.0))
    near = angle < 3.0  # the antipode, where all fronts meet, is another singular point
    exact = 1.0 + G * angle
    h = limit_gradient(mesh, np.where(angle < 0.5, exact, np.inf), G, method=method)
    return np.abs(h - exact)[near].mean()


CASES = {
    "plane": (_plane, (41, 81, 161)),
    "random plane": (_random_plane, (41, 81, 161)),
    "stretched plane": (_stretched, (41, 81, 161)),
    "sphere": (_sphere, (41, 81, 161)),
    "volume": (_volume, (11, 21, 41)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", ORDERS)
def test_order_away_from_the_source(case, method):
    error_of, sizes = CASES[case]
    errors = [error_of(n_side, method) for n_side in sizes]
    spacing = 1.0 / (np.array(sizes) - 1.0)
    order = np.polyfit(np.log(spacing), np.log(errors), 1)[0]
    told = f"errors {errors}, order {order:.2f}"
    assert order > ORDERS[method] - 0.15, told
    assert order < ORDERS[method] + 0.35, told


def test_edges_do_not_converge():
    # Structured meshes of any fineness: paths along the axes and one diagonal only.
    errors = []
    for n in (20, 40, 80):
        mesh = structured_square(n)
        distance = np.linalg.norm(mesh.points, axis=1)
        errors.append(_error_from_cone(mesh, distance, 10.0, "edge-based"))
    assert errors[-1] > 0.9 * errors[-2], errors
    assert errors[-1] > 1.0


def test_slivers_stretched_10_to_1_are_solved_to_rounding():
    # Here marching alone would take each node back hundreds of times.
    rng = np.random.default_rng(57)
    points = rng.uniform(-50.0, 50.0, (6000, 2))
    mesh = SimplexMesh(points, Delaunay(points * [10.0, 1.0]).simplices)
    h0 = np.where(np.linalg.norm(points, axis=1) < 10.0, 1.0, np.inf)
    _, info = limit_gradient(mesh, h0, G, full_output=True)
    assert info.iterations > 8 * mesh.n_points  # policy iteration has taken over
    assert info.residual < 1e-13
    assert info.largest_edge_slope <= 1.0 + 1e-11


def test_smooth_g_of_x_is_met_to_first_order():
    # g = 0.2 + 0.004 (x + 50): a plane wave from the left side, where the cell means are
    # exact; rays stay straight, h = 1 + integral of g.  From the other way the wave is the same.
    errors = []
    for n_side in (21, 41, 81):
        mesh = jittered_square(n_side, seed=56)
        s = mesh.points[:, 0] + 50.0
        h = limit_gradient(mesh, np.where(s == 0.0, 1.0, np.inf), 0.2 + 0.004 * s)
        errors.append(np.abs(h - (1.0 + 0.2 * s + 0.002 * s**2)).max())
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (order > 0.8).all(), f"errors {errors}, orders {order}"
