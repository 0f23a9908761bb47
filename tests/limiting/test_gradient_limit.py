"""g as a user gives it: arrays into cells, and g(h) into a change of variable."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting.gradient_limit import SizeTransform, factors_of, in_space

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
BOUND = np.array([0.5, 2.0, np.inf, 1.0])

LIMITS = {
    "constant": lambda h: np.full_like(h, 0.3),
    "linear": lambda h: 0.2 * h,
    "step-like": lambda h: 0.4 - 0.2 * np.tanh((h - 6.0) / 2.0),
    "rational": lambda h: 0.1 + 1.0 / (1.0 + h**2),
}


@pytest.mark.parametrize("name", LIMITS)
@given(seed=st.integers(0, 2**32 - 1))
def test_there_and_back_loses_rounding_only(name, seed):
    transform = SizeTransform(LIMITS[name], 0.01, 50.0)
    h = np.exp(np.random.default_rng(seed).uniform(np.log(0.01), np.log(50.0), 50))
    phi = transform.forward(h)
    # phi rounds by eps times its largest value, which g turns into sizes.
    step = 4.0 * np.finfo(float).eps * phi.max() * LIMITS[name](h)
    assert (np.abs(transform.backward(phi) - h) <= step + 4e-15 * h).all()


@pytest.mark.parametrize("name", LIMITS)
def test_phi_is_the_integral_of_one_over_g(name):
    g = LIMITS[name]
    transform = SizeTransform(g, 0.01, 50.0)
    for upper in (0.011, 0.3, 5.0, 6.5, 50.0):
        exact = quad(
            lambda h: 1.0 / float(g(np.array([h]))[0]), 0.01, upper, epsabs=0, epsrel=1e-11
        )
        # Linear interpolation over steps of h / 8192: 2e-9 of h dPhi/dh at most.
        bound = 1e-10 * exact[0] + 4e-9 * upper / float(g(np.array([upper]))[0])
        assert abs(float(transform.forward(np.array([upper]))[0]) - exact[0]) <= bound


@pytest.mark.parametrize(
    ("g", "values"),
    [
        (0.3, [0.3]),
        ([0.1, 0.2, 0.6, 0.8], [0.3, 0.5]),  # of nodes: the means in cells
        ([0.1, 0.7], [0.1, 0.7]),
        ((0.1, 0.7), [0.1, 0.7]),  # a pair of numbers is no product
        ([1e-200, 1e-31], [0.0, 0.0]),  # too small to square
    ],
)
def test_numbers_give_a_slope_for_all_cells_or_one_for_each(g, values):
    of_place, of_size = factors_of(g)
    slope = in_space(SQUARE, of_place)
    assert_allclose(slope.values, values, rtol=1e-15)
    assert slope.varies == (len(values) > 1)
    assert of_size is None


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("is_closed", [True, False])
def test_an_array_is_of_the_nodes_of_closed_polylines_and_may_be_of_the_cells_of_others(
    dim, is_closed
):
    n, rng = 9, np.random.default_rng(2731)
    points, first = rng.random((n, dim)), np.arange(n if is_closed else n - 1)
    mesh = SimplexMesh(points, np.column_stack([first, (first + 1) % n]))
    h0, g = np.full(n, np.inf), rng.uniform(0.1, 1.0, mesh.n_cells)
    h0[3] = 0.2
    in_cells = 0.5 * (g + np.roll(g, -1)) if is_closed else g
    rise = in_cells * np.linalg.norm(points[mesh.cells[:, 1]] - points[mesh.cells[:, 0]], axis=1)
    forth = [rise[np.arange(3, 3 + (i - 3) % n) % n].sum() if is_closed or i >= 3 else np.inf
             for i in range(n)]  # fmt: skip
    back = [rise[np.arange(i, i + (3 - i) % n) % n].sum() if is_closed or i <= 3 else np.inf
            for i in range(n)]  # fmt: skip
    for method in ("auto", "edge-based", "positive-coefficient"):
        h = limit_gradient(mesh, h0, g, method=method)
        assert_allclose(h, 0.2 + np.minimum(forth, back), rtol=1e-12)


def test_functions_and_products_give_slope_and_transform():
    of_place, of_size = factors_of(lambda h: 0.5 * h)
    assert of_place == 1.0
    transform = SizeTransform(of_size, 0.5, 2.0)
    # The table starts at the least size.
    assert_allclose(
        transform.forward(BOUND), [0.0, np.log(4) / 0.5, np.inf, np.log(2) / 0.5], rtol=1e-8
    )
    of_place, of_size = factors_of(([0.1, 0.7], lambda h: 0.5 * h))
    assert of_place == [0.1, 0.7]
    assert of_size(3.0) == 1.5
