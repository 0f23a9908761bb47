"""New boundary nodes are projected, and none of them inverts a cell."""

import re
import warnings

import numpy as np
import pytest
from adaptive_loops import SEED, disc, to_circle
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull, Delaunay

from adaptsize import Metric, SimplexMesh, adapt
from adaptsize.adaptation.boundary_maps import as_boundary_maps
from adaptsize.adaptation.boundary_moves import move_to_boundary
from adaptsize.adaptation.next_metric import metric_by_tolerance, metric_request
from adaptsize.adaptation.next_sizes import bound_by_tolerance
from adaptsize.background.interfaces import interfaces
from adaptsize.background.splitting import bisect_edges
from adaptsize.errors import ResolutionWarning, TooManyElementsError
from adaptsize.options import AdaptOptions, checked
from adaptsize.remeshing.driver import Remeshed


def test_new_boundary_nodes_are_projected_and_the_area_comes_nearer():
    pytest.importorskip("mmgpy")
    mesh = disc(5)
    plain = adapt(mesh, h0=0.05)
    result = adapt(mesh, h0=0.05, project=to_circle)
    new, moves = result.mesh, result.report.moves
    # Chords of 12 degrees sag by 1 - cos(6 deg) = 5.5e-3, more than the tolerance.
    assert plain.report.boundary_distance < 1e-9
    assert moves.n_shortened == 0
    on_boundary = np.linalg.norm(new.points[new.boundary().nodes], axis=1)
    assert_allclose(on_boundary, 1.0, rtol=1e-12)
    assert (new.signed_measures > 0.0).all()
    off = [abs(m.measures.sum() - np.pi) for m in (mesh, plain.mesh, new)]
    # pi (2 pi / n)^2 / 6 of n chords: 30 of them, then some 126.
    assert off[0] == pytest.approx(0.023, rel=0.01)
    assert off[2] < 0.08 * off[0]
    assert "nodes moved by up to" in str(result)


def test_sizes_in_space_are_those_that_the_tolerance_allows_at_curved_boundaries():
    pytest.importorskip("mmgpy")
    rng = np.random.default_rng(SEED)
    inner = rng.uniform(-0.5, 0.5, (200, 3))
    points = np.vstack([random_sphere(800, SEED).points, inner])
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    options = {"h0": 0.9, "boundary_tolerance": 8e-3, "enough": 1.1, "backend": "mmg"}
    report = adapt(mesh, **options, project=lambda x: x / np.linalg.norm(x, axis=1)[:, None]).report
    # For the tolerance, Mmg made 1 000 cells of sizes that are for 60, none of them in band.
    assert report.n_cells_after == pytest.approx(report.predicted_elements, rel=0.35)
    assert report.after.share_in_band > 0.8


def test_bounds_by_the_tolerance_are_those_of_chords():
    mesh = random_sphere(800, SEED)
    sizes = bound_by_tolerance(mesh, 1e-3)
    radius = sizes**2 / (6e-3 * mesh.diagonal)
    assert np.median(radius) == pytest.approx(1.0, rel=0.02)
    of_metric = metric_by_tolerance(mesh, 1e-3)
    assert np.median(of_metric.sizes[:, 0] / sizes) == pytest.approx(1.0, rel=0.05)
    metric = Metric.isotropic(np.full(mesh.n_points, 0.9), 3)
    request = metric_request(mesh, metric, {}, checked(AdaptOptions, {"g": None}))
    found = request.within(mesh, 1e-3).next(mesh, 1.0).at_nodes
    assert_allclose(found.sizes, np.minimum(of_metric.sizes, 0.9), rtol=1e-9)
    # Around a tube of radius 1, and along it.
    angle, z = np.meshgrid(np.arange(32) * np.pi / 16, np.arange(4.0))
    points = np.column_stack([np.cos(angle.ravel()), np.sin(angle.ravel()), z.ravel()])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(32), np.arange(3)))
    a, b = 32 * j + i, 32 * j + (i + 1) % 32
    tube = SimplexMesh(points, np.vstack([np.c_[a, b, a + 32], np.c_[b, b + 32, a + 32]]))
    around = np.sqrt(6e-3 * tube.diagonal)
    expected = [around, 10.0 * around, 10.0 * around]
    assert_allclose(metric_by_tolerance(tube, 1e-3).sizes[40], expected, rtol=0.01)
    assert metric_by_tolerance(disc(5), 1e-3) is None
    assert bound_by_tolerance(disc(5), 1e-3) is None  # corners of polygons are kept


