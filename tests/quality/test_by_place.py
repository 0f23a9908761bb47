"""Requested elements that are served, against closed forms and a slow count of random points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube
from scipy.spatial import Delaunay

from adaptsize import (
    BoxSource,
    CartesianGrid,
    SimplexMesh,
    SizeFunction,
    check_mesh,
    limit_gradient,
    size_conformity,
    size_function,
)
from adaptsize.background.bisection import resolved
from adaptsize.errors import ResolutionWarning
from adaptsize.metrics import Metric
from adaptsize.quality.by_place import RequestedElements
from adaptsize.quality.requests import unserved
from adaptsize.remeshing.delivery import warn_of_lacks
from adaptsize.sizes import predict

G = 0.25
BAND = (np.sqrt(0.5), np.sqrt(2.0))
SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])


def grid_of_triangles(n, length=1.0):
    return CartesianGrid([0.0, 0.0], length / n, (n + 1, n + 1)).mesh


def box_distance(x, lower, upper):
    return np.linalg.norm(x - np.clip(x, lower, upper), axis=1)


def judged_slowly(mesh, size, n, seed):
    """Return served, too coarse and the number of elements, of n points in each cell.

    Points are uniform in the cell, and weighted by h^-d: the definition, without bisection.
    """
    rng, d = np.random.default_rng(seed), mesh.cell_dim
    density = {1: 1.0, 2: 4.0 / np.sqrt(3.0), 3: 6.0 * np.sqrt(2.0)}[d]
    corners = [mesh.points[cell] for cell in mesh.cells]
    edges = np.array(
        [np.mean([np.linalg.norm(a - b) for i, a in enumerate(x) for b in x[:i]]) for x in corners]
    )
    drawn = np.concatenate([rng.dirichlet(np.ones(d + 1), n) @ x for x in corners])
    h = size(drawn).reshape(mesh.n_cells, n)
    weight = density * mesh.measures[:, None] * h ** (-float(d)) / n
    ratio, total = edges[:, None] / h, weight.sum()
    near = weight[(ratio >= BAND[0]) & (ratio <= BAND[1])].sum()
    return near / total, weight[ratio > BAND[1]].sum() / total, total


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["segments", "plane", "surface", "tetrahedra"]),
    st.floats(0.005, 0.1),
)
@settings(deadline=None, max_examples=15)
def test_shares_are_those_of_random_points_of_the_density(seed, kind, least):
    rng = np.random.default_rng(seed)
    mesh = {
        "segments": lambda: SimplexMesh(
            np.sort(rng.random(40))[:, None], np.column_stack([np.arange(39), np.arange(1, 40)])
        ),
        "plane": lambda: grid_of_triangles(6),
        "surface": lambda: jittered_cube(3, seed).boundary().mesh,
        "tetrahedra": lambda: jittered_cube(3, seed),
    }[kind]()
    mesh = SimplexMesh(mesh.points / np.ptp(mesh.points, axis=0), mesh.cells)
    place = rng.random(mesh.dim)

    def cone(x):
        return least + G * np.linalg.norm(x - place, axis=1)

    # A size function on the mesh itself would be linear.  On a point it grows by g everywhere.
    points = SimplexMesh(np.array([place, place]), [[0, 1]])
    size = cone if mesh.dim == 1 else SizeFunction(points, [least, least], g=G)
    found = RequestedElements.of(mesh, size).served()
    served, coarse, elements = judged_slowly(mesh, cone, 500, seed)
    assert found.served == pytest.approx(served, abs=0.05)
    assert found.too_coarse == pytest.approx(coarse, abs=0.05)
    assert found.elements == pytest.approx(elements, rel=0.1)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
@settings(deadline=None, max_examples=15)
def test_nodal_sizes_are_linear_in_the_cells(seed, dim):
    rng = np.random.default_rng(seed)
    n = {1: 60, 2: 8, 3: 3}[dim]
    mesh = CartesianGrid([0.0] * dim, 1.0 / n, (n + 1,) * dim).mesh
    h = np.exp(rng.uniform(-4.0, 0.5, mesh.n_points))
    found = RequestedElements.of(mesh, h).served()
    served, coarse, _ = judged_slowly(mesh, SizeFunction(mesh, h), 500, seed)
    assert found.served == pytest.approx(served, abs=0.05)
    assert found.too_coarse == pytest.approx(coarse, abs=0.05)
    assert found.elements == pytest.approx(predict(mesh, h).cells, rel=0.05)


@pytest.mark.parametrize("kind", ["nodal", "number", "function", "on a grid"])
@pytest.mark.parametrize(
    ("factor", "served", "coarse"), [(1.0, 1.0, 0.0), (1.6, 0.0, 1.0), (0.6, 0.0, 0.0)]
)
def test_a_uniform_mesh_of_a_constant_size(kind, factor, served, coarse):
    mesh = grid_of_triangles(8)
    mean = (2.0 + np.sqrt(2.0)) / 3.0 / 8.0
    h = mean / factor
    size = {
        "nodal": np.full(mesh.n_points, h),
        "number": h,
        "function": lambda x: np.full(len(x), h),
        "on a grid": SizeFunction(CartesianGrid([0.0, 0.0], 1.0, (2, 2)), np.full((2, 2), h)),
    }[kind]
    found = size_conformity(mesh, size)
    assert (found.served, found.too_coarse) == (pytest.approx(served), pytest.approx(coarse))
    assert found.worst.size == pytest.approx(h)
    assert found.worst.edge == pytest.approx(mean)
    elements = RequestedElements.of(mesh, size).served().elements
    assert elements == pytest.approx(4.0 / np.sqrt(3.0) / h**2)


LOWER, UPPER = np.array([995.0, 995.0]), np.array([1005.0, 1005.0])


def lost_box():
    """Return a mesh that is right but for a box, where its edges are 5.4, and both sizes."""
    square = SimplexMesh(2000.0 * SQUARE.points, SQUARE.cells)
    h = [lambda x, s=s: np.minimum(s + G * box_distance(x, LOWER, UPPER), 100.0) for s in (0.5, 5)]
    coarse = resolved(square, h[1], g=G, factor=1.9, accuracy=0.0).mesh
    fine = resolved(square, h[0], g=G, factor=1.9, accuracy=0.0).mesh
    return coarse, fine, h[0]


@pytest.mark.parametrize("kind", ["sources", "function"])
def test_elements_that_were_not_made_are_missed(kind):
    coarse, fine, h = lost_box()
    size = h
    if kind == "sources":  # the size function of a background that is resolved in the box
        size = size_function(fine, sources=BoxSource(LOWER, UPPER, 0.5), hmax=100.0, hmin=0.5, g=G)
    else:
        size = SizeFunction(fine, h(fine.points))
    found = size_conformity(coarse, size)
    in_box = box_distance(coarse.points[coarse.cells].mean(axis=1), LOWER, UPPER) == 0.0
    edges = [np.linalg.norm(x[a] - x[b]) for x in coarse.points[coarse.cells[in_box]]
             for a, b in ((0, 1), (1, 2), (2, 0))]  # fmt: skip
    assert 2.0 < np.mean(edges) < 8.0
    assert found.share_in_band > 0.8  # the edges that are there say nothing
    assert found.served < 0.4
    assert found.too_coarse > 0.6
    worst = np.array([found.worst.point])
    assert box_distance(worst, LOWER, UPPER) < 0.5
    assert found.worst.size == pytest.approx(0.5, rel=0.2)
    assert found.worst.edge > 2.0
    assert found.worst.cause == ("sources" if kind == "sources" else None)
    check = check_mesh(coarse, size=size)
    assert [requirement.name for requirement in check.failures] == ["served"]
    places = np.array([place.point for place in check.failures[0].places])
    assert (box_distance(places, LOWER, UPPER) < 10.0).all()
    assert "% too coarse, 80% required" in check.failures[0].text
    lines = unserved(RequestedElements.of(coarse, size), size)
    assert [one.what for one in lines] == ["sources" if kind == "sources" else "sizes"]
    assert "where the size 0.5 is requested" in str(lines[0])
    right = size_conformity(fine, size)
    assert right.served > 0.9
    assert check_mesh(fine, size=size).is_met
    assert unserved(RequestedElements.of(fine, size), size) == []


def test_each_request_is_judged_on_its_own():
    # Two boxes.  The large one is served, and has nearly all elements.
    large, small = ([0.1, 0.1], [0.5, 0.5]), ([0.8, 0.8], [0.81, 0.81])
    given = [BoxSource(*large, 0.01), BoxSource(*small, 0.002)]

    def h(x):
        near = [source.size + G * box_distance(x, source.lower, source.upper) for source in given]
        return np.minimum(np.minimum(*near), 0.2)

    def without(x):
        return np.minimum(0.01 + G * box_distance(x, *large), 0.2)

    background = resolved(SQUARE, h, g=G, factor=1.9, accuracy=0.0).mesh
    size = size_function(background, sources=given, g=G, hmax=0.2, hmin=0.002,
                         elements_across=0.0, elements_between=0.0)  # fmt: skip
    mesh = resolved(SQUARE, without, g=G, factor=1.9, accuracy=0.0).mesh
    elements = RequestedElements.of(mesh, size)
    assert elements.served().served > 0.8
    found = unserved(elements, size)
    assert [one.what for one in found] == ["sources"]
    assert box_distance(np.array([found[0].found.worst.point]), *small) < 0.01
    assert found[0].found.too_coarse > 0.5


def test_nothing_depends_on_position_scale_and_order():
    coarse, fine, h = lost_box()
    size = SizeFunction(fine, h(fine.points))
    found = size_conformity(coarse, size)
    rng, turn = np.random.default_rng(4), np.linalg.qr([[2.0, 1.0], [-1.0, 2.0]])[0]
    order = rng.permutation(coarse.n_cells)
    other = size_conformity(
        SimplexMesh(0.01 * coarse.points @ turn + 3.0, coarse.cells[order]),
        SizeFunction(SimplexMesh(0.01 * fine.points @ turn + 3.0, fine.cells), 0.01 * size.values),
    )
    assert other.served == pytest.approx(found.served, abs=2e-3)
    assert other.too_coarse == pytest.approx(found.too_coarse, abs=2e-3)
    assert other.worst.ratio == pytest.approx(found.worst.ratio, rel=0.05)


def test_work_is_bounded_where_far_too_few_cells_were_made():
    found = RequestedElements.of(SQUARE, lambda x: np.full(len(x), 1e-7), max_points=1000)
    assert len(found.sizes) < 3 * 8000
    served = found.served()
    assert served.too_coarse == 1.0
    assert served.elements == pytest.approx(4.0 / np.sqrt(3.0) * 1e14, rel=1e-6)


def test_places_without_a_bound_request_nothing():
    mesh = grid_of_triangles(4)
    h = np.where(mesh.points[:, 0] > 0.5, np.inf, 0.3)
    found = size_conformity(mesh, h)
    assert found.served == 1.0
    elements = RequestedElements.of(mesh, h).served().elements
    assert elements == pytest.approx(4.0 / np.sqrt(3.0) * 0.5 / 0.3**2)


def test_a_place_that_few_edges_show_is_warned_of():
    """More than half of the elements are requested in one cell of 20 000."""
    middle, radius, rng = np.array([0.5053, 0.5027]), 0.003, np.random.default_rng(1)
    angle = rng.uniform(0.0, 2.0 * np.pi, 5000)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    inside = middle + radius * np.sqrt(rng.random((5000, 1))) * around
    outside = [middle + radius * 1.12**k * around[60 * k : 60 * k + 60] for k in range(1, 39)]
    points = np.concatenate([grid_of_triangles(100).points, inside, *outside]).clip(0.0, 1.0)
    base, mesh = SimplexMesh(points, Delaunay(points).simplices), grid_of_triangles(100)
    is_in = np.linalg.norm(points - middle, axis=1) <= radius
    size = SizeFunction(base, limit_gradient(base, np.where(is_in, 5e-5, 0.0105), 0.5))
    with pytest.warns(ResolutionWarning, match=r"sizes: 5\d% of about 4\d000 requested elements"):
        warn_of_lacks(mesh, size, size, base)


@pytest.mark.parametrize("cell", [0, 7001, 14002, 19999])
def test_a_sample_of_cells_has_those_that_request_most_of_a_metric(cell):
    base = grid_of_triangles(100)
    h = np.full(base.n_points, 0.02)
    h[base.cells[cell]] = 2e-4
    size = SizeFunction(base, h)

    def metric(points):
        return Metric.isotropic(size(points), 2)

    mesh = grid_of_triangles(50)
    whole, some = (RequestedElements.of_metric(mesh, metric, base, n) for n in (None, 200))
    assert len(some.points) < 0.2 * len(whole.points)
    one, other = whole.served(), some.served()
    assert one.too_coarse > 0.3
    assert other.elements == pytest.approx(one.elements, rel=0.02)
    assert other.too_coarse == pytest.approx(one.too_coarse, abs=0.02)
    assert other.worst.ratio == pytest.approx(one.worst.ratio, rel=1e-9)
