"""Each example runs, at small settings, and finds what its docstring says."""

from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"

pytest.importorskip("pyvista", reason="the examples draw")
pytest.importorskip("matplotlib", reason="the examples draw")


#: Of these, tests/test_docs.py runs the essential lines; `make gallery` runs all of them.
ESSENTIAL_LINES_ONLY = {
    "plot_anisotropic_layers", "plot_backgrounds", "plot_cost", "plot_euler_anisotropic",
    "plot_euler_bump", "plot_fichera", "plot_g_on_a_domain", "plot_hot_spot", "plot_mesh_family",
    "plot_octree", "plot_point_source", "plot_scan", "plot_sparse_sizes", "plot_volume",
}  # fmt: skip


def test_every_other_example_is_tested():
    tests = Path(__file__).parent.glob("test_*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in tests)
    names = {path.stem for path in EXAMPLES.glob("[!_]*.py")}
    assert names >= ESSENTIAL_LINES_ONLY
    assert [name for name in names - ESSENTIAL_LINES_ONLY if f'run("{name}"' not in text] == []


def test_two_sources_are_missed_along_edges_and_not_through_triangles(run):
    found = run("plot_two_sources", n_side=80)
    # Persson (2006), Fig. 11, has 0.38 for first order on a 100 x 100 grid of squares.
    assert found["max error fast-marching"] < 0.38
    assert found["max error edge-based"] > 4.0 * found["max error fast-marching"]


def test_sizes_on_the_arcs_are_their_radii_over_elements_per_radian(run):
    pytest.importorskip("mmgpy")
    found = run("plot_curved_boundary")
    assert found["smallest size"] == pytest.approx(0.5 / 6.0, rel=0.01)
    assert found["largest slope over g"] < 1.0 + 1e-12
    assert found["share of edges in band"] > 0.9
    assert found["smallest angle"] > 15.0


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


def test_in_one_dimension_the_grid_has_the_sizes_of_formula_11(run):
    found = run("plot_one_dimension", n_nodes=201)
    limits = ("4", "2", "1", "0.5")
    # Sizes up to 1, sums of 200 rises.
    assert max(found[f"difference from formula (11), g = {g}"] for g in limits) < 1e-13
    steepest = [found[f"steepest slope over g, g = {g}"] for g in limits]
    assert steepest == pytest.approx([1.0] * 4, abs=1e-12)
    lowered = [found[f"share lowered, g = {g}"] for g in limits]
    assert lowered == sorted(lowered)


def test_errors_on_a_grid_of_100_x_100_are_those_of_the_paper(run):
    found = run("plot_grid_schemes")
    # At (50, 50): 40 + 50 along the edges from the source on the right, sqrt(40^2 + 50^2) straight.
    assert found["max error edge-based"] == pytest.approx(0.3 * (90.0 - 4100.0**0.5), rel=1e-12)
    assert round(found["max error first order"], 2) <= 0.38
    assert round(found["max error second order"], 2) == 0.10
    assert found["max error exact"] < 1e-12


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


def test_a_part_becomes_graded_tetrahedra(run, tmp_path):
    import trimesh

    part = tmp_path / "box.stl"
    trimesh.creation.box(extents=(10.0, 6.0, 4.0)).export(part)
    found = run("plot_bracket", part=part, hmin=0.7, hmax=1.0)
    assert found["inverted"] == 0
    assert found["distance over diagonal"] < 3e-3
    assert found["share of edges in band"] > 0.65  # 0.71 to 0.95: fTetWild differs from run to run
    assert (tmp_path / "bracket.vtu").exists()


def test_regions_and_tagged_facets_survive_remeshing(run):
    pytest.importorskip("mmgpy")
    found = run("plot_two_regions", in_ball=1.8, at_point=0.8)
    outside = [found[f"area of facets {tag}, after over before"] for tag in (1, 2, 3)]
    assert outside == pytest.approx([1.0, 1.0, 1.0], rel=1e-9)
    # Rounded, the ball would be larger by 1.6 %.
    assert found["area of facets 10, after over before"] == pytest.approx(1.0, abs=0.005)
    assert found["volume of region 1, after over before"] == pytest.approx(1.0, abs=0.001)
    assert found["volume of region 2, after over before"] == pytest.approx(1.0, abs=0.003)


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


def test_signed_distances_of_a_function_an_outline_pixels_and_a_part(run):
    found = run("plot_distance", n=60)
    assert found["largest error, spacings"] < 0.02
    # A node beside a gap of 0.05 may lie on either side of what closes it.
    assert found["share of right signs beside the gaps"] > 0.99
    assert found["mean error, pixels"] < 0.2
    assert found["volume inside over that of the part"] == pytest.approx(1.0, abs=0.03)


def test_objects_of_a_picture_are_meshed_with_their_labels(run):
    found = run("plot_image", every=2, elements_across=2.0)
    assert found["objects"] == 5
    assert found["area of the mesh over that of the pixels"] == pytest.approx(1.0, abs=0.04)
    assert found["smallest angle"] > 15.0
    assert found["share of edges in band"] > 0.95


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


def test_two_ellipses_keep_their_sizes_and_share_the_domain(run):
    found = run("plot_metric_gradation", n_side=41)
    assert found["smallest size"] == pytest.approx(0.02, rel=1e-12)
    # The second point is active at the first one: 0.03 + g 1.84 is less than 0.5.
    distance = np.hypot(1.8, 0.4)
    assert 20.0 < found["largest aspect ratio"] < 25.0
    assert 0.03 + 0.25 * distance < 0.5
    assert found["nodes with both"] > 300


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
