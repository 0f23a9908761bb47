"""What limit_gradient refuses, what it survives, and how it is stopped."""

import re
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest
from meshes import jittered_square, random_sphere, random_square
from numpy.testing import assert_allclose, assert_array_equal

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
    "no step": ({"max_iter": 0}, "max_iter must be an integer >= 1 or None, got 0"),
    "half a step": ({"max_iter": 1.5}, "max_iter must be an integer >= 1 or None, got 1.5"),
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
        h, info = limit_gradient(
            mesh,
            h0,
            0.3,
            method="positive-coefficient",
            floor=None,
            max_iter=1,
            tol=1e-12,
            full_output=True,
        )
    assert len(caught) == 1
    assert caught[0].filename == __file__  # the caller's line is the one shown
    assert not info.converged
    assert info.iterations == 1
    assert info.residual > 1e-12
    assert (h <= h0).all()
    assert h[60] == 1.0


# Progress and interruption.


def _long_problem():
    mesh = jittered_square(250, seed=93)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 0.1
    return mesh, h0


def test_progress_is_reported_and_ends_at_one():
    reports = []
    limit_gradient(
        *_long_problem(), 0.3, progress=lambda text, share: reports.append((text, share))
    )
    shares = [share for _, share in reports]
    assert len(reports) >= 2
    assert {text for text, _ in reports} == {"limiting the gradient"}
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] == 1.0


@pytest.mark.parametrize("method", MARCHING)
def test_an_exception_of_the_callback_stops_the_work(method):
    calls = []

    def stop(text, share):
        calls.append(text)
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        limit_gradient(*_long_problem(), 0.3, method=method, progress=stop)
    assert len(calls) == 1


