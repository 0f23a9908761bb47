"""What limit_gradient refuses, what it survives, and how it is stopped."""

import re

import numpy as np
import pytest
from meshes import jittered_square, random_sphere

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient
from adaptsize.errors import ConvergenceWarning

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
H0 = [0.1, np.inf, np.inf, np.inf]
MARCHING = ("fast-marching", "edge-based")
ALL = ("exact", *MARCHING, "positive-coefficient")


def message(expected):
    return pytest.raises(ValueError, match=re.escape(expected))


SIZES = {
    "nan": (
        [1.0, np.nan, 1.0, 1.0],
        "h0 must be positive (inf where there is no bound), got h0[1] = nan",
    ),
    "zero": ([1.0, 1.0, 0.0, 1.0], "got h0[2] = 0.0"),
    "negative": ([1.0, 1.0, 1.0, -2.0], "got h0[3] = -2.0"),
    "minus inf": ([-np.inf, 1.0, 1.0, 1.0], "got h0[0] = -inf"),
    "several": ([1.0, -1.0, 0.0, np.nan], "got h0[1] = -1.0 (and 2 more)"),
    "inf throughout": (
        [np.inf] * 4,
        "h0 must be finite at one node at least, got inf at all of them",
    ),
    "too short": ([1.0], "h0 must have shape (4,), got (1,)"),
    "a number below zero": (-1.0, "h0 must be positive (inf where there is no bound), got -1.0"),
    "infinity": (np.inf, "h0 must be finite at one node at least, got inf at all of them"),
    "a column": (np.ones((4, 1)), "h0 must have shape (4,), got (4, 1)"),
    "words": (["a"] * 4, "h0 must be an array of numbers, got ['a', 'a', 'a', 'a']"),
}


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("case", SIZES)
def test_refuses_bad_sizes(case, method):
    h0, expected = SIZES[case]
    with message(expected):
        limit_gradient(SQUARE, h0, 0.3, method=method)


LIMITS = {
    "negative": (-0.1, "g must be finite and >= 0, got -0.1"),
    "nan": (np.nan, "g must be finite and >= 0, got nan"),
    "inf": (np.inf, "g must be finite and >= 0, got inf"),
    "beyond squares": (1e200, "g must be at most 1e+30, got 1e+200"),
    "node": ([0.1, 0.2, -0.3, 0.1], "g must be finite and >= 0, got g[2] = -0.3"),
    "cell": ([0.1, np.nan], "g must be finite and >= 0, got g[1] = nan"),
    "length": (
        [0.1, 0.2, 0.3],
        "g must be a number, an array per node (4,) or per cell (2,), or callable; got shape (3,)",
    ),
    "shape": (np.full((4, 2), 0.1), "got shape (4, 2)"),
    "word": ("steep", "g must be an array of numbers, got 'steep'"),
    "a of a product": ((-1.0, lambda h: 0.1 * h), "g must be finite and >= 0, got -1.0"),
}


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("case", LIMITS)
def test_refuses_bad_limits(case, method):
    g, expected = LIMITS[case]
    with message(expected):
        limit_gradient(SQUARE, H0, g, method=method)


LIMITS_OF_SIZE = {
    "zero": (lambda h: 0.0 * h, "g(h) must be positive and finite, got g(0.1"),
    "negative somewhere": (
        lambda h: np.where(h > 0.2, -1.0, 1.0),
        "g(h) must be positive and finite, got g(0.2",
    ),
    "nan": (lambda h: h * np.nan, "= nan"),
    "inf": (lambda h: h * np.inf, "= inf"),
    "too few": (lambda h: h[1:], "g(h) must return one limit per size, shape"),
    "grows too fast": (
        lambda h: h**2,
        "g(h) must be bounded: it grows so fast that the sizes overflow",
    ),
}


@pytest.mark.parametrize("case", LIMITS_OF_SIZE)
def test_refuses_bad_functions_of_the_size(case):
    g, expected = LIMITS_OF_SIZE[case]
    far = SimplexMesh(1000.0 * SQUARE.points, SQUARE.cells)
    with message(expected):
        limit_gradient(far, H0, g)


def test_what_g_of_h_raises_comes_through():
    def g(h):
        raise ArithmeticError("of the caller")

    with pytest.raises(ArithmeticError, match="of the caller"):
        limit_gradient(SQUARE, H0, g)


@pytest.mark.parametrize("method", ["fastmarching", "", "Exact"])
def test_refuses_unknown_methods_and_lists_the_known(method):
    expected = "method must be one of 'auto', 'exact', "
    expected += f"'fast-marching', 'positive-coefficient', 'edge-based', got {method!r}"
    with message(expected):
        limit_gradient(SQUARE, H0, 0.3, method=method)


@pytest.mark.parametrize("background", [None, np.zeros((4, 2)), "mesh"])
def test_refuses_what_is_no_mesh(background):
    with message("background must be a SimplexMesh, a CartesianGrid or an Octree, got "):
        limit_gradient(background, H0, 0.3)


def test_the_exact_method_refuses_what_it_does_not_know():
    with message("method='exact' needs one number g or g(h), got g that varies in space"):
        limit_gradient(SQUARE, H0, [0.1, 0.2], method="exact")
    with message("method='exact' needs a flat domain of full dimension, got SimplexMesh(20 points"):
        limit_gradient(random_sphere(20, 91), np.ones(20), 0.3, method="exact")


