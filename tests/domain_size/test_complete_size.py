"""The complete size function: what each cause asks for, who controls what, on every background."""

import numpy as np
import pytest
from meshes import random_sphere, random_square, structured_square
from numpy.testing import assert_allclose
from shapes import moved
from solids import circle, outline

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CartesianGrid,
    CurveSource,
    Octree,
    PointSource,
    RegionSource,
    SimplexMesh,
    SizeFunction,
    refine_at_boundary,
    size_function,
)
from adaptsize._causes import Cause
from adaptsize.domain_size import budget
from adaptsize.domain_size.bounds import Bounds
from adaptsize.domain_size.request import Request
from adaptsize.options import SizeFunctionOptions, checked

G = 0.25
BOX = ([-1.3, -1.3], [1.3, 1.3])
GRID = CartesianGrid([-1.3, -1.3], 0.02, (131, 131))


def disc(points, centre=(0.0, 0.0), radius=1.0):
    return np.linalg.norm(points - np.asarray(centre), axis=1) - radius


def strip(points, half=0.2):
    """A bar along x, 1.6 long with round ends of radius 0.2."""
    x, y = points.T
    return np.hypot(np.maximum(np.abs(x) - 0.6, 0.0), y) - half


# --- what is asked ----------------------------------------------------------------


def test_the_whole_is_the_least_of_what_each_cause_alone_gives():
    ball = PointSource([0.3, 0.1], 0.03)
    options = {"background": GRID, "g": G, "hmin": 1e-3, "hmax": 0.15}
    alone = [
        size_function(strip, elements_across=0.0, **options),
        size_function(strip, elements_per_radian=0.0, elements_across=4.0, **options),
        size_function(strip, elements_per_radian=0.0, elements_across=0.0, sources=ball, **options),
    ]
    size = size_function(strip, elements_across=4.0, sources=ball, **options)
    report = size.report
    inside = report.cause >= 0
    least = np.minimum.reduce([one.values for one in alone])
    # Limiting and minimum commute; sources on edges differ by what limiting along them rounds off.
    assert_allclose(size.values[inside], least[inside], rtol=5e-3)
    for k, name in enumerate(("curvature", "width", "sources")):
        controlled = report.cause == report.causes.index(name)
        assert controlled.any()
        assert_allclose(size.values[controlled], alone[k].values[controlled], rtol=5e-3)


@pytest.mark.parametrize("on", [{"background": GRID}, {"box": BOX}])
def test_sizes_do_not_pass_through_the_outside(on):
    def two(points):  # a small disc 0.2 beside a large one
        return np.minimum(disc(points, (-0.3, 0.0), 0.8), disc(points, (0.8, 0.0), 0.1))

    size = size_function(two, **on, elements_per_radian=4.0, elements_across=0.0, g=G, hmax=10.0)
    # 0.8 / 4 on the large disc; straight from the small one it would be 0.1 / 4 + 0.2 g.
    assert_allclose(size([[0.5, 0.0]]), 0.2, atol=0.01)
    assert_allclose(size([[0.7, 0.0]]), 0.025, atol=0.004)


@pytest.mark.parametrize("on", ["grid", "octree", "image", "solid"])
def test_the_number_of_elements_in_a_level_set_is_that_of_its_measure(on):
    options, n = {"hmin": 0.1, "hmax": 0.1}, 4.0 / np.sqrt(3.0) * np.pi / 0.1**2
    if on == "image":
        pixels = CartesianGrid([-1.3, -1.3], 0.02, (131, 131)).sample(disc) < 0.0
        size = size_function(pixels, spacing=0.02, **options)
    elif on == "solid":
        grid = CartesianGrid([-1.2] * 3, 0.06, (41, 41, 41))
        size = size_function(lambda x: disc(x, (0.0, 0.0, 0.0)), background=grid, **options)
        n = 1.22 * 6.0 * np.sqrt(2.0) * 4.0 / 3.0 * np.pi / 0.1**3
    else:
        size = size_function(
            disc, **({"background": GRID} if on == "grid" else {"box": BOX}), **options
        )
    assert size.report.n_elements == pytest.approx(n, rel=0.01)


@pytest.mark.parametrize("on", [{"background": GRID}, {"box": BOX}])
def test_default_limits_are_those_of_a_mesh_and_do_not_depend_on_the_orientation(on):
    def corner(points):
        return np.maximum(np.abs(points).max(axis=1) - 0.8, points.min(axis=1))

    def turned(points):
        c, s = np.cos(0.7), np.sin(0.7)
        return corner(points @ np.array([[c, s], [-s, c]]))

    limits = [size_function(f, **on).report for f in (corner, turned, disc)]
    assert_allclose([report.hmax for report in limits], [0.08 * 2.0**0.5] * 2 + [0.1], rtol=0.03)


