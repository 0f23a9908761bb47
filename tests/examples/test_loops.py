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
    # Some 3000 sums of sizes up to 0.1.
    assert found["largest difference, warm and cold"] < 1e-13
    assert 0.0 < found["share of bounds changed"] < 0.2


def test_tetrahedra_for_the_fichera_corner_beat_uniform_ones(run):
    found = run("plot_fichera", targets=(3000, 9000), tetwild_targets=(3000,), finest=8)
    # r^(2/3) along edges: h^(2/3) on uniform meshes, that is N^(-2/9), and N^(-1/3) at best.
    assert found["uniform: rate"] == pytest.approx(-2.0 / 9.0, abs=0.04)
    # More while the first mesh, a uniform one, counts.
    assert found["Mmg: rate"] < -0.3
    # With half as many unknowns.
    assert found["Mmg: unknowns"] < 0.6 * found["uniform: unknowns"]
    assert found["Mmg: error"] < 0.97 * found["uniform: error"]
    # With the same number as the first mesh has, of 2688 tetrahedra, error 1.12.
    assert found["fTetWild: unknowns"] < 600
    assert found["fTetWild: error"] < 0.9
    assert 1.0 < found["Mmg: estimate over error"] < 1.4


def test_a_hot_spot_read_from_a_file_is_refined_and_materials_stay(run):
    found = run("plot_hot_spot", sizes=(1.0, 0.5))
    assert found["triangles in the file"] < found["triangles, 1 mm"] < found["triangles, 0.5 mm"]
    assert found["triangles, 0.5 mm"] < 3000
    # 346 MPa on finer meshes.  Without the inlay, in an endless strip, by the fit to Howland's:
    # 100 (0.284 + 2 / b - 0.6 b + 1.32 b^2) with b = 1 - 16 / 60, 328.
    assert found["highest stress in the file"] < 300.0
    assert found["highest stress, 0.5 mm"] == pytest.approx(346.0, rel=0.08)
    assert found["smallest angle"] > 20.0
    assert found["distance of the hole from the circle"] < 1e-9
    # A polygon with chords of 1.8 lacks h^2 / 6 R^2 of the disc: 1.7 of 5549.
    for way, exact in (("", 1.0 - 1.7 / 5549.0), (" by the command", 1.0)):
        share = found[f"area of material 10{way}, after over before"]
        assert share == pytest.approx(exact, abs=2e-4)
        assert found[f"area of material 20{way}, after over before"] == pytest.approx(1, abs=3e-3)
