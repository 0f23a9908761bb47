"""The adaptive loops with a solver, at small settings."""

import pytest

pytest.importorskip("matplotlib", reason="the examples draw")
pytest.importorskip("skfem", reason="the examples solve with it")
pytest.importorskip("mmgpy", reason="the examples remesh with it")


def test_meshes_of_the_l_shape_have_the_best_rates(run):
    found = run("plot_lshape", n_targets=4, also_not_limited=False)
    # r^(2/3) is in H^(5/3) and no more: h^(2/3) on uniform meshes, that is N^(-1/3).
    for order in (1, 2):
        assert found[f"P{order} uniform: rate"] == pytest.approx(-1.0 / 3.0, abs=0.06)
    # N^(-p/2), and more while the corner is still too coarse.
    assert -0.7 < found["P1 limited: rate"] < -0.48
    assert -2.0 < found["P2 limited: rate"] < -0.95
    assert found["P1 limited: error"] < 0.6 * found["P1 uniform: error"]
    assert found["P2 limited: error"] < 0.1 * found["P2 uniform: error"]
    # Residuals bound the error from above but for a constant, some times larger.
    for order, factor in ((1, 5.0), (2, 10.0)):
        assert 1.0 < found[f"P{order} limited: estimate over error"] < factor
    # Jumps from marked triangles to the others: bad angles, unless the sizes are limited.
    assert found["marked limited: smallest angle"] > 15.0
    assert found["marked not limited: smallest angle"] < 12.0
    assert found["marked limited: error"] < 0.95 * found["marked not limited: error"]


def test_meshes_that_follow_a_burner_beat_a_uniform_one_of_as_many_nodes(run):
    found = run("plot_front", radius=0.04, end=0.3)
    assert found["times fewer nodes"] > 4.0
    assert found["error"] < 0.6 * found["error, uniform with as few nodes"]
    # Interpolation loses heat in each of the transfers; what it lost comes back to rounding.
    assert found["heat lost by interpolation"] > 1e-3
    assert found["heat lost, put back"] < 1e-12


def test_a_mesh_for_a_number_that_is_wanted_has_it_better_than_one_for_the_energy(run):
    found = run("plot_goal", targets=(1000, 2000, 4000))
    assert found["error, for the goal"] < 0.6 * found["error, for the energy"]
    assert found["error, for the goal"] < 0.1 * found["error, uniform"]
    assert 1.0 < found["bound, for the goal"] / found["error, for the goal"] < 10.0
    assert found["order of the error for the goal"] < -0.8


def test_a_spot_is_followed_as_well_by_meshes_that_are_new_around_the_changes_only(run):
    found = run("plot_moving_spot", elements=3000, end=0.3)
    few, every = "new around the changes", "all new"
    assert found[f"nodes that stay, {few}"] > 0.3
    assert found[f"nodes that stay, {every}"] < 0.05
    assert found[f"triangles, {few}"] == pytest.approx(3000, rel=0.15)
    assert found[f"error, {few}"] < 1.15 * found[f"error, {every}"]
    assert found[f"largest change of heat, {few}"] < 1e-10