def refined(mesh, n_cells):
    """The same domain, with edges bisected until there are so many cells."""
    while mesh.n_cells < n_cells:
        mesh = bisect_edges(mesh, mesh.edges).mesh
    return mesh


def ball(n):
    rng = np.random.default_rng(SEED)
    points = np.vstack([random_sphere(n, SEED).points, rng.uniform(-0.5, 0.5, (n // 4, 3))])
    return SimplexMesh(points, Delaunay(points).simplices)


@pytest.mark.parametrize("has_regions", [False, True])
def test_sizes_at_curved_boundaries_do_not_shrink_with_the_meshes_of_a_loop(has_regions):
    first = ball(300)
    if has_regions:  # an interface in a larger box
        corners = np.array(np.meshgrid(*[[-2.0, 2.0]] * 3)).reshape(3, -1).T
        points = np.vstack([first.points, corners])
        whole = SimplexMesh(points, Delaunay(points).simplices)
        inside = (whole.cells < first.n_points).all(axis=1)
        first = SimplexMesh(points, whole.cells, cell_tags=1 + inside)
    of_first = bound_by_tolerance(first, 1e-3)
    later = refined(first, 15_000)
    # As generators do, which keep within the tolerance: half of it.
    off = 5e-4 * first.diagonal * np.random.default_rng(SEED).uniform(-1.0, 1.0, later.n_points)
    later = later.moved(later.points * (1.0 + off)[:, None])
    on_sphere = np.abs(np.linalg.norm(later.points, axis=1) - 0.95) < 0.1
    without = bound_by_tolerance(later, 1e-3)[on_sphere]
    assert without.min() < 0.75 * of_first.min()
    found = bound_by_tolerance(later, 1e-3, first)[on_sphere]
    finite = np.isfinite(found)
    assert finite.sum() >= 300
    assert_allclose(found[finite].min(), of_first.min(), rtol=5e-3)
    of_metric = metric_by_tolerance(later, 1e-3, first).sizes[on_sphere]
    assert_array_equal(of_metric[:, 0], found)
    assert_array_equal(np.isfinite(of_metric[:, 2]), finite)


def test_sizes_along_a_tube_stay_ten_times_those_around_it():
    angle, z = np.meshgrid(np.arange(32) * np.pi / 16, np.arange(4.0))
    points = np.column_stack([np.cos(angle.ravel()), np.sin(angle.ravel()), z.ravel()])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(32), np.arange(3)))
    a, b = 32 * j + i, 32 * j + (i + 1) % 32
    first = SimplexMesh(points, np.vstack([np.c_[a, b, a + 32], np.c_[b, b + 32, a + 32]]))
    later = refined(first, 4000)
    inside = (later.points[:, 2] > 0.5) & (later.points[:, 2] < 2.5)
    metric = metric_by_tolerance(later, 1e-3, first)[inside]
    around = np.sqrt(6e-3 * first.diagonal)
    # The facets of the later mesh are flat between edges of 11 degrees.
    assert_allclose(metric.sizes[:, 0], around, rtol=0.02)
    along = metric.size_along(np.tile([0.0, 0.0, 1.0], (inside.sum(), 1)))
    assert_allclose(along, 10.0 * around, rtol=0.05)


@pytest.mark.parametrize("number", ["elements", "nodes"])
def test_a_number_below_what_the_boundary_needs_is_refused_in_each_cycle(generator, number):
    first = ball(150)
    later = refined(first, 4000)
    few = {"elements": 2000, "nodes": 450}[number]
    message = rf"the curved boundary needs about \d+ {number}; {few} are not enough"
    texts = []
    for mesh, original in ((first, None), (later, first)):
        with pytest.raises(TooManyElementsError, match=message) as caught:
            adapt(mesh, h0=0.5, **{number: few}, original=original, max_refine=99.0)
        texts.append(str(caught.value))
        offer = caught.value.enough["boundary_tolerance"]
        assert texts[-1].endswith(f"={offer:g}")
        assert caught.value.elements > 1.1 * few
    if number == "elements":
        assert texts[0] == texts[1]
    with pytest.raises(TooManyElementsError):
        adapt(first, h0=0.5, **{number: few}, boundary_tolerance=0.8 * offer)


def test_what_the_boundary_needs_does_not_depend_on_the_nodes_inside(generator):
    needed = []
    on_sphere = random_sphere(150, SEED).points
    for mesh in (ball(150), SimplexMesh(on_sphere, Delaunay(on_sphere).simplices)):
        with pytest.raises(TooManyElementsError, match=r"needs about \d+ elements") as caught:
            adapt(mesh, h0=0.5, elements=1000, max_coarsen=99.0)
        needed.append(float(re.search(r"about (\d+)", str(caught.value))[1]))
    # Where all nodes are on the sphere, sizes at the nodes do not grow inside.
    assert needed[1] == pytest.approx(needed[0], rel=0.05)


def test_metrics_with_fewer_elements_than_sizes_are_not_refused(monkeypatch, generator):
    # On the given nodes they need 7 000: so steep metrics are not known between few nodes.
    monkeypatch.setattr(
        "adaptsize.adaptation.new_mesh.trial", lambda mesh, size, **options: Remeshed(mesh, None)
    )
    mesh = ball(150)
    metric = Metric.isotropic(np.full(mesh.n_points, 0.5), 3)
    report = adapt(mesh, h0=metric, elements=4500).report
    assert report.predicted_elements > 1.3 * 4500
    with pytest.raises(TooManyElementsError, match="needs about"):
        adapt(mesh, h0=metric, elements=1500)


def test_what_limits_forbid_is_no_reason_to_refuse(monkeypatch, generator):
    monkeypatch.setattr(
        "adaptsize.adaptation.new_mesh.trial", lambda mesh, size, **options: Remeshed(mesh, None)
    )
    result = adapt(ball(60), h0=0.5, elements=100, hmax=0.1, boundary_tolerance=0.05)
    assert result.report.budget_met is False


def test_the_first_mesh_of_a_loop_is_handed_on():
    pytest.importorskip("mmgpy")
    first = ball(60)
    result = adapt(first, h0=0.4, boundary_tolerance=2e-2)
    assert result.original is first
    again = adapt(result.mesh, h0=0.5, boundary_tolerance=2e-2)
    assert again.original is first
    from_elsewhere = SimplexMesh(result.mesh.points, result.mesh.cells)
    assert adapt(from_elsewhere, h0=0.5, boundary_tolerance=2e-2).original is from_elsewhere
    handed = adapt(from_elsewhere, h0=0.5, boundary_tolerance=2e-2, original=first)
    assert handed.original is first
    assert_array_equal(handed.size.values, again.size.values)
    away = lambda x: x / np.linalg.norm(x, axis=1)[:, None]  # noqa: E731
    moved = adapt(result.mesh, h0=0.5, boundary_tolerance=2e-2, project=away)
    # Nodes must not be put back on the boundary before: the loop begins anew.
    assert moved.original is moved.mesh
    assert moved.mesh.original is None


def test_first_meshes_have_no_first_mesh(monkeypatch, generator):
    first, second, third = (jittered_cube(n, SEED) for n in (2, 3, 4))
    made = [third]
    monkeypatch.setattr(
        "adaptsize.adaptation.new_mesh.trial", lambda *a, **k: Remeshed(made[0], None)
    )
    later = second.with_original(first)
    result = adapt(third.with_original(None), h0=0.2, boundary_tolerance=0.3, original=later)
    assert result.remeshed
    assert_array_equal(result.mesh.original.points, second.points)
    assert result.mesh.original.original is None
    assert result.original is result.mesh.original
    assert later.original is first  # unchanged


@pytest.mark.parametrize("is_known", [True, False])
def test_the_boundary_may_be_close_to_the_first_one(is_known, monkeypatch, generator):
    first = jittered_cube(3, SEED)
    shift = 8e-4 * first.diagonal * np.eye(3)[0]
    old, new = (first.moved(first.points + sign * shift) for sign in (1.0, -1.0))
    monkeypatch.setattr("adaptsize.adaptation.new_mesh.trial", lambda *a, **k: Remeshed(new, None))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ResolutionWarning)
        result = adapt(old.with_original(first if is_known else None), h0=0.2)
    assert [str(one.message) for one in caught if "boundary" in str(one.message)] == (
        [] if is_known else [str(caught[-1].message)]
    )
    away = result.report.boundary_distance / np.linalg.norm(shift)
    assert away == pytest.approx(1.0 if is_known else 2.0, rel=1e-6)


def test_an_original_without_effect_is_refused(generator):
    square = structured_square(4, half_width=1.0)
    with pytest.raises(ValueError, match="original must be a mesh in space of the same kind"):
        adapt(square, h0=0.2, original=square)
    cube = jittered_cube(3, SEED)
    with pytest.raises(ValueError, match="original must be a mesh in space of the same kind"):
        adapt(cube, h0=0.2, original=random_sphere(50, SEED))


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.floats(0.01, 3.0))
def test_no_move_inverts_a_cell_and_none_is_longer_than_asked(seed, dim, far):
    rng = np.random.default_rng(seed)
    mesh = jittered_square(7, seed, half_width=1.0) if dim == 2 else jittered_cube(4, seed % 9)
    if seed % 2:  # cells turned around
        mesh = SimplexMesh(mesh.points, mesh.cells[:, [1, 0, *range(2, dim + 1)]])
    asked = []

    def away(x):
        asked.append(far * rng.normal(size=x.shape))
        return x + asked[-1]

    moved, report = move_to_boundary(mesh, away, 30.0)
    sound = np.abs(mesh.signed_measures) > 1e-10 * mesh.diagonal**dim
    assert (moved.signed_measures * mesh.signed_measures > 0.0)[sound].all()
    assert report.n_shortened <= report.n_nodes
    way, at_wall = np.linalg.norm(moved.points - mesh.points, axis=1), mesh.boundary().nodes
    assert way[at_wall].max() == pytest.approx(report.largest_move, rel=1e-9, abs=1e-12)
    # Nodes inside follow those of the boundary.
    longest = np.linalg.norm(np.concatenate(asked), axis=1).max()
    assert way.max() <= longest * (1.0 + 1e-12)


