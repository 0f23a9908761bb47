"""Sizes chosen from a part, the refined surface they live on, and summaries."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from implicit_domains import disc
from meshes import jittered_cube, random_sphere, random_square, structured_square
from numpy.testing import assert_allclose
from shapes import block

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    SimplexMesh,
    SizeFunction,
    limit_gradient,
    read,
    size_function,
)
from adaptsize.background.splitting import split_edges
from adaptsize.errors import InputWarning, ResolutionWarning

DATA = Path(__file__).parents[2] / "data"


def cylinder(n, *, radius=1.0, height=20.0):
    """A closed cylinder as CAD programs export it: n long strips, caps as fans."""
    angle = 2 * np.pi * np.arange(n) / n
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([np.c_[ring, np.zeros(n)], np.c_[ring, np.full(n, height)]])
    cells = []
    for i in range(n):
        j = (i + 1) % n
        cells += [[i, j, j + n], [i, j + n, i + n]]
    for i in range(1, n - 1):
        cells += [[0, i + 1, i], [n, n + i, n + i + 1]]
    return SimplexMesh(points, cells)


# --- splitting edges --------------------------------------------------------------


@pytest.mark.parametrize("seed", [611, 612, 613])
def test_splitting_keeps_area_orientation_and_boundary(seed):
    mesh = random_square(60, seed)
    flipped = np.random.default_rng(seed).random(mesh.n_cells) < 0.5
    cells = np.where(flipped[:, None], mesh.cells[:, [1, 0, 2]], mesh.cells)
    mesh = SimplexMesh(mesh.points, cells, cell_tags=flipped)
    chosen = np.random.default_rng(seed + 10).random(len(mesh.edges)) < 0.5
    split = split_edges(mesh, chosen)
    new = split.mesh
    assert new.n_points == mesh.n_points + chosen.sum()
    assert new.n_cells == mesh.n_cells + chosen[mesh.cell_facets].sum()  # one more per new node
    for tag, sign in ((0, 1.0), (1, -1.0)):
        before = mesh.signed_measures[mesh.cell_tags == tag]
        after = new.signed_measures[new.cell_tags == tag]
        assert np.sign(after).tolist() == [np.sign(before[0])] * len(after)
        assert after.sum() == pytest.approx(before.sum(), rel=1e-12)
        assert sign * before[0] * np.sign(before[0]) * sign > 0
    assert (new.facet_cell_counts <= 2).all()  # conforming
    n_split_on_boundary = (mesh.facet_cell_counts[chosen] == 1).sum()
    assert (new.facet_cell_counts == 1).sum() == (
        (mesh.facet_cell_counts == 1).sum() + n_split_on_boundary
    )


def test_splitting_wants_triangles():
    with pytest.raises(ValueError, match="must consist of triangles"):
        split_edges(jittered_cube(3, 615), np.ones(1, bool))


# --- sizes on surfaces ------------------------------------------------------------


def test_cad_cylinder_is_fine_all_along_and_coarse_in_the_middle_of_its_caps():
    radius = 10.0
    mesh = cylinder(48, radius=radius, height=60.0)
    size = size_function(mesh, elements_per_radian=5.0, g=0.25, hmax=8.0, tolerance=np.inf)
    # On the side h = R / K, also in the middle, 30 from the next node of the file; the
    # facets lie up to R (1 - cos(pi / 48)) inside the circle.
    angle = np.linspace(0.1, 6.1, 40)
    side = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(40, 30.0)])
    wanted = radius / 5.0
    np.testing.assert_allclose(size(side), wanted, rtol=0.15)
    # In the middle of a cap the exact size is R / K + g R; along edges it may be more, and
    # linear interpolation on edges of up to twice the size blurs it.
    middle = size(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 60.0]]))
    assert (middle > wanted + 0.6 * 0.25 * radius).all()
    assert (middle <= 8.0).all()


def test_sizes_are_limited_along_the_edges_of_the_refined_surface():
    size = size_function(cylinder(32, radius=5.0), g=0.2)
    mesh, h = size.background, size.values
    i, j = mesh.edges.T
    assert (np.abs(h[i] - h[j]) <= 0.2 * mesh.edge_lengths * (1 + 1e-12)).all()
    # Edges were compared with sizes before these were lowered to those around, through the solid.
    assert (mesh.edge_lengths <= 2.1 * h[mesh.edges].min(axis=1)).all()
    assert mesh.measures.sum() == pytest.approx(cylinder(32, radius=5.0).measures.sum())


@pytest.mark.parametrize("method", ["auto", "fast-marching"])
def test_the_bound_holds_on_the_slivers_of_a_cad_surface(method):
    # Halved twice without flips: nodes depend on each other in circles (policy iteration).
    mesh = read(DATA / "bracket.stl")
    for _ in range(2):
        mesh = split_edges(mesh, mesh.edge_lengths > 4.0).mesh
    h0 = np.where(mesh.points[:, 2] < 1.0, 0.5, 6.0)
    _, info = limit_gradient.with_info(mesh, h0, 0.25, method=method)
    assert info.largest_edge_slope <= 1.0 + 1e-9


def test_defaults_are_shares_of_the_diameter_and_given_values_are_kept():
    mesh = random_sphere(400, 616, radius=3.0)
    report = size_function(mesh).report
    assert report.hmax == pytest.approx(mesh.diameter / 20)
    assert report.hmin == pytest.approx(mesh.diameter / 1000)
    assert (report.elements_per_radian, report.elements_across) == (4.0, 2.0)
    size = size_function(mesh, elements_per_radian=2.0, hmin=0.5, hmax=1.0)
    given = size.report
    assert (given.elements_per_radian, given.hmin, given.hmax) == (2.0, 0.5, 1.0)
    assert size.values.min() >= 0.5
    assert size.values.max() <= 1.0


@pytest.mark.parametrize("kind", ["surface", "plane", "level set", "closed line"])
def test_every_kind_of_domain_keeps_to_the_number_of_elements(kind):
    square = structured_square(8)
    domain, options = {
        "surface": (random_sphere(400, 616, radius=3.0), {}),
        "plane": (square, {}),
        "level set": (disc, {"box": ([-1.1, -1.1], [1.1, 1.1])}),
        "closed line": (square.boundary().mesh, {}),
    }[kind]
    free = size_function(domain, **options).report
    kept = size_function(domain, **options, max_elements=0.5 * free.n_elements).report
    assert kept.n_elements <= 1.02 * 0.5 * free.n_elements
    assert kept.relaxation > free.relaxation == 1.0
    with pytest.warns(
        ResolutionWarning, match=r"hmax controls \d+% of them, given parameters: hmax"
    ):
        size_function(domain, **options, hmax=1e-2, max_elements=10.0)


def test_the_number_is_kept_where_narrow_regions_get_less_than_one_element():
    # A plate 100 x 60 x 1: with one element across, 60 000.
    cube = block(1).boundary().mesh
    plate = SimplexMesh(cube.points * [100.0, 60.0, 1.0], cube.cells)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = size_function(plate, max_elements=30_000).report
    assert report.n_elements <= 1.02 * 30_000


def test_given_sizes_that_ask_for_too_much_do_not_relax_the_others_to_nothing():
    with pytest.warns(ResolutionWarning, match="max_elements"):
        report = size_function(jittered_cube(3, 622), hmax=1e-3).report
    assert report.n_elements > 300_000
    assert report.elements_per_radian == 1.0


def test_sources_and_bounds_are_heeded_and_hmin_is_not_undercut():
    mesh = jittered_cube(6, 618)
    source = BoxSource([-50, -50, -50], [0, 0, 0], 3.0)
    h0 = np.full(mesh.n_points, np.inf)
    h0[-1] = 1e-3
    size = size_function(mesh, hmin=2.0, hmax=20.0, sources=[source], h0=h0, max_elements=np.inf)
    assert size.values[-1] == 2.0
    assert size(np.array([[-25.0, -25.0, -25.0]]))[0] == pytest.approx(3.0, rel=0.05)


def test_sizes_on_a_surface_grow_into_what_it_encloses():
    cube = jittered_cube(9, 619)
    surface = cube.boundary().mesh
    size = size_function(
        surface, elements_per_radian=0.0, elements_across=0.0, g=0.1, hmin=9.0, hmax=10.0
    )
    depth = 50.0 - np.abs(cube.points).max(axis=1)
    assert_allclose(size(cube.points), 10.0)  # and no farther than hmax
    free = SizeFunction(surface, np.full(surface.n_points, 10.0), g=0.1)
    assert_allclose(free(cube.points), 10.0 + 0.1 * depth, rtol=1e-12)


# --- tolerance ----------------------------------------------------------------------


def test_sizes_on_round_surfaces_allow_the_tolerance():
    radius = 10.0
    mesh = cylinder(60, radius=radius)
    options = {"elements_across": 0, "hmax": 20.0, "g": 9.0}
    for tolerance in (1e-4, 1e-3):
        size = size_function(mesh, tolerance=tolerance, **options)
        report = size.report
        expected = min(2.0 * np.sqrt(tolerance * mesh.diameter * radius), radius / 4.0)
        assert_allclose(size(mesh.points), expected, rtol=0.02)
        assert report.tolerance == tolerance
        assert f"tolerance {tolerance:g}" in report.choices
    for default in ({}, *({"elements_per_radian": k} for k in (4.0, 2.0, 0.0))):
        other = size_function(mesh, **default, **options)
        assert_allclose(other(mesh.points), size(mesh.points))
    size = size_function(mesh, tolerance=np.inf, **options)
    assert_allclose(size(mesh.points), radius / 4.0, rtol=0.02)


def test_without_elements_per_radian_the_tolerance_alone_bounds_the_sizes_on_a_disc():
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    points = np.vstack([np.transpose([np.cos(angle), np.sin(angle)]), [[0.0, 0.0]]])
    disc = SimplexMesh(points, [[i, (i + 1) % 40, 40] for i in range(40)])
    off = dict.fromkeys(("elements_per_radian", "elements_across", "elements_between"), 0.0)
    options = {**off, "g": 0.25, "hmax": 2.0}
    size = size_function(disc, **options)
    report = size.report
    expected = 2.0 * np.sqrt(1e-3 * disc.diameter)
    assert_allclose(size.values[:40], expected, rtol=0.01)
    assert size.values[40] == pytest.approx(size.values[0] + 0.25, rel=0.01)
    assert report.choices.startswith("tolerance 0.001, g = 0.25, ")
    assert (size_function(disc, tolerance=np.inf, **options).values == 2.0).all()


def test_the_default_tolerance_is_relaxed_for_the_number_of_elements_and_reported():
    mesh = cylinder(60, radius=10.0)
    report = size_function(mesh, max_elements=2000).report
    assert report.n_elements <= 2000
    assert report.tolerance == pytest.approx(1e-3 * report.relaxation**2)
    assert report.relaxation > 1.0


def test_a_relaxed_tolerance_is_not_larger_than_the_sizes_require():
    mesh = cylinder(60, radius=10.0)
    options = {"elements_per_radian": 6.0, "elements_across": 0.0, "g": 1.0, "max_elements": 4000}
    report = size_function(mesh, **options).report
    # Chords of length l leave l^2 / (8 r); edges may be longer than the size by sqrt 2.
    assert report.tolerance == pytest.approx((10.0 / 6.0) ** 2 / (4.0 * 10.0 * mesh.diameter))
    assert report.tolerance < 0.7e-3 * report.relaxation**2


# --- tags of edges ----------------------------------------------------------------


def test_splitting_halves_tagged_edges_and_keeps_those_that_are_not_edges_of_the_mesh():
    mesh = SimplexMesh(
        [[0, 0], [2, 0], [2, 2], [0, 2]],
        [[0, 1, 2], [0, 2, 3]],
        tagged_facets=[[1, 0], [2, 1], [1, 3]],
        facet_tags=[7, 8, 9],
    )
    new = split_edges(mesh, (mesh.edges == [0, 1]).all(axis=1)).mesh
    found = {
        (*sorted(edge), tag) for edge, tag in zip(new.tagged_facets, new.facet_tags, strict=True)
    }
    assert found == {(0, 4, 7), (1, 4, 7), (1, 2, 8), (1, 3, 9)}


def test_a_size_along_a_tagged_edge_of_a_surface_is_kept_by_its_refinement():
    plain = cylinder(12)
    part = SimplexMesh(plain.points, plain.cells, tagged_facets=[[0, 12]], facet_tags=[5])
    along = BoundarySource(0.3, tags=5)
    only = {"elements_per_radian": 0, "elements_across": 0, "tolerance": np.inf}
    size = size_function(part, sources=along, hmax=2.0, **only)
    assert_allclose(size(np.linspace([1.0, 0.0, 0.0], [1.0, 0.0, 20.0], 9)), 0.3)


# --- sources off the surface ------------------------------------------------------


@pytest.mark.parametrize(
    "source",
    [
        PointSource([0.0, 0.0, 10.0], 0.1),
        CurveSource([[0, 0, 5], [0, 0, 15]], 0.1),
        BallSource([0, 0, 10], 0.2, 0.1),
        BoxSource([-0.1, -0.1, 9], [0.1, 0.1, 11], 0.1),
    ],
)
def test_a_source_that_no_node_of_the_surface_is_near_is_reported(source):
    kind = type(source).__name__
    with pytest.warns(InputWarning, match=rf"{kind} requests the size 0\.1 at \(0, 0, .*off the"):
        size_function(cylinder(12), sources=source, hmax=2, elements_across=0)


def test_sources_on_the_surface_or_below_hmin_are_not_reported():
    at_node = PointSource([1.0, 0.0, 0.0], 0.1)
    size = size_function(cylinder(12), sources=[at_node], hmax=2, elements_across=0)
    assert size([[1.0, 0.0, 0.0]]) == pytest.approx(0.1)
    # hmin makes the size there, not the distance.
    size_function(cylinder(12), sources=BallSource([0, 0, 10], 2.0, 0.1), hmin=1, hmax=1)
