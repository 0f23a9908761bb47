"""Sizes chosen from a part, the refined surface they live on, and summaries."""

from types import SimpleNamespace

import numpy as np
import pytest
from distance_shapes import ball
from meshes import jittered_cube, random_sphere, random_square, structured_square
from numpy.testing import assert_allclose
from solids import cylinder

from adaptsize import BoxSource, SimplexMesh, SizeFunction, size_function
from adaptsize.background.splitting import split_edges
from adaptsize.domain_size import tuning
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.refined_surface import RefinedSurface
from adaptsize.domain_size.request import Request
from adaptsize.errors import TooManyElementsError
from adaptsize.options import SizeFunctionOptions, checked

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
    for tag in (0, 1):
        before = mesh.signed_measures[mesh.cell_tags == tag]
        after = new.signed_measures[new.cell_tags == tag]
        assert np.sign(after).tolist() == [np.sign(before[0])] * len(after)
        assert after.sum() == pytest.approx(before.sum(), rel=1e-12)
    assert (new.facet_cell_counts <= 2).all()  # conforming
    n_split_on_boundary = (mesh.facet_cell_counts[chosen] == 1).sum()
    assert (new.facet_cell_counts == 1).sum() == (
        (mesh.facet_cell_counts == 1).sum() + n_split_on_boundary
    )


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


@pytest.mark.parametrize("kind", ["surface", "plane", "level set", "closed line"])
def test_every_kind_of_domain_keeps_to_the_number_of_elements(kind):
    square = structured_square(8)
    domain, options, hmax = {
        "surface": (random_sphere(400, 616, radius=3.0), {}, 0.05),
        "plane": (square, {}, 0.5),
        "level set": (ball(1.0), {"box": ([-1.1, -1.1], [1.1, 1.1])}, 0.05),
        "closed line": (square.boundary().mesh, {}, 0.5),
    }[kind]
    free = size_function(domain, **options).report
    kept = size_function(domain, **options, max_elements=0.5 * free.n_elements).report
    assert kept.n_elements <= 1.02 * 0.5 * free.n_elements
    assert kept.relaxation > free.relaxation == 1.0
    with pytest.raises(
        TooManyElementsError,
        match=r"max_elements = 10: hmax controls \d+% of the elements, given parameters: hmax;",
    ):
        size_function(domain, **options, hmax=hmax, max_elements=10.0)


def test_sources_and_bounds_are_heeded_and_hmin_is_not_undercut():
    mesh = jittered_cube(6, 618)
    source = BoxSource([-50, -50, -50], [0, 0, 0], 3.0)
    h0 = np.full(mesh.n_points, np.inf)
    h0[-1] = 1e-3
    size = size_function(mesh, hmin=2.0, hmax=20.0, sources=[source], h0=h0, max_elements=np.inf)
    assert size.values[mesh.n_points - 1] == 2.0
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
    mesh = cylinder(60, radius, 5.0)
    options = {"elements_across": 0, "hmax": 3.0, "g": 9.0}
    for tolerance in (3e-4, 1e-3):
        size = size_function(mesh, tolerance=tolerance, **options)
        report = size.report
        expected = min(np.sqrt(6.0 * tolerance * mesh.diameter * radius), radius / 4.0)
        assert_allclose(size(mesh.points), expected, rtol=0.02)
        assert report.tolerance == tolerance
        assert f"tolerance {tolerance:g}" in report.choices
    for default in ({}, *({"elements_per_radian": k} for k in (4.0, 2.0, 0.0))):
        other = size_function(mesh, **default, **options)
        assert_allclose(other(mesh.points), size(mesh.points))
    size = size_function(mesh, tolerance=np.inf, **options)
    assert_allclose(size(mesh.points), radius / 4.0, rtol=0.02)


def test_sizes_on_a_cone_fall_to_its_tip():
    # Curved by cos(a) / rho across the lines to the tip, which lie in facets without other nodes.
    n, height = 48, 3.0
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    around = [(i, (i + 1) % n) for i in range(n)]
    cells = [[i, j, n] for i, j in around] + [[j, i, n + 1] for i, j in around]
    cone = SimplexMesh([*ring, [0.0, 0.0, height], [0.0, 0.0, 0.0]], cells)
    size = size_function(cone, elements_per_radian=4.0)
    z = np.linspace(0.0, 0.95 * height, 20)[:, None]
    rho = (1.0 - z / height)[:, 0]
    radius = rho * np.hypot(1.0, height) / height
    expected = np.minimum(radius / 4.0, np.sqrt(6e-3 * cone.diameter * radius))
    assert_allclose(size(rho[:, None] * ring[3] + z * [0.0, 0.0, 1.0]), expected, rtol=0.2)


def test_halving_ends_where_it_makes_no_edge_shorter(monkeypatch):
    # As between slivers, where each half leaves an edge as long as the one before.
    mesh = random_sphere(400, 7)
    passes = []

    class Vain:
        def __init__(self):
            self.mesh = mesh

        def limited(self, request):
            sizes = np.full(mesh.n_points, 0.5 * mesh.edge_lengths.max())
            sizes[mesh.edges[mesh.edge_lengths.argmax()]] *= 0.9
            return SimpleNamespace(h=sizes)

        def size_of(self, limited):
            return SizeFunction(mesh, limited.h)

        def split(self, long, request):
            passes.append(int(long.sum()))
            return self

    monkeypatch.setattr(RefinedSurface, "of", lambda domain, request: Vain())
    domain = SurfaceDomain.of(mesh, 40.0)
    domain.size_for(Request.of(checked(SizeFunctionOptions, {})))
    assert passes == [1] * (tuning.PASSES_IN_VAIN + 1)