def test_corners_and_ridges_stay_and_so_do_nodes_inside():
    square = structured_square(6, half_width=1.0)
    moved, report = move_to_boundary(square, lambda x: 1.02 * x, 30.0)
    corner = (np.abs(square.points) == 1.0).all(axis=1)
    inside = (np.abs(square.points) < 1.0).all(axis=1)
    assert report.n_corners == corner.sum() == 4
    assert_array_equal(moved.points[corner | inside], square.points[corner | inside])
    assert_allclose(moved.points[~(corner | inside)], 1.02 * square.points[~(corner | inside)])
    cube = jittered_cube(5, SEED, half_width=1.0)
    moved, report = move_to_boundary(cube, lambda x: 1.001 * x, 30.0)
    ridge = (np.abs(cube.points) == 1.0).sum(axis=1) >= 2
    assert report.n_corners == ridge.sum() == 12 * 3 + 8
    assert_array_equal(moved.points[ridge], cube.points[ridge])
    surface = SimplexMesh(np.pad(square.points, ((0, 0), (0, 1))), square.cells)
    moved, report = move_to_boundary(surface, lambda x: x + np.array([0.0, 0.0, 0.01]), 30.0)
    assert report.n_corners == np.count_nonzero(~inside)  # the rim
    assert_array_equal(moved.points[:, 2], np.where(inside, 0.01, 0.0))