INTERRUPTED = """
import numpy as np
from meshes import jittered_square
from adaptsize import limit_gradient

mesh = jittered_square(30, seed=94)
h0 = np.full(mesh.n_points, np.inf)
h0[0] = 0.1
limit_gradient(mesh, h0, 0.3, method="positive-coefficient", floor=None)
try:
    print("ready", flush=True)  # the signal may come from here on
    for _ in range(100_000):
        limit_gradient(mesh, h0, 0.3, method="positive-coefficient", floor=None, tol=1e-30)
except KeyboardInterrupt:
    h = limit_gradient(mesh, h0, 0.3)
    print("alive", h.shape[0], flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT cannot be sent to one process there")
def test_ctrl_c_stops_a_long_run_and_python_lives_on():
    from pathlib import Path

    child = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", INTERRUPTED],
        cwd=Path(__file__).parents[1] / "support",
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline() == "ready\n"
        child.send_signal(signal.SIGINT)
        out, _ = child.communicate(timeout=60)
    finally:
        child.kill()
    assert out == "alive 900\n"
    assert child.returncode == 0


# Meshes at the edge of what is allowed.


def test_nodes_of_no_cell_keep_their_bound():
    points = np.vstack([SQUARE.points, [[0.5, 0.5], [0.0, 0.0]]])
    mesh = SimplexMesh(points, SQUARE.cells)
    for method in ALL:
        h = limit_gradient(mesh, [0.1, 9.0, 9.0, 9.0, 7.0, np.inf], 0.3, method=method)
        assert h[4:].tolist() == [7.0, np.inf]
        assert_allclose(h[1], 0.4, rtol=1e-15)


def test_components_do_not_see_each_other():
    mesh = SimplexMesh(
        np.concatenate([SQUARE.points, SQUARE.points + 5.0]),
        np.concatenate([SQUARE.cells, SQUARE.cells + 4]),
    )
    for method in ALL:
        h = limit_gradient(mesh, [*H0, np.inf, np.inf, np.inf, np.inf], 0.3, method=method)
        assert np.isfinite(h[:4]).all()
        assert np.isinf(h[4:]).all()
        h = limit_gradient(mesh, [*H0, 2.0, np.inf, np.inf, 2.0], 0.3, method=method)
        assert_allclose(h[:4], limit_gradient(SQUARE, H0, 0.3, method=method), rtol=1e-14)
        assert h[4:].min() == 2.0


@pytest.mark.parametrize("method", ["exact", *MARCHING, "positive-coefficient"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_single_cell_is_a_mesh(dim, method):
    mesh = SimplexMesh(np.vstack([np.zeros(dim), np.eye(dim)]), [range(dim + 1)])
    h0 = np.full(dim + 1, np.inf)
    h0[0] = 0.1
    expected = np.full(dim + 1, 0.4)
    expected[0] = 0.1
    assert_allclose(limit_gradient(mesh, h0, 0.3, method=method), expected, rtol=1e-15)


@pytest.mark.parametrize("method", ALL)
def test_sizes_pass_through_cells_of_no_volume(method):
    # A chain: a flat triangle on a line, then one with two coinciding corners.
    points = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0], [3.0, 0.0]]
    mesh = SimplexMesh(points, [[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    h = limit_gradient(mesh, [0.5, np.inf, np.inf, np.inf, np.inf], 0.5, method=method)
    assert_allclose(h, [0.5, 1.0, 1.5, 1.5, 2.0], rtol=1e-15)


@pytest.mark.parametrize("method", ["exact", *MARCHING, "positive-coefficient"])
@pytest.mark.parametrize("dim", [2, 3])
def test_all_nodes_in_one_point_take_the_least_size(method, dim):
    mesh = SimplexMesh(np.ones((5, dim)), [range(dim + 1), range(4 - dim, 5)])
    h0 = [3.0, 2.0, np.inf, 4.0, np.inf]
    assert limit_gradient(mesh, h0, 0.3, method=method).tolist() == [2.0] * 5


@pytest.mark.parametrize("exponent", [-59, -20, 20, 59])
@pytest.mark.parametrize("method", ALL)
def test_any_sensible_unit_of_length_gives_the_same_sizes(exponent, method):
    # A power of two scales without rounding; 2^(59 log2(10)) is about 1e59.
    scale = 2.0 ** np.floor(exponent * np.log2(10.0))
    mesh = random_square(60, 95)
    h0 = np.where(np.arange(60) % 9 == 0, 0.05, np.inf)
    h = limit_gradient(mesh, h0, 0.3, method=method)
    scaled = SimplexMesh(scale * mesh.points, mesh.cells)
    assert_allclose(limit_gradient(scaled, scale * h0, 0.3, method=method), scale * h, rtol=1e-13)


@pytest.mark.parametrize("scale", [1e-62, 1e62, 1e200])
def test_lengths_whose_powers_leave_the_range_are_refused(scale):
    mesh = SimplexMesh(scale * SQUARE.points, SQUARE.cells)
    with message(f"background must have coordinates of 1e-60 to 1e+60 in size, got {scale:g}"):
        limit_gradient(mesh, H0, 0.3)


@pytest.mark.parametrize("gap", [1e-90, 1e-200, 5e-324])
@pytest.mark.parametrize("method", ["auto", "fast-marching"])
def test_nodes_whose_distance_squares_to_zero_share_their_size(gap, method):
    # Regression: the fourth power of the gap underflowed, and was divided by.
    points = [[0.0, 0.0], [gap, 0.0], [1.0, 0.0], [0.0, 1.0]]
    mesh = SimplexMesh(points, [[0, 1, 2], [0, 1, 3], [1, 2, 3]])
    h = limit_gradient(mesh, [0.1, 0.1, np.inf, np.inf], 0.3, method=method)
    assert_allclose(h, [0.1, 0.1, 0.4, 0.4], rtol=1e-15)
    points = np.column_stack([points, np.zeros(4)])
    points = np.vstack([points, [0.0, 0.0, 1.0]])
    mesh = SimplexMesh(points, [[0, 1, 2, 4], [0, 1, 3, 4]])
    h = limit_gradient(mesh, [0.1, 0.1, np.inf, np.inf, np.inf], 0.3, method=method)
    assert_allclose(h, [0.1, 0.1, 0.4, 0.4, 0.4], rtol=1e-15)


@pytest.mark.parametrize("g", [1e-300, 1e-100, 1e-29, 1e29])
@pytest.mark.parametrize("method", ALL)
def test_extreme_limits_reach_every_node(method, g):
    mesh = random_square(200, 96)
    h0 = np.where(np.arange(200) == 17, 0.1, np.inf)
    h = limit_gradient(mesh, h0, g, method=method)
    i, j = mesh.edges.T
    assert np.isfinite(h).all()
    assert (np.abs(h[i] - h[j]) <= g * mesh.edge_lengths * (1 + 1e-12) + 1e-15).all()
    assert h.max() >= 0.1


@pytest.mark.parametrize("method", ["auto", "fast-marching"])
def test_sizes_over_forty_decades_stay_within_the_limit(method):
    mesh = random_square(300, 97)
    h0 = 10.0 ** np.random.default_rng(98).uniform(-20, 20, 300)
    h = limit_gradient(mesh, h0, 0.3, method=method)
    i, j = mesh.edges.T
    assert (np.abs(h[i] - h[j]) <= 0.3 * mesh.edge_lengths * (1 + 1e-12) + 1e-15).all()
    assert h.min() == h0.min()


def test_cells_without_a_limit_beside_others_give_no_warning():
    # Slopes over g are inf where g is 0 and sizes around a sliver differ by rounding.
    mesh = random_square(300, 99)
    rng = np.random.default_rng(100)
    g = np.where(rng.random(mesh.n_cells) < 0.3, 0.0, 0.3)
    h0 = rng.uniform(0.01, 1.0, 300)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, info = limit_gradient(mesh, h0, g, full_output=True)
    assert not np.isnan(list(info.cell_gradient_quantiles.values())).any()


@pytest.mark.parametrize("method", ALL)
def test_equal_bounds_under_a_limit_of_the_size_leave_no_residual(method):
    # Regression: the transformed sizes are all 0, and the residual was divided by the largest.
    h, info = limit_gradient(
        SQUARE, np.full(4, 0.1), lambda h: 0.2 + h, method=method, full_output=True
    )
    assert h.tolist() == [0.1] * 4
    assert info.residual == 0.0


@pytest.mark.parametrize("method", ["exact", "fast-marching", "hamilton-jacobi", "edge-based"])
def test_equal_bounds_on_grids_under_a_limit_of_the_size_leave_no_residual(method):
    grid = CartesianGrid([0.0, 0.0], 0.5, (4, 3))
    h0 = np.full(grid.shape, 0.1)
    h, info = limit_gradient(grid, h0, lambda h: 0.2 + h, method=method, full_output=True)
    assert (h == 0.1).all()
    assert info.residual == 0.0


@pytest.mark.parametrize(
    "background", [SQUARE, GRID, GRID.with_active([[True, True], [True, False]])]
)
def test_a_number_is_a_bound_for_all_nodes(background):
    expected = limit_gradient(background, np.full(background.nodal_shape, 0.1), 0.3)
    assert_array_equal(limit_gradient(background, 0.1, 0.3), expected)
    h, info = limit_gradient(background, 0.1, 0.3, full_output=True)
    assert_array_equal(h, expected)
    assert_array_equal(limit_gradient(background, 0.1, 0.3, initial=info), expected)
