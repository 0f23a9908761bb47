"""The number of elements of an adapted mesh."""

import math

import numpy as np
import pytest
from adaptive_loops import SEED, disc, indicator
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_square, structured_square
from numpy.testing import assert_allclose
from scipy.integrate import quad

from adaptsize import adapt
from adaptsize.adaptation import new_mesh
from adaptsize.errors import BackendError, TooManyElementsError
from adaptsize.remeshing.driver import Remeshed
from adaptsize.sizes import predict
from adaptsize.sizes.budget import mean_density


@given(st.integers(1, 3), st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
def test_mean_density_is_the_mean_over_the_simplex(d, logs):
    h = np.exp(logs[: d + 1])
    # Along the heights of a simplex: h is a + (b - a) t on slices, one dimension after the other.
    if d == 1:
        twin = quad(lambda t: 1.0 / (h[0] + (h[1] - h[0]) * t), 0.0, 1.0, epsrel=1e-9)[0]
    else:
        # The mean of H^-(d+1) is the product of 1 / H_i; see the docstring.
        twin = d * quad(
            lambda u: math.exp(u) / np.prod(h + math.exp(u)), -40.0, 40.0, epsrel=1e-9, limit=400
        )[0]  # fmt: skip
    assert mean_density(h[None])[0] == pytest.approx(twin, rel=1e-6)


def test_the_number_of_elements_is_that_of_the_generator():
    mesh = structured_square(4)
    plain = predict(mesh, np.ones(mesh.n_points)).cells
    assert plain == pytest.approx(10_000 * 4.0 / math.sqrt(3.0))
    # docs/adaptive-loops.md
    assert predict(mesh, np.ones(mesh.n_points), backend="mmg").cells == 1.00 * plain
    assert predict(mesh, np.ones(mesh.n_points), backend="unheard of").cells == plain


@pytest.mark.parametrize(
    ("number", "factor"), [*(("elements", k) for k in (0.3, 0.7, 1.0, 1.1, 1.9)), ("nodes", 0.5)]
)
def test_a_missed_number_is_corrected_by_another_mesh(generator, number, factor):
    generator.factor = factor
    mesh = jittered_square(12, SEED, half_width=1.0)
    result = adapt(mesh, indicator(mesh), **{number: 3000}, max_refine=20)
    assert result.report.budget_met
    assert result.report.n_meshes == generator.calls == (1 if factor == 1.0 else 2)
    made = result.mesh.n_cells if number == "elements" else result.mesh.n_points
    assert made == pytest.approx(3000, rel=0.05)
    unit = " nodes" if number == "nodes" else ""
    assert f"requested 3000{unit}: budget met" in str(result.report)


def test_a_generator_with_a_jump_is_met_from_both_sides(monkeypatch, generator):
    # As fTetWild's at its natural length: twice as many on one side, half as many on the other.
    class Jumping(type(generator)):
        def __call__(self, mesh, size, **options):
            asked = predict(mesh, size.values).cells
            self.factor = 1.6 if asked > 2500 else 0.75
            return super().__call__(mesh, size, **options)

    jumping = Jumping()
    monkeypatch.setattr(new_mesh, "trial", lambda *a, **k: Remeshed(jumping(*a, **k), None))
    mesh = jittered_square(12, SEED, half_width=1.0)
    result = adapt(mesh, indicator(mesh), elements=3000)
    assert result.report.n_meshes == 3
    counts = np.array([1.6 * 3000, 0.75 * 3000 / 1.6])
    best = np.exp(np.abs(np.log(counts / 3000)).min())
    assert max(result.mesh.n_cells / 3000, 3000 / result.mesh.n_cells) < best


def test_a_number_out_of_reach_is_approached_once_and_reported(generator):
    mesh = jittered_square(12, SEED, half_width=1.0)
    result = adapt(mesh, indicator(mesh), elements=100_000, hmin=0.1)
    assert generator.calls == 1
    assert result.report.budget_met is False
    assert "budget missed" in str(result)
    assert result.size.values.min() >= 0.1


@pytest.mark.parametrize(("rings", "number", "met"), [(12, 640, True), (40, 8000, True),
                                                      (40, 500, False)])  # fmt: skip
def test_discs_by_mmg_meet_the_number_unless_cells_may_not_grow_so_much(rings, number, met):
    pytest.importorskip("mmgpy")
    mesh = disc(rings)
    result = adapt(mesh, indicator(mesh), elements=number)
    assert bool(result.report.budget_met) is met
    assert (abs(result.mesh.n_cells / number - 1.0) <= 0.05) is met
    if not met:  # 9600 cells: twice as long edges are a quarter of them
        assert result.mesh.n_cells == pytest.approx(9600 / 4, rel=0.15)


def test_bounds_hold_beside_an_indicator(generator):
    mesh = jittered_square(12, SEED, half_width=1.0)
    bound = np.full(mesh.n_points, np.inf)
    bound[0] = 0.01
    result = adapt(mesh, indicator(mesh), elements=3000, h0=bound, g=0.3)
    h = result.size.values
    assert h[0] <= 0.01
    i, j = mesh.edges.T
    assert (np.abs(h[i] - h[j]) <= 0.3 * mesh.edge_lengths * (1.0 + 1e-12)).all()
    assert result.report.predicted_elements == pytest.approx(3000, rel=1e-2)


def test_a_window_of_states_has_the_smallest_sizes_of_all(generator):
    mesh = structured_square(12, half_width=1.0)
    x = mesh.points[mesh.cells].mean(axis=1)
    peaks = [([-1, -1], 8.0), ([1, 0.5], 2.0), ([0, 1], 20.0)]
    states = np.array([np.exp(-k * np.linalg.norm(x - p, axis=1)) for p, k in peaks])
    states *= np.array([[1.0], [0.9], [0.8]]) / np.linalg.norm(states, axis=1, keepdims=True)
    for far in (0.7, 0.01):  # within one cycle, and beyond
        options = {"tolerance": far, "order": 1}
        window = adapt(mesh, states, **options)
        single = [adapt(mesh, state, **options).size.values for state in states]
        assert_allclose(window.size.values, np.minimum.reduce(single), rtol=1e-9)
        assert window.report.error == pytest.approx(1.0)
        assert ("approaches the tolerance" in window.reason) == (far < 0.1)
    # For a number, all are multiplied by one factor.
    options = {"elements": 2000, "g": None, "max_refine": 1e3, "max_coarsen": 1e3}
    window = adapt(mesh, states, **options)
    single = [adapt(mesh, state, **options).size.values for state in states]
    ratio = window.size.values / np.minimum.reduce(single)
    assert ratio.min() > 1.05
    assert_allclose(ratio, ratio[0], rtol=3e-3)
    assert window.report.predicted_elements == pytest.approx(2000, rel=1e-2)
    again = adapt(mesh, states[[0, 0]], **options).size.values
    assert_allclose(again, single[0], rtol=1e-9)
    options = {"tolerance": 1.0}
    for shape in ((2, 5), (0, mesh.n_cells), (1, 2, mesh.n_cells)):
        with pytest.raises(ValueError, match="indicator must have shape"):
            adapt(mesh, np.zeros(shape), **options)


@pytest.mark.parametrize("error", [BackendError, TooManyElementsError])
def test_the_time_limit_is_one_for_all_meshes_and_a_failure_leaves_the_mesh_before(
    monkeypatch, generator, error
):
    given = []

    class Slow(type(generator)):
        factor = 0.7

        def __call__(self, mesh, size, **options):
            given.append(options["timeout"])
            if len(given) == 2:
                raise error("the time is over")
            return super().__call__(mesh, size, **options)

    slow = Slow()
    monkeypatch.setattr(new_mesh, "trial", lambda *a, **k: Remeshed(slow(*a, **k), None))
    mesh = jittered_square(12, SEED, half_width=1.0)
    result = adapt(mesh, indicator(mesh), elements=3000, timeout=60.0)
    assert given[0] == 60.0
    assert 0.0 < given[1] < 60.0
    assert len(given) == 2
    assert result.report.n_meshes == 1
    assert result.mesh.n_cells == pytest.approx(0.7 * 3000, rel=0.1)