def test_projections_by_tag_move_their_facets_only():
    mesh = structured_square(6, half_width=1.0)
    middle = mesh.points[mesh.facets].mean(axis=1)
    right, inner = (np.abs(middle[:, 0] - x) < 1e-12 for x in (1.0, 0.0))
    facets = np.concatenate([mesh.facets[right], mesh.facets[inner]])
    tags = np.repeat([5, 6], [right.sum(), inner.sum()])
    tagged = SimplexMesh(mesh.points, mesh.cells, tagged_facets=facets, facet_tags=tags)
    bend = lambda x: x + np.column_stack([0.05 * (1.0 - x[:, 1] ** 2), 0 * x[:, 1]])  # noqa: E731
    for tag, at in ((5, 1.0), (6, 0.0)):  # the second inside the domain
        moved, report = move_to_boundary(tagged, {tag: bend}, 30.0)
        changed = (moved.points != mesh.points).any(axis=1)
        expected = (mesh.points[:, 0] == at) & (np.abs(mesh.points[:, 1]) < 1.0)
        assert_array_equal(changed, expected)
        assert report.n_nodes == 5
        assert_array_equal(moved.facet_tags, tags)


def test_triangles_in_space_do_not_fold():
    mesh = random_sphere(200, SEED)
    moved, report = move_to_boundary(mesh, lambda x: x[::-1], 60.0)
    assert report.n_shortened > 100
    normals = [
        np.cross(*np.diff(m.points[m.cells], axis=1).transpose(1, 0, 2)) for m in (mesh, moved)
    ]
    assert (np.einsum("nd,nd->n", *normals) > 0.0).all()


