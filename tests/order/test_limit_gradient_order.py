"""Order of convergence of the schemes, with the tips of the cones taken out.

At a point source the rings of cells around it are never small compared with the
distance to it, which costs a factor log(1/a).  So exact data are given within a
fixed distance of the source; what is left must fall like the edge length a.
"""

import numpy as np
import pytest
from backgrounds import FAMILIES, cases
from meshes import jittered_square
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient

G = 0.3

# Schemes (with their orders, in `backgrounds.CASES`) and families of backgrounds.
PAIRS = [
    pytest.param(case, family, id=f"{case}, {name}")
    for name, family in FAMILIES.items()
    for case in cases(family.background, family.kind)
]


def _error_from_cone(background, distance, tip, far, limit):
    exact = 1.0 + G * distance
    h = limit(background, np.where(distance < tip, exact, np.inf), G)
    return np.abs(h - exact)[distance < far].mean()


@pytest.mark.parametrize(("case", "family"), PAIRS)
def test_order_away_from_the_source(case, family):
    errors = []
    for n_side in family.sizes:
        background = family.make(n_side)
        distance = family.distance(background.points).reshape(background.nodal_shape)
        limit = case.loose.limit  # the tolerance of the laws would take most of the time
        errors.append(_error_from_cone(background, distance, family.tip, family.far, limit))
    spacing = 1.0 / (np.array(family.sizes) - 1.0)
    order = np.polyfit(np.log(spacing), np.log(errors), 1)[0]
    text = f"errors {errors}, order {order:.2f}"
    assert order > case.convergence - 0.15, text
    if case.method == "exact":
        # Of the (tip/a)^2 nodes near the source one is off the ray by an angle like a^2 only, and
        # the way over it is longer by its square: order 4, with fewer nodes in space.
        return
    # The sources of the coarsest tetrahedra are few: 2.81 was seen where 2 is right.
    assert order < (1.35 if case.convergence == 1.0 else 1.5) * case.convergence, text


def test_smooth_g_of_x_is_met_to_first_order_by_marching():
    # g = 0.2 + 0.004 (x + 50): a plane wave from the left side, where the cell means are
    # exact; rays stay straight, h = 1 + integral of g.  From the other way the wave is the same.
    errors = []
    for n_side in (21, 41, 81):
        mesh = jittered_square(n_side, seed=56)
        s = mesh.points[:, 0] + 50.0
        h0 = np.where(s == 0.0, 1.0, np.inf)
        h = limit_gradient(mesh, h0, 0.2 + 0.004 * s, method="fast-marching")
        errors.append(np.abs(h - (1.0 + 0.2 * s + 0.002 * s**2)).max())
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (order > 0.8).all(), f"errors {errors}, orders {order}"


def test_slivers_stretched_10_to_1_are_solved_to_rounding():
    # Here marching alone would take each node back hundreds of times.
    rng = np.random.default_rng(57)
    points = rng.uniform(-50.0, 50.0, (3000, 2))
    mesh = SimplexMesh(points, Delaunay(points * [10.0, 1.0]).simplices)
    h0 = np.where(np.linalg.norm(points, axis=1) < 10.0, 1.0, np.inf)
    _, info = limit_gradient.with_info(mesh, h0, G, method="fast-marching")
    assert info.iterations > 8 * mesh.n_points  # policy iteration has taken over
    assert info.residual < 1e-13
    assert info.largest_edge_slope <= 1.0 + 1e-11
