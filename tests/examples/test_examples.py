"""Each example runs, at small settings, and finds what its docstring says."""

from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"

pytest.importorskip("pyvista", reason="the examples draw")


def test_every_example_is_tested():
    tests = Path(__file__).parent.glob("test_*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in tests)
    names = [path.stem for path in EXAMPLES.glob("[!_]*.py")]
    assert len(names) >= 14
    assert [name for name in names if f'"{name}"' not in text] == []


def test_two_sources_are_missed_along_edges_and_not_through_triangles(run, tmp_path):
    found = run("plot_two_sources", n_side=80)
    # Persson (2006), Fig. 11, has 0.38 for first order on a 100 x 100 grid of squares.
    assert found["max error fast-marching"] < 0.38
    assert found["max error edge-based"] > 4.0 * found["max error fast-marching"]
    assert (tmp_path / "two_sources.png").stat().st_size > 10_000


def test_edge_based_errors_stay_when_the_mesh_is_refined(run):
    coarse = run("plot_two_sources", n_side=41)
    fine = run("plot_two_sources", n_side=161)
    # First order with the logarithm of a point source: 4 times finer gains 2.5 and more.
    assert fine["mean error fast-marching"] < coarse["mean error fast-marching"] / 2.5
    assert fine["mean error edge-based"] > 0.7 * coarse["mean error edge-based"]


def test_sizes_on_the_arcs_are_their_radii_over_elements_per_radian(run, tmp_path):
    found = run("plot_curved_boundary")
    assert found["smallest size"] == pytest.approx(0.5 / 6.0, rel=0.01)
    assert found["largest slope over g"] < 1.0 + 1e-12
    assert (tmp_path / "curved_boundary.png").exists()


def test_mesh_of_the_curved_domain_follows_the_sizes(run):
    pytest.importorskip("mmgpy")
    found = run("plot_curved_boundary")
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


def test_sizes_in_a_maze_are_the_lengths_of_shortest_paths(run, tmp_path):
    found = run("plot_exact_maze", spacing=0.2)
    # Of the six bounds two are undercut, one of them around a corner.
    assert found["bounds"] == 6
    assert found["survivors"] == 4
    # At most the corners of nine blocks, and three bends are drawn.
    assert 6 <= found["corners that serve"] <= 4 * 9
    assert found["most bends of a path"] == 3
    assert found["share of nodes proved exact"] == 1.0
    assert found["largest difference of sizes and paths"] < 1e-12
    assert (tmp_path / "exact_maze.png").stat().st_size > 10_000


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


def test_errors_on_a_grid_of_100_x_100_are_those_of_the_paper(run, tmp_path):
    found = run("plot_grid_schemes")
    # At (50, 50): 40 + 50 along the edges from the source on the right, sqrt(40^2 + 50^2) straight.
    assert found["max error edge-based"] == pytest.approx(0.3 * (90.0 - 4100.0**0.5), rel=1e-12)
    assert round(found["max error first order"], 2) <= 0.38
    assert round(found["max error second order"], 2) == 0.10
    assert found["max error exact"] < 1e-12
    assert (tmp_path / "grid_schemes.png").stat().st_size > 10_000


def test_one_problem_on_three_backgrounds_converges_to_one_solution(run):
    coarse, fine = (run("plot_backgrounds", n_cells=n) for n in (64, 256))
    for name in ("grid", "quadtree", "triangles"):
        # First order with the logarithm of a point source: 4 times finer gains 2 and more.
        assert fine[f"max error, {name}"] < 0.5 * coarse[f"max error, {name}"]
        # 1.5 % of the largest size.
        assert fine[f"max error, {name}"] < 0.015 * 0.23


def test_leaves_grow_in_number_like_the_boundary_and_follow_the_sizes(run):
    found = run("plot_octree", level=6)
    # 8 for leaves 8 times smaller, and 64 if they filled the area; straight sides of the plate
    # meet one row of leaves or two, as it happens.
    assert 4.0 < found["times as many leaves, 8 times finer"] < 16.0
    # First order: two leaves of 1 / 64 at the holes, larger ones away from them.
    assert found["largest error"] < 0.3 * 2.0 / 16.0
    # No leaf is larger than the smallest size in it.
    assert found["largest leaf over the size at its centre"] < 1.0


def test_the_background_of_an_implicit_domain_is_fine_in_a_thin_wall_only(run):
    found = run("plot_implicit_background")
    assert abs(found["size in the wall"] / 0.004 - 1.0) < 0.05  # half its width
    assert found["smallest leaf"] < 0.005
    assert found["nodes"] < 20_000


def test_each_cause_controls_a_part_and_sizes_from_sources_are_exact(run, tmp_path):
    found = run("plot_sources")
    shares = [share for name, share in found.items() if name.startswith("share of nodes")]
    assert len(shares) == 4
    assert min(shares) > 0.02
    assert sum(shares) == pytest.approx(1.0, rel=1e-12)
    # A cone between nodes some 0.3 apart, cut off by up to g times half of that.
    assert 0.001 < found["largest error at the place, interpolated"] < 0.045
    assert found["largest error at the place, exact"] < 1e-12
    assert (tmp_path / "sources.png").stat().st_size > 10_000


def test_limits_that_vary_on_a_domain_hold_everywhere(run):
    found = run("plot_g_on_a_domain", n_nodes=161)
    assert found["largest slope over g, g(x)"] < 1.0 + 1e-12
    assert found["largest slope over g, g(h)"] < 1.0 + 1e-12
    # The limit is twice as large on the left, and the hole is on the right.
    assert found["mean size on the left, g(x)"] > 1.5 * found["mean size on the right, g(x)"]
    # On the right g(h) is nowhere below g(x) = 0.2.
    assert found["mean size on the right, g(h)"] > found["mean size on the right, g(x)"]


def test_a_part_becomes_graded_tetrahedra(run, tmp_path):
    import trimesh

    part = tmp_path / "box.stl"
    trimesh.creation.box(extents=(10.0, 6.0, 4.0)).export(part)
    found = run("plot_bracket", part=part, hmin=0.7, hmax=1.0)
    assert found["inverted"] == 0
    assert found["distance over diagonal"] < 3e-3
    assert found["share of edges in band"] > 0.65  # 0.71 to 0.95: fTetWild differs from run to run
    assert (tmp_path / "bracket.png").exists()
    assert (tmp_path / "bracket.vtu").exists()


def test_regions_and_tagged_facets_survive_remeshing(run):
    pytest.importorskip("mmgpy")
    found = run("plot_two_regions", in_ball=1.8, at_point=0.8)
    outside = [found[f"area of facets {tag}, after over before"] for tag in (1, 2, 3)]
    assert outside == pytest.approx([1.0, 1.0, 1.0], rel=1e-9)
    # Mmg rounds the coarse facets of the ball, by what the tolerance allows.
    assert found["area of facets 10, after over before"] == pytest.approx(1.0, abs=0.03)
    assert found["volume of region 1, after over before"] == pytest.approx(1.0, abs=0.005)
    assert found["volume of region 2, after over before"] == pytest.approx(1.0, abs=0.04)


def test_adaptive_loop_beats_uniform_meshes(run):
    pytest.importorskip("mmgpy")
    found = run("fem_loop", n_cycles=3)
    # Uniform meshes have order 1/3 here, the best adapted ones 1/2.
    assert found["order in the number of nodes"] > 0.4
    # A uniform mesh of twice the nodes has 0.8 of it.
    assert found["error at last"] < 0.35 * found["error at first"]


def test_a_size_prescribed_at_a_point_is_met_there(run, tmp_path):
    found = run("plot_point_source")
    # The point is not a node: size_function keeps sources between the nodes.
    assert found["size at the point"] == pytest.approx(0.02, rel=1e-12)
    assert (tmp_path / "point_source.png").stat().st_size > 10_000