IDLE = {
    "order": 2,
    "floor": None,
    "initial": np.ones((2, 2)),
    "tol": 1e-2,
    "max_iter": 7,
    "face_sources": False,
    "threads": 1,
    "point_sources": ([[0.5, 0.5]], [0.1]),
}
GRID = CartesianGrid([0.0, 0.0], 1.0, (2, 2))
EXACT_TAKES = ("face_sources", "threads", "point_sources")
TAKES = {
    "mesh": {
        "auto": EXACT_TAKES,
        "exact": EXACT_TAKES,
        "fast-marching": (),
        "edge-based": (),
        "positive-coefficient": ("floor", "initial", "tol", "max_iter"),
    },
    "grid": {
        "auto": (*EXACT_TAKES, "order"),
        "exact": EXACT_TAKES,
        "fast-marching": ("order",),
        "edge-based": (),
        "hamilton-jacobi": ("order", "initial", "tol", "max_iter"),
    },
}


@pytest.mark.parametrize("option", IDLE)
@pytest.mark.parametrize(
    ("kind", "method"), [(kind, method) for kind in TAKES for method in TAKES[kind]]
)
def test_each_method_takes_the_options_that_it_uses_and_refuses_the_others(kind, method, option):
    background = SQUARE if kind == "mesh" else GRID
    value = IDLE[option]
    if option == "initial":
        value = value.reshape(background.nodal_shape)
    h0 = np.reshape(H0, background.nodal_shape)
    if option in TAKES[kind][method]:
        limit_gradient(background, h0, 0.3, method=method, **{option: value})
        return
    with pytest.raises(ValueError, match=f"^{option} is for method='.*, got method='{method}'$"):
        limit_gradient(background, h0, 0.3, method=method, **{option: value})


@pytest.mark.parametrize("method", ALL)
def test_defaults_are_accepted_by_every_method(method):
    limit_gradient(
        SQUARE,
        H0,
        0.3,
        method=method,
        order=1,
        floor="hopf-lax",
        initial=None,
        tol=1e-3,
        max_iter=None,
        face_sources=True,
        threads=None,
        point_sources=None,
    )


def test_an_option_of_no_method_on_a_background_names_the_other_background():
    with message(
        "order is for method='fast-marching' or 'hamilton-jacobi' on a CartesianGrid, "
        "got method='fast-marching'"
    ):
        limit_gradient(SQUARE, H0, 0.3, method="fast-marching", order=2)
    with message(
        "floor is for method='positive-coefficient' on a SimplexMesh, got method='hamilton-jacobi'"
    ):
        limit_gradient(GRID, np.ones((2, 2)), 0.3, method="hamilton-jacobi", floor=None)


OPTIONS = {
    "floor": ({"floor": "none"}, "floor must be 'hopf-lax' or None, got 'none'"),
    "tol zero": ({"tol": 0.0}, "tol must be finite and > 0, got 0"),
    "tol nan": ({"tol": np.nan}, "tol must be finite and > 0, got nan"),
    "tol word": ({"tol": "small"}, "tol must be a number, got 'small'"),
    "no step": ({"max_iter": 0}, "max_iter must be finite and >= 1, got 0"),
    "half a step": ({"max_iter": 1.5}, "max_iter must be a whole number, got 1.5"),
    "start shape": ({"initial": np.ones(3)}, "initial must have shape (4,), got (3,)"),
    "start nan": ({"initial": [1.0, np.nan, 1.0, 1.0]}, "got initial[1] = nan"),
    "start zero": ({"initial": [1.0, 1.0, 0.0, 1.0]}, "got initial[2] = 0.0"),
    "start inf": (
        {"initial": [1.0, np.inf, 1.0, 1.0]},
        "initial must be finite in every component",
    ),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_the_iteration_refuses_bad_options(case):
    options, expected = OPTIONS[case]
    with message(expected):
        limit_gradient(SQUARE, H0, 0.3, method="positive-coefficient", **options)


def test_stopping_at_max_iter_warns_and_is_in_the_info():
    mesh = jittered_square(11, seed=92)
    h0 = np.where(np.arange(mesh.n_points) == 60, 1.0, np.inf)
    with pytest.warns(ConvergenceWarning, match="stopped after max_iter = 1 steps") as caught:
        h, info = limit_gradient.with_info(
            mesh,
            h0,
            0.3,
            method="positive-coefficient",
            floor=None,
            max_iter=1,
            tol=1e-12,
        )
    assert len(caught) == 1
    assert caught[0].filename == __file__  # the caller's line is the one shown
    assert not info.converged
    assert info.iterations == 1
    assert info.residual > 1e-12
    assert (h <= h0).all()
    assert h[60] == 1.0


@pytest.mark.parametrize("name", ["threads", "max_iter"])
def test_a_long_argument_gives_a_short_message(name):
    with pytest.raises(ValueError, match=f"{name} must be") as caught:
        limit_gradient(SQUARE, H0, 0.3, **{name: "x" * 5000})
    assert len(str(caught.value)) < 200


def test_point_sources_may_be_a_list_of_two_arrays():
    pair = IDLE["point_sources"]
    expected = limit_gradient(SQUARE, H0, 0.3, point_sources=pair)
    assert np.array_equal(limit_gradient(SQUARE, H0, 0.3, point_sources=list(pair)), expected)
    with message("point_sources must be a pair (points, sizes)"):
        limit_gradient(SQUARE, H0, 0.3, point_sources=pair[0])