def test_a_boundary_that_drifts_off_is_reported(monkeypatch, generator):
    monkeypatch.setattr("adaptsize.adaptation.new_mesh.boundary_distance", lambda *a: 9.0)
    with pytest.warns(ResolutionWarning, match="pass project= for a curved boundary"):
        adapt(structured_square(4, half_width=1.0), h0=0.2)


def test_a_node_where_a_tag_ends_stays():
    mesh = structured_square(6, half_width=1.0)
    middle = mesh.points[mesh.facets].mean(axis=1)
    upper_right = (np.abs(middle[:, 0] - 1.0) < 1e-12) & (middle[:, 1] > 0.0)
    facets = mesh.facets[upper_right]
    tagged = SimplexMesh(
        mesh.points, mesh.cells, tagged_facets=facets, facet_tags=np.full(len(facets), 5)
    )
    moved, report = move_to_boundary(tagged, {5: lambda x: x + np.array([0.01, 0.0])}, 30.0)
    changed = (moved.points != mesh.points).any(axis=1)
    y = mesh.points[:, 1]
    assert_array_equal(changed, (mesh.points[:, 0] == 1.0) & (y > 1e-9) & (y < 1.0))
    assert (report.n_nodes, report.n_corners) == (2, 2)


def icosahedron_in_a_box():
    """Tetrahedra in a box and in an icosahedron, whose facets are the interface, and turn by 42."""
    t = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [[0, s, r * t] for s in (-1, 1) for r in (-1, 1)]
    corners = np.array([np.roll(x, k) for x in corners for k in range(3)])
    axis = [-2.0, 0.0, 2.0]
    box = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    corners = corners / np.hypot(1.0, t)
    points = np.vstack([corners, box])
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    while (long := mesh.edge_lengths > 0.6).any():
        mesh = bisect_edges(mesh, mesh.edges[long]).mesh
    walls = ConvexHull(corners).equations
    inside = (mesh.points[mesh.cells].mean(axis=1) @ walls[:, :3].T < -walls[:, 3]).all(axis=1)
    facets, nodes = interfaces(SimplexMesh(mesh.points, mesh.cells, cell_tags=1 + inside))
    tags = {"tagged_facets": nodes[facets.cells], "facet_tags": np.full(facets.n_cells, 7)}
    return SimplexMesh(mesh.points, mesh.cells, cell_tags=1 + inside, **tags)


def test_coarse_facets_of_a_smooth_interface_are_no_ridges_and_cells_beside_them_follow():
    mesh = icosahedron_in_a_box()
    to_sphere = {7: lambda x: x / np.linalg.norm(x, axis=1)[:, None]}
    on_interface = np.unique(mesh.tagged_facets)
    assert np.linalg.norm(mesh.points[on_interface], axis=1).min() < 0.81
    # Cells of edges of .6 are not changed by moves of .2 at once.
    once, report = move_to_boundary(mesh, to_sphere, 30.0)
    assert report.n_corners == 0
    assert report.n_shortened <= 0.2 * report.n_nodes
    moved, report = move_to_boundary(once, to_sphere, 30.0)
    assert (report.n_corners, report.n_shortened, report.idle) == (0, 0, ())
    on_sphere = np.linalg.norm(moved.points[on_interface], axis=1)
    assert_allclose(on_sphere, 1.0, rtol=1e-12)
    sound = np.abs(mesh.signed_measures) > 1e-10  # not the flat cells of four nodes on a circle
    assert (moved.signed_measures * mesh.signed_measures > 0.0)[sound].all()
    at_walls = np.unique(mesh.boundary().nodes)
    assert_array_equal(moved.points[at_walls], mesh.points[at_walls])