def test_an_open_polyline_has_no_elements_between_features():
    points = [[0, 0], [1, 0], [1, 0.05], [0, 0.05], [0, 1]]
    report = size_function(SimplexMesh(points, [[0, 1], [1, 2], [2, 3], [3, 4]])).report
    assert "separation" not in report.causes
    assert report.elements_between == 0.0


def test_outside_sizes_go_on_as_at_the_boundary():
    size = size_function(
        disc, background=GRID, elements_per_radian=5.0, elements_across=0.0, g=G, hmax=10.0
    )
    # One box diagonal beyond the boundary at most, growing by g.
    assert_allclose(size([[1.29, 0.0], [0.9, 0.9], [5.0, 5.0]]), 0.2, atol=G * 0.03)


@pytest.mark.parametrize("given", ["array", "callable", "size function"])
def test_further_bounds_count(given):
    mesh = random_square(400, seed=98)
    values = 0.02 + 0.05 * np.abs(mesh.points[:, 0] - 0.5)
    h0 = {
        "array": values,
        "callable": lambda x: 0.02 + 0.05 * np.abs(x[:, 0] - 0.5),
        "size function": SizeFunction(mesh, values),
    }[given]
    only = {"elements_per_radian": 0.0, "elements_across": 0.0, "tolerance": np.inf}
    size = size_function(mesh, h0=h0, hmax=1.0, **only)
    report = size.report
    assert_allclose(size.values[: mesh.n_points], values, rtol=1e-12)
    assert report.domain_shares["h0"] == pytest.approx(1.0)


# --- who controls what ------------------------------------------------------------


def two_bounds(mesh):
    """Small sizes asked for on the left and on the right."""
    x = mesh.points[:, 0]
    left = np.where(x < 1e-9, 0.05, np.inf)
    right = np.where(x > 1.0 - 1e-9, 0.1, np.inf)
    return {Cause("left", 100): left, Cause("right", 101): right}


def test_each_cause_controls_what_is_nearer_to_it_and_the_middle_is_free():
    mesh = moved(structured_square(40, half_width=0.5), 0.5)
    request = Request.of(checked(SizeFunctionOptions, {"g": 0.5}))
    report = Bounds(mesh, two_bounds(mesh), (0.01, 0.2)).limited(request).report
    # 0.2 is reached 0.3 from the left and 0.2 from the right.
    assert report.domain_shares["left"] == pytest.approx(0.3, abs=0.03)
    assert report.domain_shares["right"] == pytest.approx(0.2, abs=0.03)
    assert report.domain_shares["hmax"] == pytest.approx(0.5, abs=0.03)
    assert report.smallest["left"] == 0.05
    assert report.smallest["right"] == 0.1
    # The integrals of h^-2: of (0.05 + 0.5 x)^-2 over 0.3, that is 2 (20 - 5), and so on.
    elements = np.array([2.0 * (20.0 - 5.0), 2.0 * (10.0 - 5.0), 0.5 / 0.2**2])
    shares = [report.element_shares[name] for name in ("left", "right", "hmax")]
    assert_allclose(shares, elements / elements.sum(), atol=0.03)


def test_shares_add_up_and_nodes_outside_have_no_cause():
    report = size_function(strip, background=GRID, hmax=0.2).report
    for shares in (report.domain_shares, report.element_shares):
        assert sum(shares.values()) == pytest.approx(1.0)
    phi = strip(GRID.points).reshape(GRID.shape)
    assert (report.cause[phi < -0.01] >= 0).all()
    assert (report.cause[phi > 0.011] == -1).all()  # half a pixel may count by parts
    assert set(report.bounds) == {"curvature", "width"}


# --- domains and backgrounds ------------------------------------------------------


def sphere_backgrounds():
    lower, upper = [-1.1] * 3, [1.1] * 3
    rule = refine_at_boundary(lambda x: np.linalg.norm(x, axis=1) - 1.0, spacing=0.15)
    yield "own", None
    yield "grid", CartesianGrid(lower, 0.1, (23, 23, 23))
    yield "octree", Octree.build(lower, upper, rule, max_level=4)


