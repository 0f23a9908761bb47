"""What limit_gradient refuses, what it survives, and how it is stopped."""

import re

import numpy as np
import pytest
from meshes import jittered_square

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient
from adaptsize.errors import ConvergenceWarning, InputWarning
from adaptsize.limiting import FastMarching, PositiveCoefficient

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
H0 = [0.1, np.inf, np.inf, np.inf]
MARCHING = ("fast-marching", "edge-based")
ALL = ("exact", *MARCHING, "positive-coefficient")


def message(expected):
    return pytest.raises(ValueError, match=re.escape(expected))


POSITIVE = "h0 must be positive (inf where there is no bound), got "
FREE = "h0 must be finite at one node at least, got inf at all of them"
AS_G = "g must be a number, an array per node (4,) or per cell (2,), or callable; got shape "
REFUSED = [
    ({"h0": [1.0, -1.0, 0.0, np.nan]}, POSITIVE + "h0[1] = -1.0 (and 2 more)"),
    ({"h0": [np.inf] * 4}, FREE),
    ({"g": 1e200}, "g must be at most 1e+30, got 1e+200"),
    ({"g": [0.1, 0.2, -0.3, 0.1]}, "g must be finite and >= 0, got g[2] = -0.3"),
    ({"g": [0.1, 0.2, 0.3]}, AS_G + "(3,)"),
    ({"g": (-1.0, lambda h: 0.1 * h)}, "g must be finite and >= 0, got -1"),
    ({"g": lambda h: 0.0 * h}, "g(h) must be positive and finite, got g(0.1"),
    (
        {"g": lambda h: np.where(h > 0.2, -1.0, 1.0)},
        "g(h) must be positive and finite, got g(0.2",
    ),
    ({"g": lambda h: h * np.nan}, "= nan"),
    ({"g": lambda h: h[1:]}, "g(h) must return one limit per size, shape"),
    (
        {"g": lambda h: h**2},
        "g(h) must be bounded: it grows so fast that the sizes overflow",
    ),
]


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize(("arguments", "expected"), REFUSED)
def test_refuses_bad_bounds_and_limits(arguments, expected, method):
    far = SimplexMesh(1000.0 * SQUARE.points, SQUARE.cells)
    given = {"h0": H0, "g": 0.3, **arguments}
    with message(expected):
        limit_gradient(far, given["h0"], given["g"], method=method)


def test_refuses_unknown_methods_and_lists_the_known():
    expected = "method must be one of 'auto', 'exact', "
    expected += (
        "'fast-marching', 'positive-coefficient', 'hamilton-jacobi', 'edge-based', got 'Exact'"
    )
    with message(expected):
        limit_gradient(SQUARE, H0, 0.3, method="Exact")


def test_the_exact_method_refuses_what_it_does_not_know():
    with message("method='exact' needs one number g or g(h), got g that varies in space"):
        limit_gradient(SQUARE, H0, [0.1, 0.2], method="exact")
    line = SimplexMesh([[0, 0], [1, 0], [1, 1]], [[0, 1], [1, 2]])
    with message("method='exact' needs a flat domain of full dimension or triangles, got"):
        limit_gradient(line, np.ones(3), 0.3, method="exact")


GRID = CartesianGrid([0.0, 0.0], 1.0, (2, 2))
OPTIONAL = {
    "initial": np.ones((2, 2)),
    "point_sources": ([[0.5, 0.5]], [0.1]),
    "periodic": [[1.0, 0.0]],
}
SCHEMES = {
    "auto": ("point_sources", "periodic"),
    "exact": ("point_sources", "periodic"),
    "fast-marching": ("periodic",),
    "edge-based": (),
    "positive-coefficient": ("initial",),
    "hamilton-jacobi": ("initial",),
}


@pytest.mark.parametrize("option", OPTIONAL)
@pytest.mark.parametrize("method", SCHEMES)
def test_each_scheme_takes_the_arguments_that_it_uses_and_refuses_the_others(method, option):
    background = SQUARE if method == "positive-coefficient" else GRID
    value = OPTIONAL[option]
    if option == "initial":
        value = value.reshape(background.nodal_shape)
    h0 = np.reshape(H0, background.nodal_shape)
    if option in SCHEMES[method]:
        limit_gradient(background, h0, 0.3, method=method, **{option: value})
        return
    own = "exact" if method == "auto" else method
    with pytest.raises(ValueError, match=f"^{option} is for method='.*, got method='{own}'$"):
        limit_gradient(background, h0, 0.3, method=method, **{option: value})


def test_a_scheme_on_a_background_that_it_does_not_support_says_what_it_needs():
    with message("method='fast-marching' needs a CartesianGrid with order=2, got SimplexMesh(4"):
        limit_gradient(SQUARE, H0, 0.3, method=FastMarching(order=2))
    with message("method='hamilton-jacobi' needs a CartesianGrid, got SimplexMesh(4 points"):
        limit_gradient(SQUARE, H0, 0.3, method="hamilton-jacobi")
    with message("method='positive-coefficient' needs a mesh, got CartesianGrid"):
        limit_gradient(GRID, np.ones((2, 2)), 0.3, method="positive-coefficient")


def test_stopping_at_max_iter_warns_and_is_in_the_info():
    mesh = jittered_square(11, seed=92)
    h0 = np.where(np.arange(mesh.n_points) == 60, 1.0, np.inf)
    with pytest.warns(ConvergenceWarning, match="stopped after max_iter = 1 steps") as caught:
        h, info = limit_gradient.with_info(
            mesh, h0, 0.3, method=PositiveCoefficient(floor=None, max_iter=1, tol=1e-12)
        )
    assert len(caught) == 1
    assert caught[0].filename == __file__  # the caller's line is the one shown
    assert not info.converged
    assert info.iterations == 1
    assert info.residual > 1e-12
    assert (h <= h0).all()
    assert h[60] == 1.0


def two_squares():
    """Two squares apart, of which the second one has no bound, and a node in no cell."""
    points = np.concatenate([SQUARE.points, np.add(SQUARE.points, [2.0, 0.0]), [[9.0, 9.0]]])
    mesh = SimplexMesh(points, np.concatenate([SQUARE.cells, SQUARE.cells + 4]))
    return mesh, [0.1, *[np.inf] * 8]


@pytest.mark.parametrize("method", ALL)
def test_components_without_a_bound_are_warned_of_once(method):
    mesh, h0 = two_squares()
    text = "h0 is inf at all nodes of a component of the domain: 4 of 9 nodes get the size inf"
    with pytest.warns(InputWarning) as record:
        h = limit_gradient(mesh, h0, 0.3, method=method)
    assert [str(found.message).split(";")[0] for found in record] == [text]
    assert record[0].filename == __file__
    assert np.isinf(h[4:]).all()
    limit_gradient(mesh, [0.1, np.inf, np.inf, np.inf, 1.0, *[np.inf] * 4], 0.3, method=method)


@pytest.mark.parametrize("method", ["exact", "fast-marching", "hamilton-jacobi"])
def test_components_of_a_grid_without_a_bound_are_counted(method):
    active = np.ones((8, 4), np.bool_)
    active[[2, 5]] = False
    h0 = np.full(active.shape, np.inf)
    h0[0, 0] = 0.1
    text = "2 components of the domain: 16 of 24 nodes get the size inf"
    with pytest.warns(InputWarning, match=text):
        limit_gradient(
            CartesianGrid([0.0, 0.0], 1.0, (8, 4), active=active), h0, 0.3, method=method
        )
