"""Each example runs, at small settings, and finds what its docstring says."""

from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"

pytest.importorskip("pyvista", reason="the examples draw")
pytest.importorskip("matplotlib", reason="the examples draw")


#: Of these, tests/test_docs.py runs the essential lines; `make gallery` runs all of them.
ESSENTIAL_LINES_ONLY = {
    "plot_anisotropic_layers", "plot_backgrounds", "plot_bracket", "plot_choices", "plot_cost",
    "plot_curved_boundary", "plot_distance", "plot_euler_anisotropic", "plot_euler_bump",
    "plot_fichera", "plot_g_on_a_domain", "plot_grid_schemes", "plot_hot_spot", "plot_image",
    "plot_mesh_family", "plot_metric_gradation", "plot_octree", "plot_one_dimension",
    "plot_point_source", "plot_scan", "plot_sparse_sizes", "plot_two_regions", "plot_two_sources",
    "plot_volume",
}  # fmt: skip


def test_every_other_example_is_tested():
    tests = Path(__file__).parent.glob("test_*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in tests)
    names = {path.stem for path in EXAMPLES.glob("[!_]*.py")}
    assert names >= ESSENTIAL_LINES_ONLY
    assert [name for name in names - ESSENTIAL_LINES_ONLY if f'run("{name}"' not in text] == []


def test_bounds_arise_at_few_nodes_and_make_a_mesh_of_the_predicted_number(run):
    found = run("plot_size_function", spacing=0.1)
    assert 0.02 < found["nodes with a bound"] < 0.2
    assert found["triangles over predicted"] == pytest.approx(1.0, abs=0.2)


def test_small_sizes_do_not_cross_the_slit(run):
    found = run("plot_slit")
    # Sizes of 0.15 / 4 on the notch, a circle of radius 0.15 around (1.6, 3).  The way leads from
    # there to (1.98, 0.8) and (2.02, 0.8) and up to (2.02, 3); straight, the slit is no obstacle.
    way = (0.38**2 + 2.2**2) ** 0.5 - 0.15 + 0.04 + 2.2
    around = 0.15 / 4.0 + 0.15 * way
    # The notch is a polygon: 1 % of excess is plenty.
    assert around <= found["size across the slit, inside the domain"] < 1.01 * around
    straight = 0.15 / 4.0 + 0.15 * (2.02 - 1.75)
    straight_on = found["size across the slit, straight through the slit"]
    assert straight_on == pytest.approx(straight, rel=1e-6)


def test_sizes_in_a_maze_are_the_lengths_of_shortest_paths(run):
    found = run("plot_exact_maze", spacing=0.2)
    # Of the six bounds two are undercut, one of them around a corner.
    assert found["bounds"] == 6
    assert found["survivors"] == 4
    # At most the corners of nine blocks, and three bends are drawn.
    assert 6 <= found["corners that serve"] <= 4 * 9
    assert found["most bends of a path"] == 3
    assert found["share of nodes proved exact"] == 1.0
    assert found["largest difference of sizes and paths"] < 1e-12


def test_sizes_grow_by_the_gradient_limit_of_their_side(run):
    found = run("plot_space_dependent_g", n_side=81)
    # First order from a point: up to 3 % too large at 20 cells from it.
    assert 0.4 <= found["mean slope on the left"] < 0.412
    assert 0.2 <= found["mean slope on the right"] < 0.206
    assert found["largest slope over g"] < 1.0 + 1e-12


def test_g_of_h_solves_the_differential_equation_along_rays(run):
    found = run("plot_g_of_h", n_side=101)
    # Exact but for the table of Phi and the tolerance of the differential equation.
    assert found["max error"] < 1e-8 * found["largest size"]
    assert found["largest with g = 0.2"] < found["largest size"] < found["largest with g = 0.6"]


def test_sizes_on_a_map_are_too_large_off_the_meridian(run):
    found = run("plot_great_circles", spacing=4.0)
    assert found["largest ratio of sizes on the map and on the sphere"] > 5.0
    assert found["smallest ratio"] == pytest.approx(1.0, abs=1e-9)  # no path on the map is shorter


def test_the_background_of_an_implicit_domain_is_fine_in_a_thin_wall_only(run):
    found = run("plot_implicit_background")
    assert abs(found["size in the wall"] / 0.004 - 1.0) < 0.05  # half its width
    assert found["smallest leaf"] < 0.005
    assert found["nodes"] < 20_000


def test_each_cause_controls_a_part_and_sizes_from_sources_are_exact(run):
    found = run("plot_sources")
    shares = [share for name, share in found.items() if name.startswith("share of nodes")]
    assert len(shares) == 4
    assert min(shares) > 0.02
    assert sum(shares) == pytest.approx(1.0, rel=1e-12)
    # A cone between nodes some 0.3 apart, cut off by up to g times half of that.
    assert 0.001 < found["largest error at the place, interpolated"] < 0.045
    assert found["largest error at the place, exact"] < 1e-12


def test_adaptive_loop_beats_uniform_meshes(run):
    pytest.importorskip("mmgpy")
    found = run("fem_loop", n_cycles=3)
    # Uniform meshes have order 1/3 here, the best adapted ones 1/2.
    assert found["order in the number of nodes"] > 0.4
    # A uniform mesh of twice the nodes has 0.8 of it.
    assert found["error at last"] < 0.35 * found["error at first"]


def test_layers_have_the_requested_heights(run):
    pytest.importorskip("mmgpy")
    found = run("plot_boundary_layer", first=1e-3)
    assert found["growth of the heights"] == pytest.approx(1.2, abs=0.03)
    assert found["height at the wall by the fit"] == pytest.approx(1e-3, rel=0.1)
    assert found["first height over the requested, median"] == pytest.approx(1.0, rel=0.25)
    assert found["share of edges in band"] > 0.9
    assert found["wall nodes off the wall"] < 2e-4  # a fifth of the first height
    assert found["jump of the height between neighbours, 99 %"] < 3.0


def test_limiting_takes_the_jumps_out_of_width_and_curvature(run):
    found = run("plot_feature_and_curvature", spacing=0.016)
    assert found["steepest bound over g"] > 3.0
    assert found["steepest size over g"] < 1.0 + 1e-9
    assert found["smallest angle"] > 20.0
    assert found["share of curvature"] > 0.2
    assert found["share of width"] > 0.2


def test_curvature_of_second_order_and_sizes_right_where_they_change(run):
    found = run("plot_level_set_curvature", cells=(40, 80))
    assert found["order, corrected"] > 1.9
    # The shift by phi, up to 2 spacings, is of first order.
    assert found["order, at the nodes"] < 1.5
    assert found["largest error, corrected"] < 0.1 * found["largest error, at the nodes"]
    assert found["largest error, plus sign"] > 1.5 * found["largest error, at the nodes"]
    ours = [found[f"size_from_curvature, largest error {p}"] for p in ("on the boundary", "inside")]
    assert max(ours) < 0.03
    assert found["formula (4), largest error on the boundary"] > 2.0 * ours[0]
    assert found["without - g phi, largest error inside"] > 2.0 * ours[1]


def test_feature_sizes_of_planar_shapes_are_those_known(run):
    n = 90
    step = 2.26 / (n - 1)
    found = run("plot_medial_axis", n=n)
    # b^2 / a to b on an ellipse; half the width of a ring and a strip; not small at corners.
    assert found["smallest, ellipse"] == pytest.approx(0.25, abs=2.0 * step)
    assert found["largest, ellipse"] == pytest.approx(0.5, abs=step)
    assert found["smallest, ring"] == pytest.approx(0.3, abs=0.5 * step)
    assert found["largest, ring"] == pytest.approx(0.3, abs=0.5 * step)
    assert found["smallest, rectangle, turned"] == pytest.approx(0.35, abs=step)
    assert found["smallest, L"] == pytest.approx(0.4, abs=step)
    # The cut is 0.5 sqrt(2) long.
    assert found["smallest, corner cut off"] == pytest.approx(0.707, abs=2.0 * step)
    assert found["smallest, wedge of 20 degrees"] < 2.0 * step
    assert found["smallest, wavy disc"] > 0.8


def test_objects_with_smooth_boundaries_are_meshed_to_their_sizes(run, tmp_path):
    # At n_solid = 16 the wall of 0.25 beside the hole is less than two boxes thick.
    found = run("plot_smooth_boundaries", n=90, n_solid=16)
    assert found["share of edges in band"] > 0.95
    assert found["smallest angle"] > 22.0
    # 1.76 around the hole of radius 0.28, between walls at most 0.45 wide: sizes up to 0.18.
    assert found["nodes on the hole"] > 9
    assert found["mesh over domain, area"] == pytest.approx(1.0, abs=0.02)
    assert found["share of edges in band, solid"] > 0.93
    assert found["smallest dihedral angle"] > 15.0
    assert found["slivers"] == 0
    assert found["mesh over domain, volume"] == pytest.approx(1.0, abs=0.03)
    assert (tmp_path / "solid.png").stat().st_size > 5_000


def test_the_width_resolves_walls_and_the_separation_gaps_between_corners(run):
    found = run("plot_width")
    assert found["smallest width"] == pytest.approx(0.25, rel=2e-3)  # below the hole
    assert found["smallest separation"] == pytest.approx(0.15, rel=1e-12)  # of step and slot
    assert found["separation there"] == pytest.approx(found["gap of the windows"], rel=1e-12)
    # Half a box of the grid away from the corners, with g = 0.25.
    assert found["size from the separation there"] < 1.15 * found["gap of the windows"]
    assert found["size from the width there"] > 2.0 * found["gap of the windows"]
    assert found["elements across the fin"] == pytest.approx(2.0, rel=1e-9)