@pytest.mark.parametrize(("kind", "background"), list(sphere_backgrounds()))
def test_a_sphere_has_the_same_sizes_on_every_background(kind, background):
    sphere = random_sphere(1200, seed=3)
    size = size_function(
        sphere,
        background=background,
        elements_per_radian=4.0,
        elements_across=0.0,
        g=G,
        hmax=0.6,
        tolerance=np.inf,
    )
    report = size.report
    on_sphere = size(sphere.points)
    # Curvature of random triangulations to a few per cent; nodes beside the surface add g h.
    assert_allclose(np.median(on_sphere), 0.25, atol=0.02)
    assert report.domain_shares["curvature"] > 0.5
    if kind != "own":  # nodes up to a box beside the surface ask for as much as on it
        assert 0.5 - G * 0.3 < size([[0.0, 0.0, 0.0]])[0] < 0.51


def test_of_a_surface_the_copy_is_refined_and_each_bound_with_it():
    box = np.array([[x, y, z] for x in (0.0, 4.0) for y in (0.0, 4.0) for z in (0.0, 0.5)])
    from scipy.spatial import ConvexHull

    plate = SimplexMesh(box, ConvexHull(box).simplices)
    size = size_function(plate, elements_across=2.0, g=G, hmax=2.0)
    report = size.report
    assert size.background.n_points > 100
    assert report.cause.shape == size.values.shape
    assert all(bound.shape == size.values.shape for bound in report.bounds.values())
    assert report.domain_shares["width"] == pytest.approx(1.0)
    # From h on both sides sizes grow to the middle, 0.25 away: the integral of 1 / h is 2.
    assert np.median(size.values) == pytest.approx(G * 0.25 / np.expm1(0.5 * G * 2.0), rel=0.02)


# --- refused ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("domain", "options", "message"),
    [
        (disc, {}, "box must be given with a callable domain"),
        (disc, {"box": ([0.0], [1.0], [2.0])}, r"box must be a pair \(lower, upper\), got"),
        (disc, {"box": ([1, 1], [0, 0])}, "upper must be greater than lower"),
        (disc, {"box": ([2.0, 2.0], [3.0, 3.0])}, "zero|negative|boundary"),
        (
            disc,
            {"background": outline(circle(8))},
            "background must be a CartesianGrid or an Octree for a",
        ),
        (
            outline(circle(8)),
            {"background": Octree([0, 0, 0], [1, 1, 1], (1, 1, 1), [0])},
            "must be 2-D",
        ),
        ((GRID, GRID), {"background": Octree([0, 0], [1, 1], (1, 1), [0])}, "must be a Cartesian"),
        ((GRID, np.ones(GRID.shape)), {}, "negative at a node"),
        ((GRID, -np.ones(GRID.shape)), {}, "boundary in the background"),
        (np.ones((5, 5), bool), {"background": GRID}, "background must be None for an image"),
        (disc, {"background": GRID, "h0": np.ones(3)}, "h0 must have shape"),
    ],
)
def test_bad_arguments_are_one_clear_line(domain, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        size_function(domain, **options)
    assert "\n" not in str(caught.value)


def test_sources_may_come_from_a_generator():
    # Regression: the first of several passes used it up.
    once = (source for source in [PointSource([0.3, 0.1], 0.005)])
    options = {"elements_per_radian": 2.0, "elements_across": 1.0}
    size = size_function(
        lambda x: np.linalg.norm(x, axis=1) - 1.0,
        box=([-1.2] * 2, [1.2] * 2),
        sources=once,
        **options,
    )
    assert size([[0.3, 0.1]]) < 0.006


@pytest.mark.parametrize(
    "source",
    [
        PointSource([0.0, 0.0], 2e-3), CurveSource([[-0.5, 0.0], [0.5, 0.0]], 2e-3),
        BoundarySource(2e-3), RegionSource(1, 2e-3), BoxSource([-0.3, -0.3], [0.3, 0.3], 2e-3),
        BallSource([0.0, 0.0], 0.3, 2e-3),
    ],
)  # fmt: skip
def test_the_default_of_hmin_raises_no_prescribed_size(source):
    square = structured_square(8, half_width=1.0)
    tags = np.where(np.arange(square.n_cells) == 0, 1, 2)
    square = SimplexMesh(square.points, square.cells, cell_tags=tags)
    options = {"sources": source, "max_elements": np.inf}
    size = size_function(square, **options)
    assert size.values.min() == size.report.hmin == 2e-3 < 1e-3 * square.diameter
    assert size_function(square, hmin=0.01, **options).values.min() == 0.01


def test_a_folded_plane_mesh_is_refused_before_anything_is_computed(monkeypatch):
    square = CartesianGrid([0.0, 0.0], 0.25, (5, 5)).mesh
    points = square.points.copy()
    points[12] += [0.4, 0.0]
    folded = SimplexMesh(points, square.cells)
    monkeypatch.setattr(budget, "_searched", None)
    with pytest.raises(ValueError, match=r"mesh must not be folded: \d cells .* at \("):
        size_function(folded)