@pytest.mark.parametrize("turn", [20.0, 40.0, 80.0])
def test_ridges_of_the_projected_surface_stay(turn):
    slope = np.tan(np.radians(turn / 2.0))
    square = structured_square(4, half_width=1.0)
    roof = lambda x: np.column_stack([x[:, :2], -slope * np.abs(x[:, 0])])  # noqa: E731
    mesh = SimplexMesh(roof(square.points), square.cells)
    lifted, report = move_to_boundary(mesh, lambda x: roof(x) + np.array([0.0, 0.0, 0.01]), 30.0)
    on_ridge = (square.points[:, 0] == 0.0) & (np.abs(square.points[:, 1]) < 1.0)
    moved = (lifted.points != mesh.points).any(axis=1)
    assert moved[on_ridge].all() if turn < 30.0 else not moved[on_ridge].any()
    assert report.n_nodes == (9 if turn < 30.0 else 6)


def test_projections_are_for_tags_or_names_that_the_mesh_has():
    mesh = structured_square(4, half_width=1.0)
    wall = mesh.facets[mesh.facet_cell_counts == 1]
    tags = np.where(mesh.points[wall].mean(axis=1)[:, 0] == 1.0, 5, 6)
    tagged = SimplexMesh(
        mesh.points, mesh.cells, tagged_facets=wall, facet_tags=tags, tag_names={(1, 5): "right"}
    )
    for key, found in ((7, "7"), ("left", "'left'")):
        with pytest.raises(ValueError, match=re.escape(f"(5 ('right'), 6), got {found}")):
            adapt(tagged, h0=0.2, project={key: to_circle})
    with pytest.raises(ValueError, match=r"project must be a callable .* got {}"):
        adapt(tagged, h0=0.2, project={})
    assert as_boundary_maps({"right": to_circle}, tagged) == {5: to_circle}
    assert as_boundary_maps({6: to_circle, "right": abs}, tagged) == {6: to_circle, 5: abs}


def test_a_tag_has_one_projection():
    mesh = structured_square(2)
    wall = mesh.facets[mesh.facet_cell_counts == 1]
    tags = {"tagged_facets": wall, "facet_tags": np.ones(len(wall), int)}
    tagged = SimplexMesh(mesh.points, mesh.cells, tag_names={(1, 1): "wall"}, **tags)
    for keys in (("wall", 1), (1, "wall")):
        with pytest.raises(
            ValueError, match=r"one function for each tag, got two for 1 \('wall'\)"
        ):
            as_boundary_maps(dict.fromkeys(keys, to_circle), tagged)


def test_only_projections_for_nodes_that_stay_by_their_kind_are_reported(monkeypatch):
    points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    corners = SimplexMesh(points, [[0, 1, 2], [0, 2, 3]])
    monkeypatch.setattr(
        "adaptsize.adaptation.new_mesh.trial", lambda *a, **k: Remeshed(corners, None)
    )
    monkeypatch.setattr("adaptsize.remeshing.protocol.find_spec", lambda package: True)
    with pytest.warns(ResolutionWarning, match="project has no effect: no node may move"):
        adapt(structured_square(4, half_width=1.0), h0=1.9, project=lambda x: x, backend="mmg")
    on_it, report = move_to_boundary(disc(5), to_circle, 30.0)
    for made in (report, move_to_boundary(on_it, to_circle, 30.0)[1]):
        assert (made.n_nodes > 20, made.idle) == (True, ())
    square = structured_square(4, half_width=1.0)  # the identity for straight sides
    assert move_to_boundary(square, lambda x: x, 30.0)[1].idle == ()
